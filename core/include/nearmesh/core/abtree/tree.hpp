// SPDX-License-Identifier: Apache-2.0
#pragma once
// What the query walks: a binary tree of boxes in one model's grid whose leaves hold exact faces or unresolved nodes.
// AbTree makes one that follows a replica; build_triangle_tree makes one over a fixed set of triangles (the full-mesh
// reference, and the coarse meshes that the uncertified methods test).

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "nearmesh/core/refine/active_mesh.hpp"

namespace nearmesh {

/// 32 bytes. Children and faces are places in the tree's arrays.
struct TreeNode {
  enum class Kind : std::uint32_t {
    kInner,     ///< children at first and first + 1
    kFaces,     ///< exact faces [first, first + count)
    kFrontier,  ///< an unresolved node of the forest: first is its first vertex, count its size
    kEmpty,     ///< resolved, without faces
  };
  GridBox box;
  std::uint32_t first = 0;
  std::uint32_t kind_and_count = static_cast<std::uint32_t>(Kind::kEmpty);

  [[nodiscard]] Kind kind() const { return static_cast<Kind>(kind_and_count & 3U); }
  [[nodiscard]] std::uint32_t count() const { return kind_and_count >> 2; }
  [[nodiscard]] NodeSpan frontier_node() const { return {{first}, count()}; }
  void set(Kind kind, std::uint32_t first_place, std::uint32_t count) {
    first = first_place;
    kind_and_count = static_cast<std::uint32_t>(kind) | count << 2;
  }
};

struct TreeFace {
  std::array<GridPoint, 3> corners;
  FaceKey key;
};

/// A read-only view; valid until the tree's next update.
struct TreeView {
  const Grid* grid = nullptr;
  std::span<const TreeNode> nodes;
  std::span<const TreeFace> faces;
  std::uint32_t root = 0;
  const SplitStore* store =
      nullptr;  ///< of the progressive model; none for a fixed set of triangles
  /// Of the full mesh, for questions about inside and outside; none where the triangles are not known to be one.
  const SurfaceFacts* surface = nullptr;
};

/// A tree over a fixed set of triangles.
struct TriangleTree {
  Grid grid;
  std::vector<TreeNode> nodes;
  std::vector<TreeFace> faces;
  /// To be set where the triangles are a model's full mesh and may be asked about inside and outside.
  std::optional<SurfaceFacts> surface = std::nullopt;
  [[nodiscard]] TreeView view() const {
    return {&grid, nodes, faces, 0, nullptr, surface ? &*surface : nullptr};
  }
};
/// O(n log n). The faces' order changes.
[[nodiscard]] TriangleTree build_triangle_tree(const Grid& grid, std::vector<TreeFace> faces);
/// All triangles of the current mesh of a replica, exact or not, with positions.
[[nodiscard]] std::vector<TreeFace> current_triangles(const ActiveMesh& mesh);
/// The tree over a model's full mesh, with the facts about its surface: the reference that certified answers must equal.
/// Nothing where the store lacks a split. O(n log n).
[[nodiscard]] std::optional<TriangleTree> build_full_tree(const SpmHeader& header,
                                                          const SplitStore& store);

}  // namespace nearmesh
