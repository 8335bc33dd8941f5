// SPDX-License-Identifier: Apache-2.0
#pragma once
// Coding tables that are built in, by number: a header that names a set carries no tables. And how
// tables are written where they are carried.

#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "bits.hpp"
#include "nearmesh/core/spm/detail/coding_tables.hpp"

namespace nearmesh {

/// The sets have the numbers 1, 2 and so on; 0 stands for tables that the header carries.
[[nodiscard]] std::uint32_t coding_set_count();
/// By context and symbol, the escape last; 0 where a symbol has no code.
using CodeLengths = std::vector<std::array<std::uint8_t, kSymbolLimit + 1>>;
[[nodiscard]] CodeLengths lengths_of(const CodingTables& tables);
/// A set's own. Threads: any. In: 1 to coding_set_count(). None where the data are of another
/// codec: only while that is being changed, until the data are made anew.
[[nodiscard]] const std::optional<CodeLengths>& set_lengths(std::uint32_t number);
/// The tables of a set at a scale, for models with such a lattice (SpmHeader::lattice_shift).
/// Threads: any. In: a set with a number from 1 to coding_set_count() and a scale within
/// CodingSet's. None: as for set_lengths(). Cost: some 700 KB, and a millisecond or two.
[[nodiscard]] std::optional<CodingTables> coding_set(
    CodingSet set, const std::array<std::uint8_t, 3>& lattice_shift);

/// For who holds many models, as of the tiles of a world: those of one set, scale and lattice share
/// their tables. Keeps what one of them holds. Threads: one at a time.
class SharedTables {
 public:
  /// As the function of that name.
  [[nodiscard]] std::optional<CodingTables> coding_set(
      CodingSet set, const std::array<std::uint8_t, 3>& lattice_shift);
  [[nodiscard]] std::size_t count() const { return tables_.size(); }

 private:
  std::map<std::pair<CodingSet, std::array<std::uint8_t, 3>>, CodingTables> tables_;
};

/// All contexts' code lengths.
void write_tables(BitWriter& out, const CodingTables& tables);
/// None where these are not prefix codes.
[[nodiscard]] std::optional<CodingTables> read_tables(BitReader& in);

/// One built-in set, as write_tables() writes it, in words of which the most significant bit comes
/// first.
struct CodingSetData {
  const char* name;
  std::span<const std::uint64_t> words;
};
/// Made by nearmesh-make-coding-sets: coding_sets_data.cpp.
[[nodiscard]] std::span<const CodingSetData> coding_sets_data();

}  // namespace nearmesh
