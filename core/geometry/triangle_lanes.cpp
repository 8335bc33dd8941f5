// SPDX-License-Identifier: Apache-2.0
#undef HWY_TARGET_INCLUDE
// NOLINTNEXTLINE(readability-identifier-naming): Highway's name
#define HWY_TARGET_INCLUDE "core/geometry/triangle_lanes.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include <algorithm>

#include "nearmesh/core/geometry/detail/lanes.hpp"
#include "vectors.hpp"

HWY_BEFORE_NAMESPACE();
namespace nearmesh::HWY_NAMESPACE {

void extents_gaps_lanes(const RelativeFrame& f, const DoubleTriangle& own,
                        const PlacedTriangles& other, double* gaps_m) {
  const Doubles d;
  const auto at = [&d](double x) { return hn::Set(d, x); };
  const Vec zero = hn::Zero(d);
  for (std::size_t lane = 0; lane < kLanes; lane += hn::Lanes(d)) {
    Vec square = zero;
    for (std::size_t k = 0; k < 3; ++k) {
      const double lo = std::min(std::min(own[0][k], own[1][k]), own[2][k]);
      const double hi = std::max(std::max(own[0][k], own[1][k]), own[2][k]);
      const Vec x = hn::LoadU(d, other.corner[0][k] + lane),
                y = hn::LoadU(d, other.corner[1][k] + lane),
                z = hn::LoadU(d, other.corner[2][k] + lane);
      const Vec gap = hn::Max(zero, hn::Max(hn::Sub(at(lo), hn::Max(hn::Max(x, y), z)),
                                            hn::Sub(hn::Min(hn::Min(x, y), z), at(hi))));
      square = hn::Add(square, hn::Mul(gap, gap));
    }
    hn::StoreU(
        hn::Mul(hn::Sub(hn::Sqrt(square), at(f.slack)), at(f.least_metres_per_unit * kGapShrink)),
        d, gaps_m + lane);
  }
}

/// The shortest vectors found so far, from one's own triangle to the other's.
struct ShortestLanes {
  Vec vector[3], squared;

  HWY_INLINE void offer(const Vec (&v)[3], Mask where) {
    const Vec length = dot(v, v);
    const Mask is_less = hn::And(where, hn::Lt(length, squared));
    squared = hn::IfThenElse(is_less, length, squared);
    for (std::size_t k = 0; k < 3; ++k) vector[k] = hn::IfThenElse(is_less, v[k], vector[k]);
  }
};

HWY_INLINE Vec clamp_lanes(Vec x) {
  const Vec zero = hn::Zero(Doubles()), one = hn::Set(Doubles(), 1);
  return hn::IfThenElse(hn::Lt(x, zero), zero, hn::IfThenElse(hn::Gt(x, one), one, x));
}
HWY_INLINE Vec ratio_lanes(Vec numerator, Vec denominator) {
  return hn::IfThenElseZero(hn::Gt(denominator, hn::Zero(Doubles())),
                            clamp_lanes(hn::Div(numerator, denominator)));
}

/// The edges p + s u and q + t v.
HWY_INLINE void offer_edges(const Vec (&p)[3], const Vec (&u)[3], const Vec (&q)[3],
                            const Vec (&v)[3], ShortestLanes& best) {
  const Doubles d;
  const Vec zero = hn::Zero(d);
  Vec r[3];
  for (std::size_t k = 0; k < 3; ++k) r[k] = hn::Sub(p[k], q[k]);
  const Vec a = dot(u, u), e = dot(v, v), b = dot(u, v), c = dot(u, r), g = dot(v, r);
  const Mask is_point = hn::Le(e, zero);
  Vec s = ratio_lanes(hn::Sub(hn::Mul(b, g), hn::Mul(c, e)), hn::Sub(hn::Mul(a, e), hn::Mul(b, b)));
  Vec t = hn::IfThenZeroElse(is_point, hn::Div(hn::Add(hn::Mul(b, s), g), e));
  const Mask is_within = hn::And(hn::Ge(t, zero), hn::Le(t, hn::Set(d, 1)));
  const Vec at_end = clamp_lanes(t);
  s = hn::IfThenElse(hn::AndNot(is_point, is_within), s,
                     ratio_lanes(hn::Sub(hn::Mul(b, at_end), c), a));
  t = hn::IfThenElse(is_within, t, at_end);
  Vec way[3];
  for (std::size_t k = 0; k < 3; ++k)
    way[k] = hn::Sub(hn::Add(q[k], hn::Mul(t, v[k])), hn::Add(p[k], hn::Mul(s, u[k])));
  best.offer(way, hn::Eq(zero, zero));
}

/// Corners of `from` above the face of `to`: the vector from corner to face, times `direction`.
HWY_INLINE void offer_corner_faces(const Vec (&from)[3][3], const Vec (&to)[3][3], double direction,
                                   ShortestLanes& best) {
  const Doubles d;
  const Vec zero = hn::Zero(d);
  Vec u[3], v[3];
  for (std::size_t k = 0; k < 3; ++k) {
    u[k] = hn::Sub(to[1][k], to[0][k]);
    v[k] = hn::Sub(to[2][k], to[0][k]);
  }
  const Vec n[3] = {cross(u, v, 0), cross(u, v, 1), cross(u, v, 2)};
  const Vec square = dot(n, n);
  for (const auto& corner : from) {
    Vec w[3];
    for (std::size_t k = 0; k < 3; ++k) w[k] = hn::Sub(corner[k], to[0][k]);
    const Vec of_x[3] = {cross(w, v, 0), cross(w, v, 1), cross(w, v, 2)},
              of_y[3] = {cross(u, w, 0), cross(u, w, 1), cross(u, w, 2)};
    const Vec x = dot(of_x, n), y = dot(of_y, n);
    const Mask is_above = hn::And(hn::And(hn::Ge(x, zero), hn::Ge(y, zero)),
                                  hn::And(hn::Le(hn::Add(x, y), square), hn::Gt(square, zero)));
    const Vec height = hn::Div(hn::Mul(hn::Set(d, -direction), dot(w, n)), square);
    const Vec way[3] = {hn::Mul(height, n[0]), hn::Mul(height, n[1]), hn::Mul(height, n[2])};
    best.offer(way, is_above);
  }
}

/// The operations of triangles_gap_m in their order, so that each lane has its bits.
void triangles_gaps_lanes(const RelativeFrame& f, const DoubleTriangle& own,
                          const PlacedTriangles& other, double* gaps_m) {
  const Doubles d;
  const Vec zero = hn::Zero(d);
  Vec a[3][3];
  for (std::size_t c = 0; c < 3; ++c)
    for (std::size_t k = 0; k < 3; ++k) a[c][k] = hn::Set(d, own[c][k]);
  for (std::size_t lane = 0; lane < kLanes; lane += hn::Lanes(d)) {
    Vec b[3][3];
    for (std::size_t c = 0; c < 3; ++c)
      for (std::size_t k = 0; k < 3; ++k) b[c][k] = hn::LoadU(d, other.corner[c][k] + lane);
    ShortestLanes best{{zero, zero, zero}, hn::Inf(d)};
    for (std::size_t i = 0; i < 3; ++i) {
      Vec u[3];
      for (std::size_t k = 0; k < 3; ++k) u[k] = hn::Sub(a[(i + 1) % 3][k], a[i][k]);
      for (std::size_t j = 0; j < 3; ++j) {
        Vec v[3];
        for (std::size_t k = 0; k < 3; ++k) v[k] = hn::Sub(b[(j + 1) % 3][k], b[j][k]);
        offer_edges(a[i], u, b[j], v, best);
      }
    }
    offer_corner_faces(a, b, 1, best);
    offer_corner_faces(b, a, -1, best);
    Vec end = zero, start = zero;
    for (std::size_t c = 0; c < 3; ++c) {
      Vec own_way[3], way[3];
      for (std::size_t k = 0; k < 3; ++k) {
        own_way[k] = hn::Sub(a[c][k], a[0][k]);
        way[k] = hn::Sub(b[c][k], a[0][k]);
      }
      const Vec own_at = dot(best.vector, own_way), at = dot(best.vector, way);
      end = c == 0 ? own_at : hn::Max(end, own_at);
      start = c == 0 ? at : hn::Min(start, at);
    }
    const Vec gap =
        hn::Sub(hn::Div(hn::Sub(start, end), hn::Sqrt(best.squared)), hn::Set(d, f.slack));
    const Mask is_apart = hn::And(hn::Gt(best.squared, zero), hn::Gt(gap, zero));
    hn::StoreU(
        hn::IfThenElseZero(is_apart, hn::Mul(hn::Mul(gap, hn::Set(d, f.least_metres_per_unit)),
                                             hn::Set(d, kGapShrink))),
        d, gaps_m + lane);
  }
}

void place_triangles_all(const RelativeFrame& f, const TriangleLanes& other, PlacedTriangles& out) {
  const Doubles d;
  for (std::size_t lane = 0; lane < kLanes; lane += hn::Lanes(d)) {
    for (std::size_t c = 0; c < 3; ++c) {
      const Vec p[3] = {load(other.corner[c][0] + lane), load(other.corner[c][1] + lane),
                        load(other.corner[c][2] + lane)};
      for (std::size_t k = 0; k < 3; ++k)
        hn::StoreU(hn::Add(dot(f.rotation.data() + 3 * k, p), hn::Set(d, f.translation[k])), d,
                   out.corner[c][k] + lane);
    }
  }
}

}  // namespace nearmesh::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace nearmesh {

HWY_EXPORT(extents_gaps_lanes);
HWY_EXPORT(triangles_gaps_lanes);
HWY_EXPORT(place_triangles_all);

void extents_gaps_m(const RelativeFrame& other_in_own, const DoubleTriangle& own,
                    const PlacedTriangles& other, double (&gaps_m)[kLanes]) {
  HWY_DYNAMIC_DISPATCH(extents_gaps_lanes)(other_in_own, own, other, gaps_m);
}

void triangles_gaps_m(const RelativeFrame& other_in_own, const DoubleTriangle& own,
                      const PlacedTriangles& other, double (&gaps_m)[kLanes]) {
  HWY_DYNAMIC_DISPATCH(triangles_gaps_lanes)(other_in_own, own, other, gaps_m);
}

void place_triangles(const RelativeFrame& other_in_own, const TriangleLanes& other,
                     PlacedTriangles& out) {
  HWY_DYNAMIC_DISPATCH(place_triangles_all)(other_in_own, other, out);
}

}  // namespace nearmesh
#endif
