// SPDX-License-Identifier: Apache-2.0
#pragma once
// Is a point inside a posed closed surface of which only a part is known? By the exact winding number, counted along a
// lattice ray; or the unresolved nodes that stand in the ray's way.

#include <vector>

#include "nearmesh/core/query/query.hpp"

namespace nearmesh {

enum class Side : std::uint8_t { kOutside, kInside, kOpen };

struct Location {
  Side side = Side::kOpen;
  std::vector<const TreeNode*> missing;  ///< open: unresolved nodes on the ray that needs the least
};

/// The side of `point` (of the pair's lattice) on which the full surface lies: inside where the winding number is not 0.
/// In: a closed surface; a point that is on none of its faces. Exact and the same for every state of refinement, but for
/// kOpen. Cost: O(nodes that a ray meets), at most six rays; nothing outside the root's box.
[[nodiscard]] Location locate(const TreeView& solid, const PosedFrame& frame,
                              const LatticePoint& point, QueryStats& stats);

}  // namespace nearmesh
