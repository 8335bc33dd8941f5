// SPDX-License-Identifier: Apache-2.0
#pragma once
// What the query walks: a tree of boxes in one model's grid, eight children a node, side by side
// for vector tests, whose ends hold exact faces or unresolved nodes. AbTree makes one that follows
// a replica; build_triangle_tree makes one over a fixed set of triangles (the full-mesh reference,
// and the coarse meshes that the uncertified methods test).

#include <array>
#include <bit>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "nearmesh/core/geometry/detail/lanes.hpp"
#include "nearmesh/core/refine/detail/active_mesh.hpp"

namespace nearmesh {

/// One part of a tree: its box, and what is in it.
struct TreeEntry {
  enum class Kind : std::uint32_t {
    kInner,       ///< the lanes of node `first`; count 1 where an unresolved node is below, else 0
    kFaces,       ///< the first `count` exact faces of block `first`
    kUnresolved,  ///< an unresolved node of the forest: first is its first vertex, count its size
    kEmpty,       ///< nothing: resolved, without faces. The box is empty
  };
  GridBox box;
  Slab slab;
  std::uint32_t first = 0;
  std::uint32_t kind_and_count = static_cast<std::uint32_t>(Kind::kEmpty);

  [[nodiscard]] Kind kind() const { return static_cast<Kind>(kind_and_count & 3U); }
  [[nodiscard]] std::uint32_t count() const { return kind_and_count >> 2; }
  /// It is an unresolved node, or has some below: more detail may come.
  [[nodiscard]] bool is_coarse() const {
    return kind() == Kind::kUnresolved || (kind() == Kind::kInner && count() > 0);
  }
  [[nodiscard]] NodeSpan unresolved_node() const { return {{first}, count()}; }
  void set(Kind kind, std::uint32_t first_place, std::uint32_t count) {
    first = first_place;
    kind_and_count = static_cast<std::uint32_t>(kind) | count << 2;
  }
  bool operator==(const TreeEntry&) const = default;
};

/// How large a box is, in cells, for walks of two trees that open the larger of two first.
[[nodiscard]] inline float size_of(const GridBox& box) { return static_cast<float>(box.extent()); }

/// Where an entry stands: 8 * its node + its lane.
using TreePlace = std::uint32_t;

/// Up to eight parts, each in a lane.
struct TreeNode {
  BoxLanes boxes;
  float size[kLanes] = {};  ///< size_of
  std::uint32_t first[kLanes] = {};
  std::uint32_t kind_and_count[kLanes];
  std::uint32_t lanes = 0;  ///< bits of the lanes that are not empty

  TreeNode() {
    for (std::uint32_t& kind : kind_and_count)
      kind = static_cast<std::uint32_t>(TreeEntry::Kind::kEmpty);
  }
  [[nodiscard]] TreeEntry::Kind kind(std::uint32_t lane) const {
    return static_cast<TreeEntry::Kind>(kind_and_count[lane] & 3U);
  }
  [[nodiscard]] bool is_coarse(std::uint32_t lane) const {
    return TreeEntry{{}, {}, first[lane], kind_and_count[lane]}.is_coarse();
  }
  [[nodiscard]] TreeEntry entry(std::uint32_t lane) const {
    if ((lanes >> lane & 1U) == 0) return {};
    return {boxes.box(lane), boxes.slab(lane), first[lane], kind_and_count[lane]};
  }
  void set(std::uint32_t lane, const TreeEntry& entry) {
    first[lane] = entry.first;
    kind_and_count[lane] = entry.kind_and_count;
    if (entry.kind() == TreeEntry::Kind::kEmpty) {
      boxes.set(lane, {{}, {}}, {});
      size[lane] = 0;
      lanes &= ~(1U << lane);
    } else {
      boxes.set(lane, entry.box, entry.slab);
      size[lane] = size_of(entry.box);
      lanes |= 1U << lane;
    }
  }
  /// Whether set() would change nothing. Number by number: what was written by number is slow to
  /// read by the word.
  [[nodiscard]] bool holds(std::uint32_t lane, const TreeEntry& entry) const {
    bool same = (lanes >> lane & 1U) != 0 && first[lane] == entry.first &&
                kind_and_count[lane] == entry.kind_and_count &&
                boxes.from[lane] == entry.slab.from && boxes.to[lane] == entry.slab.to;
    for (int k = 0; k < 3; ++k)
      same = same && boxes.lo[k][lane] == entry.box.lo[k] && boxes.hi[k][lane] == entry.box.hi[k] &&
             boxes.normal[k][lane] == entry.slab.normal[static_cast<std::size_t>(k)];
    return same;
  }
};

struct TreeFace {
  std::array<GridPoint, 3> corners;
  FaceKey key;
};

/// Up to eight faces.
struct FaceBlock {
  TriangleLanes triangles;
  std::array<FaceKey, kLanes> keys;

  [[nodiscard]] TreeFace face(std::uint32_t lane) const {
    return {triangles.corners(lane), keys[lane]};
  }
};

/// A read-only view; valid until the tree's next update. The root is lane 0 of node 0.
struct TreeView {
  const Grid* grid = nullptr;
  std::span<const TreeNode> nodes;
  std::span<const FaceBlock> blocks;
  /// Of the progressive model; none for a fixed set of triangles.
  const SplitStore* store = nullptr;
  /// Of the full mesh, for questions about inside and outside; none where the triangles are not
  /// known to be one.
  const SurfaceFacts* surface = nullptr;
  const HalfSpaces* half_spaces = nullptr;  ///< of unresolved nodes; none where there is no store

  [[nodiscard]] TreeEntry root() const { return nodes[0].entry(0); }
  /// Calls visit(TreeEntry) for each part of an inner entry that is not empty.
  template <class Visit>
  void for_each_child(const TreeEntry& inner, const Visit& visit) const {
    const TreeNode& node = nodes[inner.first];
    for (std::uint32_t left = node.lanes; left != 0; left &= left - 1)
      visit(node.entry(static_cast<std::uint32_t>(std::countr_zero(left))));
  }
  /// The faces of an entry of kind kFaces.
  template <class Visit>
  void for_each_face(const TreeEntry& part, const Visit& visit) const {
    for (std::uint32_t i = 0; i < part.count(); ++i) visit(blocks[part.first].face(i));
  }
};

/// A tree over a fixed set of triangles.
struct TriangleTree {
  Grid grid;
  std::vector<TreeNode> nodes;
  std::vector<FaceBlock> blocks;
  /// To be set where the triangles are a model's full mesh and may be asked about inside and
  /// outside.
  std::optional<SurfaceFacts> surface = std::nullopt;
  [[nodiscard]] TreeView view() const {
    return {&grid, nodes, blocks, nullptr, surface ? &*surface : nullptr};
  }
};
/// O(n log n).
[[nodiscard]] TriangleTree build_triangle_tree(const Grid& grid,
                                               const std::vector<TreeFace>& faces);
/// All triangles of the current mesh of a replica, exact or not, with positions.
[[nodiscard]] std::vector<TreeFace> current_triangles(const ActiveMesh& mesh);
/// The tree over a model's full mesh, with the facts about its surface: the reference that
/// certified answers must equal. Nothing where the store lacks a split. O(n log n).
[[nodiscard]] std::optional<TriangleTree> build_full_tree(const SpmHeader& header,
                                                          const SplitStore& store);

}  // namespace nearmesh
