// SPDX-License-Identifier: Apache-2.0
// Where a motion takes a body, and how exactly we know it.
//
// The error of pose_at. u = 2^-53, turn = |w dt|.
// 1. phi = w dt errs by u of each component: the angle by u turn.
// 2. phi is halved k times until |phi| <= 1/4, so 2^k <= max(1, 8 turn). The series of the
//    quaternion's cosine and sine are cut where the first term left out is below 2^-64; with
//    rounding the quaternion errs by less than 3u.
// 3. Each squaring doubles the error and adds less than 5u: after k of them it is below 8u 2^k.
// 4. A unit quaternion's error d turns into 4d of its matrix as an operator (2d, doubled by the
//    division by q.q, which removes any error of the length); computing the entries adds less than
//    10u, and the product with R0 less than 10u.
// Together below u (turn + 32 max(1, 8 turn) + 20) < u (64 + 320 turn).
#include "nearmesh/core/geometry/motion.hpp"

#include <algorithm>
#include <cmath>
#include <string>

#include "core/base/float_guard.hpp"
#include "motion_bounds.hpp"
#include "vec3.hpp"

namespace nearmesh {
namespace {

/// Covers the rounding of the few operations of a bound.
constexpr double kRoundUp = 1 + 0x1p-48;
/// The most by which a rotation that check_pose accepts stretches: |R^T R - I| <= 1e-5 an entry,
/// and rounding.
constexpr double kStretch = 1.0001;

/// exp([phi]), row-major.
std::array<double, 9> turn_by(const Vec3& phi) {
  double square = dot(phi, phi);
  double scale = 1;
  int halvings = 0;
  for (; square > 0x1p-4; ++halvings) {  // at most 22 times: |phi| <= 2^20
    square *= 0.25;
    scale *= 0.5;
  }
  const double x = square / 4;  // of half the angle; at most 2^-6
  double w = 1 + x * (-1.0 / 2 +
                      x * (1.0 / 24 + x * (-1.0 / 720 + x * (1.0 / 40320 - x * (1.0 / 3628800)))));
  const double sine =
      1 + x * (-1.0 / 6 +
               x * (1.0 / 120 + x * (-1.0 / 5040 + x * (1.0 / 362880 - x * (1.0 / 39916800)))));
  Vec3 v;
  for (std::size_t k = 0; k < 3; ++k) v[k] = 0.5 * scale * phi[k] * sine;
  for (; halvings > 0; --halvings) {
    const double doubled = 2 * w;
    w = w * w - dot(v, v);
    for (double& c : v) c *= doubled;
  }
  const double n = 2 / (w * w + dot(v, v));
  const auto [a, b, c] = v;
  return {1 - n * (b * b + c * c), n * (a * b - c * w),     n * (a * c + b * w),
          n * (a * b + c * w),     1 - n * (a * a + c * c), n * (b * c - a * w),
          n * (a * c - b * w),     n * (b * c + a * w),     1 - n * (a * a + b * b)};
}

/// Of at most half a turn, from its sine and cosine times any number above 0. By square roots
/// alone, which are the same on every platform.
double angle_of(double sine, double cosine) {
  constexpr int kHalvings = 9;
  for (int i = 0; i < kHalvings; ++i) {
    const double length = std::sqrt(sine * sine + cosine * cosine);
    const double s = sine / length, c = cosine / length;
    // Both are the tangent of the half; one of them does not cancel.
    sine = c < 0 ? 1 - c : s;
    cosine = c < 0 ? s : 1 + c;
  }
  const double t = sine / cosine, square = t * t;
  return std::ldexp(t * (1 - square * (1.0 / 3 - square * (1.0 / 5 - square / 7))), kHalvings);
}

/// The axis of a rotation times its angle, at most half a turn.
Vec3 axis_angle(const std::array<double, 9>& r) {
  // r - r^T is the axis times twice the angle's sine, the trace of r 1 + 2 cosine.
  Vec3 axis{r[7] - r[5], r[2] - r[6], r[3] - r[1]};
  const double twice_sine = std::sqrt(dot(axis, axis)), twice_cosine = r[0] + r[4] + r[8] - 1;
  if (twice_sine == 0 && twice_cosine >= 0) return {};
  const double angle = angle_of(twice_sine, twice_cosine);
  double length = twice_sine;
  if (twice_cosine < 0) {
    // Near half a turn the sine says little: r + r^T - 2 cosine is the axis times the axis, times a
    // number, so each of its columns is along the axis.
    Vec3 along;
    double longest = -1;
    for (std::size_t k = 0; k < 3; ++k) {
      Vec3 column;
      for (std::size_t i = 0; i < 3; ++i)
        column[i] = r[3 * i + k] + r[3 * k + i] - (i == k ? twice_cosine : 0);
      if (const double square = dot(column, column); square > longest) {
        longest = square;
        along = column;
      }
    }
    const double sign = dot(along, axis) < 0 ? -1 : 1;
    for (double& x : along) x *= sign;
    axis = along;
    length = std::sqrt(longest);
  }
  for (double& x : axis) x *= angle / length;
  return axis;
}

}  // namespace

Motion motion_between(const Pose& from, const Pose& to, double dt_s) {
  const FloatGuard guard;
  Motion motion{.pose = from};
  std::array<double, 9> turn{};  // to * from^T
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t j = 0; j < 3; ++j)
      for (std::size_t k = 0; k < 3; ++k)
        turn[3 * i + j] += to.rotation[3 * i + k] * from.rotation[3 * j + k];
  const Vec3 phi = axis_angle(turn);
  for (std::size_t k = 0; k < 3; ++k) {
    motion.linear_velocity_mps[k] = (to.translation_m[k] - from.translation_m[k]) / dt_s;
    motion.angular_velocity_radps[k] = phi[k] / dt_s;
  }
  return motion;
}

Pose pose_at(const Motion& motion, double dt_s) {
  const FloatGuard guard;
  Pose pose = motion.pose;
  if (dt_s == 0) return pose;
  for (std::size_t k = 0; k < 3; ++k) pose.translation_m[k] += motion.linear_velocity_mps[k] * dt_s;
  Vec3 phi;
  for (std::size_t k = 0; k < 3; ++k) phi[k] = motion.angular_velocity_radps[k] * dt_s;
  if (phi == Vec3{}) return pose;
  NEARMESH_ASSERT(dot(phi, phi) <= kMaxTurnRad * kMaxTurnRad * kRoundUp);
  const std::array<double, 9> turn = turn_by(phi);
  const std::array<double, 9>& from = motion.pose.rotation;
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t j = 0; j < 3; ++j)
      pose.rotation[3 * i + j] =
          turn[3 * i] * from[j] + turn[3 * i + 1] * from[3 + j] + turn[3 * i + 2] * from[6 + j];
  return pose;
}

// Of what is 2^512 m far the square is infinite: then the sum, which is no less.
double length_bound(const Vec3& v) {
  const double square = dot(v, v);
  if (!std::isfinite(square)) return (std::abs(v[0]) + std::abs(v[1]) + std::abs(v[2])) * kRoundUp;
  return std::sqrt(square) * kRoundUp;
}

double reach_m(const Grid& grid, const GridBox& box) {
  Vec3 farthest;
  // Once: sweeps ask this of each pair of nodes.
  const double cell_m = std::ldexp(1.0, grid.exponent);
  for (int k = 0; k < 3; ++k) {
    const auto axis = static_cast<std::size_t>(k);
    const double lo = grid.origin_m[axis] + box.lo[k] * cell_m;
    const double hi = grid.origin_m[axis] + box.hi[k] * cell_m;
    farthest[axis] = std::max(std::abs(lo), std::abs(hi));
  }
  return length_bound(farthest) * kRoundUp;
}

double speed_bound_mps(const Motion& motion, double reach) {
  const double turn_rate = length_bound(motion.angular_velocity_radps);
  // An infinite reach, without a turn, is no speed.
  const double turning_mps = turn_rate > 0 ? turn_rate * reach * kStretch : 0;
  return (length_bound(motion.linear_velocity_mps) + turning_mps) * kRoundUp;
}

double placing_error_m(const Motion& motion, double reach, double duration_s) {
  const double turn = length_bound(motion.angular_velocity_radps) * duration_s;
  return (pose_rotation_error(turn) * reach * kStretch +
          0x1p-50 * (length_bound(motion.pose.translation_m) +
                     length_bound(motion.linear_velocity_mps) * duration_s)) *
         kRoundUp;
}

// pose_at's error; each entry of the fixed-point rotation rounded by 2^-31, which the grid's part
// of the point feels (an operator of at most 3 * 2^-31); the grid's origin turned in doubles; its
// place and then the vertex rounded to lattice points, sqrt(3)/2 of a cell each. Of a model that
// shares a lattice it is the lattice's origin that is turned in doubles and rounded, and all from
// there to the point that the fixed-point rotation feels; the grid's own place is rounded with the
// vertex, once.
double posing_error_m(const Motion& motion, double reach, double duration_s, const Grid& grid,
                      int lattice_exp) {
  const double origin = length_bound(grid.lattice_origin_m());
  return (placing_error_m(motion, reach, duration_s) + 3.01 * 0x1p-31 * (reach + origin) +
          0x1p-49 * (origin + length_bound(motion.pose.translation_m)) +
          1.7322 * std::ldexp(1.0, lattice_exp)) *
         kRoundUp;
}

}  // namespace nearmesh
