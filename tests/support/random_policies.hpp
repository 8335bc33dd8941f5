// SPDX-License-Identifier: Apache-2.0
#pragma once
// Random states of refinement that a peer can be in.

#include <functional>

#include "brute_force.hpp"
#include "core/demand/collect.hpp"
#include "core/refine/refined_mesh.hpp"
#include "fault_of.hpp"
#include "half_spaces.hpp"

namespace nearmesh::test {

// ---- states of a model at hand ------------------------------------------------------------------

/// Does these splits and all that they rest on.
inline void split_these(LocalModel& model, std::span<const VertexId> splits) {
  RefineDelta delta;
  for (const VertexId u : splits) EXPECT_TRUE(model.mesh.split(u, delta));
  model.tree.update(delta);
}
inline void split_all(LocalModel& model) { split_these(model, all_splits(model.mesh.store())); }

/// A random set, closed towards the roots: from a few splits to most of the model.
inline void split_random(LocalModel& model, Random& random) {
  const std::uint32_t count = model.mesh.store().vertex_count();
  std::vector<VertexId> splits;
  for (std::uint32_t n = count >> random.below(10); n > 0; --n) {
    const VertexId u{random.below(count)};
    if (!model.mesh.store().is_root(u)) splits.push_back(u);
  }
  split_these(model, splits);
}

inline void collapse_to_base(LocalModel& model) {
  RefineDelta delta;
  for (const BaseRoot& root : model.mesh.store().roots()) model.mesh.collapse(root.node, delta);
  model.tree.update(delta);
}

/// Up to three nodes, of any size, made whole.
inline void collapse_some(LocalModel& model, Random& random) {
  for (std::uint32_t n = random.below(4); n > 0; --n) {
    const VertexId u{random.below(model.mesh.store().vertex_count())};
    if (model.mesh.store().is_root(u)) continue;
    RefineDelta delta;
    model.mesh.collapse(model.mesh.store().node_of(u), delta);
    model.tree.update(delta);
  }
}

// ---- a peer's body ------------------------------------------------------------------------------

/// A replica and its tree: one body at a peer, which knows only what it was sent.
struct Body {
  explicit Body(const SpmHeader& header) : replica(header), tree(replica.mesh()) {}
  RefinedMesh replica;
  AbTree tree;

  void apply(std::span<const std::uint8_t> bytes) {
    const Result<SplitBatch> batch = decode_batch(replica.header(), bytes);
    ASSERT_TRUE(batch.is_ok()) << batch.status().message();
    const RefinedMesh::Applied applied = replica.apply_batch(batch.value());
    ASSERT_TRUE(applied.status.is_ok()) << applied.status.message();
    tree.update(applied.delta);
  }
  /// Up to three nodes made whole; what was below them is forgotten, or stays known.
  void evict_some(Random& random) {
    for (std::uint32_t n = random.below(4); n > 0; --n) {
      const VertexId u{random.below(replica.store().vertex_count())};
      if (!replica.store().is_known(u) || replica.store().is_root(u)) continue;
      const NodeSpan node = replica.store().node_of(u);
      tree.update(replica.collapse(node));
      if (replica.mesh().is_current(node) && random.below(2) == 0) replica.forget(node);
    }
  }
  [[nodiscard]] TreeView view() const { return tree.view(replica.header().grid); }
};

/// A cube around a random vertex, of any magnitude, cut to the grid.
inline GridBox random_region(const SplitStore& store, Random& random) {
  const GridPoint at = store.position({random.below(store.vertex_count())});
  const std::int32_t half = store.grid_max() >> random.below(10);
  GridBox box;
  for (int k = 0; k < 3; ++k) {
    box.lo[k] = std::max(0, at[k] - half);
    box.hi[k] = std::min(store.grid_max() - half, at[k]) + half;
  }
  return box;
}

/// What a peer asks for: the nodes that its answer lacks, and their boxes as the region.
inline RegionRequest request_missing(const SplitStore& store, const std::vector<NodeSpan>& missing,
                                     std::uint32_t max_splits) {
  RegionRequest request{.attach = missing, .max_splits = max_splits};
  if (request.attach.size() > kMaxAttachNodes) request.attach.resize(kMaxAttachNodes);
  for (const NodeSpan& node : request.attach) {
    if (request.region.size() == kMaxRegionBoxes)
      request.region.back().box.add(store.box(node));
    else
      request.region.push_back(store.box(node));
  }
  return request;
}

/// Everything that a region needs, from the base mesh on.
inline RegionRequest request_region(const SplitStore& store, const GridBox& region,
                                    std::uint32_t max_splits) {
  RegionRequest request{.region = {region}, .max_splits = max_splits};
  for (const BaseRoot& root : store.roots())
    if (root.node.size > 1 && request.attach.size() < kMaxAttachNodes)
      request.attach.push_back(root.node);
  return request;
}

/// What a publisher of the model sends, in batches of at most `max_bytes`, with these half-spaces.
using HalfSpacesOf = std::function<std::vector<NodeHalfSpace>(const Treelet&)>;
inline std::vector<std::vector<std::uint8_t>> serve(const BakedModel& model,
                                                    const RegionRequest& request,
                                                    std::size_t max_bytes,
                                                    const HalfSpacesOf& half_spaces_of = {}) {
  if (request.attach.empty()) return {};
  EXPECT_TRUE(check_request(model.store, request).is_ok());
  const Result<Demand> demand =
      collect(model.store, request, test::no_require, AttachRule::kAlways);
  EXPECT_TRUE(demand.is_ok());
  const Treelet& treelet = demand.value().treelet;
  return encode_batches(model.header, model.store, treelet, BoxPolicy::kCutNodes, max_bytes,
                        half_spaces_of ? half_spaces_of(treelet) : std::vector<NodeHalfSpace>());
}

/// Delivers batches the way a bad link does: in any order, a share of them lost, some twice.
inline void deliver(Body& body, std::vector<std::vector<std::uint8_t>> batches, Random& random) {
  shuffle(batches, random);
  for (std::size_t i = 0; i < batches.size(); ++i) {
    if (random.below(4) == 0) continue;
    body.apply(batches[i]);
    if (random.below(8) == 0) body.apply(batches[random.below(static_cast<std::uint32_t>(i) + 1)]);
  }
}

}  // namespace nearmesh::test
