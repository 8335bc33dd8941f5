// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <optional>

#include "core/base/stopwatch.hpp"

namespace nearmesh::subscriber::program {

/// The exercise's clock. Nobody keeps it: it runs with each peer's own, and who hears a later time
/// goes on from there. So it is the latest of all, less what a pose takes on its way, and none is
/// ever set back. Who moves nothing has no time of its own, and waits for the first that it hears:
/// the exercise may begin, or be played, long after it.
class ExerciseClock {
 public:
  explicit ExerciseClock(bool moves_bodies) : runs_(moves_bodies) {}
  [[nodiscard]] double now_s() const { return runs_ ? ahead_s_ + clock_.seconds() : 0; }
  void follow(std::optional<double> heard_s) {
    if (!heard_s) return;
    const double ahead_s = *heard_s - clock_.seconds();
    ahead_s_ = runs_ ? std::max(ahead_s_, ahead_s) : ahead_s;
    runs_ = true;
  }

 private:
  const Stopwatch clock_{};
  double ahead_s_ = 0;
  bool runs_;
};

}  // namespace nearmesh::subscriber::program
