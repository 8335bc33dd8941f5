// SPDX-License-Identifier: Apache-2.0
// Intersection of two overlapping triangles.
// Source: Guigue and Devillers 2003, section 4 (the ends of the common segment by orientation
// signs); coplanar and degenerate pairs are ours: edges clipped by half-planes, with exact
// fractions.
//
// Error. An end is x + t (y - x) for an edge xy, t = h(x) / (h(x) - h(y)) with heights h that are
// exact integers. With u = 2^-53: both conversions and the division give t within 3.01 u t; the
// product errs by 4.02 u |y - x| <= 4.02 u E a coordinate; the sum, whose terms are exact
// differences and whose value stays within E, adds 1.01 u E. In all below 5.1 u E a coordinate, 9 u
// E in length. The exact point lies in both triangles because signs, not t, chose the edge.
#include "triangle_intersection.hpp"

#include <algorithm>

#include "exact.hpp"

namespace nearmesh {
namespace {

/// 0..2 a's corners, 3..5 b's, relative to corner 0.
using BothCorners = std::array<Whole3, 6>;

Int128 orientation(const BothCorners& c, std::size_t o, std::size_t i, std::size_t j,
                   std::size_t k) {
  return dot(cross(subtract<Int128>(c[i], c[o]), subtract<Int128>(c[j], c[o])),
             subtract<Int128>(c[k], c[o]));
}

Wide3 normal_of(const BothCorners& c, std::size_t base) {
  return cross(subtract<Int128>(c[base + 1], c[base]), subtract<Int128>(c[base + 2], c[base]));
}

/// Six times the volumes that corners other..other+2 span with the triangle base..base+2.
Wide3 heights(const BothCorners& c, const Wide3& normal, std::size_t base, std::size_t other) {
  Wide3 h;
  for (std::size_t i = 0; i < 3; ++i) h[i] = dot(normal, subtract<Int128>(c[other + i], c[base]));
  return h;
}

Signs signs_of(const Wide3& h) { return {sign(h[0]), sign(h[1]), sign(h[2])}; }

Double3 as_doubles(const Whole3& p) {
  return {static_cast<double>(p[0]), static_cast<double>(p[1]), static_cast<double>(p[2])};
}

/// x + (part / whole) (y - x).
Double3 along(const Whole3& x, const Whole3& y, Int128 part, Int128 whole) {
  const double t = static_cast<double>(part) / static_cast<double>(whole);
  Double3 p;
  for (std::size_t k = 0; k < 3; ++k)
    p[k] = static_cast<double>(x[k]) + t * static_cast<double>(y[k] - x[k]);
  return p;
}

/// Where xy, of heights hx and hy that are not equal, has the height 0.
Double3 crossing(const Whole3& x, const Whole3& y, Int128 hx, Int128 hy) {
  return along(x, y, hx, hx - hy);
}

void add(TriangleIntersection& out, const Double3& p, const Double3& q) {
  out.pieces[out.count++] = {p, q};
}

/// Two proper triangles whose planes cross: the later start and the earlier end of the intervals in
/// which the two cut the common line.
void cross_planes(const BothCorners& c, const Wide3& heights_a, const Wide3& heights_b,
                  TriangleIntersection& out) {
  const Lone a = find_lone(signs_of(heights_a)), b = find_lone(signs_of(heights_b));
  // Each triangle is turned over where the other's lone corner lies below it.
  const std::size_t p1 = a.corner, q1 = kNext[p1 + b.negative], r1 = kNext[p1 + !b.negative];
  const std::size_t p2 = 3U + b.corner, q2 = 3 + kNext[b.corner + a.negative],
                    r2 = 3 + kNext[b.corner + !a.negative];
  const auto cut = [&](std::size_t from, std::size_t to) {
    return from < 3 ? crossing(c[from], c[to], heights_a[from], heights_a[to])
                    : crossing(c[from], c[to], heights_b[from - 3], heights_b[to - 3]);
  };
  // Along the line a's interval runs from edge p1r1 to p1q1, b's from p2q2 to p2r2. Positive: b's
  // edge p2y cuts the line after a's edge p1x.
  const auto order = [&](std::size_t x, std::size_t y) {
    return sign(orientation(c, x, p2, p1, y));
  };
  const bool starts_with_b = order(r1, q2) > 0, ends_with_b = order(q1, r2) < 0;
  // Ends of one triangle fall together only in a corner on the line, where both cuts give that
  // corner's own coordinates.
  const bool is_point =
      starts_with_b != ends_with_b && (starts_with_b ? order(q1, q2) : order(r1, r2)) == 0;
  const Double3 start = starts_with_b ? cut(p2, q2) : cut(p1, r1);
  add(out, start, is_point ? start : ends_with_b ? cut(p2, r2) : cut(p1, q1));
}

// ---- pairs in one plane, and triangles that are segments or points ------------------------------

/// The convex hull of a triangle's corners: a point, a segment or the triangle.
struct Hull {
  std::array<Whole3, 3> corner;
  std::size_t size;
};

Hull hull_of(const BothCorners& c, std::size_t base, bool is_proper) {
  if (is_proper) return {{c[base], c[base + 1], c[base + 2]}, 3};
  const auto first = c.begin() + static_cast<std::ptrdiff_t>(base);
  const auto [lo, hi] = std::minmax_element(first, first + 3);  // on a line any order does
  return {{*lo, *hi, *hi}, *lo == *hi ? 1U : 2U};
}

/// Twice the area of pqr in the plane of two axes.
struct Plane {
  std::size_t x, y;
  [[nodiscard]] Int128 area(const Whole3& p, const Whole3& q, const Whole3& r) const {
    return static_cast<Int128>(q[x] - p[x]) * (r[y] - p[y]) -
           static_cast<Int128>(q[y] - p[y]) * (r[x] - p[x]);
  }
};
Plane plane_across(const Wide3& normal) {
  const std::size_t axis = nonzero_axis(normal);
  return {(axis + 1) % 3, (axis + 2) % 3};
}

/// part / whole, in [0, 1].
struct Fraction {
  Int128 part, whole;
};

/// Sign of x - y, by their continued fractions: products would not fit 128 bits.
int compare(Fraction x, Fraction y) {
  while (true) {
    const Int128 nx = x.part / x.whole, ny = y.part / y.whole;
    if (nx != ny) return nx < ny ? -1 : 1;
    const Int128 rx = x.part % x.whole, ry = y.part % y.whole;
    if (rx == 0 || ry == 0) return int{rx != 0} - int{ry != 0};
    // rx / x.whole against ry / y.whole: their inverses, the other way round.
    const Fraction inverse_x{x.whole, rx};
    x = {y.whole, ry};
    y = inverse_x;
  }
}

/// The part of segment pq inside a proper triangle of the same plane.
struct Clip {
  Fraction from{0, 1}, to{1, 1};
  bool is_empty = false;
  bool is_along_edge = false;  ///< pq lies on the line of an edge
};

Clip clip(const Whole3& p, const Whole3& q, const Hull& triangle, const Plane& plane) {
  const int turn = sign(plane.area(triangle.corner[0], triangle.corner[1], triangle.corner[2]));
  Clip part;
  for (std::size_t i = 0; i < 3; ++i) {
    const Whole3 &from = triangle.corner[i], &to = triangle.corner[(i + 1) % 3];
    const Int128 hp = turn * plane.area(from, to, p), hq = turn * plane.area(from, to, q);
    if (hp < 0 && hq < 0) part.is_empty = true;
    if (hp == 0 && hq == 0) part.is_along_edge = true;
    if ((hp < 0) == (hq < 0)) continue;
    const Fraction at = hp < 0 ? Fraction{-hp, hq - hp} : Fraction{hp, hp - hq};
    if (hp < 0 && compare(at, part.from) > 0) part.from = at;
    if (hq < 0 && compare(at, part.to) < 0) part.to = at;
  }
  part.is_empty = part.is_empty || compare(part.from, part.to) > 0;
  return part;
}

void add(TriangleIntersection& out, const Whole3& p, const Whole3& q, const Clip& part) {
  const Double3 start = along(p, q, part.from.part, part.from.whole);
  add(out, start,
      compare(part.from, part.to) == 0 ? start : along(p, q, part.to.part, part.to.whole));
}

/// The outline of the common area: the parts of each one's edges inside the other. Where only
/// points are common, one.
void cross_in_plane(const Hull& a, const Hull& b, const Plane& plane, TriangleIntersection& out) {
  TriangleIntersection points;
  for (const Hull* own : {&a, &b}) {
    const Hull& other = own == &a ? b : a;
    for (std::size_t i = 0; i < 3; ++i) {
      const Whole3 &p = own->corner[i], &q = own->corner[(i + 1) % 3];
      const Clip part = clip(p, q, other, plane);
      // Where edges of both lie on one line they have the same part in common: a's will do.
      if (part.is_empty || (own == &b && part.is_along_edge)) continue;
      const bool is_point = compare(part.from, part.to) == 0;
      if (!is_point) add(out, p, q, part);
      if (is_point && points.count == 0) add(points, p, q, part);
    }
  }
  if (out.count == 0) out = points;
}

/// Two segments.
void cross_segments(const Hull& a, const Hull& b, TriangleIntersection& out) {
  const Wide3 normal =
      cross(subtract<Int128>(a.corner[1], a.corner[0]), subtract<Int128>(b.corner[1], b.corner[0]));
  if (is_zero(normal)) {  // on one line, on which corners are in ascending order
    add(out, as_doubles(std::max(a.corner[0], b.corner[0])),
        as_doubles(std::min(a.corner[1], b.corner[1])));
    return;
  }
  const Plane plane = plane_across(normal);
  const Double3 p =
      crossing(a.corner[0], a.corner[1], plane.area(b.corner[0], b.corner[1], a.corner[0]),
               plane.area(b.corner[0], b.corner[1], a.corner[1]));
  add(out, p, p);
}

/// A segment against a proper triangle at `face`.
void cross_segment(const BothCorners& c, const Hull& segment, std::size_t face, const Wide3& normal,
                   TriangleIntersection& out) {
  const Whole3 &p = segment.corner[0], &q = segment.corner[1];
  const Int128 hp = dot(normal, subtract<Int128>(p, c[face]));
  const Int128 hq = dot(normal, subtract<Int128>(q, c[face]));
  if (hp != hq) {
    const Double3 at = crossing(p, q, hp, hq);
    add(out, at, at);
  } else {  // both 0, as they touch
    add(out, p, q, clip(p, q, hull_of(c, face, true), plane_across(normal)));
  }
}

/// Coplanar triangles, and pairs of which one or both are segments or points.
void cross_flat(const BothCorners& c, const Wide3& normal_a, const Wide3& normal_b,
                TriangleIntersection& out) {
  const bool proper_a = !is_zero(normal_a), proper_b = !is_zero(normal_b);
  const Hull a = hull_of(c, 0, proper_a), b = hull_of(c, 3, proper_b);
  if (a.size == 1 || b.size == 1) {
    const Double3 p = as_doubles((a.size == 1 ? a : b).corner[0]);
    add(out, p, p);
  } else if (proper_a && proper_b) {
    cross_in_plane(a, b, plane_across(normal_b), out);
  } else if (proper_b) {
    cross_segment(c, a, 3, normal_b, out);
  } else if (proper_a) {
    cross_segment(c, b, 0, normal_a, out);
  } else {
    cross_segments(a, b, out);
  }
}

}  // namespace

TriangleIntersection intersect_triangles(const LatticeTriangle& a, const LatticeTriangle& b) {
  BothCorners c;
  for (std::size_t i = 0; i < 3; ++i) {
    c[i] = subtract<std::int64_t>(a[i].v, a[0].v);
    c[3 + i] = subtract<std::int64_t>(b[i].v, a[0].v);
  }
  const Wide3 normal_a = normal_of(c, 0), normal_b = normal_of(c, 3);
  const Wide3 heights_a = heights(c, normal_b, 3, 0), heights_b = heights(c, normal_a, 0, 3);
  TriangleIntersection out;
  // A triangle without a plane puts every corner at height zero.
  if (all_zero(signs_of(heights_a)) || all_zero(signs_of(heights_b))) {
    cross_flat(c, normal_a, normal_b, out);
  } else {
    cross_planes(c, heights_a, heights_b, out);
  }
  return out;
}

}  // namespace nearmesh
