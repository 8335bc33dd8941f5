// SPDX-License-Identifier: Apache-2.0
// triangles_overlap against an oracle that works differently: it computes intersection points as
// exact fractions of 384-bit integers, edge by edge, where the product only ever asks for signs.
#include "core/geometry/triangle_overlap.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <iostream>
#include <vector>

#include "core/base/random.hpp"
#include "rounds.hpp"

namespace nearmesh {
namespace {

__extension__ typedef unsigned __int128 Limb2;

/// A signed integer of 384 bits (two's complement): the oracle's largest value is below 2^300.
struct Wide {
  std::array<std::uint64_t, 6> limb{};

  Wide() = default;
  Wide(std::int64_t x) {  // NOLINT: implicit by design
    limb.fill(x < 0 ? ~std::uint64_t{0} : 0);
    limb[0] = static_cast<std::uint64_t>(x);
  }
  [[nodiscard]] int sign() const {
    if (limb[5] >> 63) return -1;
    return std::any_of(limb.begin(), limb.end(), [](std::uint64_t x) { return x != 0; });
  }
};

Wide operator+(const Wide& a, const Wide& b) {
  Wide out;
  Limb2 carry = 0;
  for (std::size_t i = 0; i < 6; ++i) {
    carry += static_cast<Limb2>(a.limb[i]) + b.limb[i];
    out.limb[i] = static_cast<std::uint64_t>(carry);
    carry >>= 64;
  }
  return out;
}
Wide operator-(const Wide& a) {
  Wide out;
  for (std::size_t i = 0; i < 6; ++i) out.limb[i] = ~a.limb[i];
  return out + Wide(1);
}
Wide operator-(const Wide& a, const Wide& b) { return a + -b; }
Wide operator*(const Wide& a, const Wide& b) {
  Wide out;
  for (std::size_t i = 0; i < 6; ++i) {
    Limb2 carry = 0;
    for (std::size_t j = 0; i + j < 6; ++j) {
      carry += static_cast<Limb2>(a.limb[i]) * b.limb[j] + out.limb[i + j];
      out.limb[i + j] = static_cast<std::uint64_t>(carry);
      carry >>= 64;
    }
  }
  return out;
}
bool operator<=(const Wide& a, const Wide& b) { return (b - a).sign() >= 0; }

using WideVec = std::array<Wide, 3>;

WideVec operator-(const WideVec& a, const WideVec& b) {
  return {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
}
WideVec operator+(const WideVec& a, const WideVec& b) {
  return {a[0] + b[0], a[1] + b[1], a[2] + b[2]};
}
WideVec operator*(const Wide& s, const WideVec& a) { return {s * a[0], s * a[1], s * a[2]}; }
WideVec cross(const WideVec& u, const WideVec& v) {
  return {u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]};
}
Wide dot(const WideVec& u, const WideVec& v) { return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]; }
bool is_zero(const WideVec& v) { return v[0].sign() == 0 && v[1].sign() == 0 && v[2].sign() == 0; }

using WideTriangle = std::array<WideVec, 3>;

/// Is num / den within [0, 1]? den > 0.
bool in_unit_range(const Wide& num, const Wide& den) { return num.sign() >= 0 && num <= den; }

/// Segments p + s u and q + t v, s and t in [0, 1]: solves for s and t.
bool segments_meet(const WideVec& p, const WideVec& u, const WideVec& q, const WideVec& v) {
  const WideVec w = q - p;
  const WideVec n = cross(u, v);
  if (!is_zero(n)) {
    if (dot(w, n).sign() != 0) return false;
    const Wide den = dot(n, n);
    return in_unit_range(dot(cross(w, v), n), den) && in_unit_range(dot(cross(w, u), n), den);
  }
  const WideVec line = is_zero(u) ? v : u;
  if (is_zero(line)) return is_zero(w);
  if (!is_zero(cross(line, w))) return false;
  const Wide p0 = dot(line, p);
  const Wide p1 = dot(line, p + u);
  const Wide q0 = dot(line, q);
  const Wide q1 = dot(line, q + v);
  const Wide& p_lo = p0 <= p1 ? p0 : p1;
  const Wide& p_hi = p0 <= p1 ? p1 : p0;
  const Wide& q_lo = q0 <= q1 ? q0 : q1;
  const Wide& q_hi = q0 <= q1 ? q1 : q0;
  return p_lo <= q_hi && q_lo <= p_hi;
}

/// The point x / den (den > 0), in the plane of proper triangle t: is it inside?
bool point_in_triangle(const WideVec& x, const Wide& den, const WideTriangle& t, const WideVec& n) {
  for (std::size_t i = 0; i < 3; ++i) {
    const WideVec edge = t[(i + 1) % 3] - t[i];
    if (dot(cross(edge, x - den * t[i]), n).sign() < 0) return false;
  }
  return true;
}

bool segment_meets_triangle(const WideVec& p, const WideVec& q, const WideTriangle& t) {
  const WideVec n = cross(t[1] - t[0], t[2] - t[0]);
  const WideVec u = q - p;
  if (!is_zero(n)) {
    const Wide height = dot(n, t[0] - p);
    const Wide rate = dot(n, u);
    if (rate.sign() != 0) {  // meets the plane in the one point p + (height / rate) u
      const Wide num = rate.sign() < 0 ? -height : height;
      const Wide den = rate.sign() < 0 ? -rate : rate;
      return in_unit_range(num, den) && point_in_triangle(den * p + num * u, den, t, n);
    }
    if (height.sign() != 0) return false;
    if (point_in_triangle(p, Wide(1), t, n)) return true;
  }
  for (std::size_t i = 0; i < 3; ++i)
    if (segments_meet(p, u, t[i], t[(i + 1) % 3] - t[i])) return true;
  return false;
}

bool oracle_overlap(const LatticeTriangle& a, const LatticeTriangle& b) {
  WideTriangle wide_a;
  WideTriangle wide_b;
  for (std::size_t i = 0; i < 3; ++i)
    for (int k = 0; k < 3; ++k) {
      wide_a[i][static_cast<std::size_t>(k)] = Wide(a[i][k]) - Wide(a[0][k]);
      wide_b[i][static_cast<std::size_t>(k)] = Wide(b[i][k]) - Wide(a[0][k]);
    }
  for (std::size_t i = 0; i < 3; ++i)
    if (segment_meets_triangle(wide_a[i], wide_a[(i + 1) % 3], wide_b) ||
        segment_meets_triangle(wide_b[i], wide_b[(i + 1) % 3], wide_a))
      return true;
  return false;
}

LatticeTriangle triangle(LatticePoint p, LatticePoint q, LatticePoint r) { return {p, q, r}; }

constexpr std::array<std::array<std::size_t, 3>, 6> kOrders{
    {{0, 1, 2}, {1, 2, 0}, {2, 0, 1}, {1, 0, 2}, {0, 2, 1}, {2, 1, 0}}};

LatticeTriangle reordered(const LatticeTriangle& t, std::size_t order) {
  return {t[kOrders[order][0]], t[kOrders[order][1]], t[kOrders[order][2]]};
}

/// The answer, after checking that all 72 ways of asking agree.
bool overlap_in_every_order(const LatticeTriangle& a, const LatticeTriangle& b) {
  const bool answer = triangles_overlap(a, b);
  for (std::size_t i = 0; i < 6; ++i)
    for (std::size_t j = 0; j < 6; ++j) {
      EXPECT_EQ(triangles_overlap(reordered(a, i), reordered(b, j)), answer) << i << ' ' << j;
      EXPECT_EQ(triangles_overlap(reordered(b, j), reordered(a, i)), answer) << i << ' ' << j;
    }
  return answer;
}

// ---- Families of pairs
// ---------------------------------------------------------------------------

class PairMaker {
 public:
  explicit PairMaker(std::uint64_t seed) : random_(seed) {}
  Random& random() { return random_; }

  std::int64_t whole(std::int64_t lo, std::int64_t hi) {  // inclusive
    const auto span = static_cast<std::uint64_t>(hi - lo) + 1;
    return lo + static_cast<std::int64_t>(random_.next() % span);
  }
  LatticePoint point(std::int64_t extent) {
    return {{whole(0, extent), whole(0, extent), whole(0, extent)}};
  }
  LatticeTriangle any(std::int64_t extent) { return {point(extent), point(extent), point(extent)}; }

 private:
  Random random_;
};

LatticePoint plus(const LatticePoint& p, const LatticePoint& q, std::int64_t times = 1) {
  return {{p[0] + times * q[0], p[1] + times * q[1], p[2] + times * q[2]}};
}

/// Six corners o + i u + j v.
std::array<LatticeTriangle, 2> coplanar(PairMaker& make, std::int64_t extent) {
  const std::int64_t steps = std::min<std::int64_t>(extent, make.whole(2, 12));
  const LatticePoint u = make.point(extent / steps / 2);
  const LatticePoint v = make.point(extent / steps / 2);
  std::array<LatticeTriangle, 2> out;
  for (LatticeTriangle& t : out)
    for (LatticePoint& p : t) p = plus(plus({}, u, make.whole(0, steps)), v, make.whole(0, steps));
  return out;
}

/// A lattice point of t: corners are moved so that one exists inside, on an edge or at a corner.
LatticePoint point_on(PairMaker& make, LatticeTriangle& t) {
  const LatticePoint origin = t[0];
  std::int64_t weight[3] = {0, 0, 0};
  const std::int64_t n = make.whole(1, 5);
  for (std::int64_t i = 0; i < n; ++i) ++weight[make.whole(0, 2)];
  LatticePoint sum = origin;
  for (std::size_t i = 1; i < 3; ++i)
    for (int k = 0; k < 3; ++k) {
      const std::int64_t edge = (t[i][k] - origin[k]) / n;
      t[i][k] = origin[k] + n * edge;
      sum[k] += weight[i] * edge;
    }
  return sum;
}

/// b touches a in a lattice point of both; then, maybe, moves off by one unit.
std::array<LatticeTriangle, 2> touching(PairMaker& make, std::int64_t extent) {
  LatticeTriangle a = make.any(extent);
  LatticeTriangle b = make.any(extent);
  const LatticePoint on_a = point_on(make, a);
  const LatticePoint on_b = point_on(make, b);
  LatticePoint shift = plus(on_a, on_b, -1);
  if (make.whole(0, 1)) shift[static_cast<int>(make.whole(0, 2))] += make.whole(-1, 1);
  for (LatticePoint& p : b) p = plus(p, shift);
  return {a, b};
}

std::array<LatticeTriangle, 2> sharing_corners(PairMaker& make, std::int64_t extent) {
  const LatticeTriangle a = make.any(extent);
  LatticeTriangle b = make.any(extent);
  const auto shared = static_cast<std::size_t>(make.whole(1, 3));
  for (std::size_t i = 0; i < shared; ++i) b[i] = a[i];
  if (make.whole(0, 1))
    for (LatticePoint& p : b) p[static_cast<int>(make.whole(0, 2))] += make.whole(-1, 1);
  return {a, b};
}

/// Long thin triangles across each other.
std::array<LatticeTriangle, 2> slivers(PairMaker& make, std::int64_t extent) {
  std::array<LatticeTriangle, 2> out;
  for (LatticeTriangle& t : out) {
    t[0] = make.point(extent);
    t[1] = {{extent - t[0][0], extent - t[0][1], extent - t[0][2]}};  // through the middle
    for (int k = 0; k < 3; ++k) t[1][k] += make.whole(-2, 2);         // or just beside it
    t[2] = plus(t[make.whole(0, 1)], {{make.whole(-2, 2), make.whole(-2, 2), make.whole(-2, 2)}});
  }
  return out;
}

/// Segments (three collinear corners) and points against anything, often touching.
std::array<LatticeTriangle, 2> degenerate(PairMaker& make, std::int64_t extent) {
  std::array<LatticeTriangle, 2> out;
  switch (make.whole(0, 2)) {
    case 0:
      out = touching(make, extent);
      break;
    case 1:
      out = coplanar(make, extent);
      break;
    default:
      out = {make.any(extent), make.any(extent)};
  }
  for (LatticeTriangle& t : out) {
    switch (make.whole(0, 3)) {
      case 0:
        t[1] = t[2] = t[0];
        break;
      case 1:
        t[2] = t[make.whole(0, 1)];
        break;
      case 2:
        for (int k = 0; k < 3; ++k) t[1][k] = t[0][k] + (t[1][k] - t[0][k]) / 2 * 2;
        for (int k = 0; k < 3; ++k) t[2][k] = t[0][k] + (t[1][k] - t[0][k]) / 2;
        break;
      default:
        break;
    }
  }
  if (make.whole(0, 2) == 0) {  // bring one corner of each together
    const LatticePoint shift = plus(out[0][static_cast<std::size_t>(make.whole(0, 2))],
                                    out[1][static_cast<std::size_t>(make.whole(0, 2))], -1);
    for (LatticePoint& p : out[1]) p = plus(p, shift);
  }
  return out;
}

std::array<LatticeTriangle, 2> unrelated(PairMaker& make, std::int64_t extent) {
  return {make.any(extent), make.any(extent)};
}

/// A tiny triangle near a corner, an edge or the face of a huge one.
std::array<LatticeTriangle, 2> small_on_large(PairMaker& make, std::int64_t extent) {
  LatticeTriangle a = make.any(extent);
  LatticeTriangle b = make.any(std::min<std::int64_t>(extent, make.whole(1, 40)));
  const LatticePoint shift = plus(point_on(make, a), b[0], -1);
  for (LatticePoint& p : b) p = plus(p, plus(shift, make.point(2)));
  return {a, b};
}

using Family = std::array<LatticeTriangle, 2> (*)(PairMaker&, std::int64_t);

void compare_with_oracle(Family family, std::uint64_t seed, int pairs_per_extent) {
  std::cout << "seed " << seed << '\n';
  PairMaker make(seed);
  int contacts = 0;
  int frees = 0;
  for (const int bits : {1, 2, 4, 8, 15, 16, 17, 19, 20, 21, 29, 30, 31, 38}) {
    for (int i = 0; i < pairs_per_extent; ++i) {
      auto [a, b] = family(make, std::int64_t{1} << bits);
      // Far from the origin, as posed vertices may be.
      const std::int64_t far = make.whole(0, 1) * (std::int64_t{1} << 61);
      const LatticePoint shift{
          {make.whole(-far, far), make.whole(-far, far), make.whole(-far, far)}};
      for (std::size_t k = 0; k < 3; ++k) {
        a[k] = plus(a[k], shift);
        b[k] = plus(b[k], shift);
      }
      const bool expected = oracle_overlap(a, b);
      ++(expected ? contacts : frees);
      const bool swap = make.whole(0, 1) != 0;
      const LatticeTriangle x = reordered(a, static_cast<std::size_t>(make.whole(0, 5)));
      const LatticeTriangle y = reordered(b, static_cast<std::size_t>(make.whole(0, 5)));
      ASSERT_EQ(swap ? triangles_overlap(y, x) : triangles_overlap(x, y), expected)
          << "bits " << bits << " pair " << i;
    }
  }
  EXPECT_GT(contacts, pairs_per_extent / 10);
  EXPECT_GT(frees, pairs_per_extent / 10);
}

TEST(TrianglesOverlap, EqualsOracleOnRandomPairs) {
  compare_with_oracle(unrelated, 11, test::rounds(8000));
}
TEST(TrianglesOverlap, EqualsOracleOnCoplanarPairs) {
  compare_with_oracle(coplanar, 12, test::rounds(8000));
}
TEST(TrianglesOverlap, EqualsOracleOnTouchingPairsAndOneUnitApart) {
  compare_with_oracle(touching, 13, test::rounds(12000));
}
TEST(TrianglesOverlap, EqualsOracleOnSharedCorners) {
  compare_with_oracle(sharing_corners, 14, test::rounds(6000));
}
TEST(TrianglesOverlap, EqualsOracleOnSlivers) {
  compare_with_oracle(slivers, 15, test::rounds(6000));
}
TEST(TrianglesOverlap, EqualsOracleOnSegmentsAndPoints) {
  compare_with_oracle(degenerate, 16, test::rounds(12000));
}
TEST(TrianglesOverlap, EqualsOracleOnSmallAgainstLarge) {
  compare_with_oracle(small_on_large, 17, test::rounds(6000));
}

TEST(TrianglesOverlap, AnswersAlikeInEveryOrder) {
  PairMaker make(18);
  for (const Family family :
       {unrelated, coplanar, touching, sharing_corners, slivers, degenerate, small_on_large})
    for (const int bits : {1, 2, 10, 18, 25, 38})
      for (int i = 0; i < test::rounds(150); ++i) {
        const auto [a, b] = family(make, std::int64_t{1} << bits);
        ASSERT_EQ(overlap_in_every_order(a, b), oracle_overlap(a, b));
      }
}

// ---- Single facts, by hand
// -----------------------------------------------------------------------

const LatticeTriangle kFloor = triangle({{0, 0, 0}}, {{4, 0, 0}}, {{0, 4, 0}});

TEST(TrianglesOverlap, CrossingIsContact) {
  EXPECT_TRUE(overlap_in_every_order(kFloor, triangle({{1, 1, -1}}, {{1, 1, 1}}, {{9, 9, 1}})));
}
TEST(TrianglesOverlap, TouchingAtAVertexIsContact) {
  EXPECT_TRUE(overlap_in_every_order(kFloor, triangle({{4, 0, 0}}, {{9, 0, 1}}, {{9, 1, 1}})));
}
TEST(TrianglesOverlap, VertexOnFaceIsContact) {
  EXPECT_TRUE(overlap_in_every_order(kFloor, triangle({{1, 1, 0}}, {{0, 0, 9}}, {{1, 0, 9}})));
}
TEST(TrianglesOverlap, VertexOneUnitAboveFaceIsFree) {
  EXPECT_FALSE(overlap_in_every_order(kFloor, triangle({{1, 1, 1}}, {{0, 0, 9}}, {{1, 0, 9}})));
}
TEST(TrianglesOverlap, CrossingEdgesAreContact) {
  EXPECT_TRUE(overlap_in_every_order(kFloor, triangle({{2, -1, 0}}, {{2, 0, 0}}, {{2, 0, 9}})));
}
TEST(TrianglesOverlap, EdgePassingBesideACornerIsFree) {
  EXPECT_FALSE(overlap_in_every_order(kFloor, triangle({{5, -1, -1}}, {{5, 1, 1}}, {{9, 0, 9}})));
}
TEST(TrianglesOverlap, SharedEdgeIsContact) {
  EXPECT_TRUE(overlap_in_every_order(kFloor, triangle({{0, 0, 0}}, {{4, 0, 0}}, {{0, -3, 5}})));
}
TEST(TrianglesOverlap, EqualTrianglesAreContact) {
  EXPECT_TRUE(overlap_in_every_order(kFloor, kFloor));
}
TEST(TrianglesOverlap, CoplanarContainedIsContact) {
  EXPECT_TRUE(overlap_in_every_order(triangle({{0, 0, 0}}, {{9, 0, 0}}, {{0, 9, 0}}),
                                     triangle({{1, 1, 0}}, {{2, 1, 0}}, {{1, 2, 0}})));
}
TEST(TrianglesOverlap, CoplanarTouchingAtACornerIsContact) {
  EXPECT_TRUE(overlap_in_every_order(kFloor, triangle({{2, 2, 0}}, {{4, 2, 0}}, {{2, 4, 0}})));
}
TEST(TrianglesOverlap, CoplanarBesideIsFree) {
  EXPECT_FALSE(overlap_in_every_order(kFloor, triangle({{3, 2, 0}}, {{4, 2, 0}}, {{3, 4, 0}})));
}
TEST(TrianglesOverlap, ParallelPlanesAreFree) {
  EXPECT_FALSE(overlap_in_every_order(triangle({{0, 0, 0}}, {{4, 0, 4}}, {{0, 4, 4}}),
                                      triangle({{0, 0, 1}}, {{4, 0, 5}}, {{0, 4, 5}})));
}
TEST(TrianglesOverlap, PointInsideFaceIsContact) {
  EXPECT_TRUE(overlap_in_every_order(kFloor, triangle({{1, 1, 0}}, {{1, 1, 0}}, {{1, 1, 0}})));
}
TEST(TrianglesOverlap, PointInPlaneOutsideFaceIsFree) {
  EXPECT_FALSE(overlap_in_every_order(kFloor, triangle({{3, 3, 0}}, {{3, 3, 0}}, {{3, 3, 0}})));
}
TEST(TrianglesOverlap, EqualPointsAreContact) {
  const LatticeTriangle point = triangle({{5, 5, 5}}, {{5, 5, 5}}, {{5, 5, 5}});
  EXPECT_TRUE(overlap_in_every_order(point, point));
}
TEST(TrianglesOverlap, SegmentThroughFaceIsContact) {
  EXPECT_TRUE(overlap_in_every_order(kFloor, triangle({{1, 1, -2}}, {{1, 1, 0}}, {{1, 1, 2}})));
}
TEST(TrianglesOverlap, CrossingSegmentsAreContact) {
  EXPECT_TRUE(overlap_in_every_order(triangle({{0, 0, 0}}, {{2, 2, 2}}, {{4, 4, 4}}),
                                     triangle({{0, 4, 0}}, {{4, 0, 4}}, {{0, 4, 0}})));
}
TEST(TrianglesOverlap, SkewSegmentsAreFree) {
  EXPECT_FALSE(overlap_in_every_order(triangle({{0, 0, 0}}, {{4, 4, 4}}, {{0, 0, 0}}),
                                      triangle({{0, 4, 1}}, {{4, 0, 4}}, {{0, 4, 1}})));
}
TEST(TrianglesOverlap, CollinearSegmentsEndToEndAreContact) {
  EXPECT_TRUE(overlap_in_every_order(triangle({{0, 0, 0}}, {{1, 2, 3}}, {{2, 4, 6}}),
                                     triangle({{2, 4, 6}}, {{3, 6, 9}}, {{3, 6, 9}})));
}

TEST(TrianglesOverlap, OneUnitDecidesAtTheLargestExtent) {
  const std::int64_t far = (std::int64_t{1} << 39) - 8;
  const LatticeTriangle plane =
      triangle({{-far, -far, -far + 1}}, {{far, -far, -far}}, {{far - 3, far, far}});
  // The middle of the first edge, once on it and once a unit off.
  const LatticeTriangle on = triangle({{far, -far, -far}}, {{far, -far, 0}}, {{far, -far - 5, 0}});
  LatticeTriangle off = on;
  for (LatticePoint& p : off) p[0] += 1;
  EXPECT_TRUE(overlap_in_every_order(plane, on));
  EXPECT_FALSE(overlap_in_every_order(plane, off));
}

TEST(TrianglesOverlap, CubeAgainstItselfShiftedGivesTheKnownCounts) {
  // A cube with 4 x 4 quads a side, 192 triangles; counts from FAILURES.md F3 (exact oracle).
  std::vector<LatticeTriangle> cube;
  for (int axis = 0; axis < 3; ++axis)
    for (const std::int64_t side : {0, 8})
      for (std::int64_t i = 0; i < 8; i += 2)
        for (std::int64_t j = 0; j < 8; j += 2) {
          const auto corner = [&](std::int64_t x, std::int64_t y) {
            LatticePoint p;
            p[axis] = side;
            p[(axis + 1) % 3] = x;
            p[(axis + 2) % 3] = y;
            return p;
          };
          cube.push_back({corner(i, j), corner(i + 2, j), corner(i + 2, j + 2)});
          cube.push_back({corner(i, j), corner(i + 2, j + 2), corner(i, j + 2)});
        }
  const auto count = [&](const LatticePoint& shift) {
    int pairs = 0;
    for (const LatticeTriangle& a : cube)
      for (const LatticeTriangle& b : cube)
        pairs += triangles_overlap(a, {plus(b[0], shift), plus(b[1], shift), plus(b[2], shift)});
    return pairs;
  };
  EXPECT_EQ(count({{8, 0, 0}}), 644);
  EXPECT_EQ(count({{8, 4, 4}}), 268);
  EXPECT_EQ(count({{8, 8, 0}}), 140);
  EXPECT_EQ(count({{8, 8, 8}}), 36);
}

}  // namespace
}  // namespace nearmesh
