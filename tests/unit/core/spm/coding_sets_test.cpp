// SPDX-License-Identifier: Apache-2.0
#include "core/spm/coding_sets.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <numeric>

#include "core/bake/count_typical.hpp"
#include "core/spm/set_places.hpp"
#include "nearmesh/core/bake/bake.hpp"
#include "nearmesh/core/mesh/clean.hpp"
#include "nearmesh/core/mesh/generate.hpp"
#include "test_models.hpp"

namespace nearmesh {
namespace {

std::uint64_t table_bits(const CodingTables& tables) {
  BitWriter out;
  write_tables(out, tables);
  return out.bit_count();
}

/// Of one whose coordinates have no factor in common.
constexpr std::array<std::uint8_t, 3> kNoShift{};

std::uint64_t least_bits(const TrainingCounts& counts,
                         const std::array<std::uint8_t, 3>& lattice_shift) {
  std::uint64_t least = ~std::uint64_t{0};
  for (std::uint32_t number = 1; number <= coding_set_count(); ++number)
    for (int scale = CodingSet::kMinScale; scale <= CodingSet::kMaxScale; ++scale)
      least = std::min(least, coded_bits(counts, *coding_set({number, scale}, lattice_shift)));
  return least;
}

TEST(CodingSets, AreOfThisCodec) {
  ASSERT_GE(coding_set_count(), 1U);
  for (std::uint32_t number = 1; number <= coding_set_count(); ++number) {
    const std::optional<CodingTables> set = coding_set({number, 0}, kNoShift);
    ASSERT_TRUE(set) << "set " << number << ": make the sets anew (nearmesh-make-coding-sets)";
    EXPECT_EQ(set->set(), (CodingSet{number, 0}));
    EXPECT_EQ(set->contexts().size(), static_cast<std::size_t>(coding_context_count()));
  }
}

// What is moved is a code of its own: complete, and with the same lengths.
TEST(CodingSets, HaveCompleteCodesAtEveryScale) {
  const auto sorted = [](const HuffmanTable& table) {
    auto lengths = table.lengths;
    std::sort(lengths.begin(), lengths.end());
    return lengths;
  };
  for (std::uint32_t number = 1; number <= coding_set_count(); ++number) {
    const CodingTables home = *coding_set({number, 0}, kNoShift);
    for (int scale = CodingSet::kMinScale; scale <= CodingSet::kMaxScale; ++scale) {
      const std::array<std::uint8_t, 3> shift{0, 31, static_cast<std::uint8_t>(scale & 7)};
      const CodingTables moved = *coding_set({number, scale}, shift);
      const record::SetPlaces places(scale, shift);
      for (int i = 0; i < coding_context_count(); ++i) {
        HuffmanTable table = moved.contexts()[static_cast<std::size_t>(i)];
        EXPECT_TRUE(table.derive()) << number << ' ' << scale << ' ' << i;
        EXPECT_EQ(sorted(table),
                  sorted(home.contexts()[static_cast<std::size_t>(places.context(i))]))
            << number << ' ' << scale << ' ' << i;
      }
    }
  }
}

TEST(SharedTables, AreSharedByModelsOfOneSetScaleAndLattice) {
  SharedTables shared;
  const CodingTables one = *shared.coding_set({1, 3}, kNoShift);
  EXPECT_EQ(shared.coding_set({1, 3}, kNoShift)->fast(), one.fast());
  EXPECT_NE(shared.coding_set({2, 3}, kNoShift)->fast(), one.fast());
  EXPECT_NE(shared.coding_set({1, 4}, kNoShift)->fast(), one.fast());
  EXPECT_NE(shared.coding_set({1, 3}, {1, 0, 0})->fast(), one.fast());
  // It was held all the while.
  EXPECT_EQ(shared.coding_set({1, 3}, kNoShift)->fast(), one.fast());
}

TEST(SharedTables, KeepNoneThatNobodyHolds) {
  SharedTables shared;
  const CodingTables held = *shared.coding_set({1, 3}, kNoShift);
  static_cast<void>(shared.coding_set({1, 4}, kNoShift));
  static_cast<void>(shared.coding_set({1, 5}, kNoShift));
  EXPECT_EQ(shared.count(), 2U);  // the one that is held, and the last
}

// The same mesh on a grid of fewer bits has the same offsets, shorter: a set fits it at another
// scale, and no header carries tables for them.
TEST(CodingSets, FitAMeshOnAnyGrid) {
  const IndexedMesh mesh = generate_sphere(40, 0);
  std::optional<CodingSet> fine;
  for (const int bits : {21, 19, 17, 15}) {
    const CleanResult clean = clean_mesh(mesh, {.grid_bits = bits}).value();
    const BakedModel baked = bake(clean.mesh, clean.report.rounding_error_m, {}).value();
    ASSERT_NE(baked.header.tables.set().number, 0U) << bits;
    if (!fine) fine = baked.header.tables.set();
    const ScaleFit fit = fit_scale(count_typical(baked.header, baked.store),
                                   baked.header.lattice_shift, *set_lengths(fine->number));
    EXPECT_NEAR(fit.scale, fine->scale - (21 - bits), 1) << bits;
  }
}

TEST(CodedBits, AreThoseOfTheRecordsOfABatch) {
  const BakedModel model = test::bake_named("aircraft");
  LocalModel whole(model.store, model.header.grid);
  RefineDelta delta;
  for (const VertexId u : test::all_splits(model.store))
    static_cast<void>(whole.mesh.split(u, delta));
  const Treelet treelet = active_treelet(whole.mesh);
  TrainingCounts counts;
  count_treelet(model.header, model.store, treelet, BoxPolicy::kCutNodes, counts);
  EXPECT_EQ(count_records(counts), treelet.size());
  SpmHeader header = model.header;
  for (const CodingTables& tables : {model.header.tables, make_tables(counts)}) {
    header.tables = tables;
    const auto batches =
        encode_batches(header, model.store, treelet, BoxPolicy::kCutNodes, 1 << 20);
    ASSERT_EQ(batches.size(), 1U);
    // The head names a handful of attach nodes; long shapes and many faces have further bits, which
    // no table changes.
    const double bytes = static_cast<double>(coded_bits(counts, tables)) / 8;
    EXPECT_NEAR(static_cast<double>(batches.front().size()), bytes, 0.05 * bytes);
    EXPECT_GE(static_cast<double>(batches.front().size()), bytes);
  }
}

TEST(ChooseTables, TakesASetWhereNobodyLoadsMuch) {
  const BakedModel model = test::bake_named("aircraft");
  const TrainingCounts counts = count_typical(model.header, model.store);
  const auto& shift = model.header.lattice_shift;
  const CodingTables chosen = choose_tables(counts, shift, 10);
  ASSERT_NE(chosen.set().number, 0U);
  EXPECT_EQ(coded_bits(counts, chosen), least_bits(counts, shift));
}

// Both sides of the rule, near the edge.
TEST(ChooseTables, TakesAModelsOwnWhereTheyAreWorthTheirPlace) {
  // A model whose records are like no other's: all alike in each context.
  TrainingCounts counts(static_cast<std::size_t>(coding_context_count()));
  constexpr std::uint64_t kRecords = 1'000'000;
  for (auto& context : counts) context[100] = kRecords;
  const std::uint64_t records = count_records(counts);
  const CodingTables own = make_tables(counts);
  const std::uint64_t own_bits = coded_bits(counts, own);
  const std::uint64_t least = least_bits(counts, kNoShift);
  ASSERT_GT(least, own_bits);
  // So many splits make up for the tables.
  const double even = static_cast<double>(table_bits(own)) * static_cast<double>(records) /
                      static_cast<double>(least - own_bits);
  ASSERT_LT(even * static_cast<double>(own_bits) / static_cast<double>(records),
            8.0 * kChosenForBytes);
  const auto set_for = [&](double splits) {
    return choose_tables(counts, kNoShift, static_cast<std::uint32_t>(splits)).set().number;
  };
  EXPECT_NE(set_for(0.9 * even), 0U);
  EXPECT_EQ(set_for(1.2 * even + 1), 0U);
}

TEST(ChooseTables, LooksAtNoMoreThanAPeerLoads) {
  // A large model: first just what a set is made for, then ever less so.
  TrainingCounts kin;
  const CodingTables first = *coding_set({1, 0}, kNoShift);
  for (const HuffmanTable& table : first.contexts()) {
    auto& context = kin.emplace_back();
    for (std::size_t symbol = 0; symbol < kSymbolLimit; ++symbol)
      if (const int length = table.codes[symbol].length; length > 0)
        context[symbol] = 1000U << (kMaxCodeBits - length);
  }
  bool was_set = false, was_own = false;
  for (const std::uint64_t foreign : {0, 5, 10, 20, 40, 80, 160}) {
    TrainingCounts counts = kin;
    for (auto& context : counts)
      context[100] +=
          std::accumulate(context.begin(), context.end(), std::uint64_t{0}) * foreign / 1000;
    const CodingTables own = make_tables(counts);
    const CodingTables chosen = choose_tables(counts, kNoShift, 1U << 29);
    const std::uint64_t bits = coded_bits(counts, own);
    const std::uint64_t least = least_bits(counts, kNoShift);
    const double share = static_cast<double>(least) / static_cast<double>(bits) - 1;
    EXPECT_EQ(chosen.set().number != 0,
              share * kChosenForBytes * 8 <= static_cast<double>(table_bits(own)))
        << foreign;
    (chosen.set().number != 0 ? was_set : was_own) = true;
  }
  EXPECT_TRUE(was_set);
  EXPECT_TRUE(was_own);
}

}  // namespace
}  // namespace nearmesh
