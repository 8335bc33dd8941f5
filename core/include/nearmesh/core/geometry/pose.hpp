// SPDX-License-Identifier: Apache-2.0
#pragma once
// API (docs/api.md).
// The fixed-point posed model: a published pose in doubles becomes, once, nine fixed-point numbers
// and an integer translation; after that every posed vertex is an integer, the same on every
// machine. The full-mesh reference and the certified answer share this rule, so they compare bit by
// bit.

#include <array>
#include <cmath>
#include <cstdint>
#include <string_view>

#include "nearmesh/core/base/status.hpp"
#include "nearmesh/core/geometry/detail/grid.hpp"

namespace nearmesh {

/// A rigid placement: x_world = rotation * x_model + translation. Metres.
struct Pose {
  std::array<double, 9> rotation{1, 0, 0, 0, 1, 0, 0, 0, 1};  ///< row-major
  std::array<double, 3> translation_m{};
  bool operator==(const Pose&) const = default;
};

/// Checks a pose from outside. Errors: kInvalidArgument, naming `body`, where an entry is not
/// finite, |translation| exceeds 1e9 m, R^T R differs from the identity by more than 1e-5, or det R
/// < 0.
[[nodiscard]] Status check_pose(const Pose& pose, std::string_view body);

/// The same pose with the rotation next to its matrix. Sessions take the poses of a host so, since
/// those of floats are off by their rounding. What check_pose accepts moves by no more than that
/// takes: with E = R^T R - 1, a point by at most 0.51 |E| times its distance from the model's
/// origin, |E| being the root of the sum of E's squares; 1e-7 of the distance for a rotation
/// rounded to floats. A matrix within 2^-40 of a rotation (no entry of E beyond that) keeps its
/// bits; so what this gives is not changed by it again. Deterministic.
/// Precondition: check_pose accepted the pose.
[[nodiscard]] Pose orthonormal(const Pose& pose);

/// The rotation, row-major, of the quaternion w + x i + y j + z k, which is normalised first.
/// Errors: kInvalidArgument where its length is not within 1e-3 of 1, naming it.
[[nodiscard]] Result<std::array<double, 9>> rotation_of_quaternion(
    const std::array<double, 4>& wxyz, std::string_view body);
/// The way back: w, x, y, z, with w >= 0, of length 1 but for rounding. Precondition: as of
/// orthonormal().
[[nodiscard]] std::array<double, 4> quaternion_of_rotation(const std::array<double, 9>& rotation);

/// A point of the pair's common integer lattice (see lattice_exponent).
struct LatticePoint {
  std::array<std::int64_t, 3> v{};
  std::int64_t& operator[](int axis) { return v[static_cast<std::size_t>(axis)]; }
  std::int64_t operator[](int axis) const { return v[static_cast<std::size_t>(axis)]; }
  bool operator==(const LatticePoint&) const = default;
};
using LatticeTriangle = std::array<LatticePoint, 3>;

/// The lattice on which a pair of models is compared has cells of 2^e metres: a quarter of the
/// finer grid's cell, but never so fine that a model spans more than 2^38 cells (exact tests use
/// 128 bits). Symmetric in its arguments.
[[nodiscard]] int lattice_exponent(const Grid& a, const Grid& b);

/// A model's fixed-point placement on the lattice: 30 fractional bits of rotation.
struct PosedFrame {
  std::array<std::int64_t, 9> rotation{};  ///< round(R * 2^30), row-major
  /// Of the grid's origin, in lattice cells, rounded down where there is a remainder.
  std::array<std::int64_t, 3> translation{};
  /// What rounding `translation` down left, in [0, 2^shift): of a model that shares its lattice. It
  /// is kept for the rounding of each point, so that neighbours, which have other remainders, round
  /// the points they share alike.
  std::array<std::int64_t, 3> remainder{};
  int shift = 30;  ///< lattice = (rotation * grid, rounded) >> shift
  int lattice_exp = 0;
  Grid grid;
};

/// Derives the fixed-point placement.
/// Precondition: check_pose accepted the pose. Moving the pose by a multiple of the lattice cell
/// moves `translation` by exactly that integer whenever the pose's own doubles express the move
/// exactly, whatever the rotation. Models with one lattice (Grid::lattice_cells) in one pose place
/// equal points of that lattice alike, to the bit.
/// Errors: kUnsupported when the translation does not fit 2^62 lattice cells, the model spans more
/// than 2^38 of them (lattice_exponent never asks for that), or its cell is below 2^-100 of theirs:
/// the other model is so much larger that doubles would overflow between the two. 2^-31 where it
/// shares its lattice.
[[nodiscard]] Result<PosedFrame> make_posed_frame(const Grid& grid, const Pose& pose,
                                                  int lattice_exp);

/// A row of the fixed-point rotation times a grid point, in lattice cells, rounding half up. Never
/// decreases with n.
[[nodiscard]] inline std::int64_t round_to_cells(const PosedFrame& frame, std::int64_t n) {
  // |n| <= 2^31 * 2^30 * sqrt(3) * (1 + 1e-5) < 2^61.8, so n + 2^(shift - 1) fits for shift <= 62,
  // and anything shifted further rounds to 0. A remainder adds less than 2^shift to n, and is there
  // for shift <= 61 only: that fits too. A left shift stays within 2^40: see make_posed_frame.
  if (frame.shift <= 0) return n * (std::int64_t{1} << -frame.shift);
  if (frame.shift <= 62) return (n + (std::int64_t{1} << (frame.shift - 1))) >> frame.shift;
  return 0;
}

/// Where the grid's origin is beyond `translation`, in lattice cells: at least 0, less than 1.
[[nodiscard]] inline double beyond_translation(const PosedFrame& frame, std::size_t axis) {
  if (frame.remainder[axis] == 0) return 0;  // nearly always: only tiles of a world have any
  return std::ldexp(static_cast<double>(frame.remainder[axis]), -frame.shift);
}

/// The posed vertex. Deterministic: integer arithmetic only, rounding half up. Each coordinate is
/// within half a cell of the frame's affine image of p. p lies in the frame's grid or, where shift
/// >= 0, is any int32 point.
[[nodiscard]] inline LatticePoint pose_point(const PosedFrame& frame, const GridPoint& p) {
  LatticePoint out;
  for (int k = 0; k < 3; ++k) {
    const std::int64_t* row = frame.rotation.data() + 3 * k;
    const auto axis = static_cast<std::size_t>(k);
    out[k] = round_to_cells(frame,
                            row[0] * p[0] + row[1] * p[1] + row[2] * p[2] + frame.remainder[axis]) +
             frame.translation[axis];
  }
  return out;
}

/// The posed face: that is what touches.
[[nodiscard]] inline LatticeTriangle pose_triangle(const PosedFrame& frame,
                                                   const std::array<GridPoint, 3>& corners) {
  return {pose_point(frame, corners[0]), pose_point(frame, corners[1]),
          pose_point(frame, corners[2])};
}

/// A closed box along the lattice's axes.
struct LatticeBox {
  LatticePoint lo, hi;
};
/// The tightest one that holds pose_point of every grid point in `box`, hence every posed triangle
/// with corners there. Exact: each coordinate grows or falls with each of the point's, so a corner
/// of the box is the extreme.
/// Precondition: the box is not empty.
[[nodiscard]] inline LatticeBox pose_box(const PosedFrame& frame, const GridBox& box) {
  LatticeBox out;
  for (int k = 0; k < 3; ++k) {
    const std::int64_t* row = frame.rotation.data() + 3 * k;
    std::int64_t least = frame.remainder[static_cast<std::size_t>(k)], most = least;
    for (int i = 0; i < 3; ++i) {
      const std::int64_t at_lo = row[i] * box.lo[i], at_hi = row[i] * box.hi[i];
      least += std::min(at_lo, at_hi);
      most += std::max(at_lo, at_hi);
    }
    const std::int64_t moved = frame.translation[static_cast<std::size_t>(k)];
    out.lo[k] = round_to_cells(frame, least) + moved;
    out.hi[k] = round_to_cells(frame, most) + moved;
  }
  return out;
}

}  // namespace nearmesh
