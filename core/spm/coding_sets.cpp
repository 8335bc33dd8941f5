// SPDX-License-Identifier: Apache-2.0
#include "coding_sets.hpp"

#include <utility>

#include "set_places.hpp"
#include "train.hpp"

namespace nearmesh {
namespace {

// Code lengths of one context: the escape's, 0 for none at all, then symbols in order until the
// code is complete. Present symbols are few, so runs of zeros are counted.
void write_table(BitWriter& out, const HuffmanTable& table) {
  out.put(table.lengths[kEscape], 4);
  std::uint32_t zeros = 0;
  for (const std::uint8_t length : std::span(table.lengths).first(kEscape)) {
    if (length == 0) {
      ++zeros;
      continue;
    }
    out.put_gamma(zeros);
    out.put(length, 4);
    zeros = 0;
  }
}

/// False where it is no prefix code, or not a complete one.
bool read_table(BitReader& in, CodeLengths::value_type& lengths) {
  const auto share = [](std::uint32_t length) { return (1U << kMaxCodeBits) >> length; };
  const std::uint32_t escape = in.get(4);
  if (escape > kMaxCodeBits) return false;
  lengths[kEscape] = static_cast<std::uint8_t>(escape);
  std::uint32_t sum = share(escape);
  for (std::uint64_t symbol = 0; sum < share(0); ++symbol) {
    symbol += in.get_gamma();
    const std::uint32_t length = in.get(4);
    if (in.overrun() || symbol >= kEscape || length == 0 || length > kMaxCodeBits) return false;
    lengths[symbol] = static_cast<std::uint8_t>(length);
    sum += share(length);
  }
  return !in.overrun() && sum == share(0);
}

std::optional<CodeLengths> read_lengths(BitReader& in) {
  CodeLengths lengths(static_cast<std::size_t>(coding_context_count()));
  for (auto& context : lengths)
    if (!read_table(in, context)) return std::nullopt;
  return lengths;
}

/// In: complete prefix codes.
CodingTables make_tables_of(const CodeLengths& lengths, CodingSet set = {}) {
  std::vector<HuffmanTable> contexts(lengths.size());
  for (std::size_t i = 0; i < contexts.size(); ++i) {
    contexts[i].lengths = lengths[i];
    [[maybe_unused]] const bool is_code = contexts[i].derive();
    NEARMESH_ASSERT(is_code);
  }
  return CodingTables(std::move(contexts), set);
}

std::optional<CodeLengths> read_set(std::uint32_t number) {
  std::vector<std::uint8_t> bytes;
  for (const std::uint64_t word : coding_sets_data()[number - 1].words)
    for (int shift = 56; shift >= 0; shift -= 8)
      bytes.push_back(static_cast<std::uint8_t>(word >> shift));
  BitReader in(bytes);
  std::optional<CodeLengths> lengths = read_lengths(in);
  if (in.bits_left() >= 64) return std::nullopt;
  return lengths;
}

// A constant each, read where it is first asked for.
template <std::uint32_t kNumber>
const std::optional<CodeLengths>& constant_set() {
  // A constant, and the check for global state knows those by their names.
  // NOLINTNEXTLINE(readability-identifier-naming)
  static const std::optional<CodeLengths> kSet = read_set(kNumber);
  return kSet;
}

using ConstantSet = const std::optional<CodeLengths>& (*)();
constexpr std::uint32_t kMostSets = 32;

template <std::uint32_t... kBefore>
constexpr std::array<ConstantSet, kMostSets> constant_sets(
    std::integer_sequence<std::uint32_t, kBefore...>) {
  return {constant_set<kBefore + 1>...};
}

}  // namespace

const std::optional<CodeLengths>& set_lengths(std::uint32_t number) {
  NEARMESH_ASSERT(number >= 1 && number <= coding_set_count() && number <= kMostSets);
  static constexpr std::array kSets =
      constant_sets(std::make_integer_sequence<std::uint32_t, kMostSets>());
  return kSets[number - 1]();
}

std::optional<CodingTables> coding_set(CodingSet set,
                                       const std::array<std::uint8_t, 3>& lattice_shift) {
  NEARMESH_ASSERT(set.scale >= CodingSet::kMinScale && set.scale <= CodingSet::kMaxScale);
  const std::optional<CodeLengths>& lengths = set_lengths(set.number);
  if (!lengths) return std::nullopt;
  const record::SetPlaces places(set.scale, lattice_shift);
  CodeLengths moved(lengths->size());
  for (int i = 0; i < static_cast<int>(moved.size()); ++i) {
    auto& context = moved[static_cast<std::size_t>(i)];
    const auto& own = (*lengths)[static_cast<std::size_t>(places.context(i))];
    context[kEscape] = own[kEscape];
    for (std::uint32_t symbol = 0; symbol < kSymbolLimit; ++symbol)
      context[symbol] = own[places.symbol(i, symbol)];
  }
  return make_tables_of(moved, set);
}

std::optional<CodingTables> SharedTables::coding_set(
    CodingSet set, const std::array<std::uint8_t, 3>& lattice_shift) {
  const std::pair key{set, lattice_shift};
  if (const auto found = tables_.find(key); found != tables_.end()) return found->second;
  std::erase_if(tables_, [](const auto& tables) { return !tables.second.is_shared(); });
  const std::optional<CodingTables> made = nearmesh::coding_set(set, lattice_shift);
  if (made) tables_.emplace(key, *made);
  return made;
}

void write_tables(BitWriter& out, const CodingTables& tables) {
  for (const HuffmanTable& table : tables.contexts()) write_table(out, table);
}

std::optional<CodingTables> read_tables(BitReader& in) {
  const std::optional<CodeLengths> lengths = read_lengths(in);
  return lengths ? std::optional(make_tables_of(*lengths)) : std::nullopt;
}

CodeLengths lengths_of(const CodingTables& tables) {
  CodeLengths lengths;
  for (const HuffmanTable& table : tables.contexts()) lengths.push_back(table.lengths);
  return lengths;
}

std::uint32_t coding_set_count() { return static_cast<std::uint32_t>(coding_sets_data().size()); }

}  // namespace nearmesh
