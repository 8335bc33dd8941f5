// SPDX-License-Identifier: Apache-2.0
#include "core/spm/coding_sets.hpp"

#include <gtest/gtest.h>

#include <numeric>

#include "core/bake/count_typical.hpp"
#include "test_models.hpp"

namespace nearmesh {
namespace {

std::uint64_t table_bits(const CodingTables& tables) {
  BitWriter out;
  write_tables(out, tables);
  return out.bit_count();
}

TEST(CodingSets, AreOfThisCodec) {
  ASSERT_GE(coding_set_count(), 1U);
  for (std::uint32_t number = 1; number <= coding_set_count(); ++number) {
    const std::optional<CodingTables> set = coding_set(number);
    ASSERT_TRUE(set) << "set " << number << ": make the sets anew (nearmesh-make-coding-sets)";
    EXPECT_EQ(set->set(), number);
    EXPECT_EQ(set->contexts().size(), static_cast<std::size_t>(coding_context_count()));
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
  const CodingTables chosen = choose_tables(counts, 10);
  ASSERT_NE(chosen.set(), 0U);
  for (std::uint32_t number = 1; number <= coding_set_count(); ++number)
    EXPECT_LE(coded_bits(counts, chosen), coded_bits(counts, *coding_set(number))) << number;
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
  std::uint64_t least = ~std::uint64_t{0};
  for (std::uint32_t number = 1; number <= coding_set_count(); ++number)
    least = std::min(least, coded_bits(counts, *coding_set(number)));
  ASSERT_GT(least, own_bits);
  // So many splits make up for the tables.
  const double even = static_cast<double>(table_bits(own)) * static_cast<double>(records) /
                      static_cast<double>(least - own_bits);
  ASSERT_LT(even * static_cast<double>(own_bits) / static_cast<double>(records),
            8.0 * kChosenForBytes);
  EXPECT_NE(choose_tables(counts, static_cast<std::uint32_t>(0.9 * even)).set(), 0U);
  EXPECT_EQ(choose_tables(counts, static_cast<std::uint32_t>(1.2 * even) + 1).set(), 0U);
}

TEST(ChooseTables, LooksAtNoMoreThanAPeerLoads) {
  // A large model: first just what a set is made for, then ever less so.
  TrainingCounts kin;
  const CodingTables first = coding_set(1).value();
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
    const CodingTables chosen = choose_tables(counts, 1U << 29);
    const std::uint64_t bits = coded_bits(counts, own);
    std::uint64_t least = ~std::uint64_t{0};
    for (std::uint32_t number = 1; number <= coding_set_count(); ++number)
      least = std::min(least, coded_bits(counts, *coding_set(number)));
    const double share = static_cast<double>(least) / static_cast<double>(bits) - 1;
    EXPECT_EQ(chosen.set() != 0,
              share * kChosenForBytes * 8 <= static_cast<double>(table_bits(own)))
        << foreign;
    (chosen.set() != 0 ? was_set : was_own) = true;
  }
  EXPECT_TRUE(was_set);
  EXPECT_TRUE(was_own);
}

}  // namespace
}  // namespace nearmesh
