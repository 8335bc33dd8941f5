// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/core/spm/detail/coding_tables.hpp"

#include <gtest/gtest.h>

#include "core/base/random.hpp"
#include "core/spm/contexts.hpp"

namespace nearmesh {
namespace {

std::vector<std::uint64_t> random_counts(Random& random) {
  std::vector<std::uint64_t> counts(kSymbolLimit);
  for (std::uint64_t& count : counts)
    if (random.below(3) > 0) count = random.next() >> (24 + random.below(40));
  return counts;
}

TEST(HuffmanTable, EveryCodeDecodesToItsSymbol) {
  for (std::uint64_t seed = 0; seed < 100; ++seed) {
    SCOPED_TRACE(seed);
    Random random(seed);
    const HuffmanTable table = HuffmanTable::from_counts(random_counts(random));
    for (int symbol = 0; symbol <= kSymbolLimit; ++symbol) {
      const HuffmanTable::Code code = table.codes[static_cast<std::size_t>(symbol)];
      if (code.length == 0) continue;
      const auto& found =
          table.decode[static_cast<std::size_t>(code.bits) << (table.decode_bits - code.length)];
      EXPECT_EQ(found.symbol, symbol);
      EXPECT_EQ(found.length, code.length);
    }
  }
}

/// By the next kFastCodeBits bits: every code of no more bits but the escape, and nothing else;
/// with the bits that follow.
TEST(CodingTables, FastTableHoldsTheShortCodesAndNothingElse) {
  Random random(1);
  std::vector<HuffmanTable> contexts;
  for (int i = 0; i < record::kContextCount - 2; ++i)
    contexts.push_back(HuffmanTable::from_counts(random_counts(random)));
  std::vector<std::uint64_t> few(kSymbolLimit);
  few[5] = 1000;
  few[9] = 10;
  contexts.push_back(HuffmanTable::from_counts(few));
  contexts.push_back(HuffmanTable::from_counts(std::vector<std::uint64_t>(kSymbolLimit)));
  const CodingTables tables(contexts);
  for (std::size_t c = 0; c < contexts.size(); ++c)
    for (std::size_t next = 0; next < std::size_t{1} << kFastCodeBits; ++next) {
      const HuffmanTable::Decoded& fast = tables.fast()[(c << kFastCodeBits) + next];
      const std::size_t twelve = next << (kMaxCodeBits - kFastCodeBits);
      const HuffmanTable::Decoded& found =
          contexts[c].decode[twelve >> (kMaxCodeBits - contexts[c].decode_bits)];
      const bool is_short = found.length <= kFastCodeBits && found.symbol != kEscape;
      ASSERT_EQ(fast.symbol, is_short ? found.symbol : kEscape);
      const std::uint32_t tail = record::tail_bits(static_cast<int>(c), found.symbol);
      ASSERT_EQ(fast.length, is_short ? found.length + tail : 0U);
    }
}

TEST(HuffmanTable, NoCodeIsLongerThanTheLimit) {
  std::vector<std::uint64_t> fibonacci(kSymbolLimit);  // the deepest code there is
  std::uint64_t a = 1, b = 1;
  for (std::size_t i = 0; i < 80; ++i) {
    fibonacci[i] = a;
    b = a + b;
    std::swap(a, b);
  }
  const HuffmanTable table = HuffmanTable::from_counts(fibonacci);
  EXPECT_LE(table.decode_bits, kMaxCodeBits);
  for (std::size_t i = 0; i < 80; ++i) EXPECT_GT(table.codes[i].length, 0) << i;
}

TEST(HuffmanTable, EveryContextHasAnEscape) {
  Random random(1);
  const HuffmanTable table = HuffmanTable::from_counts(random_counts(random));
  EXPECT_GT(table.codes[kEscape].length, 0);
}

TEST(HuffmanTable, NothingCountedMeansTheEscapeWithoutABit) {
  const HuffmanTable table = HuffmanTable::from_counts({});
  EXPECT_EQ(table.decode_bits, 0);
  EXPECT_EQ(table.decode[0].symbol, kEscape);
  EXPECT_EQ(table.decode[0].length, 0);
}

TEST(HuffmanTable, DeriveRefusesCodesThatOverlap) {
  HuffmanTable table;
  table.lengths[0] = table.lengths[1] = table.lengths[2] = 1;
  EXPECT_FALSE(table.derive());
}

TEST(HuffmanTable, DeriveRefusesAnIncompleteCode) {
  HuffmanTable table;
  table.lengths[0] = 1;
  table.lengths[1] = 2;
  EXPECT_FALSE(table.derive());
}

TEST(HuffmanTable, DeriveRefusesTooLongACode) {
  HuffmanTable table;
  for (std::size_t i = 0; i < 14; ++i) table.lengths[i] = static_cast<std::uint8_t>(i + 1);
  table.lengths[13] = 13;
  EXPECT_FALSE(table.derive());
}

}  // namespace
}  // namespace nearmesh
