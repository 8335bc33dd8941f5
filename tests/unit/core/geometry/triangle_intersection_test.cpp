// SPDX-License-Identifier: Apache-2.0
#include "core/geometry/triangle_intersection.hpp"

#include <gtest/gtest.h>

#include <vector>

#include "core/base/random.hpp"
#include "core/geometry/triangle_overlap.hpp"
#include "distance.hpp"
#include "exact_distance.hpp"

namespace nearmesh {
namespace {

using test::operator-;
using test::Vec;
using LongTriangle = std::array<Vec, 3>;
constexpr long double kNear = 1e-9L;  // far below what small integers can leave between two points

LongTriangle relative_to(const LatticeTriangle& t, const LatticePoint& origin) {
  LongTriangle out;
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t k = 0; k < 3; ++k)
      out[i][k] = static_cast<long double>(t[i].v[k] - origin.v[k]);
  return out;
}

long double point_triangle(const Vec& p, const LongTriangle& t) {
  return std::min({test::point_face(p, t), test::point_segment(p, t[0], t[1]),
                   test::point_segment(p, t[1], t[2]), test::point_segment(p, t[2], t[0])});
}

/// Every extreme point of the intersection of two triangles of small integers is one of these, and
/// all are in it: corners in the other, edges through the other's plane, edges through edges.
std::vector<Vec> candidates(const LongTriangle& a, const LongTriangle& b) {
  std::vector<Vec> points;
  const auto offer = [&](const Vec& p) {
    if (point_triangle(p, a) < kNear && point_triangle(p, b) < kNear) points.push_back(p);
  };
  for (const LongTriangle* own : {&a, &b}) {
    const LongTriangle& other = own == &a ? b : a;
    const Vec n = test::cross(other[1] - other[0], other[2] - other[0]);
    for (std::size_t i = 0; i < 3; ++i) {
      const Vec &p = (*own)[i], &q = (*own)[(i + 1) % 3], d = q - p;
      offer(p);
      if (const long double slope = test::dot(n, d); slope != 0)
        offer(test::along(p, d, test::dot(n, other[0] - p) / slope));
      for (std::size_t j = 0; j < 3; ++j) {
        const Vec &r = other[j], e = other[(j + 1) % 3] - r, m = test::cross(d, e);
        if (const long double square = test::dot(m, m); square > 0)
          offer(test::along(p, d, test::dot(test::cross(r - p, e), m) / square));
      }
    }
  }
  return points;
}

long double point_piece(const Vec& p, const IntersectionPiece& piece) {
  return test::point_segment(p, {piece.p[0], piece.p[1], piece.p[2]},
                             {piece.q[0], piece.q[1], piece.q[2]});
}

void expect_same_as_candidates(const LatticeTriangle& a, const LatticeTriangle& b) {
  const TriangleIntersection found = intersect_triangles(a, b);
  const std::vector<Vec> points = candidates(relative_to(a, a[0]), relative_to(b, a[0]));
  ASSERT_GT(found.count, 0U);
  long double spread = 0;
  for (const Vec& p : points) spread = std::max(spread, test::length(p - points[0]));
  if (spread < kNear) {
    EXPECT_EQ(found.count, 1U);
    EXPECT_EQ(found.pieces[0].p, found.pieces[0].q);
  }
  for (const Vec& p : points) {
    long double least = 1;
    for (std::size_t i = 0; i < found.count; ++i)
      least = std::min(least, point_piece(p, found.pieces[i]));
    EXPECT_LT(least, kNear);
  }
  for (std::size_t i = 0; i < found.count; ++i)
    for (const auto& end : {found.pieces[i].p, found.pieces[i].q}) {
      long double least = 1;
      for (const Vec& p : points)
        least = std::min(least, test::length(p - Vec{end[0], end[1], end[2]}));
      EXPECT_LT(least, kNear);
    }
}

LatticeTriangle random_triangle(Random& random, std::uint32_t span) {
  LatticeTriangle t;
  for (LatticePoint& p : t)
    for (int k = 0; k < 3; ++k) p[k] = random.below(span);
  return t;
}

TEST(TriangleIntersection, IsAllOfTheIntersectionAndNoMore) {
  // Few places for the corners: touching, coplanar and degenerate pairs are common.
  for (const std::uint32_t span : {2U, 3U, 6U}) {
    Random random(span);
    std::size_t flat = 0, met = 0;
    for (int i = 0; i < 6000; ++i) {
      LatticeTriangle a = random_triangle(random, span), b = random_triangle(random, span);
      if (i % 3 == 0)
        for (std::size_t k = 0; k < 3; ++k) a[k][2] = b[k][2] = 1;
      if (!triangles_overlap(a, b)) continue;
      ++met;
      flat += i % 3 == 0;
      expect_same_as_candidates(a, b);
      if (HasFailure()) FAIL() << "span " << span << ", case " << i;
    }
    EXPECT_GT(flat, 500U);
    EXPECT_GT(met - flat, 300U);
  }
}

TEST(TriangleIntersection, EndsLieOnBothTrianglesWithinTheStatedError) {
  Random random(7);
  std::size_t met = 0;
  for (int i = 0; i < 60000; ++i) {
    // All sizes up to the limit; some flattened to slivers.
    const int bits = 4 + static_cast<int>(random.below(36));
    const auto draw = [&](int b) {
      return static_cast<std::int64_t>(random.unit() * static_cast<double>(std::int64_t{1} << b));
    };
    LatticeTriangle a, b;
    for (LatticeTriangle* t : {&a, &b})
      for (LatticePoint& p : *t)
        for (int k = 0; k < 3; ++k) p[k] = draw(i % 4 == k ? std::max(1, bits - 12) : bits);
    if (!triangles_overlap(a, b)) continue;
    ++met;
    std::int64_t extent = 0;
    for (int k = 0; k < 3; ++k) {
      const auto [lo, hi] = std::minmax({a[0][k], a[1][k], a[2][k], b[0][k], b[1][k], b[2][k]});
      extent = std::max(extent, hi - lo);
    }
    const test::Quad bound = test::Quad(kIntersectionError) * static_cast<test::Quad>(extent);
    const TriangleIntersection found = intersect_triangles(a, b);
    for (std::size_t j = 0; j < found.count; ++j)
      for (const auto& end : {found.pieces[j].p, found.pieces[j].q}) {
        test::QuadVec p;
        for (std::size_t k = 0; k < 3; ++k)
          p[k] = static_cast<test::Quad>(a[0].v[k]) + static_cast<test::Quad>(end[k]);
        EXPECT_TRUE(test::point_triangle_square(p, a) <= bound * bound) << i;
        EXPECT_TRUE(test::point_triangle_square(p, b) <= bound * bound) << i;
      }
  }
  EXPECT_GT(met, 5000U);
}

TEST(TriangleIntersection, OfCoplanarTrianglesIsTheOutlineOfTheCommonArea) {
  const auto at = [](std::int64_t x, std::int64_t y) { return LatticePoint{{x, y, 5}}; };
  // A star of David: a hexagon of sides 2, 2 sqrt 2 and so on; each side once.
  const LatticeTriangle a{at(0, 0), at(12, 0), at(6, 9)}, b{at(0, 6), at(6, -3), at(12, 6)};
  const TriangleIntersection star = intersect_triangles(a, b);
  EXPECT_EQ(star.count, 6U);
  double twice_area = 0;
  for (std::size_t i = 0; i < star.count; ++i) {
    const auto &p = star.pieces[i].p, &q = star.pieces[i].q;
    // About the middle, which sees every side.
    twice_area += std::abs((p[0] - 6) * (q[1] - 3) - (p[1] - 3) * (q[0] - 6));
  }
  EXPECT_NEAR(twice_area / 2, 36, 1e-12);
  // Equal triangles: three sides, not six.
  EXPECT_EQ(intersect_triangles(a, a).count, 3U);
}

}  // namespace
}  // namespace nearmesh
