// SPDX-License-Identifier: Apache-2.0
#pragma once
// The builder shared by micro trees in slots and trees over fixed triangles: faces are cut into
// blocks of up to eight, blocks and unresolved nodes into nodes of up to eight lanes, each time by
// medians along the longest axis of the centres, so that blocks and the lowest nodes are nearly
// full. A slot that changes has some 20 faces, so the cut must be cheap rather than clever;
// measured in ARCHITECTURE.md.

#include <vector>

#include "nearmesh/core/abtree/detail/tree_pages.hpp"

namespace nearmesh {

/// The entry of an inner node: a box and a slab around all its lanes; both empty where all lanes
/// are.
[[nodiscard]] TreeEntry inner_entry(const TreePages<TreeNode>& nodes, std::uint32_t place);

/// Builds one tree after another, keeping its memory.
/// The tree depends on the order in which faces and nodes are added, which must not depend on
/// history.
class TreeBuilder {
 public:
  void clear();
  /// Room for the faces to be: face i is to be set in lane i % kLanes of block i / kLanes.
  [[nodiscard]] FaceBlock* add_faces(std::size_t count) {
    face_count_ = count;
    if (faces_.size() * kLanes < count) faces_.resize(2 * ((count + kLanes - 1) / kLanes));
    return faces_.data();
  }
  void add_unresolved(NodeSpan node, const GridBox& box, const Slab& slab = {});
  /// Makes the tree in place, parents before children, and returns its root, but for its box and
  /// slab if that is an inner entry: inner_entry() finds them, and sooner when what was written
  /// here has had time to reach the cache.
  [[nodiscard]] TreeEntry build(TreeArrays& arrays);

 private:
  /// A part to be placed: a face, a block or an unresolved node.
  struct Part {
    std::array<std::int32_t, 3> center;  // by halves, so that it fits
    std::uint32_t index;
  };
  void divide(std::span<Part> parts, std::size_t middle);
  template <class Emit>
  void cut(std::span<Part> parts, std::size_t groups, const Emit& emit);
  void cut_faces(TreePages<FaceBlock>& blocks);
  void add_block(std::span<const Part> parts, TreePages<FaceBlock>& blocks);
  TreeEntry make_entry(std::span<Part> parts, TreePlace place, TreePages<TreeNode>& nodes);

  std::size_t face_count_ = 0;
  std::vector<FaceBlock> faces_;  // the first so many
  std::vector<TreeEntry> lanes_;
  // Nodes but for the top, and where they hang.
  std::vector<std::pair<std::uint32_t, TreePlace>> inner_;
  std::vector<Part> parts_, right_parts_;
  std::vector<std::uint32_t> offsets_;
};

}  // namespace nearmesh
