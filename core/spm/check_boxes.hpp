// SPDX-License-Identifier: Apache-2.0
#pragma once
// Whether a model keeps the promise that every certified answer rests on: each node's box encloses
// every face that has a corner in the node (core/THEOREM.md). Who builds or serves a model asks
// once; a peer cannot, since it holds a part.

#include "nearmesh/core/spm/detail/split_store.hpp"

namespace nearmesh {

/// In: a store that knows every split. Cost: O(vertices + faces), 24 bytes a vertex meanwhile.
/// Errors: kCorrupt naming a node whose box leaves out a face.
[[nodiscard]] Status check_boxes(const SplitStore& store);

}  // namespace nearmesh
