// SPDX-License-Identifier: Apache-2.0
#pragma once
// API (docs/api.md).
// Refines two local models, split by split, until the query between them is certified or no detail
// can settle it: what a peer's exchange with a publisher comes to when the link is free. For files
// at hand, tests and measurements.

#include <functional>

#include "nearmesh/core/abtree/detail/ab_tree.hpp"
#include "nearmesh/core/query/query.hpp"

namespace nearmesh {

/// A mesh state and its tree over one store.
struct LocalModel {
  explicit LocalModel(const SplitStore& store, const Grid& model_grid)
      : grid(model_grid), mesh(store), tree(mesh) {}
  LocalModel(const LocalModel&) = delete;  // the tree refers to the mesh
  LocalModel& operator=(const LocalModel&) = delete;

  Grid grid;
  ActiveMesh mesh;
  AbTree tree;
  [[nodiscard]] TreeView view() const { return tree.view(grid); }
};

/// Where the time went: seconds of wall clock, and how many rounds of query and split.
struct CertifyTimes {
  double refine_s = 0, tree_s = 0, query_s = 0;
  std::uint32_t rounds = 0;
};

/// Makes a node's split known to the store, e.g. ModelFile::require.
using Require = std::function<Status(NodeSpan)>;

/// Repeats query and split of what is missing until nothing is. Each split is one that an uncertain
/// answer named, so both models end with no more than the answer needs. Ends: every round splits at
/// least one node.
/// Out: certified, or is_beyond_detail(), or exhausted: QueryOptions::max_tests bound each round.
/// Errors: those of require; kCorrupt where a model contradicts its boxes; kNotFound where require
/// succeeds but the store still lacks the split. After an error make both models anew: mesh and
/// tree may have parted.
[[nodiscard]] Result<Answer> certify(LocalModel& a, const PosedFrame& frame_a,
                                     const Require& require_a, LocalModel& b,
                                     const PosedFrame& frame_b, const Require& require_b,
                                     const QueryOptions& options, CertifyTimes* times = nullptr);

/// Splits nodes that an answer misses, and lets the tree follow.
/// Errors: those of require; kCorrupt and kNotFound as certify(), and the model is to be made anew
/// then.
[[nodiscard]] Status split_missing(LocalModel& model, const std::vector<NodeSpan>& nodes,
                                   const Require& require);

}  // namespace nearmesh
