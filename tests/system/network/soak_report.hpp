// SPDX-License-Identifier: Apache-2.0
#pragma once
// What a soak found: kept while it runs, shown now and then, written at its end.

#include <string>
#include <vector>

#include "soak_peers.hpp"
#include "watch.hpp"

namespace nearmesh::test {

struct SoakCounts {
  std::uint64_t joined = 0, failed = 0;
  std::uint64_t ended[3] = {};  ///< as planned, by Ending
};

struct SoakSample {
  double seconds = 0;
  int present = 0;  ///< peers
  SoakCounts counts;
  std::uint64_t answers = 0, certified = 0, wrong = 0;  ///< checked so far
  Holding publisher, resident;  ///< resident: the mean of those that stay from start to end
  SharedFiles shared;
};

/// A line on standard error.
void show(const SoakSample& sample);

/// What memory did after the warm-up: five minutes, or a third of a shorter run.
struct Growth {
  std::string kind;            ///< whose and which
  double first = 0, last = 0;  ///< kB, means of the first and the last fifth
  Slope slope;                 ///< kB a minute
};
[[nodiscard]] std::vector<Growth> growth_of(const std::vector<SoakSample>& samples);

/// soak.csv, soak-memory.csv and soak-totals.csv. `end`: when all have gone. Throws
/// std::runtime_error.
void write_soak(const SoakOptions& options, const std::vector<SoakSample>& samples,
                const SoakSample& end, std::vector<double> joins_s, const Warnings& warnings);

}  // namespace nearmesh::test
