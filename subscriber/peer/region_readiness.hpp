// SPDX-License-Identifier: Apache-2.0
#pragma once
// What a model lacks within a box: takes the tree of its replica, gives RegionReadiness.

#include <array>

#include "nearmesh/core/abtree/detail/tree.hpp"
#include "nearmesh/subscriber/peer/readiness.hpp"

namespace nearmesh::subscriber {

/// What a tree lacks in a box of its model's frame, metres, corners included: boxes are rounded
/// outward, so `resolved` is a proof. Preconditions: the tree has a store, lo_m <= hi_m, both
/// finite. Cost: O(nodes that meet the box).
[[nodiscard]] RegionReadiness lacks_in_box(const TreeView& tree, const std::array<double, 3>& lo_m,
                                           const std::array<double, 3>& hi_m);

}  // namespace nearmesh::subscriber
