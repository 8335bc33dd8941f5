// SPDX-License-Identifier: Apache-2.0
#pragma once
// What relative frames and the tests of separation share. Where the numbers come from:
// box_overlap.cpp.

#include "vec3.hpp"

namespace nearmesh {

using Mat3 = std::array<double, 9>;

inline constexpr double kDoubleRounding = 0x1p-46;
/// Covers the rounding of the last few operations of a gap.
inline constexpr double kGapShrink = 1 - 0x1p-40;

inline Vec3 turn(const Mat3& m, const Vec3& v) {
  return {m[0] * v[0] + m[1] * v[1] + m[2] * v[2], m[3] * v[0] + m[4] * v[1] + m[5] * v[2],
          m[6] * v[0] + m[7] * v[1] + m[8] * v[2]};
}

}  // namespace nearmesh
