// SPDX-License-Identifier: Apache-2.0
#include "wait_for_recorder.hpp"

#include <spdlog/spdlog.h>

#include <chrono>
#include <string>
#include <thread>

#include "core/base/stopwatch.hpp"

namespace nearmesh::subscriber::program {
namespace {

constexpr auto kPause = std::chrono::milliseconds(50);

}  // namespace

Status wait_for_recorder(const DdsChannel& channel, const RunOptions& options) {
  const double limit_s = *options.wait_recorder_s;
  const wire::TransportOptions& transport = options.channel.transport;
  const std::string where =
      "domain " + std::to_string(transport.domain) + ", topics " + transport.prefix + "/*";
  if (!channel.has_recorder())
    spdlog::info("waiting for a recorder: nearmesh-subscriber record on {}; Ctrl-C ends", where);
  const Stopwatch clock;
  while (!channel.has_recorder() && stop_requested == 0) {
    if (limit_s > 0 && clock.seconds() > limit_s)
      return {StatusCode::kNotFound, "no recorder came within " + std::to_string(limit_s) +
                                         " s: start nearmesh-subscriber record on " + where +
                                         ", or leave out --wait-recorder"};
    std::this_thread::sleep_for(kPause);
  }
  return Status::ok();
}

}  // namespace nearmesh::subscriber::program
