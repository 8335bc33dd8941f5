// SPDX-License-Identifier: Apache-2.0
#pragma once
// The time that an update has, and what its parts are expected to take.

#include <algorithm>
#include <cstdint>

#include "core/base/stopwatch.hpp"
#include "core/query/lacking_ahead.hpp"

namespace nearmesh::subscriber {

/// Runs from where it is made. Threads: any may look at it.
class FrameBudget {
 public:
  explicit FrameBudget(double seconds) : seconds_(seconds) {}
  [[nodiscard]] double seconds() const { return seconds_; }
  [[nodiscard]] double spent_s() const { return spent_.seconds(); }
  [[nodiscard]] double left_s() const { return seconds_ - spent_s(); }

 private:
  double seconds_;
  Stopwatch spent_;
};

/// So many tests of a look ahead fit. A look is no answer: it may end where time does, with what
/// matters soonest. Never so few that it sees nothing.
inline constexpr double kLeastTests = 2'000, kTest_s = 1e-7;
[[nodiscard]] inline std::uint64_t tests_within(double left_s, double test_s = kTest_s) {
  return static_cast<std::uint64_t>(
      std::clamp(left_s / test_s, kLeastTests, static_cast<double>(kLookTests)));
}

/// After so many updates without one there is a look ahead whatever time is left.
inline constexpr std::uint64_t kPatientLooks = 8;

/// What something took of late: a mean that falls slowly, and rises by the share that is given.
/// Where it must not be overrun, at once. What comes in some updates only falls more slowly.
class ExpectedCost {
 public:
  explicit ExpectedCost(double rise = 1, double fall = 1.0 / 8) : rise_(rise), fall_(fall) {}
  void add(double cost_s) { cost_s_ += (cost_s - cost_s_) * (cost_s > cost_s_ ? rise_ : fall_); }
  [[nodiscard]] double seconds() const { return cost_s_; }

 private:
  double rise_, fall_;
  double cost_s_ = 0;
};

}  // namespace nearmesh::subscriber
