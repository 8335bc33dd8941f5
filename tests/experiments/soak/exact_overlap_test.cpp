// SPDX-License-Identifier: Apache-2.0
// The rational oracle itself: cases with known answers, and its symmetries.
#include "exact_overlap.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "core/base/random.hpp"

namespace nearmesh::test {
namespace {

/// The answer for one order of corners; every other order and side must agree.
template <class Triangle>
bool in_every_order(Triangle a, Triangle b) {
  const bool answer = exact_overlap(a, b);
  for (int turn = 0; turn < 3; ++turn) {
    for (int flip = 0; flip < 2; ++flip) {
      for (int i = 0; i < 3; ++i) {
        EXPECT_EQ(exact_overlap(a, b), answer);
        EXPECT_EQ(exact_overlap(b, a), answer);
        std::rotate(b.begin(), b.begin() + 1, b.end());
      }
      std::swap(b[0], b[1]);
    }
    std::rotate(a.begin(), a.begin() + 1, a.end());
  }
  return answer;
}

LatticeTriangle lattice(const DoubleTriangle& t) {
  LatticeTriangle out;
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t k = 0; k < 3; ++k) out[i].v[k] = static_cast<std::int64_t>(t[i][k]);
  return out;
}

struct Case {
  const char* what;
  DoubleTriangle a, b;
  bool touch;
};

constexpr DoubleTriangle kFloor{{{0, 0, 0}, {4, 0, 0}, {0, 4, 0}}};
constexpr DoubleTriangle kSlope{{{0, 0, 0}, {6, 0, 3}, {0, 6, 3}}};  // x + y = 2 z

const Case kCases[] = {
    {"equal", kFloor, kFloor, true},
    {"crosses the inside", kFloor, {{{1, 1, -1}, {1, 1, 1}, {2, 1, 1}}}, true},
    {"passes the hypotenuse", kFloor, {{{3, 3, -1}, {3, 3, 1}, {9, 9, 1}}}, false},
    {"corner on the inside", kFloor, {{{1, 1, 0}, {1, 1, 5}, {2, 1, 5}}}, true},
    {"corner a unit above the inside", kFloor, {{{1, 1, 1}, {1, 1, 5}, {2, 1, 5}}}, false},
    {"corner on an edge", kFloor, {{{2, 2, 0}, {2, 2, 5}, {3, 2, 5}}}, true},
    {"corner in the plane, beside the edge", kFloor, {{{3, 2, 0}, {3, 2, 5}, {4, 2, 5}}}, false},
    {"corner on a corner", kFloor, {{{4, 0, 0}, {9, 0, 5}, {9, 9, -5}}}, true},
    {"edges cross in the hypotenuse", kFloor, {{{2, 2, -2}, {2, 2, 2}, {9, 9, 0}}}, true},
    {"edges pass in skew", kFloor, {{{3, 2, -2}, {3, 2, 2}, {9, 9, 0}}}, false},
    {"shares an edge", kFloor, {{{4, 0, 0}, {0, 4, 0}, {4, 4, 7}}}, true},
    {"coplanar, inside", kFloor, {{{1, 1, 0}, {2, 1, 0}, {1, 2, 0}}}, true},
    {"coplanar, around", kFloor, {{{-9, -9, 0}, {50, -9, 0}, {-9, 50, 0}}}, true},
    {"coplanar star without a corner inside", kFloor, {{{3, 3, 0}, {-1, 1, 0}, {1, -1, 0}}}, true},
    {"coplanar, edge touches corner", kFloor, {{{5, -1, 0}, {3, 1, 0}, {9, 9, 0}}}, true},
    {"coplanar, apart", kFloor, {{{5, 0, 0}, {3, 2, 0}, {9, 9, 0}}}, false},
    {"parallel planes", kFloor, {{{0, 0, 1}, {4, 0, 1}, {0, 4, 1}}}, false},
    {"oblique, parallel, a unit apart", kSlope, {{{0, 0, 1}, {6, 0, 4}, {0, 6, 4}}}, false},
    {"oblique, corner on it between lattice points",
     kSlope,
     {{{1, 0, 0}, {1, 0, 1}, {1, -5, 0}}},
     true},
    {"point inside", kSlope, {{{1, 1, 1}, {1, 1, 1}, {1, 1, 1}}}, true},
    {"point beside the plane", kSlope, {{{1, 2, 1}, {1, 2, 1}, {1, 2, 1}}}, false},
    {"point in the plane, outside", kSlope, {{{4, 4, 4}, {4, 4, 4}, {4, 4, 4}}}, false},
    {"equal points",
     {{{5, 6, 7}, {5, 6, 7}, {5, 6, 7}}},
     {{{5, 6, 7}, {5, 6, 7}, {5, 6, 7}}},
     true},
    {"other points",
     {{{5, 6, 7}, {5, 6, 7}, {5, 6, 7}}},
     {{{5, 6, 8}, {5, 6, 8}, {5, 6, 8}}},
     false},
    {"point on a segment",
     {{{0, 0, 0}, {3, 6, 9}, {0, 0, 0}}},
     {{{1, 2, 3}, {1, 2, 3}, {1, 2, 3}}},
     true},
    {"point beyond a segment",
     {{{0, 0, 0}, {1, 2, 3}, {2, 4, 6}}},
     {{{3, 6, 9}, {3, 6, 9}, {3, 6, 9}}},
     false},
    {"point beside a segment",
     {{{0, 0, 0}, {3, 6, 9}, {1, 2, 3}}},
     {{{1, 2, 4}, {1, 2, 4}, {1, 2, 4}}},
     false},
    {"segments cross",
     {{{0, 0, 0}, {4, 4, 4}, {2, 2, 2}}},
     {{{0, 4, 0}, {4, 0, 4}, {0, 4, 0}}},
     true},
    {"segments in skew",
     {{{0, 0, 0}, {4, 4, 4}, {0, 0, 0}}},
     {{{0, 4, 1}, {4, 0, 4}, {0, 4, 1}}},
     false},
    {"segments in a plane, apart",
     {{{0, 0, 0}, {4, 4, 4}, {0, 0, 0}}},
     {{{3, 2, 3}, {4, 0, 4}, {4, 0, 4}}},
     false},
    {"segments end to end",
     {{{0, 0, 0}, {1, 2, 3}, {2, 4, 6}}},
     {{{2, 4, 6}, {3, 6, 9}, {3, 6, 9}}},
     true},
    {"segments on a line, apart",
     {{{0, 0, 0}, {1, 2, 3}, {2, 4, 6}}},
     {{{3, 6, 9}, {4, 8, 12}, {4, 8, 12}}},
     false},
    {"segments beside each other",
     {{{0, 0, 0}, {2, 4, 6}, {2, 4, 6}}},
     {{{0, 0, 1}, {2, 4, 7}, {2, 4, 7}}},
     false},
    {"segment through the face", kSlope, {{{1, 1, -2}, {1, 1, 4}, {1, 1, 0}}}, true},
    {"segment short of the face", kSlope, {{{1, 1, 2}, {1, 1, 4}, {1, 1, 3}}}, false},
    {"segment in the plane across", kSlope, {{{-2, 2, 0}, {4, 4, 4}, {-2, 2, 0}}}, true},
};

TEST(ExactOverlap, KnowsTheHandCases) {
  for (const Case& c : kCases) {
    EXPECT_EQ(in_every_order(lattice(c.a), lattice(c.b)), c.touch) << c.what;
    EXPECT_EQ(in_every_order(c.a, c.b), c.touch) << c.what;
  }
}

TEST(ExactOverlap, SeesTheLastBitOfADouble) {
  // The corner stands on the floor, or the least double above it.
  DoubleTriangle above{{{1, 1, 0}, {1, 1, 1e300}, {2, 1, 1e300}}};
  EXPECT_TRUE(in_every_order(kFloor, above));
  above[0][2] = 0x1p-1074;
  EXPECT_FALSE(in_every_order(kFloor, above));
}

TEST(ExactOverlap, TakesFractionsThatNoDoubleHolds) {
  // The centroid of the floor lies at 4/3.
  ExactTriangle pin;
  for (auto& corner : pin) corner = {mpq_class(4, 3), mpq_class(4, 3), 0};
  EXPECT_TRUE(in_every_order(exact::from_doubles(kFloor), pin));
  for (auto& corner : pin) corner[2] = mpq_class(1, 1000003);
  EXPECT_FALSE(in_every_order(exact::from_doubles(kFloor), pin));
}

TEST(ExactOverlap, HasNoLimitOfSize) {
  constexpr std::int64_t kTop = INT64_MAX;
  constexpr std::int64_t kBottom = INT64_MIN;
  const LatticeTriangle plane{
      {{{kBottom, kBottom, 0}}, {{kTop, kBottom, 0}}, {{kBottom, kTop, 0}}}};
  // The hypotenuse is x + y = -1.
  EXPECT_TRUE(in_every_order(plane, {{{{7, -8, kTop}}, {{7, -8, kBottom}}, {{kTop, kTop, kTop}}}}));
  EXPECT_FALSE(
      in_every_order(plane, {{{{7, -7, kTop}}, {{7, -7, kBottom}}, {{kTop, kTop, kTop}}}}));
}

TEST(ExactOverlap, IsTheSameInEveryOrderAndFrame) {
  Random random(1);
  int touching = 0;
  for (int i = 0; i < 1500; ++i) {
    const std::uint32_t bound = 2 + random.below(9);
    DoubleTriangle a, b;
    for (std::size_t c = 0; c < 3; ++c)
      for (std::size_t k = 0; k < 3; ++k) {
        a[c][k] = random.below(bound);
        b[c][k] = random.below(bound);
      }
    const bool answer = in_every_order(lattice(a), lattice(b));
    touching += answer;
    // The same points of a grid of 2^-20, moved: fractions again, and the axes change places.
    for (DoubleTriangle* t : {&a, &b})
      for (auto& corner : *t) {
        for (double& x : corner) x = std::ldexp(x, -20) - 3;
        std::rotate(corner.begin(), corner.begin() + 1, corner.end());
      }
    EXPECT_EQ(exact_overlap(a, b), answer);
  }
  EXPECT_GT(touching, 300);
  EXPECT_LT(touching, 1200);
}

}  // namespace
}  // namespace nearmesh::test
