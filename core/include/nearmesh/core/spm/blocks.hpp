// SPDX-License-Identifier: Apache-2.0
#pragma once
// Stored blocks: the forest cut into treelets by node size, each encoded ahead of time with the wire's codec.

#include <vector>

#include "nearmesh/core/spm/codec.hpp"

namespace nearmesh {

/// Level of a node of size >= 2: the k with 64^k < size <= 64^(k+1). A block holds the splits of one level below
/// one maximal node of that level, so a walk from a root to a leaf touches one block a level.
[[nodiscard]] int block_level(std::uint32_t size);
inline constexpr int kMaxBlockLevels = 6;

struct StoredBlock {
  NodeSpan root;
  Treelet treelet;
};

/// All blocks of a complete store, by level, then by first id.
[[nodiscard]] std::vector<std::vector<StoredBlock>> cut_into_blocks(const SplitStore& store);

}  // namespace nearmesh
