// SPDX-License-Identifier: Apache-2.0
#pragma once
// How a model's coding tables come about: its own stored blocks and typical requests are counted once, while it is baked.

#include <array>
#include <cstdint>
#include <vector>

#include "nearmesh/core/spm/detail/codec.hpp"

namespace nearmesh {

/// By context and symbol.
using TrainingCounts = std::vector<std::array<std::uint64_t, kSymbolLimit>>;

/// Adds what encoding the treelet as one batch would use. header.tables are not read.
void count_treelet(const SpmHeader& header, const SplitStore& store, const Treelet& treelet,
                   BoxPolicy boxes, TrainingCounts& counts);

/// Symbols that are met less than once in so many splits have no code of their own: it takes some six bits of the header,
/// which every peer receives, and without it the symbol takes seven bits more.
inline constexpr std::uint64_t kTableSplits = 20'000;
/// In: counts of coding_context_count() contexts.
[[nodiscard]] CodingTables make_tables(const TrainingCounts& counts);

/// How many contexts the codec has; a header with another number is refused.
[[nodiscard]] int coding_context_count();

}  // namespace nearmesh
