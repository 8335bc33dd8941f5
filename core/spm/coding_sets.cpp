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

bool read_table(BitReader& in, HuffmanTable& table) {
  const auto share = [](std::uint32_t length) { return (1U << kMaxCodeBits) >> length; };
  const std::uint32_t escape = in.get(4);
  table.lengths[kEscape] = static_cast<std::uint8_t>(escape);
  std::uint32_t sum = share(escape);
  for (std::uint64_t symbol = 0; sum < share(0); ++symbol) {
    symbol += in.get_gamma();
    const std::uint32_t length = in.get(4);
    if (in.overrun() || symbol >= kEscape || length == 0 || length > kMaxCodeBits) return false;
    table.lengths[symbol] = static_cast<std::uint8_t>(length);
    sum += share(length);
  }
  return !in.overrun() && table.derive();
}

std::optional<std::vector<HuffmanTable>> read_contexts(BitReader& in) {
  std::vector<HuffmanTable> contexts(static_cast<std::size_t>(coding_context_count()));
  for (HuffmanTable& table : contexts)
    if (!read_table(in, table)) return std::nullopt;
  return contexts;
}

std::optional<CodeLengths> read_set(std::uint32_t number) {
  std::vector<std::uint8_t> bytes;
  for (const std::uint64_t word : coding_sets_data()[number - 1].words)
    for (int shift = 56; shift >= 0; shift -= 8)
      bytes.push_back(static_cast<std::uint8_t>(word >> shift));
  BitReader in(bytes);
  const std::optional<std::vector<HuffmanTable>> contexts = read_contexts(in);
  if (!contexts || in.bits_left() >= 64) return std::nullopt;
  CodeLengths lengths;
  for (const HuffmanTable& table : *contexts) lengths.push_back(table.lengths);
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

CodingTables make_tables_of(CodingSet set, const CodeLengths& lengths,
                            const std::array<std::uint8_t, 3>& lattice_shift) {
  const record::SetPlaces places(set.scale, lattice_shift);
  std::vector<HuffmanTable> contexts(lengths.size());
  for (int i = 0; i < static_cast<int>(contexts.size()); ++i) {
    HuffmanTable& table = contexts[static_cast<std::size_t>(i)];
    const auto& own = lengths[static_cast<std::size_t>(places.context(i))];
    table.lengths[kEscape] = own[kEscape];
    for (std::uint32_t symbol = 0; symbol < kSymbolLimit; ++symbol)
      table.lengths[symbol] = own[places.symbol(i, symbol)];
    static_cast<void>(table.derive());
  }
  return CodingTables(std::move(contexts), set);
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
  return lengths ? std::optional(make_tables_of(set, *lengths, lattice_shift)) : std::nullopt;
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
  std::optional<std::vector<HuffmanTable>> contexts = read_contexts(in);
  if (!contexts) return std::nullopt;
  return CodingTables(*std::move(contexts));
}

std::uint32_t coding_set_count() { return static_cast<std::uint32_t>(coding_sets_data().size()); }

}  // namespace nearmesh
