// SPDX-License-Identifier: Apache-2.0
#pragma once
// The fixed-point posed model: a published pose in doubles becomes, once, nine fixed-point numbers
// and an integer translation; after that every posed vertex is an integer, the same on every machine.
// The full-mesh reference and the certified answer share this rule, so they compare bit by bit.

#include <array>
#include <cstdint>
#include <string_view>

#include "nearmesh/core/base/status.hpp"
#include "nearmesh/core/geometry/grid.hpp"

namespace nearmesh {

/// A rigid placement: x_world = rotation * x_model + translation. Metres.
struct Pose {
  std::array<double, 9> rotation{1, 0, 0, 0, 1, 0, 0, 0, 1};  ///< row-major
  std::array<double, 3> translation_m{};
};

/// Checks a pose from outside. Errors: kInvalidArgument, naming `body`, where an entry is not finite,
/// |translation| exceeds 1e9 m, R^T R differs from the identity by more than 1e-5, or det R < 0.
[[nodiscard]] Status check_pose(const Pose& pose, std::string_view body);

/// A point of the pair's common integer lattice (see lattice_exponent).
struct LatticePoint {
  std::array<std::int64_t, 3> v{};
  std::int64_t& operator[](int axis) { return v[static_cast<std::size_t>(axis)]; }
  std::int64_t operator[](int axis) const { return v[static_cast<std::size_t>(axis)]; }
  bool operator==(const LatticePoint&) const = default;
};
using LatticeTriangle = std::array<LatticePoint, 3>;

/// The lattice on which a pair of models is compared has cells of 2^e metres: a quarter of the finer
/// grid's cell, but never so fine that a model spans more than 2^38 cells (exact tests use 128 bits).
[[nodiscard]] int lattice_exponent(const Grid& a, const Grid& b);

/// A model's fixed-point placement on the lattice: 30 fractional bits of rotation.
struct PosedFrame {
  std::array<std::int64_t, 9> rotation{};     ///< round(R * 2^30), row-major
  std::array<std::int64_t, 3> translation{};  ///< of the grid's origin, in lattice cells
  int shift = 30;                             ///< lattice = (rotation * grid, rounded) >> shift
  int lattice_exp = 0;
  Grid grid;
};

/// Derives the fixed-point placement. Precondition: check_pose accepted the pose.
/// Errors: kUnsupported when the translation does not fit 2^62 lattice cells.
[[nodiscard]] Result<PosedFrame> make_posed_frame(const Grid& grid, const Pose& pose,
                                                  int lattice_exp);

/// The posed vertex. Deterministic: integer arithmetic only, rounding half up.
[[nodiscard]] LatticePoint pose_point(const PosedFrame& frame, const GridPoint& p);

}  // namespace nearmesh
