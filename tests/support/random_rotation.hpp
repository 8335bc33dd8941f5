// SPDX-License-Identifier: Apache-2.0
#pragma once
// Rotations for random poses, the same on every machine.

#include <array>
#include <cmath>

#include "core/base/random.hpp"

namespace nearmesh::test {

/// The rotation, row-major, of a quaternion (w, x, y, z) of the given length.
inline std::array<double, 9> rotation_of(const double (&q)[4], double length) {
  const double w = q[0] / length, x = q[1] / length, y = q[2] / length, z = q[3] / length;
  return {1 - 2 * (y * y + z * z), 2 * (x * y - z * w),     2 * (x * z + y * w),
          2 * (x * y + z * w),     1 - 2 * (x * x + z * z), 2 * (y * z - x * w),
          2 * (x * z - y * w),     2 * (y * z + x * w),     1 - 2 * (x * x + y * y)};
}

/// A rotation uniform over all rotations, row-major.
inline std::array<double, 9> random_rotation(Random& random) {
  double q[4], square = 0;
  do {
    square = 0;
    for (double& x : q) {
      x = random.between(-1, 1);
      square += x * x;
    }
  } while (square > 1 || square < 0.01);
  return rotation_of(q, std::sqrt(square));
}

}  // namespace nearmesh::test
