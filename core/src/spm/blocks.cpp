// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/core/spm/blocks.hpp"

#include <algorithm>
#include <bit>

namespace nearmesh {

int block_level(std::uint32_t size) {
  static_assert(kSlotSize == 64);
  return (std::bit_width(size - 1) + 5) / 6 - 1;
}

std::vector<std::vector<StoredBlock>> cut_into_blocks(const SplitStore& store) {
  std::vector<std::vector<StoredBlock>> levels(kMaxBlockLevels);
  std::vector<NodeSpan> block_roots;
  for (const BaseRoot& root : store.roots())
    if (root.node.size > 1) block_roots.push_back(root.node);
  std::vector<NodeSpan> stack;
  while (!block_roots.empty()) {
    StoredBlock block{block_roots.back(), {}};
    block_roots.pop_back();
    const int level = block_level(block.root.size);
    stack.assign(1, block.root);
    while (!stack.empty()) {
      TreeletSplit split{stack.back(), {}};
      stack.pop_back();
      split.split = store.split_of(split.node);
      NEARMESH_ASSERT(split.split.is_valid());
      const NodeSpan left = split.node.left_of(split.split);
      const NodeSpan right = split.node.right_of(split.split);
      // Right first, so that the left child is taken next: preorder.
      for (const NodeSpan& child : {right, left}) {
        if (child.size < 2) continue;
        if (block_level(child.size) == level) {
          stack.push_back(child);
          (child == left ? split.left_included : split.right_included) = true;
        } else {
          block_roots.push_back(child);
        }
      }
      block.treelet.push_back(split);
    }
    levels[static_cast<std::size_t>(level)].push_back(std::move(block));
  }
  for (auto& level : levels)
    std::sort(level.begin(), level.end(),
              [](const StoredBlock& a, const StoredBlock& b) { return a.root < b.root; });
  return levels;
}

}  // namespace nearmesh
