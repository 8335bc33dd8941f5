// SPDX-License-Identifier: Apache-2.0
// Poses and triangles as raw numbers: the guard of poses, the exact triangle test, and the
// conservative box tests, which must never part what the exact test finds touching.

#include <algorithm>
#include <cmath>

#include "core/geometry/triangle_overlap.hpp"
#include "fuzz_input.hpp"
#include "nearmesh/core/geometry/detail/box_overlap.hpp"

using namespace nearmesh;

namespace {

/// Rotations from small quaternions, since raw doubles are hardly ever orthonormal; one entry in
/// four poses is then replaced by a raw double.
Pose read_pose(fuzz::FuzzInput& in) {
  Pose pose;
  const std::uint8_t kind = in.byte();
  double q[4], length = 0;
  for (double& x : q) {
    x = in.number<std::int8_t>();
    length += x * x;
  }
  if (length > 0) {
    length = std::sqrt(length);
    const double w = q[0] / length, x = q[1] / length, y = q[2] / length, z = q[3] / length;
    pose.rotation = {1 - 2 * (y * y + z * z), 2 * (x * y - z * w),     2 * (x * z + y * w),
                     2 * (x * y + z * w),     1 - 2 * (x * x + z * z), 2 * (y * z - x * w),
                     2 * (x * z - y * w),     2 * (y * z + x * w),     1 - 2 * (x * x + y * y)};
  }
  for (double& t : pose.translation_m)
    t = (kind & 1U) != 0 ? in.number<double>() : in.number<std::int16_t>() / 256.0;
  if ((kind & 6U) == 6) pose.rotation[kind / 8 % 9] = in.number<double>();
  return pose;
}

Grid read_grid(fuzz::FuzzInput& in) {
  Grid grid;
  grid.bits = 4 + in.byte() % 28;
  // Mostly sizes that meet; else whatever a header may say.
  const auto exponent = in.number<std::int16_t>();
  grid.exponent =
      exponent % 4 != 0 ? exponent / 4 % 8 - grid.bits : exponent / 4 % (kMaxGridExponent + 1);
  for (double& x : grid.origin_m) x = std::ldexp(in.number<std::int16_t>(), grid.exponent);
  return grid;
}

GridPoint read_point(fuzz::FuzzInput& in, const Grid& grid) {
  GridPoint p;
  const auto mask = static_cast<std::uint32_t>((std::uint64_t{1} << grid.bits) - 1);
  for (int k = 0; k < 3; ++k) {
    const std::uint8_t kind = in.byte();
    p[k] = static_cast<std::int32_t>(
        (kind < 200 ? std::uint32_t{kind} : in.number<std::uint32_t>()) & mask);
  }
  return p;
}

void check_pair(const LatticeTriangle& a, const LatticeTriangle& b, bool touch) {
  FUZZ_CHECK(triangles_overlap(b, a) == touch);
  FUZZ_CHECK(triangles_overlap({a[1], a[2], a[0]}, {b[2], b[1], b[0]}) == touch);
  FUZZ_CHECK(triangles_overlap({a[0], a[2], a[1]}, {b[1], b[2], b[0]}) == touch);
}

void check_lattice_triangles(fuzz::FuzzInput& in) {
  const int shift = in.byte() % 33;
  LatticeTriangle a, b, moved_a, moved_b, mirrored_a, mirrored_b;
  const std::int64_t by = in.number<std::int64_t>() >> 2;
  const auto read = [&](LatticeTriangle& t, LatticeTriangle& moved, LatticeTriangle& mirrored) {
    for (std::size_t i = 0; i < 3; ++i)
      for (int k = 0; k < 3; ++k) {
        // Differences stay below 2^40, as the test demands.
        t[i][k] = std::int64_t{in.number<std::int8_t>()} * (std::int64_t{1} << shift) / 4;
        if (shift > 8) t[i][k] += in.number<std::int8_t>();
        moved[i][k] = t[i][k] + by;
        mirrored[i][(k + 1) % 3] = -t[i][k];
      }
  };
  read(a, moved_a, mirrored_a);
  read(b, moved_b, mirrored_b);
  const bool touch = triangles_overlap(a, b);
  check_pair(a, b, touch);
  FUZZ_CHECK(triangles_overlap(moved_a, moved_b) == touch);
  FUZZ_CHECK(triangles_overlap(mirrored_a, mirrored_b) == touch);
  FUZZ_CHECK(triangles_overlap(a, a));
  FUZZ_CHECK(triangles_overlap(a, {a[0], b[1], b[2]}));  // a common corner
}

void check_posed(fuzz::FuzzInput& in) {
  const Pose pose_a = read_pose(in), pose_b = read_pose(in);
  const Grid grid_a = read_grid(in), grid_b = read_grid(in);
  const Status ok_a = check_pose(pose_a, "body"), ok_b = check_pose(pose_b, "body");
  for (const Status& status : {ok_a, ok_b})
    FUZZ_CHECK(status.is_ok() || status.message().find("body") != std::string::npos);
  if (!ok_a.is_ok() || !ok_b.is_ok()) return;
  const int lattice = lattice_exponent(grid_a, grid_b);
  const Result<PosedFrame> a = make_posed_frame(grid_a, pose_a, lattice);
  const Result<PosedFrame> b = make_posed_frame(grid_b, pose_b, lattice);
  if (!a.is_ok() || !b.is_ok()) return;

  std::array<GridPoint, 3> corners_a, corners_b;
  GridBox box_a, box_b;
  LatticeTriangle posed_a, posed_b;
  for (std::size_t i = 0; i < 3; ++i) {
    box_a.add(corners_a[i] = read_point(in, grid_a));
    box_b.add(corners_b[i] = read_point(in, grid_b));
    posed_a[i] = pose_point(a.value(), corners_a[i]);
    posed_b[i] = pose_point(b.value(), corners_b[i]);
  }
  const RelativeFrame b_in_a = make_relative_frame(a.value(), b.value());
  const RelativeFrame a_in_b = make_relative_frame(b.value(), a.value());
  const bool apart = boxes_apart(b_in_a, centered(box_a), centered(box_b));
  FUZZ_CHECK((boxes_gap_m(b_in_a, centered(box_a), centered(box_b)) > 0) == apart);
  const bool touch = triangles_overlap(posed_a, posed_b);
  check_pair(posed_a, posed_b, touch);
  if (!touch) return;
  FUZZ_CHECK(!apart);
  FUZZ_CHECK(!boxes_apart(a_in_b, centered(box_b), centered(box_a)));
  FUZZ_CHECK(!box_triangle_apart(b_in_a, centered(box_a), to_a_units(b_in_a, corners_b)));
  FUZZ_CHECK(!box_triangle_apart(a_in_b, centered(box_b), to_a_units(a_in_b, corners_a)));
  FUZZ_CHECK(triangles_gap_m(b_in_a, as_doubles(corners_a), to_a_units(b_in_a, corners_b)) <= 0);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  fuzz::FuzzInput in(data, size);
  if (in.byte() % 2 == 0) {
    check_lattice_triangles(in);
  } else {
    check_posed(in);
  }
  return 0;
}
