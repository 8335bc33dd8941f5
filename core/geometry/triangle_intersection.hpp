// SPDX-License-Identifier: Apache-2.0
#pragma once
// Where two posed triangles meet: which parts of which edges is decided exactly, by signs; only the
// coordinates of the ends are rounded. Takes a pair that triangles_overlap accepts, gives points
// and segments.

#include <array>
#include <cstddef>

#include "nearmesh/core/geometry/pose.hpp"

namespace nearmesh {

/// A point (p == q) or a segment, in lattice cells relative to the first corner of triangle a.
struct IntersectionPiece {
  std::array<double, 3> p{}, q{};
};

/// The pieces of one pair: one point or segment; of coplanar triangles with an area in common the
/// outline of that area.
struct TriangleIntersection {
  std::array<IntersectionPiece, 6> pieces;
  std::size_t count = 0;
};

/// Every end lies within this many times E of a point of both triangles, where E is the greatest
/// difference of two coordinates, along one axis, of the pair's six corners. Bound:
/// triangle_intersection.cpp.
inline constexpr double kIntersectionError = 9 * 0x1p-53;

/// Precondition: triangles_overlap(a, b). Deterministic; the ends of a piece have no particular
/// order.
[[nodiscard]] TriangleIntersection intersect_triangles(const LatticeTriangle& a,
                                                       const LatticeTriangle& b);

}  // namespace nearmesh
