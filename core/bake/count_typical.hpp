// SPDX-License-Identifier: Apache-2.0
#pragma once
// What a model's batches are made of: what its coding tables are made from, or chosen by.

#include "core/spm/train.hpp"

namespace nearmesh {

/// Counts what stored blocks and typical requests use. In: a complete store; header.tables are not
/// read.
[[nodiscard]] TrainingCounts count_typical(const SpmHeader& header, const SplitStore& store);

}  // namespace nearmesh
