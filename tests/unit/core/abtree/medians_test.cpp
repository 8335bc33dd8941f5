// SPDX-License-Identifier: Apache-2.0
#include "core/abtree/medians.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <utility>
#include <vector>

#include "core/base/random.hpp"

namespace nearmesh {
namespace {

/// The same by sorting.
std::uint64_t least_by_sorting(const PartCenters& centers, std::uint64_t parts,
                               std::uint32_t count) {
  std::int64_t longest = -1, lowest = 0;
  std::size_t axis = 0;
  for (std::size_t k = 0; k < 3; ++k) {
    std::int64_t lo = INT64_MAX, hi = INT64_MIN;
    for (std::uint32_t i = 0; i < kWordParts; ++i)
      if ((parts >> i & 1U) != 0) {
        lo = std::min<std::int64_t>(lo, centers.axis[k][i]);
        hi = std::max<std::int64_t>(hi, centers.axis[k][i]);
      }
    if (hi - lo <= longest) continue;
    longest = hi - lo;
    lowest = lo;
    axis = k;
  }
  // Centres further apart than 2^25 are told apart by their upper bits.
  const int shift =
      std::max(0, static_cast<int>(std::bit_width(static_cast<std::uint64_t>(longest))) - 25);
  std::vector<std::pair<std::int64_t, std::uint32_t>> order;
  for (std::uint32_t i = 0; i < kWordParts; ++i)
    if ((parts >> i & 1U) != 0) order.emplace_back((centers.axis[axis][i] - lowest) >> shift, i);
  std::sort(order.begin(), order.end());
  std::uint64_t least = 0;
  for (std::uint32_t i = 0; i < count; ++i) least |= std::uint64_t{1} << order[i].second;
  return least;
}

TEST(Medians, LeastPartsAreThoseOfASort) {
  Random random(91);
  for (int i = 0; i < 20000; ++i) {
    SCOPED_TRACE(i);
    PartCenters centers;
    const std::uint32_t bits = 1 + random.below(31);  // few bits: many equal centres
    for (auto& axis : centers.axis)
      for (std::int32_t& center : axis)
        center = static_cast<std::int32_t>(random.below(std::uint32_t{1} << bits)) -
                 (std::int32_t{1} << (bits - 1));
    std::uint64_t parts = 0;
    while (std::popcount(parts) < 2)
      parts = (std::uint64_t{random.below(0xffffffffU)} << 32 | random.below(0xffffffffU)) >>
              random.below(64);
    const std::uint32_t count =
        1 + random.below(static_cast<std::uint32_t>(std::popcount(parts)) - 1);
    ASSERT_EQ(least_parts(centers, parts, count), least_by_sorting(centers, parts, count));
  }
}

TEST(Medians, NthLeastIsTheOneThatSortingFinds) {
  Random random(93);
  for (int i = 0; i < 2000; ++i) {
    // Few different ones, so that some are equal, or all 32 bits; also counts that do not fill a
    // vector.
    const std::uint32_t range = i % 3 == 0 ? 5 : i % 3 == 1 ? 0x7fffffffU : 1U << random.below(31);
    std::vector<std::uint32_t> numbers(1 + random.below(200));
    for (std::uint32_t& x : numbers) {
      x = random.below(range);
      if (i % 3 == 1) x = x << 1 | random.below(2);
    }
    const std::size_t n = random.below(static_cast<std::uint32_t>(numbers.size()));
    std::vector<std::uint32_t> sorted = numbers;
    std::sort(sorted.begin(), sorted.end());
    ASSERT_EQ(nth_least(numbers, n), sorted[n]);
  }
}

TEST(Medians, CentersLieHalfwayOfCorners) {
  Random random(92);
  TriangleLanes triangles;
  for (std::uint32_t lane = 0; lane < kLanes; ++lane) {
    std::array<GridPoint, 3> corners;
    for (GridPoint& corner : corners)
      for (std::int32_t& x : corner.v) x = static_cast<std::int32_t>(random.below(0x7fffffffU));
    triangles.set(lane, corners);
  }
  PartCenters centers{};
  set_centers(triangles, 8, centers);
  for (std::uint32_t lane = 0; lane < kLanes; ++lane) {
    GridBox box;
    for (const GridPoint& corner : triangles.corners(lane)) box.add(corner);
    for (int k = 0; k < 3; ++k)
      EXPECT_EQ(centers.axis[k][8 + lane], (box.lo[k] >> 1) + (box.hi[k] >> 1));
  }
  EXPECT_EQ(centers.axis[0][7], 0);
  EXPECT_EQ(centers.axis[2][16], 0);
}

}  // namespace
}  // namespace nearmesh
