// SPDX-License-Identifier: Apache-2.0
#pragma once
// Exact triangle-triangle overlap on integers, by signs of orientations only. Touching is contact.
// Source: Guigue and Devillers 2003 (the sequence of orientation signs); ours adds degenerate
// triangles (segments, points) and exact signs at every extent.

#include "nearmesh/core/geometry/pose.hpp"

namespace nearmesh {

/// True iff the closed point sets of the triangles share a point. Exact for every input whose
/// coordinate differences within the pair stay below 2^40: coplanar, touching, degenerate to a
/// segment or a point included. Symmetric in its arguments and invariant under reordering corners.
[[nodiscard]] bool triangles_overlap(const LatticeTriangle& a, const LatticeTriangle& b);

}  // namespace nearmesh
