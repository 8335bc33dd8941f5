// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cmath>

#include "core/base/random.hpp"
#include "nearmesh/core/spm/detail/split_store.hpp"

namespace nearmesh {
namespace {

constexpr std::int64_t kGreatest = 0x7fffffff;

TEST(BoxExtent, NeverDecreasesWithTheCode) {
  for (int code = 1; code <= kMaxExtentCode; ++code)
    EXPECT_GE(box_extent(static_cast<std::uint8_t>(code)),
              box_extent(static_cast<std::uint8_t>(code - 1)));
}

TEST(BoxExtent, IsTheSmallestIntegerThatTheFormatStates) {
  for (int code = 0; code <= kMaxExtentCode; ++code) {
    const long double exact = std::exp2(static_cast<long double>(code) / 4) - 1;
    EXPECT_EQ(box_extent(static_cast<std::uint8_t>(code)),
              static_cast<std::int64_t>(std::ceil(exact)))
        << code;
  }
}

TEST(BoxExtent, GreatestCodeCoversTheGreatestGrid) {
  EXPECT_GE(box_extent(kMaxExtentCode), kGreatest);
}

void expect_tightest(std::int64_t x) {
  const std::uint8_t code = box_extent_code(x);
  ASSERT_LE(code, kMaxExtentCode) << x;
  EXPECT_GE(box_extent(code), x);
  if (code > 0) {
    EXPECT_LT(box_extent(static_cast<std::uint8_t>(code - 1)), x);
  }
}

TEST(BoxExtentCode, IsTheTightestThatEnclosesNearEveryBorder) {
  for (int code = 0; code <= kMaxExtentCode; ++code)
    for (int off = -3; off <= 3; ++off) {
      const std::int64_t x = box_extent(static_cast<std::uint8_t>(code)) + off;
      if (x >= 0 && x <= kGreatest) expect_tightest(x);
    }
}

TEST(BoxExtentCode, IsTheTightestThatEnclosesAnyNumber) {
  Random random(1);
  for (int i = 0; i < 20000; ++i)
    expect_tightest(static_cast<std::int64_t>(random.next() >> (33 + random.below(31))));
}

TEST(EncodeBox, DecodedBoxEnclosesTheBox) {
  Random random(2);
  for (int i = 0; i < 5000; ++i) {
    GridPoint at;
    GridBox box;
    for (int k = 0; k < 3; ++k)
      at[k] = static_cast<std::int32_t>(random.next() >> (33 + random.below(31)));
    box.add(at);
    for (int corner = 0; corner < 2; ++corner) {
      GridPoint p;
      for (int k = 0; k < 3; ++k)
        p[k] = static_cast<std::int32_t>(random.next() >> (33 + random.below(31)));
      box.add(p);
    }
    const BoxCode code = encode_box(at, box);
    for (int k = 0; k < 3; ++k) {
      ASSERT_LE(at[k] - box_extent(code[2 * static_cast<std::size_t>(k)]), box.lo[k]) << i;
      ASSERT_GE(at[k] + box_extent(code[2 * static_cast<std::size_t>(k) + 1]), box.hi[k]) << i;
    }
  }
}

}  // namespace
}  // namespace nearmesh
