// SPDX-License-Identifier: Apache-2.0
#pragma once
// Stored blocks: the forest cut into treelets by node size, each encoded ahead of time with the
// wire's codec.

#include <vector>

#include "nearmesh/core/spm/detail/codec.hpp"

namespace nearmesh {

/// Level of a node of size >= 2: the k with 64^k < size <= 64^(k+1). A block holds the splits of
/// one level below one maximal node of that level, so a walk from a root to a leaf touches one
/// block a level.
[[nodiscard]] int block_level(std::uint32_t size);
inline constexpr int kMaxBlockLevels = 6;

/// Root nodes of all blocks of a complete store, by level, then by first id. Cost: one pass over
/// the ids.
[[nodiscard]] std::vector<NodeSpan> block_roots(const SplitStore& store);
/// The splits of the block below one of them.
[[nodiscard]] Treelet block_treelet(const SplitStore& store, NodeSpan root);

}  // namespace nearmesh
