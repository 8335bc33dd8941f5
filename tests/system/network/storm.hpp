// SPDX-License-Identifier: Apache-2.0
#pragma once
// Hostile packets against a whole exercise: a publisher, two peers that fly at each other, a
// recorder and the example simulator, on one host. Half of the packets are captured traffic with
// changes, half are built from the grammar of RTPS.

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "runs.hpp"
#include "tests/support/rtps_message.hpp"

namespace nearmesh::test {

struct StormOptions {
  std::uint64_t packets = 100'000;
  double packets_per_s = 2000;
  bool secured = false;
  std::uint64_t seed = 1;
  double deaf_s = 2;  ///< a stream on which nothing comes for so long counts as deaf
  /// What is sent first, some times to each port.
  std::vector<RtpsBytes> first;
};

struct StormResult {
  std::uint64_t sent = 0, captured = 0;
  std::vector<std::string> ended;  ///< programs that ended before they were told to
  std::vector<std::string> spins;  ///< threads that use more than half a core when all is over
  std::vector<std::string> deaf;   ///< streams on which nothing comes after the end, of all five
  double slowest_end_s = 0;        ///< from SIGINT to the end, of the slowest program
  std::uint64_t answers = 0, certified = 0,
                wrong = 0;     ///< of both peers, all against the full meshes
  double longest_pause_s = 0;  ///< without a certified answer, of the worse peer
  std::string complaint;       ///< what a program that ended said last
};

/// Throws std::runtime_error when the exercise does not even begin.
[[nodiscard]] StormResult weather_storm(const Exercise& exercise, const StormOptions& options);

}  // namespace nearmesh::test
