// SPDX-License-Identifier: Apache-2.0
#pragma once
// How a model's coding tables come about: its own stored blocks and typical requests are counted
// once, while it is baked. By these one of the built-in sets is chosen, or tables are made that the
// header carries.

#include <array>
#include <cstdint>
#include <vector>

#include "coding_sets.hpp"
#include "nearmesh/core/spm/detail/codec.hpp"

namespace nearmesh {

/// By context and symbol.
using TrainingCounts = std::vector<std::array<std::uint64_t, kSymbolLimit>>;

/// Adds what encoding the treelet as one batch would use. header.tables are not read.
void count_treelet(const SpmHeader& header, const SplitStore& store, const Treelet& treelet,
                   BoxPolicy boxes, TrainingCounts& counts);

/// Symbols that are met less than once in so many splits have no code of their own: it takes some
/// six bits of the header, which every peer receives, and without it the symbol takes seven bits
/// more.
inline constexpr std::uint64_t kTableSplits = 20'000;
/// In: counts of coding_context_count() contexts.
[[nodiscard]] CodingTables make_tables(const TrainingCounts& counts,
                                       std::uint64_t table_splits = kTableSplits);

/// How many splits were counted.
[[nodiscard]] std::uint64_t count_records(const TrainingCounts& counts);
/// Bits that coding what was counted takes, with what follows each symbol in any case.
[[nodiscard]] std::uint64_t coded_bits(const TrainingCounts& counts, const CodingTables& tables);

/// At which scale a set codes what was counted in a model of such a lattice best, and in how many
/// bits.
struct ScaleFit {
  int scale = 0;
  std::uint64_t bits = 0;
};
[[nodiscard]] ScaleFit fit_scale(const TrainingCounts& counts,
                                 const std::array<std::uint8_t, 3>& lattice_shift,
                                 const CodeLengths& lengths);

/// A built-in set makes a model's answers larger than its own tables would, and its header smaller
/// by these. A peer that loads so many bytes of answers is to receive the fewest
/// (core/spm/README.md).
inline constexpr std::uint64_t kChosenForBytes = 16'384;
/// The built-in set, at the scale, that codes the counts best; tables of the model's own where they
/// are worth their place in the header. In: what was counted in a model of so many splits: nobody
/// loads more than all of them.
[[nodiscard]] CodingTables choose_tables(const TrainingCounts& counts,
                                         const std::array<std::uint8_t, 3>& lattice_shift,
                                         std::uint32_t split_count);
/// The built-in set alone: for many models of one kind, of which a peer holds headers and tables of
/// several. Own tables only where no set is of this codec.
[[nodiscard]] CodingTables nearest_set(const TrainingCounts& counts,
                                       const std::array<std::uint8_t, 3>& lattice_shift);

/// How many contexts the codec has.
[[nodiscard]] int coding_context_count();

}  // namespace nearmesh
