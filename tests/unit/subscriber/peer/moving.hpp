// SPDX-License-Identifier: Apache-2.0
#pragma once
// A body in motion, a while later.

#include <cmath>

#include "core/ask/predict.hpp"

namespace nearmesh::test {

using Vector3 = std::array<double, 3>;

/// Rotation by |w| * t about w.
inline std::array<double, 9> turn(const Vector3& w, double t) {
  const double rate = std::hypot(w[0], w[1], w[2]);
  if (rate == 0) return {1, 0, 0, 0, 1, 0, 0, 0, 1};
  const double c = std::cos(rate * t), s = std::sin(rate * t);
  const double x = w[0] / rate, y = w[1] / rate, z = w[2] / rate, d = 1 - c;
  return {c + x * x * d,     x * y * d - z * s, x * z * d + y * s, y * x * d + z * s, c + y * y * d,
          y * z * d - x * s, z * x * d - y * s, z * y * d + x * s, c + z * z * d};
}

/// The pose `t` seconds later at constant velocities.
inline Pose moved(const Motion& motion, double t) {
  Pose pose;
  const std::array<double, 9> r = turn(motion.angular_velocity_radps, t);
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t j = 0; j < 3; ++j) {
      pose.rotation[3 * i + j] = 0;
      for (std::size_t k = 0; k < 3; ++k)
        pose.rotation[3 * i + j] += r[3 * i + k] * motion.pose.rotation[3 * k + j];
    }
  for (std::size_t k = 0; k < 3; ++k)
    pose.translation_m[k] = motion.pose.translation_m[k] + motion.linear_velocity_mps[k] * t;
  return pose;
}

}  // namespace nearmesh::test
