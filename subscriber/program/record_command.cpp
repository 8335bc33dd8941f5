// SPDX-License-Identifier: Apache-2.0
// nearmesh-subscriber record: a live session into a file, until Ctrl-C.
#include <spdlog/spdlog.h>
#include <unistd.h>

#include <memory>
#include <thread>

#include "commands.hpp"
#include "core/base/counted.hpp"
#include "core/base/stopwatch.hpp"
#include "idl/program/logging.hpp"
#include "nearmesh/idl/messages/topics.hpp"
#include "subscriber/dds/dds_recorder.hpp"

namespace nearmesh::subscriber::program {
namespace {

void show(const char* end, const RecorderStats& stats, double seconds) {
  const auto count = [](std::uint64_t n) { return static_cast<unsigned long long>(n); };
  std::fprintf(stderr,
               "%s%.0f s: %s, %.1f MB of %s, %s, %llu sent before, %llu lost, %llu dropped%s",
               *end == '\n' ? "" : "\r", seconds, counted(stats.messages, "sample").c_str(),
               static_cast<double>(stats.bytes) / 1e6, counted(stats.writers, "writer").c_str(),
               counted(stats.parts, "file").c_str(), count(stats.before), count(stats.lost),
               count(stats.dropped), end);
}

}  // namespace

Outcome run(const RecorderOptions& options) {
  wire::program::log_fastdds();
  wire::program::log_network(options.transport);
  Result<std::unique_ptr<DdsRecorder>> created = DdsRecorder::create(options);
  NEARMESH_RETURN_IF_ERROR(created);
  DdsRecorder& recorder = *created.value();
  spdlog::info("recording domain {}, topics {}/*, into {}", options.transport.domain,
               options.transport.prefix, options.path);
  const bool terminal = ::isatty(STDERR_FILENO) != 0;
  const Stopwatch clock;
  double shown_s = 0;
  std::uint64_t warned = 0;
  for (bool ended = false; !ended && stop_requested == 0;) {
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
    for (const std::string& line : recorder.take_complaints())
      wire::program::log("record").warn("{}", line);
    const RecorderStats stats = recorder.stats();
    ended = stats.ended || !stats.identity.is_ok();
    // On a terminal one line that is renewed; in a log now and then, and at once when something is
    // missing.
    const bool missed = stats.lost + stats.dropped > warned;
    if (clock.seconds() - shown_s < (terminal ? 0.5 : missed ? 1 : 10)) continue;
    shown_s = clock.seconds();
    warned = stats.lost + stats.dropped;
    show(terminal ? " " : "\n", stats, shown_s);
  }
  const bool at_limit = recorder.stats().ended;
  const Status identity = recorder.stats().identity;
  const Status status = recorder.finish();
  if (terminal) std::fprintf(stderr, "\n");
  show("\n", recorder.stats(), clock.seconds());
  NEARMESH_RETURN_IF_ERROR(status);
  if (!identity.is_ok()) return {identity, wire::program::kIdentityEnded};
  if (at_limit) spdlog::info("ended: {} has reached its size", options.path);
  return Status::ok();
}

}  // namespace nearmesh::subscriber::program
