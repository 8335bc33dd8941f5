// SPDX-License-Identifier: Apache-2.0
#pragma once
// Whether a model's header says the truth of its surface: the open edges and the parts, on which
// "inside" and "contained" rest
//. Who builds or serves a model asks once; a peer cannot, since it holds a part.

#include "nearmesh/core/spm/detail/split_store.hpp"

namespace nearmesh {

/// In: a store that knows every split. Cost: O(vertices + faces), 70 bytes a vertex meanwhile.
/// Errors: kCorrupt with what the header says and what the faces give.
[[nodiscard]] Status check_surface(const SplitStore& store);

}  // namespace nearmesh
