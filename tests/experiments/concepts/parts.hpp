// SPDX-License-Identifier: Apache-2.0
#pragma once
// What the pictures of the forest, of a slot and of a certificate show, found in the structures
// themselves.

#include <optional>

#include "canvas.hpp"
#include "exchange.hpp"

namespace nearmesh::concepts {

/// A node of the forest, where it stands in the front, and how deep.
struct ForestNode {
  enum class Kind : std::uint8_t {
    kSplit,       ///< above the front
    kExact,       ///< of the front: a vertex that stands for itself alone
    kUnresolved,  ///< of the front
    kBelow,       ///< below the front: not here
  };
  NodeSpan node;
  std::uint32_t depth = 0;
  Kind kind = Kind::kSplit;
  std::optional<std::size_t> parent;  ///< place in the list
};
/// All nodes of the full forest, parents first, as the mesh has split them.
[[nodiscard]] std::vector<ForestNode> forest_of(const SplitStore& full, const ActiveMesh& mesh);

/// An opened slot: the lanes of the node of the tree in which it begins.
struct OpenedSlot {
  NodeSpan node;
  struct Lane {
    TreeEntry entry;
    std::vector<TreeFace> faces;  ///< of a block
  };
  std::vector<Lane> lanes;
};
/// The slots of a replica whose lanes are all blocks of faces or unresolved nodes, both kinds among
/// them.
[[nodiscard]] std::vector<OpenedSlot> open_slots(const Replica& replica);

/// Two parts of which one is an unresolved node, and what proves them apart.
struct ProvedApart {
  Unresolved a, b;  ///< of the ground, of the other body
  int axis = -1;    ///< boxes are apart along it; or
  /// Of a, beyond which all of b's box is, though the boxes meet.
  std::optional<HalfSpace> half_space;
  double gap_m = 0;
};
/// The pair of unresolved nodes with the narrowest gap between boxes, and the one with the
/// narrowest behind a half-space, among gaps that can be seen.
[[nodiscard]] std::optional<ProvedApart> narrowest_boxes(const Exchange& exchange);
[[nodiscard]] std::optional<ProvedApart> narrowest_half_space(const Exchange& exchange);

/// Faces of the full mesh with a vertex in the node.
[[nodiscard]] std::vector<Face> faces_at(const Body& body, NodeSpan node);

/// Two orthogonal unit vectors: how the world is looked at.
struct View {
  Place right, up;
  [[nodiscard]] Point operator()(const Place& p) const {
    return {right[0] * p[0] + right[1] * p[1] + right[2] * p[2],
            up[0] * p[0] + up[1] * p[1] + up[2] * p[2]};
  }
};
/// A box of the body's grid, looked at: the outline, counter-clockwise.
[[nodiscard]] std::vector<Point> outline(const Body& body, const GridBox& box, const View& view);

}  // namespace nearmesh::concepts
