// SPDX-License-Identifier: Apache-2.0
#pragma once
// The larger measurements of nearmesh-network. Each writes one CSV file into a folder.

#include <cstdio>
#include <string>
#include <vector>

#include "runs.hpp"

namespace nearmesh::test {

struct MeasureOptions {
  std::string out;  ///< folder
  std::vector<double> mbit{0.25, 1, 10, 40};
  std::vector<double> loss{0, 0.01, 0.05, 0.1};
  int frames = 200;
  double seconds = 10;
  unsigned domain = 40;
  wire::Transport transport = wire::Transport::kLan;
  std::vector<int> programs;
  std::vector<int> light, together;
  double rate_hz = 2;
  std::vector<std::string> faults;  ///< by name; empty: all
  int rounds = 5;
  bool secured = false;  ///< faults: the bad peer is one of the authenticated
  std::vector<std::string> scenes{"terrain-grazing", "two-scans", "touching-flight"};  ///< cold
  std::vector<double> round_trips_s{0, 0.05};
};

/// For each rate and pose of the chart's terrain, both bodies streamed: seconds from the pose to
/// the first certified answer, headers being there, and bytes of the peer's interface meanwhile;
/// beside what the chart's clock says at no delay.
void measure_poses(const MeasureOptions& options);
/// For each of the chart's scenes, rate and round trip: peers that join where the bodies are in
/// contact already. Seconds from the match to the first certified answer; of a scene that moves,
/// how many of the first 100 frames at 100 Hz are certified.
void measure_cold_starts(const MeasureOptions& options);
/// Peers of one publisher, as programs of their own and as light peers: what they need and what the
/// publisher spends.
void measure_peers(const MeasureOptions& options, const Exercise& exercise);

/// Healthy peers fly on while one bad peer after the other comes and goes: faults.csv, times to
/// certified answers with and without each, side by side.
void measure_faults(const MeasureOptions& options, Exercise exercise);
/// The publisher killed and started again, and one of two that serve the same killed: restarts.csv,
/// and restarts-flight.csv of a flight meanwhile whose answers are checked.
void measure_restarts(const MeasureOptions& options, const Exercise& exercise);

}  // namespace nearmesh::test
