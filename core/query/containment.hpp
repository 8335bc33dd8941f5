// SPDX-License-Identifier: Apache-2.0
#pragma once
// Is a point inside a posed closed surface of which only a part is known? By the exact winding
// number, counted along a lattice ray; or the unresolved nodes that stand in the ray's way.

#include <vector>

#include "nearmesh/core/query/query.hpp"

namespace nearmesh {

enum class Side : std::uint8_t { kOutside, kInside, kUndecided };

/// From a point of the pair's lattice along one of its axes, either way.
struct Ray {
  LatticePoint from;
  int axis = 0;
  bool upward = true;
};

struct Location {
  Side side = Side::kUndecided;
  std::vector<TreeEntry> missing;  ///< undecided: unresolved nodes on the ray that needs the least
  Ray ray;                         ///< undecided: that ray
};

/// The side of `point` (of the pair's lattice) on which the full surface lies: inside where the
/// winding number is not 0. In: a closed surface; a point that is on none of its faces. Out: exact,
/// and the same in every state of refinement, but for kUndecided. Cost: O(nodes that a ray meets),
/// at most six rays; nothing outside the root's box.
[[nodiscard]] Location locate(const TreeView& solid, const PosedFrame& frame,
                              const LatticePoint& point, QueryStats& stats);

/// Adds boxes of the solid's grid that cover what lies of the ray inside `box`, with a cell or two
/// around it: a hint where to ask for detail, not a bound that a decision may rest on.
void add_ray_boxes(const PosedFrame& solid, const Ray& ray, const GridBox& box,
                   std::vector<GridBox>& boxes);

}  // namespace nearmesh
