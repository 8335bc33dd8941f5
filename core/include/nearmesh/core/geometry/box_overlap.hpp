// SPDX-License-Identifier: Apache-2.0
#pragma once
// Conservative separation tests between boxes and triangles of two posed models. "Separated" is
// always true of the posed integer geometry: rounding of posed vertices and of doubles is inside the
// slack. Plain double arithmetic without contraction: the same outcome on every machine.

#include "nearmesh/core/geometry/pose.hpp"

namespace nearmesh {

/// Centre and half extents of a box, in its own model's grid units.
struct CenteredBox {
  std::array<double, 3> center{};
  std::array<double, 3> half{};
};
[[nodiscard]] CenteredBox centered(const GridBox& box);  ///< exact (dyadic)

/// Maps model B's grid into model A's grid: x_A = rotation * x_B + translation, the true inverse of
/// A's fixed-point frame times B's (no orthonormality assumed).
struct RelativeFrame {
  std::array<double, 9> rotation{};
  std::array<double, 9> abs_rotation{};   ///< |rotation| plus 1e-9 of its norm: guards edge-edge axes
  std::array<double, 3> translation{};    ///< in A's grid units
  std::array<double, 9> inverse{};        ///< of rotation
  double slack = 0;                       ///< bound of all rounding, in A's grid units
  double metres_per_unit = 0;             ///< A's cell
};
[[nodiscard]] RelativeFrame make_relative_frame(const PosedFrame& a, const PosedFrame& b);

/// True when box a (A's grid) and box b (B's grid) are certainly apart. 15 separating axes.
[[nodiscard]] bool boxes_apart(const RelativeFrame& f, const CenteredBox& a, const CenteredBox& b);

/// A lower bound in metres of the distance between anything inside a and anything inside b, posed;
/// 0 when no axis separates them.
[[nodiscard]] double boxes_gap_m(const RelativeFrame& f, const CenteredBox& a, const CenteredBox& b);

/// A triangle with its corners in A's grid units (doubles).
using DoubleTriangle = std::array<std::array<double, 3>, 3>;
/// B's triangle (B's grid units) in A's grid units.
[[nodiscard]] DoubleTriangle to_a_units(const RelativeFrame& f, const std::array<GridPoint, 3>& b);
/// A's own triangle, converted.
[[nodiscard]] DoubleTriangle as_doubles(const std::array<GridPoint, 3>& a);

/// True when box a and triangle t (both in A's grid units) are certainly apart. 13 axes.
[[nodiscard]] bool box_triangle_apart(const RelativeFrame& f, const CenteredBox& a,
                                      const DoubleTriangle& t);

/// A lower bound in metres of the distance between two triangles in A's grid units: the greatest gap
/// over the two normals, nine edge products and in-plane edge normals, less the slack; 0 if none.
[[nodiscard]] double triangles_gap_m(const RelativeFrame& f, const DoubleTriangle& a,
                                     const DoubleTriangle& b);

}  // namespace nearmesh
