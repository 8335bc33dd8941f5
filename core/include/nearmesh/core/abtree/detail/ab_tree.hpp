// SPDX-License-Identifier: Apache-2.0
#pragma once
// The active bounding tree of a replica: follows refinement at the cost of what arrived. A sparse
// upper tree over the roots and the larger nodes of the merge forest; below it slots, maximal nodes
// of at most 64 ids, each with a micro tree over its exact faces and its unresolved nodes, whose
// boxes stand as they came. Boxes above enclose what is below them. Takes RefineDelta, gives
// TreeView. Source: Liu, Georganas, Roth 2006, section 3.3 (AB-tree; its inner workings are known
// from Table 1 there only, so this is our own design). How it works inside:
// core/abtree/ab_tree.cpp.

#include <array>
#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

#include "nearmesh/core/abtree/detail/tree_pages.hpp"
#include "nearmesh/core/base/detail/sparse_array.hpp"

namespace nearmesh {

class TreeBuilder;
struct AxesBox;

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
  AbTree(AbTree&&) noexcept;
  AbTree& operator=(AbTree&&) noexcept;
  ~AbTree();

  /// Follows one operation of the mesh. Must be called for each, in order, and before a collapsed
  /// node's splits are forgotten by the store. Cost: O(changed slots and their neighbours); nothing
  /// when the delta is empty.
  void update(const RefineDelta& delta);

  [[nodiscard]] TreeView view(const Grid& grid) const {
    return {&grid,           arrays_.nodes.view(),      arrays_.blocks.view(),
            &mesh_->store(), &mesh_->store().surface(), &mesh_->half_spaces()};
  }
  [[nodiscard]] AbTreeStats stats() const;
  /// The slot of which the last update() found an exact face outside the box that must enclose it:
  /// what was sent of the model contradicts itself. Size 0: none.
  [[nodiscard]] NodeSpan contradiction() const { return contradiction_; }

 private:
  static constexpr std::uint32_t kNone = 0xffffffffU;
  /// Which vertices, a bit for each or for some: 32 in a row have bits of their own.
  using VertexBits = std::uint32_t;
  static constexpr VertexBits kAllVertices = ~VertexBits{0};
  static VertexBits bit_of(VertexId v) { return VertexBits{1} << (v.value % 32); }
  /// A tip whose faces depend, or did, on whether these are vertices of the full mesh.
  struct Watch {
    std::uint32_t tip;
    VertexBits corners;
  };

  // A tip of the upper tree: a slot, or a larger node that is not split yet.
  struct Tip {
    NodeSpan node;
    TreePlace place = 0;
    bool changed = false;           // to be built anew, whichever faces are exact
    bool queued = false;            // in pending_
    std::uint32_t exact_count = 0;  // faces in the micro tree
    GridBox bounds;                 // of a slot: its node's box; empty until it is asked for
    // Known faces of splits above it whose home vertex lies in `node`.
    std::vector<FaceKey> inherited;
    std::vector<Watch> watchers;  // who waits for a corner here, or might lose one

    [[nodiscard]] bool is_slot() const { return node.size <= kSlotSize; }
  };
  /// What else is known of a node of the upper tree.
  struct Upper {
    std::array<std::uint32_t, kLanes> first_vertices;  // of the lanes, or kNone
    TreePlace parent;
    // Of the forest, which its lanes share out; none in the fixed tree over the roots.
    NodeSpan node;
    std::uint32_t order;  // greater than that of any node above it
    bool queued;          // in refits_
    bool loose;           // in loose_
    bool gone;            // while that above is packed anew: to be freed
  };
  /// Lanes [begin, end) of an upper node: where a node of the forest has its part of the tree.
  struct Lanes {
    std::uint32_t tree_node, begin, end;
  };
  /// Nodes of the forest that share out one of them, by first vertex: the first so many.
  struct Cut {
    std::array<NodeSpan, kLanes> nodes;
    std::uint32_t count;
  };
  struct Packing;

  std::uint32_t new_tip(NodeSpan node, TreePlace place);
  void free_tip(std::uint32_t tip);
  [[nodiscard]] std::uint32_t tip_of(VertexId active) const { return tip_of_[active.value] - 1; }
  void set_tip_of(VertexId active, std::uint32_t tip) { tip_of_.set(active.value) = tip + 1; }
  [[nodiscard]] std::uint32_t tip_at(TreePlace place) const;
  [[nodiscard]] bool is_tip(NodeSpan node) const { return tips_[tip_of(node.first)].node == node; }
  void set_entry(TreePlace place, const TreeEntry& entry);
  [[nodiscard]] TreeEntry entry(TreePlace place) const {
    return arrays_.nodes[place / kLanes].entry(place % kLanes);
  }

  void queue(std::uint32_t tip);
  void mark_changed(std::uint32_t tip);
  void tell_watchers(std::uint32_t tip, VertexBits corners, bool may_lose);
  void watch_corners(std::uint32_t watcher);
  void watch(std::uint32_t tip, std::uint32_t watcher, VertexBits corners);
  void apply_split(VertexId u);
  void apply_collapse(NodeSpan node);
  void apply_box(NodeSpan node);
  [[nodiscard]] Slab slab_of(NodeSpan node, const GridBox& box) const;
  void free_micro_tree(TreePlace place);

  // Slots: slots.cpp.
  void look_at(std::uint32_t tip);
  void fetch_slot(std::uint32_t tip);
  void fetch_micro_tree(TreePlace place);
  struct SlotBits {
    std::uint64_t active, resolved;
  };
  [[nodiscard]] SlotBits bits_of(NodeSpan slot) const;
  void find_exact_faces(std::uint32_t slot);
  void make_room(std::size_t faces);
  void find_inherited_faces(std::uint32_t slot, const SlotBits& bits);
  void find_own_faces(NodeSpan slot, const SlotBits& bits);
  void check_bounds(std::uint32_t tip, const AxesBox& faces);
  void build_micro_tree(std::uint32_t slot);

  // The upper tree: upper_tree.cpp.
  [[nodiscard]] Lanes find_lanes(NodeSpan node) const;
  [[nodiscard]] std::uint32_t lane_count(std::uint32_t tree_node) const;
  [[nodiscard]] Cut cut(NodeSpan node) const;
  [[nodiscard]] bool is_cut(std::uint32_t tree_node, const Cut& cut) const;
  void loosen(std::uint32_t tree_node);
  void pack_loose();
  void pack(std::uint32_t tree_node);
  void fill(std::uint32_t tree_node, const Cut& cut, std::uint32_t opened_in, Packing& packing);
  void take_over(TreePlace from, TreePlace to, Packing& packing);
  [[nodiscard]] std::pair<std::uint32_t, std::uint32_t> find_upper(NodeSpan node,
                                                                   std::uint32_t from,
                                                                   const Packing& packing) const;
  void move_lane(std::uint32_t tree_node, std::uint32_t from, std::uint32_t to);
  void queue_refit(std::uint32_t tree_node);
  bool refit_lane(TreePlace place);
  void refit();
  [[nodiscard]] Upper& upper(std::uint32_t tree_node) { return uppers_[upper_of_[tree_node]]; }
  [[nodiscard]] const Upper& upper(std::uint32_t tree_node) const {
    return uppers_[upper_of_[tree_node]];
  }
  std::uint32_t new_upper(TreePlace parent, NodeSpan node);
  std::uint32_t hang_upper(TreePlace place, NodeSpan node);
  void free_upper(std::uint32_t tree_node);

  const ActiveMesh* mesh_;
  TreeArrays arrays_;
  LazyArray<std::uint32_t> upper_of_;  // beside the nodes: of one of the upper tree
  std::vector<Upper> uppers_;
  std::vector<std::uint32_t> free_uppers_;
  std::vector<Tip> tips_;
  std::vector<std::uint32_t> free_tips_;
  SparseArray<std::uint32_t> tip_of_;                            // by active vertex, plus one
  std::vector<TreePlace> root_places_;                           // of each root
  std::vector<std::uint32_t> pending_;                           // tips to look at
  std::vector<std::uint32_t> loose_;                             // upper nodes to be packed anew
  std::vector<std::pair<std::uint32_t, std::uint32_t>> refits_;  // order and index of nodes, a heap
  std::vector<TreePlace> micro_roots_;  // lanes of slots whose box and slab are to be found
  NodeSpan contradiction_;
  std::uint64_t exact_total_ = 0, slot_total_ = 0, rebuilt_slots_ = 0, rebuilt_faces_ = 0;

  // Scratch of look_at().
  struct ExactFace {
    FaceKey key;
    FaceCorners face;
  };
  std::vector<ExactFace> exact_faces_;
  std::vector<VertexId> corners_elsewhere_;            // to watch
  std::vector<std::uint32_t> tips_elsewhere_;          // that have them
  std::size_t exact_count_ = 0, elsewhere_count_ = 0;  // the first so many of these
  std::unique_ptr<TreeBuilder> builder_;
};

}  // namespace nearmesh
