// SPDX-License-Identifier: Apache-2.0
#pragma once
// What is held of a stored block, against the block itself: the comparison of an audit.

#include <optional>

#include "core/base/digest.hpp"
#include "nearmesh/core/spm/detail/split_store.hpp"

namespace nearmesh {

struct Difference {
  VertexId split;
  ContentHash told, proved;  ///< of the split's record, as it is held and as the block has it
};

/// The first split of the block that is held and is another there. A box that came wider than the block's is none: of a node that
/// came without a box some publishers know an ancestor's alone. Cost: O(block).
[[nodiscard]] std::optional<Difference> difference(const SplitStore& held, const SplitBatch& block);

}  // namespace nearmesh
