// SPDX-License-Identifier: Apache-2.0
#include "train.hpp"

#include <algorithm>
#include <limits>
#include <numeric>
#include <optional>
#include <span>
#include <utility>

#include "coding_sets.hpp"
#include "make_record.hpp"
#include "record_codec.hpp"
#include "set_places.hpp"

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

namespace {

/// What was counted, without what was not.
struct Counted {
  int context = 0;
  std::uint32_t symbol = 0;
  std::uint64_t count = 0;
};
std::vector<Counted> all_counted(const TrainingCounts& counts) {
  std::vector<Counted> counted;
  for (std::size_t i = 0; i < counts.size(); ++i)
    for (std::uint32_t symbol = 0; symbol < kSymbolLimit; ++symbol)
      if (counts[i][symbol] > 0)
        counted.push_back({static_cast<int>(i), symbol, counts[i][symbol]});
  return counted;
}

/// Of tables at a scale, which are not made for it. A symbol without a code is written after the
/// escape.
std::uint64_t coded_bits(std::span<const Counted> counted, const CodeLengths& lengths,
                         const record::SetPlaces& places) {
  std::uint64_t bits = 0;
  for (const auto& [context, symbol, count] : counted) {
    const auto& own = lengths[static_cast<std::size_t>(places.context(context))];
    const std::uint32_t code = own[places.symbol(context, symbol)];
    bits += count * ((code != 0 ? code : own[kEscape] + record::kEscapedBits) +
                     record::tail_bits(context, symbol));
  }
  return bits;
}

ScaleFit fit_scale(std::span<const Counted> counted,
                   const std::array<std::uint8_t, 3>& lattice_shift, const CodeLengths& lengths) {
  ScaleFit best{0, std::numeric_limits<std::uint64_t>::max()};
  for (int scale = CodingSet::kMinScale; scale <= CodingSet::kMaxScale; ++scale)
    if (const std::uint64_t bits = coded_bits(counted, lengths, {scale, lattice_shift});
        bits < best.bits)
      best = {scale, bits};
  return best;
}

/// No number where no set is of this codec.
CodingSet find_nearest_set(const TrainingCounts& counts,
                           const std::array<std::uint8_t, 3>& lattice_shift, std::uint64_t& least) {
  const std::vector<Counted> counted = all_counted(counts);
  least = std::numeric_limits<std::uint64_t>::max();
  CodingSet nearest;
  for (std::uint32_t number = 1; number <= coding_set_count(); ++number) {
    const std::optional<CodeLengths>& lengths = set_lengths(number);
    if (!lengths) continue;
    const ScaleFit fit = fit_scale(counted, lattice_shift, *lengths);
    if (fit.bits >= least) continue;
    least = fit.bits;
    nearest = {number, fit.scale};
  }
  return nearest;
}

}  // namespace

std::uint64_t coded_bits(const TrainingCounts& counts, const CodingTables& tables) {
  return coded_bits(all_counted(counts), lengths_of(tables), {0, {}});
}

ScaleFit fit_scale(const TrainingCounts& counts, const std::array<std::uint8_t, 3>& lattice_shift,
                   const CodeLengths& lengths) {
  return fit_scale(all_counted(counts), lattice_shift, lengths);
}

CodingTables nearest_set(const TrainingCounts& counts,
                         const std::array<std::uint8_t, 3>& lattice_shift) {
  std::uint64_t least = 0;
  const CodingSet nearest = find_nearest_set(counts, lattice_shift, least);
  return nearest.number == 0 ? make_tables(counts) : *coding_set(nearest, lattice_shift);
}

CodingTables choose_tables(const TrainingCounts& counts,
                           const std::array<std::uint8_t, 3>& lattice_shift,
                           std::uint32_t split_count) {
  CodingTables own = make_tables(counts);
  const std::uint64_t own_bits = coded_bits(counts, own);
  std::uint64_t least = 0;
  const CodingSet nearest = find_nearest_set(counts, lattice_shift, least);
  if (nearest.number == 0) return own;
  BitWriter written;
  write_tables(written, own);
  // Both sides times own_bits.
  const std::uint64_t whole =
      own_bits * split_count / std::max<std::uint64_t>(count_records(counts), 1);
  const std::uint64_t loaded = std::min(kChosenForBytes * 8, whole);
  const bool is_own_dearer =
      least <= own_bits || (least - own_bits) * loaded <= written.bit_count() * own_bits;
  return is_own_dearer ? *coding_set(nearest, lattice_shift) : own;
}

int coding_context_count() { return record::kContextCount; }

}  // namespace nearmesh
