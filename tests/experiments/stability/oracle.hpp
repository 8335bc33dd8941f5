// SPDX-License-Identifier: Apache-2.0
#pragma once
// The truth: which triangles of two posed meshes share a point, in exact rational arithmetic on the
// very doubles that every system is given. Sets are closed; a triangle may be a segment or a point.

#include <cstdint>
#include <utility>
#include <vector>

#include "case.hpp"

namespace nearmesh::stability {

/// Places of triangles in the faces of a and of b.
using PairList = std::vector<std::pair<std::uint32_t, std::uint32_t>>;

/// All touching pairs, ascending. Pairs whose boxes are apart (in doubles rounded outward) are not
/// looked at. Every coordinate finite. Some 20 us a pair of triangles whose boxes meet.
[[nodiscard]] PairList touching_pairs(const Body& a, const Body& b);

/// Stops at the first pair.
[[nodiscard]] bool touches(const Body& a, const Body& b);

/// Whether the closed bodies, taken with their insides, share a point: surfaces that touch, or a
/// vertex of one inside the other, by the parity of exact crossings along a ray that passes no
/// edge. Each body is one part whose surface does not cross itself, or parts of which the first
/// vertices tell.
[[nodiscard]] bool solids_meet(const Body& a, bool solid_a, const Body& b, bool solid_b);

}  // namespace nearmesh::stability
