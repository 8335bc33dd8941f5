// SPDX-License-Identifier: Apache-2.0
// Where one body lies as the other sees it, with the slack that covers all rounding (its bound:
// box_overlap.cpp).
#include <algorithm>
#include <cmath>

#include "nearmesh/core/geometry/detail/box_overlap.hpp"
#include "slack.hpp"

namespace nearmesh {
namespace {

constexpr double kPosedRounding = 1.7322;  ///< lattice cells, of both models; > 1.0001 sqrt(3)
constexpr double kInt32Magnitude = 0x1p33;

Mat3 multiply(const Mat3& m, const Mat3& n) {
  Mat3 out;
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t j = 0; j < 3; ++j)
      out[3 * i + j] = m[3 * i] * n[j] + m[3 * i + 1] * n[3 + j] + m[3 * i + 2] * n[6 + j];
  return out;
}

/// [3 i + l] = e_i . (column j x column k), (j, k, l) a cyclic turn of (0, 1, 2).
Mat3 cofactors(const Mat3& m) {
  Mat3 out;
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t l = 0; l < 3; ++l) {
      const std::size_t i1 = 3 * ((i + 1) % 3);
      const std::size_t i2 = 3 * ((i + 2) % 3);
      const std::size_t j = (l + 1) % 3;
      const std::size_t k = (l + 2) % 3;
      out[3 * i + l] = m[i1 + j] * m[i2 + k] - m[i1 + k] * m[i2 + j];
    }
  return out;
}

Mat3 inverse_of(const Mat3& m) {
  const Mat3 c = cofactors(m);
  const double det = m[0] * c[0] + m[3] * c[3] + m[6] * c[6];
  return {c[0] / det, c[3] / det, c[6] / det, c[1] / det, c[4] / det,
          c[7] / det, c[2] / det, c[5] / det, c[8] / det};
}

Mat3 absolute(const Mat3& m) {
  Mat3 out;
  for (std::size_t i = 0; i < 9; ++i) out[i] = std::abs(m[i]);
  return out;
}

/// A frame's rotation as doubles (exact integers below 2^31, scaled to order 1).
Mat3 unit_rotation(const PosedFrame& frame) {
  Mat3 out;
  for (std::size_t i = 0; i < 9; ++i) out[i] = static_cast<double>(frame.rotation[i]) * 0x1p-30;
  return out;
}

/// A lower bound of |m x| / |x|: |m x|^2 = |x|^2 + x (m^T m - I) x >= |x|^2 (1 - Frobenius norm).
double least_stretch(const Mat3& m) {
  double off = 0;
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t j = 0; j < 3; ++j) {
      const double g = m[i] * m[j] + m[3 + i] * m[3 + j] + m[6 + i] * m[6 + j] - (i == j ? 1 : 0);
      off += g * g;
    }
  return std::sqrt(1 - std::min(1.0, std::sqrt(off) + 0x1p-48)) * kGapShrink;
}

/// A relative frame but for its slack. offset: from A's grid origin to B's, in A's units, not
/// turned.
RelativeFrame relate(const Mat3& rotation_a, const Mat3& rotation_b, const Vec3& offset,
                     int exponent_a, int exponent_b) {
  const Mat3 inverse_a = inverse_of(rotation_a);
  const double scale = std::ldexp(1.0, exponent_b - exponent_a);
  RelativeFrame f;
  f.rotation = multiply(inverse_a, rotation_b);
  for (double& entry : f.rotation) entry *= scale;
  f.translation = turn(inverse_a, offset);
  f.inverse = inverse_of(f.rotation);
  f.abs_rotation = absolute(f.rotation);
  f.abs_inverse = absolute(f.inverse);
  f.abs_cofactor = absolute(cofactors(f.rotation));
  f.metres_per_unit = std::ldexp(1.0, exponent_a);
  f.least_metres_per_unit = f.metres_per_unit * least_stretch(rotation_a);
  f.least_metres_per_b_unit = std::ldexp(1.0, exponent_b) * least_stretch(rotation_b);
  return f;
}

/// M of the slack.
double magnitude_of(int exponent_a, int exponent_b, const Vec3& offset) {
  return std::abs(offset[0]) + std::abs(offset[1]) + std::abs(offset[2]) +
         kInt32Magnitude * (1 + std::ldexp(1.0, exponent_b - exponent_a));
}

}  // namespace

RelativeFrame make_relative_frame(const PosedFrame& a, const PosedFrame& b) {
  NEARMESH_ASSERT(a.lattice_exp == b.lattice_exp);
  const double cell = std::ldexp(1.0, a.lattice_exp - a.grid.exponent);
  Vec3 offset;
  for (std::size_t k = 0; k < 3; ++k)  // |translation| < 2^62 each: the difference fits
    offset[k] = (static_cast<double>(b.translation[k] - a.translation[k]) +
                 (beyond_translation(b, k) - beyond_translation(a, k))) *
                cell;
  RelativeFrame f =
      relate(unit_rotation(a), unit_rotation(b), offset, a.grid.exponent, b.grid.exponent);
  f.slack = kPosedRounding * cell +
            kDoubleRounding * magnitude_of(a.grid.exponent, b.grid.exponent, offset);
  return f;
}

RelativeFrame make_relative_frame(const Grid& grid_a, const Pose& pose_a, const Grid& grid_b,
                                  const Pose& pose_b) {
  const double unit_m = std::ldexp(1.0, grid_a.exponent);
  const Vec3 origin_a = turn(pose_a.rotation, grid_a.origin_m);
  const Vec3 origin_b = turn(pose_b.rotation, grid_b.origin_m);
  Vec3 offset;
  double terms = 0;  // what rounds before the difference is taken
  for (std::size_t k = 0; k < 3; ++k) {
    offset[k] =
        ((pose_b.translation_m[k] - pose_a.translation_m[k]) + (origin_b[k] - origin_a[k])) /
        unit_m;
    terms += 2 * (std::abs(grid_a.origin_m[k]) + std::abs(grid_b.origin_m[k])) +
             std::abs(pose_b.translation_m[k] - pose_a.translation_m[k]);
  }
  RelativeFrame f =
      relate(pose_a.rotation, pose_b.rotation, offset, grid_a.exponent, grid_b.exponent);
  f.slack =
      kDoubleRounding * (magnitude_of(grid_a.exponent, grid_b.exponent, offset) + terms / unit_m);
  return f;
}

std::array<double, 3> to_grid_units(const Grid& grid, const Pose& pose,
                                    const std::array<double, 3>& vector_world_m) {
  const Vec3 v = turn(inverse_of(pose.rotation), vector_world_m);
  const double unit_m = std::ldexp(1.0, grid.exponent);
  return {v[0] / unit_m, v[1] / unit_m, v[2] / unit_m};
}

bool balls_apart(const PosedFrame& frame_a, const GridBox& a, const PosedFrame& frame_b,
                 const GridBox& b) {
  NEARMESH_ASSERT(frame_a.lattice_exp == frame_b.lattice_exp);
  const CenteredBox box_a = centered(a), box_b = centered(b);
  const double scale_a = std::ldexp(1.0, -frame_a.shift), scale_b = std::ldexp(1.0, -frame_b.shift);
  // In lattice cells. Frames stretch by less than 1.0001; four cells are more than what corners and
  // origins round, and a grid unit of each, with 2^-40 of the way, more than what doubles do, here
  // and in boxes_apart.
  double way2 = 0, way1 = 0;
  for (std::size_t k = 0; k < 3; ++k) {
    double at_a = 0, at_b = 0;
    for (std::size_t i = 0; i < 3; ++i) {
      at_a += static_cast<double>(frame_a.rotation[3 * k + i]) * box_a.center[i];
      at_b += static_cast<double>(frame_b.rotation[3 * k + i]) * box_b.center[i];
    }
    const auto origins = static_cast<double>(frame_b.translation[k] - frame_a.translation[k]);
    const double way = origins + (at_b * scale_b - at_a * scale_a);
    way2 += way * way;
    way1 += std::abs(origins);
  }
  const auto radius = [](const CenteredBox& box, double scale) {
    return (std::sqrt(dot(box.half, box.half)) * 1.001 + 1) * 0x1p30 * scale;
  };
  const double room = radius(box_a, scale_a) + radius(box_b, scale_b) + 0x1p-40 * way1 + 4;
  return way2 > room * room;
}

}  // namespace nearmesh
