// SPDX-License-Identifier: Apache-2.0
#include "train.hpp"

#include <algorithm>
#include <limits>
#include <numeric>
#include <optional>
#include <utility>

#include "coding_sets.hpp"
#include "make_record.hpp"
#include "record_codec.hpp"

namespace nearmesh {

void count_treelet(const SpmHeader& header, const SplitStore& store, const Treelet& treelet,
                   BoxPolicy boxes, TrainingCounts& counts) {
  counts.resize(record::kContextCount);
  record::CountingCoder coder(counts);
  record::OpenEdges edges;
  std::vector<SplitFace> faces;
  for (const TreeletSplit& split : treelet) {
    faces.clear();
    SplitRecord record = make_record(store, split, faces);
    record::Inclusion included{split.left_included, split.right_included};
    record::code_record(coder, header, boxes, edges, record, included, faces);
  }
}

std::uint64_t count_records(const TrainingCounts& counts) {
  // Each record has one symbol in these contexts.
  std::uint64_t records = 0;
  for (std::size_t i = record::kOffset0; i < record::kOffset1; ++i)
    records += std::accumulate(counts[i].begin(), counts[i].end(), std::uint64_t{0});
  return records;
}

CodingTables make_tables(const TrainingCounts& counts, std::uint64_t table_splits) {
  const std::uint64_t records = count_records(counts);
  std::vector<HuffmanTable> contexts;
  for (auto context : counts) {
    std::uint64_t escapes = 0;
    for (std::uint64_t& count : context)
      if (count * table_splits < records) escapes += std::exchange(count, 0);
    contexts.push_back(HuffmanTable::from_counts(context, escapes));
  }
  return CodingTables(std::move(contexts));
}

std::uint64_t coded_bits(const TrainingCounts& counts, const CodingTables& tables) {
  std::uint64_t bits = 0;
  for (std::size_t i = 0; i < counts.size(); ++i) {
    const HuffmanTable& table = tables.contexts()[i];
    for (std::uint32_t symbol = 0; symbol < kSymbolLimit; ++symbol) {
      const std::uint32_t own = table.codes[symbol].length;
      const std::uint32_t code =
          own != 0 ? own : table.codes[kEscape].length + record::kEscapedBits;
      bits += counts[i][symbol] * (code + record::tail_bits(static_cast<int>(i), symbol));
    }
  }
  return bits;
}

namespace {

/// Of no number where no set is of this codec.
CodingTables find_nearest_set(const TrainingCounts& counts, std::uint64_t& least) {
  least = std::numeric_limits<std::uint64_t>::max();
  CodingTables nearest;
  for (std::uint32_t number = 1; number <= coding_set_count(); ++number) {
    const std::optional<CodingTables> set = coding_set(number);
    if (!set) continue;
    if (const std::uint64_t bits = coded_bits(counts, *set); bits < least) {
      least = bits;
      nearest = *set;
    }
  }
  return nearest;
}

}  // namespace

CodingTables nearest_set(const TrainingCounts& counts) {
  std::uint64_t least = 0;
  CodingTables nearest = find_nearest_set(counts, least);
  return nearest.set() == 0 ? make_tables(counts) : nearest;
}

CodingTables choose_tables(const TrainingCounts& counts, std::uint32_t split_count) {
  CodingTables own = make_tables(counts);
  const std::uint64_t own_bits = coded_bits(counts, own);
  std::uint64_t least = 0;
  CodingTables nearest = find_nearest_set(counts, least);
  if (nearest.set() == 0) return own;
  BitWriter written;
  write_tables(written, own);
  // Both sides times own_bits.
  const std::uint64_t whole =
      own_bits * split_count / std::max<std::uint64_t>(count_records(counts), 1);
  const std::uint64_t loaded = std::min(kChosenForBytes * 8, whole);
  const bool is_own_dearer =
      least <= own_bits || (least - own_bits) * loaded <= written.bit_count() * own_bits;
  return is_own_dearer ? nearest : own;
}

int coding_context_count() { return record::kContextCount; }

}  // namespace nearmesh
