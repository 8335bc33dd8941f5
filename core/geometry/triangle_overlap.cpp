// SPDX-License-Identifier: Apache-2.0
// Exact triangle-triangle overlap: boxes, then the sides of each triangle's corners against the
// other's plane, then two orientations (Guigue and Devillers 2003). Flat and degenerate pairs leave
// through one rare door, flat_overlap.
#include "triangle_overlap.hpp"

#include <algorithm>
#include <cmath>

#include "exact.hpp"

namespace nearmesh {
namespace {

// A 3x3 determinant of differences up to E is at most 6 E^3.
constexpr std::int64_t kDoubleExact = std::int64_t{1} << 16;      ///< 6 E^3 < 2^53
constexpr std::int64_t kInt64Exact = std::int64_t{1} << 20;       ///< 6 E^3 < 2^63
constexpr std::int64_t kPlaneInt64Exact = std::int64_t{1} << 30;  ///< 2 E^2 < 2^63
// Forward error of (u x v) . w in doubles, inputs exact, u = 2^-53: cross 4u E^2, products 6u E^3
// each, sum 28u E^3 in all; 64u leaves room.
constexpr double kFilter = 0x1p-47;

/// The six corners, 0..2 a's and 3..5 b's, as doubles relative to corner 3 (exact: differences stay
/// below 2^40), with what is needed to fall back on integers.
struct TrianglePair {
  std::array<Double3, 6> real;
  const LatticeTriangle& a;
  const LatticeTriangle& b;
  std::int64_t extent;   ///< bounds every coordinate difference
  double plane_bound_a;  ///< error of the tests against a's plane; negative: doubles are exact
  double plane_bound_b;
  double bound;  ///< error of any orientation; negative: doubles are exact

  [[nodiscard]] const Whole3& whole(std::size_t corner) const {
    return corner < 3 ? a[corner].v : b[corner - 3].v;
  }
};

struct Box {
  Whole3 lo;
  Whole3 hi;
};

Box box_of(const LatticeTriangle& t) {
  Box box;
  for (std::size_t k = 0; k < 3; ++k) {
    box.lo[k] = std::min(std::min(t[0].v[k], t[1].v[k]), t[2].v[k]);
    box.hi[k] = std::max(std::max(t[0].v[k], t[1].v[k]), t[2].v[k]);
  }
  return box;
}

/// Without branches: near pairs, the usual case here, would mispredict them.
bool boxes_meet(const Box& a, const Box& b) {
  int apart = 0;
  for (std::size_t k = 0; k < 3; ++k) apart |= int{a.lo[k] > b.hi[k]} | int{b.lo[k] > a.hi[k]};
  return apart == 0;
}

std::int64_t extent_of(const Box& box) {
  return std::max(std::max(box.hi[0] - box.lo[0], box.hi[1] - box.lo[1]), box.hi[2] - box.lo[2]);
}

std::int64_t joint_extent(const Box& a, const Box& b) {
  std::int64_t extent = 0;
  for (std::size_t k = 0; k < 3; ++k)
    extent = std::max(extent, std::max(a.hi[k], b.hi[k]) - std::min(a.lo[k], b.lo[k]));
  return extent;
}

Double3 relative(const LatticePoint& p, const LatticePoint& origin) {
  return {static_cast<double>(p.v[0] - origin.v[0]), static_cast<double>(p.v[1] - origin.v[1]),
          static_cast<double>(p.v[2] - origin.v[2])};
}

TrianglePair make_pair(const LatticeTriangle& a, const LatticeTriangle& b, const Box& box_a,
                       const Box& box_b) {
  TrianglePair pair{{relative(a[0], b[0]), relative(a[1], b[0]), relative(a[2], b[0]), Double3{},
                     relative(b[1], b[0]), relative(b[2], b[0])},
                    a,
                    b,
                    joint_extent(box_a, box_b),
                    -1,
                    -1,
                    -1};
  NEARMESH_ASSERT(pair.extent <= std::int64_t{1} << 40);
  if (pair.extent > kDoubleExact) {
    const double e = static_cast<double>(pair.extent);
    const double ea = static_cast<double>(extent_of(box_a));
    const double eb = static_cast<double>(extent_of(box_b));
    pair.plane_bound_a = ea * ea * e * kFilter;
    pair.plane_bound_b = eb * eb * e * kFilter;
    pair.bound = e * e * e * kFilter;
  }
  return pair;
}

template <class Int>
int exact_orientation(const Whole3& o, const Whole3& p, const Whole3& q, const Whole3& r) {
  return sign(dot(cross(subtract<Int>(p, o), subtract<Int>(q, o)), subtract<Int>(r, o)));
}

/// Sign of (i - o) x (j - o) . (k - o), when doubles leave it open.
[[gnu::noinline]] int exact_orientation(const TrianglePair& pair, std::size_t o, std::size_t i,
                                        std::size_t j, std::size_t k) {
  const Whole3& origin = pair.whole(o);
  return pair.extent <= kInt64Exact
             ? exact_orientation<std::int64_t>(origin, pair.whole(i), pair.whole(j), pair.whole(k))
             : exact_orientation<Int128>(origin, pair.whole(i), pair.whole(j), pair.whole(k));
}

/// Sign of (i - o) x (j - o) . (k - o).
int orientation(const TrianglePair& pair, std::size_t o, std::size_t i, std::size_t j,
                std::size_t k) {
  const auto& p = pair.real;
  const double d = dot(cross(subtract<double>(p[i], p[o]), subtract<double>(p[j], p[o])),
                       subtract<double>(p[k], p[o]));
  return std::abs(d) > pair.bound ? sign(d) : exact_orientation(pair, o, i, j, k);
}

/// Six times the volumes that corners other..other+2 span with the triangle base..base+2.
[[gnu::always_inline]] inline Double3 heights(const TrianglePair& pair, std::size_t base,
                                              std::size_t other) {
  const auto& p = pair.real;
  const Double3 normal =
      cross(subtract<double>(p[base + 1], p[base]), subtract<double>(p[base + 2], p[base]));
  return {dot(normal, subtract<double>(p[other], p[base])),
          dot(normal, subtract<double>(p[other + 1], p[base])),
          dot(normal, subtract<double>(p[other + 2], p[base]))};
}

bool certainly_one_side(const Double3& h, double bound) {
  const double least = std::max(bound, 0.0);
  return std::min(std::min(h[0], h[1]), h[2]) > least ||
         std::max(std::max(h[0], h[1]), h[2]) < -least;
}

/// Exact signs of heights.
[[gnu::always_inline]] inline Signs signs_of(const Double3& h, double bound,
                                             const TrianglePair& pair, std::size_t base,
                                             std::size_t other) {
  Signs s{sign(h[0]), sign(h[1]), sign(h[2])};
  if (std::min(std::min(std::abs(h[0]), std::abs(h[1])), std::abs(h[2])) <= bound) [[unlikely]]
    for (std::size_t i = 0; i < 3; ++i)
      if (std::abs(h[i]) <= bound)
        s[i] = exact_orientation(pair, base, base + 1, base + 2, other + i);
  return s;
}

bool strictly_one_side(const Signs& s) { return s[0] != 0 && s[0] == s[1] && s[1] == s[2]; }

/// find_lone for all 27 triples: branches on random signs would cost more than all arithmetic.
constexpr std::array<Lone, 27> kLone = [] {
  std::array<Lone, 27> table{};
  for (int i = 0; i < 27; ++i)
    table[static_cast<std::size_t>(i)] = find_lone({i / 9 - 1, i / 3 % 3 - 1, i % 3 - 1});
  return table;
}();

Lone lone_of(const Signs& s) {
  return kLone[static_cast<std::size_t>(9 * s[0] + 3 * s[1] + s[2] + 13)];
}

/// Two proper triangles whose planes cross: both cut the common line in an interval; two
/// orientations order the intervals' ends.
bool crossing_overlap(const TrianglePair& pair, const Signs& a_sides, const Signs& b_sides) {
  const Lone a = lone_of(a_sides);
  const Lone b = lone_of(b_sides);
  // Each triangle is turned over where the other's lone corner lies below it.
  const std::size_t p1 = a.corner;
  const std::size_t q1 = kNext[p1 + b.negative];
  const std::size_t r1 = kNext[p1 + !b.negative];
  const std::size_t p2 = 3U + b.corner;
  const std::size_t q2 = 3 + kNext[b.corner + a.negative];
  const std::size_t r2 = 3 + kNext[b.corner + !a.negative];
  return orientation(pair, q1, p2, p1, q2) <= 0 && orientation(pair, p1, p2, r1, r2) <= 0;
}

/// The collinear triangle at `line`, which leaves the plane of the proper triangle at `face`,
/// against that triangle: all edges lie on one line, so the first that reaches the plane decides.
bool line_pierces_face(const TrianglePair& pair, std::size_t line, const Signs& line_sides,
                       std::size_t face) {
  std::size_t i = 0;
  while (line_sides[i] * line_sides[(i + 1) % 3] > 0 ||
         (line_sides[i] == 0 && line_sides[(i + 1) % 3] == 0))
    ++i;  // ends: the corners are neither strictly on one side nor all in the plane
  const std::size_t p = line + i;
  const std::size_t q = line + (i + 1) % 3;
  const int s0 = orientation(pair, p, q, face, face + 1);
  const int s1 = orientation(pair, p, q, face + 1, face + 2);
  const int s2 = orientation(pair, p, q, face + 2, face);
  return std::min({s0, s1, s2}) >= 0 || std::max({s0, s1, s2}) <= 0;
}

template <class Int>
int planar_orientation(const TrianglePair& pair, std::size_t x, std::size_t y, std::size_t i,
                       std::size_t j, std::size_t k) {
  const Whole3& o = pair.whole(i);
  const Whole3& p = pair.whole(j);
  const Whole3& q = pair.whole(k);
  return sign(static_cast<Int>(p[x] - o[x]) * static_cast<Int>(q[y] - o[y]) -
              static_cast<Int>(p[y] - o[y]) * static_cast<Int>(q[x] - o[x]));
}

/// True when an edge line of the triangle at `base` (proper, a segment or a point) has the whole of
/// the triangle at `other` strictly outside.
template <class Int>
bool edge_separates(const TrianglePair& pair, std::size_t x, std::size_t y, std::size_t base,
                    std::size_t other) {
  const int turn = planar_orientation<Int>(pair, x, y, base, base + 1, base + 2);
  for (std::size_t i = 0; i < 3; ++i) {
    const std::size_t from = base + i;
    const std::size_t to = base + (i + 1) % 3;
    Signs s;
    for (std::size_t k = 0; k < 3; ++k)
      s[k] = planar_orientation<Int>(pair, x, y, from, to, other + k);
    // A segment turns neither way: either side of its line is outside.
    if (strictly_one_side(s) && s[0] != turn) return true;
  }
  return false;
}

/// All six corners in one plane whose normal has a component along `axis`; not all on one line.
/// Convex sets in a plane are apart iff the line of one of their edges separates them.
bool planar_overlap(const TrianglePair& pair, std::size_t axis) {
  const std::size_t x = (axis + 1) % 3;
  const std::size_t y = (axis + 2) % 3;
  if (pair.extent <= kPlaneInt64Exact)
    return !edge_separates<std::int64_t>(pair, x, y, 0, 3) &&
           !edge_separates<std::int64_t>(pair, x, y, 3, 0);
  return !edge_separates<Int128>(pair, x, y, 0, 3) && !edge_separates<Int128>(pair, x, y, 3, 0);
}

Wide3 exact_normal(const TrianglePair& pair, std::size_t base) {
  const Whole3& origin = pair.whole(base);
  return cross(subtract<Int128>(pair.whole(base + 1), origin),
               subtract<Int128>(pair.whole(base + 2), origin));
}

/// Direction of a collinear triangle; zero for a point.
Wide3 direction(const TrianglePair& pair, std::size_t base) {
  const Wide3 first = subtract<Int128>(pair.whole(base + 1), pair.whole(base));
  return is_zero(first) ? subtract<Int128>(pair.whole(base + 2), pair.whole(base)) : first;
}

/// Two segments or points whose boxes meet.
bool line_line_overlap(const TrianglePair& pair) {
  const Wide3 u = direction(pair, 0);
  const Wide3 v = direction(pair, 3);
  const Wide3 between = subtract<Int128>(pair.whole(0), pair.whole(3));
  const Wide3 normal = cross(u, v);
  if (!is_zero(normal))
    return dot(normal, between) == 0 && planar_overlap(pair, nonzero_axis(normal));
  // Parallel, or points: on one line (or in one place) the boxes have settled it.
  return is_zero(cross(is_zero(u) ? v : u, between));
}

/// Coplanar pairs, and pairs of which one or both are segments or points. The boxes meet.
[[gnu::noinline]] bool flat_overlap(const TrianglePair& pair, const Signs& a_sides,
                                    const Signs& b_sides) {
  const Wide3 normal_b = exact_normal(pair, 3);
  if (!is_zero(normal_b))
    return all_zero(a_sides) ? planar_overlap(pair, nonzero_axis(normal_b))
                             : line_pierces_face(pair, 0, a_sides, 3);
  const Wide3 normal_a = exact_normal(pair, 0);
  if (!is_zero(normal_a))
    return all_zero(b_sides) ? planar_overlap(pair, nonzero_axis(normal_a))
                             : line_pierces_face(pair, 3, b_sides, 0);
  return line_line_overlap(pair);
}

}  // namespace

bool triangles_overlap(const LatticeTriangle& a, const LatticeTriangle& b) {
  const Box box_a = box_of(a);
  const Box box_b = box_of(b);
  if (!boxes_meet(box_a, box_b)) return false;
  const TrianglePair pair = make_pair(a, b, box_a, box_b);
  const Double3 a_heights = heights(pair, 3, 0);
  if (certainly_one_side(a_heights, pair.plane_bound_b)) return false;
  const Double3 b_heights = heights(pair, 0, 3);
  if (certainly_one_side(b_heights, pair.plane_bound_a)) return false;

  const Signs a_sides = signs_of(a_heights, pair.plane_bound_b, pair, 3, 0);
  const Signs b_sides = signs_of(b_heights, pair.plane_bound_a, pair, 0, 3);
  if (strictly_one_side(a_sides) || strictly_one_side(b_sides)) return false;
  // A triangle without a plane puts every corner at height zero.
  if (all_zero(a_sides) || all_zero(b_sides)) return flat_overlap(pair, a_sides, b_sides);
  return crossing_overlap(pair, a_sides, b_sides);
}

}  // namespace nearmesh
