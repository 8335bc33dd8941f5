// SPDX-License-Identifier: Apache-2.0
#pragma once
// The builder shared by micro trees in slots and trees over fixed triangles: median split on the longest axis of the
// centres. A slot has some 130 items, so the split must be cheap rather than clever; measured in ARCHITECTURE.md.

#include <functional>
#include <vector>

#include "nearmesh/core/abtree/tree.hpp"

namespace nearmesh {

inline constexpr std::uint32_t kFacesPerLeaf = 4;

/// What a leaf can hold: a face (index into the caller's faces) or a frontier node.
struct BuildItem {
  GridBox box;
  NodeSpan frontier;  // size 0: a face
  std::uint32_t face = 0;
};

struct BuildOutput {
  TreeNode root;
  std::vector<TreeNode> nodes;  // pairs; children's places count from 0
  std::vector<std::uint32_t>
      faces;  // order in which the caller's faces must stand; places count from 0
};

/// Ties are broken by the items' given order, which must not depend on history. Leaves `items` reordered.
void build_tree(std::vector<BuildItem>& items, BuildOutput& out);

}  // namespace nearmesh
