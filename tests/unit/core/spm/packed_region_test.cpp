// SPDX-License-Identifier: Apache-2.0
#include "core/spm/packed_region.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "core/base/random.hpp"
#include "nearmesh/core/spm/detail/split_store.hpp"

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

TEST(PackedRegion, CoversWhatWasPackedAndLittleMore) {
  Random random(40);
  for (int i = 0; i < 3000; ++i) {
    const std::int64_t range = std::int64_t{2} << random.below(30);
    const std::vector<RegionPart> region = random_region(random, range);
    for (const RegionPart& part : region) ASSERT_EQ(fault_of(part), nullptr);
    const PackedRegion packed = pack_region(region);
    const Result<std::vector<RegionPart>> back = unpack_region(packed);
    ASSERT_TRUE(back.is_ok()) << back.status().message();
    ASSERT_EQ(back.value().size(), region.size());
    const std::int64_t step = std::int64_t{1} << packed.shift;
    EXPECT_LE(step, std::max<std::int64_t>(1, range >> 13));
    for (std::size_t at = 0; at < region.size(); ++at) {
      const RegionPart &part = region[at], &wider = back.value()[at];
      EXPECT_EQ(fault_of(wider), nullptr);
      EXPECT_TRUE(wider.box.contains(part.box));
      std::int64_t greatest = 0;
      for (int k = 0; k < 3; ++k)
        greatest = std::max(greatest, std::int64_t{part.box.hi[k]} - part.box.lo[k]);
      for (int k = 0; k < 3; ++k) {
        EXPECT_LT(std::int64_t{part.box.lo[k]} - wider.box.lo[k], step);
        EXPECT_LE(std::int64_t{wider.box.hi[k]} - part.box.hi[k], greatest / 127 + 3 * step);
      }
      EXPECT_GE(wider.radius, part.radius);
      EXPECT_LE(std::int64_t{wider.radius} - part.radius, packed.radius * step / 255 + 2 * step);
      EXPECT_LE(wider.min_extent, part.min_extent);
      EXPECT_GT(box_extent(box_extent_code(std::int64_t{wider.min_extent} + 1)), part.min_extent);
      EXPECT_EQ(wider.normal, part.normal);
    }
    const PackedRegion again = pack_region(back.value());
    EXPECT_EQ(again.origin, packed.origin);
    EXPECT_EQ(again.shift, packed.shift);
    EXPECT_EQ(again.radius, packed.radius);
    EXPECT_EQ(again.parts, packed.parts);
  }
}

// Along its normal a slab gains no more than a 255th of its box; what of it is beyond box and
// radius is cut.
TEST(PackedRegion, HoldsSlabsTightly) {
  Random random(42);
  int tight = 0;
  for (int i = 0; i < 3000; ++i) {
    const std::vector<RegionPart> region =
        random_region(random, std::int64_t{2} << random.below(30));
    std::vector<RegionPart> uncut = region;
    for (RegionPart& part : uncut) {
      part.slab_lo = std::numeric_limits<std::int32_t>::min();
      part.slab_hi = std::numeric_limits<std::int32_t>::max();
    }
    const PackedRegion packed = pack_region(region);
    const std::vector<RegionPart> back = unpack_region(packed).value();
    const std::vector<RegionPart> whole = unpack_region(pack_region(uncut)).value();
    for (std::size_t at = 0; at < region.size(); ++at) {
      const RegionPart &part = region[at], &wider = back[at];
      double most = 2;
      for (int k = 0; k < 3; ++k)
        most += std::abs(wider.normal[static_cast<std::size_t>(k)]) / 128.0 *
                (double{0} + wider.box.hi[k] - wider.box.lo[k]) / 255;
      EXPECT_LE(wider.slab_lo, std::max(part.slab_lo, whole[at].slab_lo));
      EXPECT_GE(wider.slab_hi, std::min(part.slab_hi, whole[at].slab_hi));
      const std::uint8_t* slab = &packed.parts[at * kBytesPerPart + 13];
      if (slab[0] > 0 && slab[0] < 255) {
        ++tight;
        EXPECT_LE(double{0} + part.slab_lo - wider.slab_lo, most);
      }
      if (slab[1] > 0 && slab[1] < 255) {
        ++tight;
        EXPECT_LE(double{0} + wider.slab_hi - part.slab_hi, most);
      }
    }
  }
  EXPECT_GT(tight, 5000);
}

// No point of a part is lost, whatever became of its slab: so nothing that the part meets is.
TEST(PackedRegion, HasEveryPointOfItsParts) {
  Random random(41);
  int inside = 0, cut = 0;
  for (int i = 0; i < 20000; ++i) {
    const std::int64_t range = std::int64_t{2} << random.below(30);
    const std::vector<RegionPart> region = random_region(random, range);
    const std::vector<RegionPart> back = unpack_region(pack_region(region)).value();
    for (std::size_t at = 0; at < region.size(); ++at) {
      GridPoint p;
      for (int k = 0; k < 3; ++k)
        p[k] = static_cast<std::int32_t>(std::clamp<std::int64_t>(
            std::int64_t{region[at].box.lo[k]} + below(random, 2 * range - 1) - range / 2,
            std::numeric_limits<std::int32_t>::min(), std::numeric_limits<std::int32_t>::max()));
      const GridBox point{p, p};
      if (region[at].meets(point)) {
        ++inside;
        ASSERT_TRUE(back[at].meets(point));
      }
      RegionPart whole = back[at];
      whole.normal = {};
      whole.slab_lo = whole.slab_hi = 0;
      cut += whole.meets(point) && !back[at].meets(point) ? 1 : 0;
    }
  }
  EXPECT_GT(inside, 1000);
  EXPECT_GT(cut, 1000);
}

TEST(PackedRegion, TakeTheGreatestNumbers) {
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

TEST(PackedRegion, OfNothingAreNone) {
  EXPECT_TRUE(pack_region({}).parts.empty());
  EXPECT_TRUE(unpack_region({}).value().empty());
}

TEST(PackedRegion, OutOfRangeAreRefused) {
  RegionPart part(GridBox{{0, 0, 0}, {9, 9, 9}});
  const PackedRegion good = pack_region({&part, 1});
  const auto refused = [&](const char* word, const auto& spoil) {
    PackedRegion bad = good;
    spoil(bad);
    const auto region = unpack_region(bad);
    ASSERT_FALSE(region.is_ok()) << word;
    EXPECT_NE(region.status().message().find(word), std::string::npos) << region.status().message();
  };
  refused("steps", [](PackedRegion& r) { r.shift = kMaxRegionShift + 1; });
  refused("times 17 bytes", [](PackedRegion& r) { r.parts.pop_back(); });
  refused("times 17 bytes",
          [](PackedRegion& r) { r.parts.resize((kMaxRegionBoxes + 1) * kBytesPerPart); });
  refused("size of box 0", [](PackedRegion& r) { r.parts[9] = kMaxSizeShift + 1; });
  refused("least extent of box 0", [](PackedRegion& r) { r.parts[16] = kMaxExtentCode + 1; });
  refused("beyond 2^31", [](PackedRegion& r) {
    r.origin[0] = std::numeric_limits<std::int32_t>::max();
    r.parts[0] = 1;
  });
}

}  // namespace
}  // namespace nearmesh
