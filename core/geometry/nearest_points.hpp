// SPDX-License-Identifier: Apache-2.0
#pragma once
// Where two posed triangles that do not meet are nearest to each other. In doubles: the points lie
// on the triangles but for rounding, so their distance bounds that of the triangles from above.

#include <array>

#include "nearmesh/core/geometry/pose.hpp"

namespace nearmesh {

struct NearestPoints {
  std::array<double, 3> on_a{}, on_b{};  ///< cells, relative to the first corner of a
  /// Cells. The triangles are at most so far apart, rounding included; nearly that, but for the
  /// last few digits.
  double at_most = 0;
};

/// Precondition: coordinate differences within the pair stay below 2^40. Triangles may be segments
/// or points. Deterministic.
[[nodiscard]] NearestPoints nearest_points(const LatticeTriangle& a, const LatticeTriangle& b);

/// How far a point is from a triangle, or segment, or point, but for rounding: any units.
[[nodiscard]] double distance_to_triangle(const std::array<double, 3>& p,
                                          const std::array<std::array<double, 3>, 3>& triangle);

}  // namespace nearmesh
