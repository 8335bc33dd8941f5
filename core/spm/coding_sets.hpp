// SPDX-License-Identifier: Apache-2.0
#pragma once
// Coding tables that are built in, by number: a header that names a set carries no tables. And how
// tables are written where they are carried.

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "bits.hpp"
#include "nearmesh/core/spm/detail/coding_tables.hpp"

namespace nearmesh {

/// The sets have the numbers 1, 2 and so on; 0 stands for tables that the header carries.
[[nodiscard]] std::uint32_t coding_set_count();
/// All who ask share it. Threads: any. In: 1 to coding_set_count(). None where the data are of
/// another codec: only while that is being changed, until the data are made anew.
[[nodiscard]] std::optional<CodingTables> coding_set(std::uint32_t number);

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
