// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/core/spm/detail/half_space.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <set>

#include "core/base/random.hpp"

namespace nearmesh {
namespace {

constexpr std::uint32_t kDirections = 1U << kDirectionBits;

double length(const std::array<std::int8_t, 3>& n) {
  return std::sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
}

TEST(HalfSpaceNormal, IsAboutAsLongAsThoseOfSlabs) {
  for (std::uint32_t code = 0; code < kDirections; ++code)
    EXPECT_NEAR(length(half_space_normal(static_cast<std::uint16_t>(code))), 127, 0.9) << code;
}

TEST(HalfSpaceNormal, EachDirectionHasOneWithinThreeDegrees) {
  Random random(3);
  for (int i = 0; i < 100'000; ++i) {
    std::array<double, 3> v{};
    for (double& x : v) x = random.between(-1, 1);
    if (i % 7 == 0) v[random.below(3)] = 0;
    const double size = std::sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
    if (size < 1e-3) continue;
    const auto n = half_space_normal(nearest_direction(v));
    const double cosine = (n[0] * v[0] + n[1] * v[1] + n[2] * v[2]) / size / length(n);
    ASSERT_GT(cosine, std::cos(3 * 3.14159 / 180)) << v[0] << ' ' << v[1] << ' ' << v[2];
  }
}

TEST(HalfSpaceNormal, NearestOfANormalHasThatNormal) {
  for (std::uint32_t code = 0; code < kDirections; ++code) {
    const auto n = half_space_normal(static_cast<std::uint16_t>(code));
    const std::array<double, 3> v{double(n[0]), double(n[1]), double(n[2])};
    EXPECT_EQ(half_space_normal(nearest_direction(v)), n) << code;
  }
}

// Integers alone, so that these stand for every machine.
TEST(HalfSpaceNormal, SomeAsTheFormatStates) {
  using Normal = std::array<std::int8_t, 3>;
  EXPECT_EQ(half_space_normal(0), (Normal{0, 0, -127}));
  EXPECT_EQ(half_space_normal(31 * 64 + 31), (Normal{-2, -2, 127}));
  EXPECT_EQ(half_space_normal(63 * 64 + 32), (Normal{127, 0, -2}));
  EXPECT_EQ(half_space_normal(42 * 64 + 42), (Normal{73, 73, 73}));
}

TEST(HalfSpaceReach, IsRoundedOutwardsToTheLeastThatReaches) {
  EXPECT_EQ(half_space_reach(0), 0);
  EXPECT_EQ(half_space_reach(1), 64);
  EXPECT_EQ(half_space_reach(9), 128);
  EXPECT_EQ(half_space_reach(255), (std::int64_t{110218} << 31) >> 10);
  Random random(4);
  for (int i = 0; i < 100'000; ++i) {
    const auto reach = static_cast<std::int64_t>(random.next() >> (26 + random.below(38)));
    const auto code = half_space_reach_code(reach);
    if (!code) {
      EXPECT_GT(reach, half_space_reach(255));
      continue;
    }
    ASSERT_GE(half_space_reach(*code), reach);
    if (*code > 0) {
      ASSERT_LT(half_space_reach(static_cast<std::uint8_t>(*code - 1)), reach);
    }
    ASSERT_LE(half_space_reach(*code), std::max<std::int64_t>(64, reach + reach / 10 + 1));
  }
}

TEST(AddHalfSpace, AnyOrderAndRepeatsGiveTheSame) {
  Random random(5);
  for (int round = 0; round < 2000; ++round) {
    std::vector<HalfSpace> all(random.below(24));
    for (HalfSpace& h : all)
      h = {static_cast<std::uint16_t>(random.below(20)),
           static_cast<std::uint8_t>(random.below(4))};
    std::vector<HalfSpace> straight, shuffled;
    for (const HalfSpace& h : all) add_half_space(h, straight);
    std::set<HalfSpace> least(all.begin(), all.end());
    std::vector<HalfSpace> expected;
    for (const HalfSpace& h : least)
      if (expected.size() < kMaxHalfSpaces &&
          (expected.empty() || expected.back().direction != h.direction))
        expected.push_back(h);
    EXPECT_EQ(straight, expected);
    const std::size_t count = all.size();
    for (std::size_t i = 0; i < count; ++i)
      all.push_back(all[random.below(static_cast<std::uint32_t>(count))]);
    for (std::size_t i = all.size(); i > 1; --i)
      std::swap(all[i - 1], all[random.below(static_cast<std::uint32_t>(i))]);
    for (const HalfSpace& h : all) {
      const std::vector<HalfSpace> before = shuffled;
      const bool changed = add_half_space(h, shuffled);
      EXPECT_EQ(changed, shuffled != before);
    }
    EXPECT_EQ(shuffled, expected);
  }
}

}  // namespace
}  // namespace nearmesh
