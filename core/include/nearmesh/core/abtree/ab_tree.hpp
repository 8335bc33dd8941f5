// SPDX-License-Identifier: Apache-2.0
#pragma once
// The active bounding tree of a replica: follows refinement at the cost of what arrived.
// A sparse upper tree over the roots and the larger nodes of the merge forest, with boxes as they came (of original
// faces: never refitted); below it slots, maximal nodes of at most 64 ids, each with a micro tree over its exact faces
// and its unresolved nodes. Takes RefineDelta, gives TreeView.
// Source: the paper, section 3.3 (AB-tree; its inner workings are known from Table 1 only, so this is our own design).

#include <cstdint>
#include <vector>

#include "nearmesh/core/abtree/tree.hpp"

namespace nearmesh {

struct AbTreeStats {
  std::uint64_t slots = 0;
  std::uint64_t exact_faces = 0;
  std::uint64_t rebuilt_slots = 0;  ///< by the last update
  std::uint64_t rebuilt_faces = 0;  ///< by the last update
  std::uint64_t bytes = 0;
};

class AbTree {
 public:
  /// The tree of the mesh's current state. The mesh must outlive this. Cost: O(active).
  explicit AbTree(const ActiveMesh& mesh);

  /// Follows one operation of the mesh. Must be called for each, in order, and before a collapsed node's splits are
  /// forgotten by the store. Cost: O(changed slots and their neighbours); nothing when the delta is empty.
  void update(const RefineDelta& delta);

  [[nodiscard]] TreeView view(const Grid& grid) const {
    return {&grid, nodes_, faces_, 0, &mesh_->store()};
  }
  [[nodiscard]] AbTreeStats stats() const;

 private:
  static constexpr std::uint32_t kNone = 0xffffffffU;

  // A leaf of the upper tree: a slot, or a larger node that is not split yet.
  struct Leaf {
    NodeSpan node;
    std::uint32_t tree_node = 0;  // its place in nodes_
    std::uint32_t node_range = kNone, node_capacity = 0;
    std::uint32_t face_range = kNone, face_capacity = 0, exact_count = 0;
    std::uint64_t exact_digest = 0;       // of the exact faces in the micro tree
    bool changed = false;                 // its own nodes changed since it was built
    bool queued = false;                  // in pending_
    std::vector<FaceKey> bucket;          // known faces whose home vertex lies in `node`
    std::vector<std::uint32_t> watchers;  // leaves with a face that has a corner here

    [[nodiscard]] bool is_slot() const { return node.size <= kSlotSize; }
  };

  std::uint32_t new_leaf(NodeSpan node, std::uint32_t tree_node);
  void free_leaf(std::uint32_t leaf);
  [[nodiscard]] std::uint32_t leaf_of(VertexId active) const { return leaf_of_[active.value] - 1; }
  void set_leaf_of(VertexId active, std::uint32_t leaf) { leaf_of_[active.value] = leaf + 1; }
  void mark_changed(std::uint32_t leaf);
  void apply_split(VertexId u);
  void apply_collapse(NodeSpan node);
  void apply_box(NodeSpan node);
  void rebuild(std::uint32_t leaf);
  void store_micro_tree(std::uint32_t leaf);
  [[nodiscard]] std::uint32_t find_tree_node(NodeSpan node) const;

  // Ranges of nodes_ and faces_ in powers of two, with free lists.
  template <class T>
  static std::uint32_t allocate(std::vector<T>& pool, std::vector<std::vector<std::uint32_t>>& free,
                                std::uint32_t capacity);

  const ActiveMesh* mesh_;
  std::vector<TreeNode> nodes_;
  std::vector<TreeFace> faces_;
  std::vector<std::vector<std::uint32_t>> free_nodes_, free_faces_;  // by log2 of the capacity
  std::vector<Leaf> leaves_;
  std::vector<std::uint32_t> free_leaves_;
  LazyArray<std::uint32_t> leaf_of_;       // by active vertex, plus one
  std::vector<std::uint32_t> root_nodes_;  // place in nodes_ of each root
  std::vector<std::uint32_t> pending_;     // leaves to look at
  std::uint64_t exact_total_ = 0, slot_total_ = 0, rebuilt_slots_ = 0, rebuilt_faces_ = 0;

  // Scratch of rebuild().
  std::vector<FaceKey> exact_keys_;
  std::vector<TreeFace> exact_faces_;
};

}  // namespace nearmesh
