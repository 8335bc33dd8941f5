// SPDX-License-Identifier: Apache-2.0
#include "blocks.hpp"

#include <algorithm>
#include <array>
#include <bit>

namespace nearmesh {

int block_level(std::uint32_t size) {
  static_assert(kSlotSize == 64);
  return (std::bit_width(size - 1) + 5) / 6 - 1;
}

std::vector<NodeSpan> block_roots(const SplitStore& store) {
  std::array<std::vector<NodeSpan>, kMaxBlockLevels> levels;
  const auto add = [&levels](NodeSpan node) {
    levels[static_cast<std::size_t>(block_level(node.size))].push_back(node);
  };
  for (const BaseRoot& root : store.roots())
    if (root.node.size > 1) add(root.node);
  for (VertexId u{0}; u.value < store.vertex_count(); ++u.value) {
    if (store.is_root(u)) continue;
    const NodeSpan node = store.node_of(u);
    for (const NodeSpan& child : {node.left_of(u), node.right_of(u)})
      if (child.size > 1 && block_level(child.size) != block_level(node.size)) add(child);
  }
  std::vector<NodeSpan> roots;
  for (auto& level : levels) {
    std::sort(level.begin(), level.end());
    roots.insert(roots.end(), level.begin(), level.end());
  }
  return roots;
}

Treelet block_treelet(const SplitStore& store, NodeSpan root) {
  const int level = block_level(root.size);
  Treelet treelet;
  std::vector<NodeSpan> stack{root};
  while (!stack.empty()) {
    TreeletSplit split{stack.back(), {}};
    stack.pop_back();
    split.split = store.split_of(split.node);
    NEARMESH_ASSERT(split.split.is_valid());
    const NodeSpan left = split.node.left_of(split.split);
    const NodeSpan right = split.node.right_of(split.split);
    // Right first, so that the left child is taken next: preorder.
    for (const NodeSpan& child : {right, left}) {
      if (child.size < 2 || block_level(child.size) != level) continue;
      stack.push_back(child);
      (child == left ? split.left_included : split.right_included) = true;
    }
    treelet.push_back(split);
  }
  return treelet;
}

}  // namespace nearmesh
