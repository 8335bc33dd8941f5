// SPDX-License-Identifier: Apache-2.0
#pragma once
// What is held of a stored block, against the block itself: the comparison of an audit.

#include <optional>

#include "core/base/digest.hpp"
#include "nearmesh/core/spm/detail/split_store.hpp"

namespace nearmesh {

struct Difference {
  VertexId split;    ///< as it is held
  ContentHash told;  ///< of its record
  /// Of its record in the block; none: the record cuts the block's root in two, and no record of
  /// the content does.
  std::optional<ContentHash> proved;
};

/// What is held and cannot be of a content that has `block` with this root: a split that cuts the
/// root in two, or the first split of the block that is held otherwise. A box that came wider than
/// the block's is none: of a node that came without a box some publishers know an ancestor's alone.
/// So where there is none, a held node about which ModelFile::prove gave the block is one of the
/// block's records. Cost: O(block + roots + depth).
[[nodiscard]] std::optional<Difference> difference(const SplitStore& held, NodeSpan root,
                                                   const SplitBatch& block);

}  // namespace nearmesh
