// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/core/spm/region_words.hpp"

#include <gtest/gtest.h>

#include <limits>

#include "nearmesh/core/base/random.hpp"

namespace nearmesh {
namespace {

std::int32_t below(Random& random, std::int64_t range) {
  return static_cast<std::int32_t>(random.below(static_cast<std::uint32_t>(range)));
}

/// Parts within `range` cells of a place, `range` up to 2^30.
std::vector<RegionPart> random_region(Random& random, std::int64_t range) {
  std::vector<RegionPart> region(1 + random.below(20));
  GridPoint place;
  for (int k = 0; k < 3; ++k) place[k] = below(random, 1LL << 31) - (1 << 30);
  for (RegionPart& part : region) {
    for (int k = 0; k < 3; ++k) {
      part.box.lo[k] = place[k] + below(random, range);
      part.box.hi[k] = static_cast<std::int32_t>(
          std::min<std::int64_t>(std::int64_t{part.box.lo[k]} + below(random, range),
                                 std::numeric_limits<std::int32_t>::max()));
      part.normal[static_cast<std::size_t>(k)] = static_cast<std::int8_t>(below(random, 85) - 42);
    }
    if (random.below(3) == 0) part.normal = {};
    part.radius = random.below(2) == 0 ? 0 : below(random, range);
    part.min_extent = random.below(2) == 0 ? 0 : below(random, range);
    // Around the box's first corner, as far as int32 goes.
    double along = 0;
    for (std::size_t k = 0; k < 3; ++k) along += double{part.normal[k] / 128.0} * part.box.lo.v[k];
    if (part.normal == std::array<std::int8_t, 3>{}) continue;
    part.slab_lo = static_cast<std::int32_t>(along - below(random, range) / 2.0);
    part.slab_hi = static_cast<std::int32_t>(
        std::min<std::int64_t>(std::int64_t{part.slab_lo} + below(random, range),
                               std::numeric_limits<std::int32_t>::max()));
  }
  return region;
}

TEST(RegionWords, CoverWhatWasPackedAndLittleMore) {
  Random random(40);
  for (int i = 0; i < 3000; ++i) {
    const std::int64_t range = std::int64_t{2} << random.below(30);
    const std::vector<RegionPart> region = random_region(random, range);
    for (const RegionPart& part : region) ASSERT_EQ(fault_of(part), nullptr);
    const RegionWords packed = pack_region(region);
    const Result<std::vector<RegionPart>> back = unpack_region(packed);
    ASSERT_TRUE(back.is_ok()) << back.status().message();
    ASSERT_EQ(back.value().size(), region.size());
    const std::int64_t step = std::int64_t{1} << packed.shift;
    EXPECT_LE(step, std::max<std::int64_t>(1, range >> 13));
    for (std::size_t at = 0; at < region.size(); ++at) {
      const RegionPart &part = region[at], &wider = back.value()[at];
      EXPECT_EQ(fault_of(wider), nullptr);
      EXPECT_TRUE(wider.box.contains(part.box));
      for (int k = 0; k < 3; ++k) {
        EXPECT_LT(std::int64_t{part.box.lo[k]} - wider.box.lo[k], step);
        EXPECT_LT(std::int64_t{wider.box.hi[k]} - part.box.hi[k], step);
      }
      EXPECT_GE(wider.radius, part.radius);
      EXPECT_LT(std::int64_t{wider.radius} - part.radius, step);
      EXPECT_LE(wider.min_extent, part.min_extent);
      if (part.min_extent < 0xffff * step) {  // the most that a word holds
        EXPECT_LT(std::int64_t{part.min_extent} - wider.min_extent, step);
      }
      if (wider.normal != part.normal) continue;  // left out; see below
      EXPECT_LE(wider.slab_lo, part.slab_lo);
      EXPECT_GE(wider.slab_hi, part.slab_hi);
      EXPECT_LE(std::int64_t{part.slab_lo} - wider.slab_lo, 2 * step);
      EXPECT_LE(std::int64_t{wider.slab_hi} - part.slab_hi, 2 * step);
    }
    const RegionWords again = pack_region(back.value());
    EXPECT_EQ(again.origin, packed.origin);
    EXPECT_EQ(again.shift, packed.shift);
    EXPECT_EQ(again.words, packed.words);
  }
}

// Nothing that a part meets is lost, whatever became of its slab.
TEST(RegionWords, MeetWhateverThePartsMeet) {
  Random random(41);
  int met = 0, slabs = 0, left_out = 0;
  for (int i = 0; i < 20000; ++i) {
    const std::int64_t range = std::int64_t{2} << random.below(30);
    const std::vector<RegionPart> region = random_region(random, range);
    const std::vector<RegionPart> back = unpack_region(pack_region(region)).value();
    for (std::size_t at = 0; at < region.size(); ++at) {
      GridBox box;
      for (int n = 0; n < 2; ++n) {
        GridPoint p;
        for (int k = 0; k < 3; ++k)
          p[k] = static_cast<std::int32_t>(std::clamp<std::int64_t>(
              std::int64_t{region[at].box.lo[k]} + below(random, 2 * range - 1) - range / 2,
              std::numeric_limits<std::int32_t>::min(), std::numeric_limits<std::int32_t>::max()));
        box.add(p);
      }
      const bool has_slab = region[at].normal != std::array<std::int8_t, 3>{};
      slabs += has_slab ? 1 : 0;
      left_out += has_slab && back[at].normal != region[at].normal ? 1 : 0;
      if (!region[at].asks_for(box)) continue;
      ++met;
      ASSERT_TRUE(back[at].asks_for(box));
    }
  }
  EXPECT_GT(met, 1000);
  EXPECT_LT(left_out, slabs / 20);
}

TEST(RegionWords, TakeTheGreatestNumbers) {
  constexpr std::int32_t kLeast = std::numeric_limits<std::int32_t>::min(),
                         kMost = std::numeric_limits<std::int32_t>::max();
  RegionPart part(GridBox{{kLeast, kLeast, kLeast}, {kMost, kMost, kMost}});
  part.radius = kMaxRegionRadius;
  part.min_extent = kMost;
  part.normal = {0, 0, 127};
  part.slab_lo = kLeast;
  part.slab_hi = kMost;
  const RegionPart back = unpack_region(pack_region({&part, 1})).value()[0];
  EXPECT_EQ(fault_of(back), nullptr);
  EXPECT_EQ(back.box, part.box);
  EXPECT_EQ(back.radius, part.radius);
}

TEST(RegionWords, OfNothingAreNone) {
  EXPECT_TRUE(pack_region({}).words.empty());
  EXPECT_TRUE(unpack_region({}).value().empty());
}

TEST(RegionWords, OutOfRangeAreRefused) {
  RegionPart part(GridBox{{0, 0, 0}, {9, 9, 9}});
  const RegionWords good = pack_region({&part, 1});
  const auto refused = [&](const char* word, const auto& spoil) {
    RegionWords bad = good;
    spoil(bad);
    const auto region = unpack_region(bad);
    ASSERT_FALSE(region.is_ok()) << word;
    EXPECT_NE(region.status().message().find(word), std::string::npos) << region.status().message();
  };
  refused("steps", [](RegionWords& r) { r.shift = kMaxRegionShift + 1; });
  refused("times 12 words", [](RegionWords& r) { r.words.pop_back(); });
  refused("times 12 words",
          [](RegionWords& r) { r.words.resize((kMaxRegionBoxes + 1) * kWordsPerPart); });
  refused("normal", [](RegionWords& r) { r.words[9] = 0x100; });
  refused("beyond 2^31", [](RegionWords& r) {
    r.origin[0] = std::numeric_limits<std::int32_t>::max();
    r.words[0] = 1;
  });
}

}  // namespace
}  // namespace nearmesh
