// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <csignal>
#include <optional>
#include <stdexcept>

#include "flyers.hpp"
#include "measures.hpp"

namespace nearmesh::test {
namespace {

constexpr double kLeaveTime_s = 4;  // more than the lease, until nothing is left of a bad peer

/// A kind of nearmesh-network-mean-peer, or what is done to one.
struct Fault {
  const char* name;
  const char* kind;    // nullptr: nobody comes
  double rate_hz = 0;  // of its messages
  int signal = 0;      // sent to it when the time begins
};
constexpr Fault kFaults[] = {{"nobody", nullptr},
                             {"frozen", "everything", 0, SIGSTOP},
                             {"killed", "everything", 0, SIGKILL},
                             {"slow", "slow"},
                             {"everything", "everything"},
                             {"flood", "flood", 1000},
                             {"flood-large", "flood-large", 1000},
                             {"nowhere", "nowhere", 1000},
                             {"certificates", "certificates", 1000},
                             {"holder", "holder", 1000},
                             {"thief", "thief", 300},
                             {"inventor", "inventor", 300}};

/// Seconds, of the frames that had to wait for something.
struct Times {
  std::vector<double> waits_s;
  std::uint64_t frames = 0, certified = 0;

  void add(const std::vector<Flyers::Answer>& answers) {
    for (const Flyers::Answer& answer : answers) {
      ++frames;
      certified += answer.certified ? 1 : 0;
      if (answer.waited) waits_s.push_back(answer.certified_s - answer.asked_s);
    }
  }
  [[nodiscard]] double quantile(double share) {
    if (waits_s.empty()) return 0;
    std::sort(waits_s.begin(), waits_s.end());
    const auto last = static_cast<double>(waits_s.size() - 1);
    return waits_s[static_cast<std::size_t>(share * last + 0.5)];
  }
};

class Trial {
 public:
  Trial(const MeasureOptions& options, const Exercise& exercise)
      : options_(options), exercise_(exercise), airspace_(exercise) {
    pause(5);
    static_cast<void>(airspace_.flyers->take_answers());
    out_ = open_csv(options.out + "/faults.csv");
    std::fprintf(out_,
                 "kind,round,quiet_frames,quiet_certified,quiet_waited,quiet_p50_s,quiet_p99_s,"
                 "frames,certified,waited,p50_s,p99_s,publisher_cpu,quiet_publisher_cpu,"
                 "publisher_memory,publisher_lines\n");
  }
  ~Trial() { std::fclose(out_); }

  void measure(const Fault& fault) {
    Times all_quiet, all;
    for (int round = 1; round <= options_.rounds; ++round) {
      Times quiet, with;
      const Spent before = spent_by(*airspace_.publisher);
      quiet.add(fly());
      std::unique_ptr<Process> bad = start(fault);
      const std::size_t lines = lines_of(airspace_.publisher->err()).size();
      const Spent middle = spent_by(*airspace_.publisher);
      with.add(fly());
      const Spent after = spent_by(*airspace_.publisher);
      write(fault, round, quiet, with, (after.cpu_s - middle.cpu_s) / options_.seconds,
            (middle.cpu_s - before.cpu_s) / options_.seconds, after.memory_bytes,
            lines_of(airspace_.publisher->err()).size() - lines);
      for (auto& [sum, part] : {std::pair(&all_quiet, &quiet), std::pair(&all, &with)}) {
        sum->waits_s.insert(sum->waits_s.end(), part->waits_s.begin(), part->waits_s.end());
        sum->frames += part->frames;
        sum->certified += part->certified;
      }
      bad.reset();
      if (fault.kind != nullptr) pause(kLeaveTime_s);
      static_cast<void>(airspace_.flyers->take_answers());
      if (airspace_.publisher->is_over())
        throw std::runtime_error("the publisher died: " + airspace_.publisher->err());
    }
    write(fault, 0, all_quiet, all, 0, 0, 0, 0);
    std::fprintf(stderr, "%s: p99 %.1f ms, without %.1f ms\n", fault.name, 1e3 * all.quantile(0.99),
                 1e3 * all_quiet.quantile(0.99));
  }

 private:
  [[nodiscard]] std::vector<Flyers::Answer> fly() {
    static_cast<void>(airspace_.flyers->take_answers());
    pause(options_.seconds);
    return airspace_.flyers->take_answers();
  }
  [[nodiscard]] std::unique_ptr<Process> start(const Fault& fault) {
    if (fault.kind == nullptr) return nullptr;
    const Lan::Visit visit = airspace_.lan.visit(2);
    std::vector<std::string> words{fault.kind, "--rate", std::to_string(fault.rate_hz), "--domain",
                                   std::to_string(exercise_.domain)};
    if (!exercise_.security.empty())
      words.insert(words.end(), {"--security", exercise_.security + "/mallory"});
    auto bad = std::make_unique<Process>(airspace_.folder, "nearmesh-network-mean-peer", words);
    if (!await([&] { return bad->is_over() || bad->out().starts_with("ready"); }) || bad->is_over())
      throw std::runtime_error("no bad peer: " + bad->err());
    pause(1);  // it is served, and what its joining costs is over
    if (fault.signal != 0) bad->signal(fault.signal);
    return bad;
  }
  /// Round 0: all of them together.
  void write(const Fault& fault, int round, Times& quiet, Times& with, double cpu, double quiet_cpu,
             std::uint64_t memory, std::size_t lines) {
    const auto count = [](std::uint64_t n) { return static_cast<unsigned long long>(n); };
    std::fprintf(out_, "%s,%d,%llu,%llu,%zu,%.5f,%.5f,%llu,%llu,%zu,%.5f,%.5f,%.3f,%.3f,%llu,%zu\n",
                 fault.name, round, count(quiet.frames), count(quiet.certified),
                 quiet.waits_s.size(), quiet.quantile(0.5), quiet.quantile(0.99),
                 count(with.frames), count(with.certified), with.waits_s.size(), with.quantile(0.5),
                 with.quantile(0.99), cpu, quiet_cpu, count(memory), lines);
    std::fflush(out_);
  }

  const MeasureOptions& options_;
  const Exercise& exercise_;
  Airspace airspace_;
  std::FILE* out_ = nullptr;
};

}  // namespace

void measure_faults(const MeasureOptions& options, Exercise exercise) {
  const Folder folder;
  if (options.secured) {
    exercise.security = folder.file("set");
    std::string err;
    if (run(folder, "nearmesh-publisher",
            {"make-security", exercise.security, "--publisher", "serve", "--subscriber", "alice",
             "mallory", "--domain", std::to_string(exercise.domain)},
            nullptr, &err) != 0)
      throw std::runtime_error("no identities: " + err);
  }
  Trial trial(options, exercise);
  for (const Fault& fault : kFaults)
    if (options.faults.empty() ||
        std::find(options.faults.begin(), options.faults.end(), fault.name) != options.faults.end())
      trial.measure(fault);
}

}  // namespace nearmesh::test
