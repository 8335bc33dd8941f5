// SPDX-License-Identifier: Apache-2.0
#include "core/spm/bits.hpp"

#include <gtest/gtest.h>

#include <algorithm>

#include "core/base/random.hpp"

namespace nearmesh {
namespace {

struct Field {
  std::uint64_t value;
  int bits;  // 0: gamma, 64: put64
};

std::vector<Field> random_fields(Random& random, std::size_t count) {
  std::vector<Field> fields;
  for (std::size_t i = 0; i < count; ++i) {
    const std::uint32_t kind = random.below(4);
    if (kind == 0) {
      fields.push_back({random.next() >> (33 + random.below(31)), 0});
    } else if (kind == 1) {
      fields.push_back({random.next(), 64});
    } else {
      const int bits = 1 + static_cast<int>(random.below(32));
      fields.push_back({random.next() >> (64 - bits), bits});
    }
  }
  return fields;
}

void put(BitWriter& out, const Field& field) {
  if (field.bits == 0) {
    out.put_gamma(field.value);
  } else if (field.bits == 64) {
    out.put64(field.value);
  } else {
    out.put(field.value, field.bits);
  }
}

std::uint64_t get(BitReader& in, const Field& field) {
  if (field.bits == 0) return in.get_gamma();
  return field.bits == 64 ? in.get64() : in.get(field.bits);
}

// Both readers over the same bytes, in fields of random widths, from a random bit on to beyond the
// end.
TEST(WindowReader, ReadsWhatABitReaderReads) {
  for (std::uint64_t seed = 0; seed < 200; ++seed) {
    SCOPED_TRACE(seed);
    Random random(seed);
    std::vector<std::uint8_t> bytes(random.below(40));
    for (std::uint8_t& byte : bytes) byte = static_cast<std::uint8_t>(random.next());
    BitReader expected(bytes);
    expected.skip(static_cast<int>(random.below(static_cast<std::uint32_t>(bytes.size() * 8 + 1))));
    const PaddedBytes padded(bytes);
    WindowReader in(padded, expected.used());
    for (int field = 0; field < 30; ++field) {
      in.refill();
      for (int ready = WindowReader::kReadyBits; ready > 0;) {
        const int bits =
            1 + static_cast<int>(random.below(static_cast<std::uint32_t>(std::min(ready, 32))));
        ASSERT_EQ(in.window() >> (64 - bits), expected.get(bits));
        in.take(static_cast<std::uint64_t>(bits));
        ASSERT_EQ(in.used_bits(), expected.used());
        ready -= bits;
      }
    }
  }
}

TEST(Bits, ReadsBackWhatWasWritten) {
  for (std::uint64_t seed = 0; seed < 200; ++seed) {
    SCOPED_TRACE(seed);
    Random random(seed);
    const std::vector<Field> fields = random_fields(random, 100);
    BitWriter out;
    for (const Field& field : fields) put(out, field);
    const std::vector<std::uint8_t> bytes = std::move(out).finish();
    BitReader in(bytes);
    for (const Field& field : fields) ASSERT_EQ(get(in, field), field.value);
    EXPECT_FALSE(in.overrun());
    EXPECT_LT(in.bits_left(), 8U);
  }
}

TEST(Bits, GammaCarriesTheGreatestValue) {
  BitWriter out;
  out.put_gamma(0xfffffffeU - 1);
  out.put_gamma(0);
  const std::vector<std::uint8_t> bytes = std::move(out).finish();
  BitReader in(bytes);
  EXPECT_EQ(in.get_gamma(), 0xfffffffdU);
  EXPECT_EQ(in.get_gamma(), 0U);
}

TEST(Bits, TruncateTakesBackEverythingAfterTheMark) {
  for (std::uint64_t seed = 0; seed < 200; ++seed) {
    SCOPED_TRACE(seed);
    Random random(seed);
    const std::vector<Field> kept = random_fields(random, 1 + random.below(20));
    const std::vector<Field> taken_back = random_fields(random, 1 + random.below(20));
    const std::vector<Field> after = random_fields(random, 5);
    BitWriter straight, detour;
    for (const Field& field : kept) put(straight, field), put(detour, field);
    const std::size_t mark = detour.bit_count();
    for (const Field& field : taken_back) put(detour, field);
    detour.truncate(mark);
    EXPECT_EQ(detour.bit_count(), mark);
    for (const Field& field : after) put(straight, field), put(detour, field);
    ASSERT_EQ(std::move(detour).finish(), std::move(straight).finish());
  }
}

TEST(Bits, AppendEqualsWritingInOne) {
  for (std::uint64_t seed = 0; seed < 200; ++seed) {
    SCOPED_TRACE(seed);
    Random random(seed);
    const std::vector<Field> first = random_fields(random, random.below(20));
    const std::vector<Field> second = random_fields(random, random.below(20));
    BitWriter one, head, tail;
    for (const Field& field : first) put(one, field), put(head, field);
    for (const Field& field : second) put(one, field), put(tail, field);
    head.append(tail);
    EXPECT_EQ(head.bit_count(), one.bit_count());
    ASSERT_EQ(std::move(head).finish(), std::move(one).finish());
  }
}

TEST(Bits, PeekDoesNotConsume) {
  const std::vector<std::uint8_t> bytes{0xa5, 0x0f};
  BitReader in(bytes);
  EXPECT_EQ(in.peek(4), 0xaU);
  EXPECT_EQ(in.peek(8), 0xa5U);
  EXPECT_EQ(in.bits_left(), 16U);
}

TEST(Bits, ReadingPastTheEndGivesZerosAndIsRemembered) {
  const std::vector<std::uint8_t> bytes{0xff};
  BitReader in(bytes);
  EXPECT_EQ(in.get(16), 0xff00U);
  EXPECT_TRUE(in.overrun());
  EXPECT_EQ(in.bits_left(), 0U);
}

TEST(Bits, PeekingPastTheEndIsNoOverrun) {
  const std::vector<std::uint8_t> bytes{0xff};
  BitReader in(bytes);
  EXPECT_EQ(in.peek(12), 0xff0U);
  in.skip(8);
  EXPECT_FALSE(in.overrun());
}

TEST(Bits, GammaOfEndlessZerosIsAnOverrunNotANumber) {
  const std::vector<std::uint8_t> zeros(64);
  BitReader in(zeros);
  EXPECT_EQ(in.get_gamma(), 0U);
  EXPECT_TRUE(in.overrun());
}

TEST(Bits, GammaAtTheEndOfTheBytesStops) {
  BitReader in({});
  EXPECT_EQ(in.get_gamma(), 0U);
  EXPECT_TRUE(in.overrun());
}

}  // namespace
}  // namespace nearmesh
