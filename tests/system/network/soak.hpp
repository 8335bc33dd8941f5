// SPDX-License-Identifier: Apache-2.0
#pragma once
// A long run: one publisher, peers that join, leave and crash at random on links with losses, and a
// few that stay. Every answer of every peer is checked against the full meshes, and what the
// programs hold is sampled all the while.

#include <cstdint>
#include <string>

#include "runs.hpp"

namespace nearmesh::test {

struct SoakOptions {
  std::string out;  ///< folder for the CSV
  double minutes = 30;
  std::uint64_t seed = 1;  ///< of who joins when, for how long, and how it ends
  int peers = 20;          ///< at most at a time; a fifth of them stays from start to end
  double loss = 0.02;      ///< of each peer's link, both directions
  double rate_hz = 5;      ///< frames a second
  /// "lan": each peer on a host of its own. "same-host": all on one, through shared memory, where
  /// links lose nothing.
  std::string transport = "lan";
};

/// Writes soak.csv (samples), soak-totals.csv and soak-memory.csv, and prints what it found. Throws
/// std::runtime_error.
/// Out: true when no answer was wrong, no program failed and no file of ours was left in shared
/// memory.
[[nodiscard]] bool soak(const SoakOptions& options, const Exercise& exercise);

}  // namespace nearmesh::test
