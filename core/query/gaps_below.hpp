// SPDX-License-Identifier: Apache-2.0
#pragma once
// What a search for the nearest parts knows of the lanes of a node that it opens.

#include "nearmesh/core/abtree/detail/tree.hpp"

namespace nearmesh {

/// How far two parts are apart at least, metres.
struct PartsGap {
  double gap = 0;
  /// As axes and slabs of the larger body alone tell it, less what the walk's floats may lose of
  /// that. Of exact faces any axis tells it.
  double by_larger = 0;
};

/// Of the lanes of a node and one part of the other tree. Lanes that are empty: any.
struct GapsBelow {
  double gap[kLanes], by_larger[kLanes];
};

/// The part of the other tree, and what is known already of it and of all that is below the node.
struct PartAbove {
  PartsGap above;
  double lost_m = 0;            ///< of its own size, by floats
  double lost_per_size = 0;     ///< of a lane of the node: metres a cell of its size
  bool is_coarse = false;       ///< TreeEntry::is_coarse
  bool is_node_larger = false;  ///< the node is the larger body's
};

/// `gaps`: of the node's boxes and the part. `along_way_m`: gaps along some other axis. The bits of
/// those lanes whose gap is less than `of_use_m`.
[[nodiscard]] std::uint32_t find_gaps_below(const TreeNode& node, const PartAbove& part,
                                            const BoxGaps& gaps,
                                            const double (&along_way_m)[kLanes], double of_use_m,
                                            GapsBelow& below);

}  // namespace nearmesh
