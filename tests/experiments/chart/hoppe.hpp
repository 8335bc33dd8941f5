// SPDX-License-Identifier: Apache-2.0
#pragma once
// Which splits must be done before a split, by the rule of Hoppe, "View-dependent refinement of
// progressive meshes" (1997), section 3: a split is legal when its vertex and the four faces around
// the two that it makes are active. A face is active once the split that makes it is done, so the
// rule is a list of splits for each split. A reconstruction: the 2006 paper cites the rule and does
// not state it. Where an edge has more than two faces, all count.

#include <vector>

#include "nearmesh/core/refine/detail/active_mesh.hpp"

namespace nearmesh::chart {

class HoppeRule {
 public:
  /// `order` is the progressive mesh: all splits, parents first. Cost: O(splits x faces at a
  /// vertex).
  HoppeRule(const SplitStore& store, const std::vector<VertexId>& order);
  /// Does u and, before it, all that the rule asks for.
  void split(ActiveMesh& mesh, VertexId u, RefineDelta& delta) const;

 private:
  std::vector<std::uint32_t> first_;  // by split, into needs_
  std::vector<VertexId> needs_;
};

}  // namespace nearmesh::chart
