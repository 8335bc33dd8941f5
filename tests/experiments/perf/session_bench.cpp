// SPDX-License-Identifier: Apache-2.0
// A session without DDS, faster than real time, recorded as the recorder does; what that costs, and
// what reading it takes. With its defaults and -o it records the golden session of the tests
// (tests/system/sessions/make_golden.py).
//   nearmesh-bench-session --peers 10 --seconds 3600 --rate 20 --terrain 128 --commit-ms 10 -o
//   hour.db3

#include <CLI/CLI.hpp>
#include <cstdio>
#include <cstdlib>
#include <filesystem>

#include "core/base/hash.hpp"
#include "core/base/resources.hpp"
#include "subscriber/recorded/verify.hpp"
#include "taped_session.hpp"

using namespace nearmesh;

namespace {

double seconds_of(const std::string& command) {
  const Stopwatch watch;
  return std::system(command.c_str()) == 0 ? watch.seconds() : -1;
}

int fail(const Status& status) {
  std::fprintf(stderr, "nearmesh-bench-session: %s\n", status.message().c_str());
  return 1;
}

}  // namespace

int main(int argc, char** argv) {
  test::SessionPlan plan;
  std::string path;
  double commit_ms = plan.commit_period_s * 1e3;
  CLI::App app{"Records a simulated session and measures it"};
  app.add_option("--peers", plan.peers, "Peers, an aircraft each")
      ->capture_default_str()
      ->check(CLI::Range(1, 100));
  app.add_option("--seconds", plan.seconds, "Simulated time")->capture_default_str();
  app.add_option("--rate", plan.rate_hz, "Frames a second")->capture_default_str();
  app.add_option("--terrain", plan.terrain_size, "Squares along a side of the terrain")
      ->capture_default_str();
  app.add_option("--aircraft", plan.aircraft_faces, "Faces of an aircraft")->capture_default_str();
  app.add_option("--commit-ms", commit_ms,
                 "Time between commits, in real time: divide the recorder's 500 by how much faster "
                 "than real time the run is")
      ->capture_default_str();
  app.add_option("-o,--output", path, "File to create")->required();
  CLI11_PARSE(app, argc, argv);
  plan.commit_period_s = commit_ms / 1e3;

  const Stopwatch watch;
  const Result<test::SessionFigures> recorded = test::record_session(plan, path);
  if (!recorded.is_ok()) return fail(recorded.status());
  const test::SessionFigures& figures = recorded.value();
  const double run_s = watch.seconds();
  const auto count = [](std::uint64_t n) { return static_cast<unsigned long long>(n); };
  std::printf(
      "session: %u peers, %g s at %g Hz, simulated in %.1f s; %llu answers, %.2f %% "
      "certified within their frame\n",
      plan.peers, plan.seconds, plan.rate_hz, run_s, count(figures.answers),
      100 * static_cast<double>(figures.certified) /
          static_cast<double>(std::max<std::uint64_t>(1, figures.answers)));
  const auto bytes = std::filesystem::file_size(path);
  std::printf("file: %.1f MB, %llu messages, %.0f bytes a message\n",
              static_cast<double>(bytes) / 1e6, count(figures.messages),
              static_cast<double>(bytes) / static_cast<double>(figures.messages));
  std::printf("recording: %.2f us a message; %.2f %% of a core in real time\n",
              figures.append_s * 1e6 / static_cast<double>(figures.messages),
              100 * figures.append_s / plan.seconds);
  const std::string subscriber =
      (std::filesystem::read_symlink("/proc/self/exe").parent_path() / "nearmesh-subscriber")
          .string();
  std::printf("info: %.2f s\n", seconds_of("'" + subscriber + "' info '" + path + "' >/dev/null"));
  for (const unsigned threads : {1U, 2U}) {
    auto reader = RecordingReader::open(path);
    if (!reader.is_ok()) return fail(reader.status());
    const Stopwatch clock;
    const auto report = subscriber::verify(*reader.value(), {.threads = threads});
    if (!report.is_ok()) return fail(report.status());
    std::printf(
        "verify, %u thread%s: %.2f s, %llu of %llu reports verified, %llu different, "
        "digest %s\n",
        threads, threads == 1 ? "" : "s", clock.seconds(), count(report.value().verified),
        count(report.value().reports), count(report.value().different),
        to_hex(report.value().digest).c_str());
  }
  std::printf("peak memory: %.0f MB\n", static_cast<double>(peak_memory_bytes()) / 1e6);
  return 0;
}
