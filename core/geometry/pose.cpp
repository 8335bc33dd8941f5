// SPDX-License-Identifier: Apache-2.0
// The fixed-point pose rule and the guards of poses and motions at the boundary.
#include "nearmesh/core/geometry/pose.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>

#include "core/base/float_guard.hpp"
#include "nearmesh/core/geometry/motion.hpp"

namespace nearmesh {
namespace {

constexpr double kMaxTranslationM = 1e9;
constexpr double kMaxSpeed = 1e9;
constexpr double kOrthonormalTolerance = 1e-5;
constexpr double kQuaternionTolerance = 1e-3;
constexpr double kMaxTranslationCells = 0x1p62;
constexpr int kMaxSpanBits = 38;  ///< a posed model spans at most 2^38 lattice cells per axis
constexpr int kSubBits = 2;       ///< the lattice divides the finer cell by 2^2
constexpr int kRotationBits = 30;
constexpr int kMaxFinerBits = 100;       ///< of a model's cell than the lattice's
constexpr int kMaxFinerSharedBits = 31;  ///< where it keeps a remainder, which then is below 2^61

Status refuse(std::string_view body, const std::string& what) {
  return {StatusCode::kInvalidArgument, "pose of " + std::string(body) + ": " + what};
}

/// Short decimal form; std::to_string prints 1e308 with 309 digits.
std::string number(double x) {
  char text[32];
  std::snprintf(text, sizeof text, "%.9g", x);
  return text;
}

double column_dot(const std::array<double, 9>& r, std::size_t i, std::size_t j) {
  return r[i] * r[j] + r[3 + i] * r[3 + j] + r[6 + i] * r[6 + j];
}

double determinant(const std::array<double, 9>& r) {
  return r[0] * (r[4] * r[8] - r[5] * r[7]) - r[1] * (r[3] * r[8] - r[5] * r[6]) +
         r[2] * (r[3] * r[7] - r[4] * r[6]);
}

}  // namespace

Status check_pose(const Pose& pose, std::string_view body) {
  const FloatGuard guard;
  for (std::size_t i = 0; i < 9; ++i)
    if (!std::isfinite(pose.rotation[i]))
      return refuse(body, "rotation[" + std::to_string(i) + "] is " + number(pose.rotation[i]) +
                              ", expected a finite number");
  for (std::size_t i = 0; i < 3; ++i)
    if (!(std::abs(pose.translation_m[i]) <= kMaxTranslationM))
      return refuse(body, "translation_m[" + std::to_string(i) + "] is " +
                              number(pose.translation_m[i]) +
                              ", expected a finite number within 1e9 m");
  const auto& t = pose.translation_m;
  if (!(t[0] * t[0] + t[1] * t[1] + t[2] * t[2] <= kMaxTranslationM * kMaxTranslationM))
    return refuse(body, "translation_m is " +
                            number(std::sqrt(t[0] * t[0] + t[1] * t[1] + t[2] * t[2])) +
                            " m long, expected at most 1e9");
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t j = i; j < 3; ++j) {
      const double dot = column_dot(pose.rotation, i, j);
      // Written so that an overflow to infinity or NaN is refused as well.
      if (!(std::abs(dot - (i == j ? 1.0 : 0.0)) <= kOrthonormalTolerance))
        return refuse(body, "rotation is not orthonormal: columns " + std::to_string(i) + " and " +
                                std::to_string(j) + " have the product " + number(dot) +
                                ", expected " + (i == j ? "1" : "0") + " within 1e-5");
    }
  if (!(determinant(pose.rotation) > 0))
    return refuse(body, "rotation is a reflection: its determinant is negative, expected 1");
  return Status::ok();
}

Result<std::array<double, 9>> rotation_of_quaternion(const std::array<double, 4>& wxyz,
                                                     std::string_view body) {
  const FloatGuard guard;
  const double length =
      std::sqrt(wxyz[0] * wxyz[0] + wxyz[1] * wxyz[1] + wxyz[2] * wxyz[2] + wxyz[3] * wxyz[3]);
  if (!(std::abs(length - 1) <= kQuaternionTolerance))
    return refuse(body, "quaternion: its length is " + number(length) +
                            ", expected 1 within 1e-3 (w, x, y, z)");
  const double w = wxyz[0] / length, x = wxyz[1] / length, y = wxyz[2] / length,
               z = wxyz[3] / length;
  return std::array<double, 9>{
      1 - 2 * (y * y + z * z), 2 * (x * y - z * w),     2 * (x * z + y * w),
      2 * (x * y + z * w),     1 - 2 * (x * x + z * z), 2 * (y * z - x * w),
      2 * (x * z - y * w),     2 * (y * z + x * w),     1 - 2 * (x * x + y * y)};
}

// The greatest of the four is found first, so that nothing small is divided by.
std::array<double, 4> quaternion_of_rotation(const std::array<double, 9>& r) {
  const FloatGuard guard;
  std::array<double, 4> squares{1 + r[0] + r[4] + r[8], 1 + r[0] - r[4] - r[8],
                                1 - r[0] + r[4] - r[8], 1 - r[0] - r[4] + r[8]};
  std::size_t most = 0;
  for (std::size_t i = 1; i < 4; ++i)
    if (squares[i] > squares[most]) most = i;
  const double x = r[7] - r[5], y = r[2] - r[6], z = r[3] - r[1], xy = r[1] + r[3],
               xz = r[2] + r[6], yz = r[5] + r[7];
  std::array<double, 4> q = most == 0   ? std::array{squares[0], x, y, z}
                            : most == 1 ? std::array{x, squares[1], xy, xz}
                            : most == 2 ? std::array{y, xy, squares[2], yz}
                                        : std::array{z, xz, yz, squares[3]};
  const double length = 2 * std::sqrt(squares[most]) * (q[0] < 0 ? -1 : 1);
  for (double& part : q) part = length != 0 ? part / length : 0;
  return q;
}

Pose orthonormal(const Pose& pose) {
  const FloatGuard guard;
  constexpr double kGoodEnough = 0x1p-40;
  Pose out = pose;
  std::array<double, 9>& r = out.rotation;
  // R <- R (3 - R^T R) / 2 squares the error: 3e-5 at first, so two steps leave what doubles round.
  for (int step = 0; step < 3; ++step) {
    std::array<double, 9> e{};
    double worst = 0;
    for (std::size_t i = 0; i < 3; ++i)
      for (std::size_t j = 0; j < 3; ++j) {
        e[3 * i + j] = column_dot(r, i, j) - (i == j ? 1.0 : 0.0);
        worst = std::max(worst, std::abs(e[3 * i + j]));
      }
    if (worst <= kGoodEnough) break;
    const std::array<double, 9> before = r;
    for (std::size_t i = 0; i < 3; ++i)
      for (std::size_t j = 0; j < 3; ++j)
        r[3 * i + j] =
            before[3 * i + j] - 0.5 * (before[3 * i] * e[j] + before[3 * i + 1] * e[3 + j] +
                                       before[3 * i + 2] * e[6 + j]);
  }
  return out;
}

Status check_motion(const Motion& motion, std::string_view body) {
  NEARMESH_RETURN_IF_ERROR(check_pose(motion.pose, body));
  for (const auto& [name, velocity] :
       {std::pair("linear_velocity_mps", &motion.linear_velocity_mps),
        {"angular_velocity_radps", &motion.angular_velocity_radps}})
    for (std::size_t i = 0; i < 3; ++i)
      if (!(std::abs((*velocity)[i]) <= kMaxSpeed))
        return {StatusCode::kInvalidArgument,
                "motion of " + std::string(body) + ": " + name + "[" + std::to_string(i) + "] is " +
                    number((*velocity)[i]) + ", expected a finite number within 1e9"};
  return Status::ok();
}

int lattice_exponent(const Grid& a, const Grid& b) {
  const int finest = std::min(a.exponent, b.exponent) - kSubBits;
  const int widest = std::max(a.exponent + a.bits, b.exponent + b.bits) - kMaxSpanBits;
  return std::max(finest, widest);
}

Result<PosedFrame> make_posed_frame(const Grid& grid, const Pose& pose, int lattice_exp) {
  const FloatGuard guard;
  if (grid.bits + grid.exponent - lattice_exp > kMaxSpanBits)
    return Status(StatusCode::kUnsupported, "a grid of 2^" +
                                                std::to_string(grid.bits + grid.exponent) +
                                                " m spans more than 2^38 lattice cells of 2^" +
                                                std::to_string(lattice_exp) + " m");
  // box_overlap.cpp takes products of four lengths of one model in the other's cells: they stay
  // below 2^(4 (62 + 134)) and above 2^(-4 * 134).
  if (lattice_exp - grid.exponent > (grid.shares_lattice() ? kMaxFinerSharedBits : kMaxFinerBits))
    return Status(StatusCode::kUnsupported,
                  "its grid's cell of 2^" + std::to_string(grid.exponent) +
                      " m is too small beside a model that needs lattice cells of 2^" +
                      std::to_string(lattice_exp) + " m");
  PosedFrame frame;
  frame.grid = grid;
  frame.lattice_exp = lattice_exp;
  frame.shift = kRotationBits - (grid.exponent - lattice_exp);
  for (std::size_t i = 0; i < 9; ++i)
    frame.rotation[i] = static_cast<std::int64_t>(std::floor(pose.rotation[i] * 0x1p30 + 0.5));

  // The origin of the lattice is turned in doubles, the way from there to the grid's in fixed
  // point, as points are: so what a point of the lattice comes to does not depend on whose grid it
  // is in.
  const std::array<double, 3> origin_m = grid.lattice_origin_m();
  for (std::size_t k = 0; k < 3; ++k) {
    const double* row = pose.rotation.data() + 3 * k;
    const double rotated_m = row[0] * origin_m[0] + row[1] * origin_m[1] + row[2] * origin_m[2];
    // |way| < 2^61.8, as of points.
    std::int64_t way = 0;
    for (std::size_t i = 0; i < 3; ++i) way += frame.rotation[3 * k + i] * grid.lattice_cells[i];
    const double way_cells = std::ldexp(static_cast<double>(way), -frame.shift);
    // Whole and fractional cells are added apart, so that a large translation does not round the
    // fraction away: whole cells of either then shift the sum exactly.
    const double rotated = std::ldexp(rotated_m, -lattice_exp);
    const double moved = std::ldexp(pose.translation_m[k], -lattice_exp);
    if (!(std::abs(rotated) < kMaxTranslationCells && std::abs(moved) < kMaxTranslationCells &&
          std::abs(rotated + moved) < kMaxTranslationCells &&
          std::abs(way_cells) < kMaxTranslationCells &&
          std::abs(rotated + moved + way_cells) < kMaxTranslationCells))
      return Status(StatusCode::kUnsupported, "translation_m[" + std::to_string(k) +
                                                  "] = " + number(pose.translation_m[k]) +
                                                  " with the grid's origin (" + number(rotated_m) +
                                                  ") does not fit 2^62 lattice cells of 2^" +
                                                  std::to_string(lattice_exp) + " m");
    const double rotated_whole = std::floor(rotated);
    const double moved_whole = std::floor(moved);
    const double fraction = (rotated - rotated_whole) + (moved - moved_whole);
    frame.translation[k] = static_cast<std::int64_t>(rotated_whole) +
                           static_cast<std::int64_t>(moved_whole) +
                           static_cast<std::int64_t>(std::floor(fraction + 0.5));
    if (frame.shift <= 0) {
      frame.translation[k] += way * (std::int64_t{1} << -frame.shift);
    } else if (way != 0) {  // then shift <= 61
      const std::int64_t whole = way >> frame.shift;
      frame.translation[k] += whole;
      frame.remainder[k] = way - (whole << frame.shift);
    }
  }
  return frame;
}

}  // namespace nearmesh
