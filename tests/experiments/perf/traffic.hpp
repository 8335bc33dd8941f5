// SPDX-License-Identifier: Apache-2.0
#pragma once
// The traffic that the benches of many bodies fly.

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "core/base/random.hpp"
#include "nearmesh/core/geometry/motion.hpp"

namespace nearmesh::test {

inline constexpr double kSide_m = 100e3, kHeight_m = 3e3, kSpeed_mps = 200, kStep_s = 0.05;

/// Bodies that fly at up to 200 m/s over a square of 100 km, turn, and turn back at its edges. The
/// same draws from the same seed.
class Traffic {
 public:
  Traffic(std::uint64_t seed, std::size_t count) {
    Random random(seed);
    for (std::size_t i = 0; i < count; ++i) {
      Motion motion;
      motion.pose.translation_m = {random.between(0, kSide_m), random.between(0, kSide_m),
                                   random.between(0, kHeight_m)};
      const double course = random.between(0, 6.283), speed = random.between(0.5, 1) * kSpeed_mps;
      motion.linear_velocity_mps = {speed * std::cos(course), speed * std::sin(course),
                                    random.between(-20, 20)};
      motions.push_back(motion);
    }
  }
  void step() {
    ++steps_;
    for (std::size_t i = 0; i < motions.size(); ++i) {
      auto& [pose, v, w] = motions[i];
      const double turn = (static_cast<double>((i * 7 + steps_ / 100) % 5) - 2) * 0.02 * kStep_s;
      const double vx = v[0] - v[1] * turn, vy = v[1] + v[0] * turn;
      const double length = std::hypot(vx, vy) / std::hypot(v[0], v[1]);
      v[0] = vx / length;
      v[1] = vy / length;
      for (std::size_t k = 0; k < 3; ++k) {
        pose.translation_m[k] += v[k] * kStep_s;
        const double top = k == 2 ? kHeight_m : kSide_m;
        if ((pose.translation_m[k] < 0 && v[k] < 0) || (pose.translation_m[k] > top && v[k] > 0))
          v[k] = -v[k];
      }
    }
  }
  std::vector<Motion> motions;

 private:
  std::size_t steps_ = 0;
};

}  // namespace nearmesh::test
