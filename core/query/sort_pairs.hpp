// SPDX-License-Identifier: Apache-2.0
#pragma once
// The order in which an answer lists its pairs.

#include <vector>

#include "nearmesh/core/query/query.hpp"

namespace nearmesh {

/// Ascending. O(n) where all have most of their bits in common, as those of one query have.
void sort_pairs(std::vector<FacePair>& pairs);

}  // namespace nearmesh
