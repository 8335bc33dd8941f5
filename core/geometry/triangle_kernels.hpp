// SPDX-License-Identifier: Apache-2.0
// One's own triangle against eight of the other model's: by axes that part them, and by signs of
// orientations where they certainly meet (Guigue and Devillers 2003, as triangle_overlap.cpp).
//
// Errors. Axes: as in box_overlap.cpp, any vector may serve. Orientations: the image of the posed
// corners keeps orientation, and with s the slack, L the greatest distance of two corners here,
// differences of corners are those of their images but for s (box_overlap.cpp, 1: two corners'
// rounding makes up the slack, whichever bodies they are of). A determinant of three differences
// then is off by at most (L + s)^3 - L^3 <= 3 s (L + s)^2 <= s (3.4 L^2 + 27 s^2). Doubles add less
// than 2^-47 L^3 <= s L^2 / 2, since L <= M and s >= 2^-46 M there. So a sign beyond 4 s (L^2 + 7
// s^2) is that of the exact test. Where all six heights are beyond it, and each triangle has
// corners on both sides of the other's plane, two more such signs tell whether they meet.
#if defined(NEARMESH_GEOMETRY_TRIANGLE_KERNELS) == defined(HWY_TARGET_TOGGLE)
#ifdef NEARMESH_GEOMETRY_TRIANGLE_KERNELS
#undef NEARMESH_GEOMETRY_TRIANGLE_KERNELS
#else
#define NEARMESH_GEOMETRY_TRIANGLE_KERNELS
#endif

#include <hwy/highway.h>

#include <algorithm>

#include "placed_boxes.hpp"
#include "vectors.hpp"

HWY_BEFORE_NAMESPACE();
namespace nearmesh::HWY_NAMESPACE {

/// The axis across two edges.
HWY_INLINE void across(const Vec (&own_from)[3], const Vec (&own_to)[3], const Vec (&other_from)[3],
                       const Vec (&other_to)[3], Vec (&axis)[3]) {
  Vec u[3], v[3];
  for (std::size_t k = 0; k < 3; ++k) {
    u[k] = hn::Sub(own_to[k], own_from[k]);
    v[k] = hn::Sub(other_to[k], other_from[k]);
  }
  for (std::size_t k = 0; k < 3; ++k) axis[k] = cross(u, v, k);
}

/// x, y or z, where the first, the second or neither mask is set.
HWY_INLINE void choose(Mask first, Mask second, const Vec (&x)[3], const Vec (&y)[3],
                       const Vec (&z)[3], Vec (&out)[3]) {
  for (std::size_t k = 0; k < 3; ++k)
    out[k] = hn::IfThenElse(first, x[k], hn::IfThenElse(second, y[k], z[k]));
}
HWY_INLINE void exchange(Mask where, Vec (&x)[3], Vec (&y)[3]) {
  for (std::size_t k = 0; k < 3; ++k) {
    const Vec t = hn::IfThenElse(where, y[k], x[k]);
    y[k] = hn::IfThenElse(where, x[k], y[k]);
    x[k] = t;
  }
}

/// The corner of a triangle that is alone on its side of a plane which no corner is on, and the
/// next two in turn.
struct LoneCorner {
  Vec lone[3], next[3], last[3];
  Mask is_below;
  Mask is_none;  ///< all are on one side
};
HWY_INLINE LoneCorner lone_corner(const Vec (&x)[3], const Vec (&y)[3], const Vec (&z)[3],
                                  const Vec (&heights)[3]) {
  const Vec zero = hn::Zero(Doubles());
  const Mask a = hn::Gt(heights[0], zero), b = hn::Gt(heights[1], zero),
             c = hn::Gt(heights[2], zero);
  const Mask first = hn::Not(hn::Xor(b, c)), second = hn::Not(hn::Xor(a, c));
  LoneCorner out;
  choose(first, second, x, y, z, out.lone);
  choose(first, second, y, z, x, out.next);
  choose(first, second, z, x, y, out.last);
  out.is_below = hn::Or(hn::And(a, b), hn::And(hn::Or(a, b), c));  // two are above
  out.is_none = hn::And(first, second);
  return out;
}

/// One's own triangles: two corners relative to the first.
struct OwnTriangle {
  Vec second[3], third[3];
};

/// Whether the triangles are certainly apart along an axis. The other's corners are relative to
/// one's own first.
HWY_INLINE Mask parts(const Vec (&axis)[3], const OwnTriangle& own, const Vec (&other)[3][3],
                      double slack) {
  const Vec zero = hn::Zero(Doubles());
  const Vec room = hn::Mul(hn::Set(Doubles(), slack),
                           hn::Add(hn::Add(hn::Abs(axis[0]), hn::Abs(axis[1])), hn::Abs(axis[2])));
  const Vec x = dot(axis, other[0]), y = dot(axis, other[1]), z = dot(axis, other[2]);
  const Vec second = dot(axis, own.second), third = dot(axis, own.third);
  return hn::Or(
      hn::Gt(hn::Min(hn::Min(second, third), zero), hn::Add(hn::Max(hn::Max(x, y), z), room)),
      hn::Lt(hn::Max(hn::Max(second, third), zero), hn::Sub(hn::Min(hn::Min(x, y), z), room)));
}

/// By how much an orientation of four of the corners may err.
HWY_INLINE Vec orientation_error(const OwnTriangle& own, const Vec (&other)[3][3], double slack) {
  const Doubles d;
  Vec square = hn::Set(d, 7 * slack * slack);
  for (std::size_t k = 0; k < 3; ++k) {
    const Vec lo = hn::Min(hn::Min(own.second[k], own.third[k]), hn::Zero(d));
    const Vec hi = hn::Max(hn::Max(own.second[k], own.third[k]), hn::Zero(d));
    const Vec extent =
        hn::Sub(hn::Max(hi, hn::Max(hn::Max(other[0][k], other[1][k]), other[2][k])),
                hn::Min(lo, hn::Min(hn::Min(other[0][k], other[1][k]), other[2][k])));
    square = hn::Add(square, hn::Mul(extent, extent));
  }
  return hn::Mul(hn::Set(d, 4 * slack), square);
}

/// `apart` by two pairs of edges, `touching` by the signs of their orientations. Heights: of the
/// other's corners above one's own plane, and the other way round, times the lengths of the
/// normals.
struct MaskVerdicts {
  Mask apart, touching;
};
HWY_INLINE MaskVerdicts test_edges(const OwnTriangle& own, const Vec (&b)[3][3],
                                   const Vec (&b_heights)[3], const Vec (&own_heights)[3],
                                   double slack) {
  const Doubles d;
  const Vec zero = hn::Zero(d), error = orientation_error(own, b, slack);
  Mask certain = hn::Gt(hn::Abs(b_heights[0]), error);
  for (const Vec& height :
       {b_heights[1], b_heights[2], own_heights[0], own_heights[1], own_heights[2]})
    certain = hn::And(certain, hn::Gt(hn::Abs(height), error));
  Vec a[3][3];
  for (std::size_t k = 0; k < 3; ++k) {
    a[0][k] = zero;
    a[1][k] = own.second[k];
    a[2][k] = own.third[k];
  }
  // Where heights are not certain, these corners are a guess, and as good for finding an axis as
  // any.
  LoneCorner lone_a = lone_corner(a[0], a[1], a[2], own_heights);
  LoneCorner lone_b = lone_corner(b[0], b[1], b[2], b_heights);
  certain = hn::AndNot(hn::Or(lone_a.is_none, lone_b.is_none), certain);
  exchange(lone_b.is_below, lone_a.next, lone_a.last);
  exchange(lone_a.is_below, lone_b.next, lone_b.last);
  Vec first[3], second[3], from_next[3], from_lone[3];
  across(lone_a.next, lone_a.lone, lone_b.lone, lone_b.next, first);
  across(lone_a.lone, lone_a.last, lone_b.lone, lone_b.last, second);
  for (std::size_t k = 0; k < 3; ++k) {
    from_next[k] = hn::Sub(lone_b.lone[k], lone_a.next[k]);
    from_lone[k] = hn::Sub(lone_b.lone[k], lone_a.lone[k]);
  }
  const Vec most = hn::Max(dot(first, from_next), dot(second, from_lone));
  return {hn::Or(parts(first, own, b, slack), parts(second, own, b, slack)),
          hn::And(certain, hn::Lt(most, hn::Neg(error)))};
}

/// What is certain of eight pairs of triangles, of `wanted` alone.
HWY_INLINE PairVerdicts test_triangles_inline(const RelativeFrame& f,
                                              const TriangleLanes& own_lanes,
                                              const TriangleLanes& other, std::uint32_t wanted) {
  const Doubles d;
  PairVerdicts out;
  for (std::size_t lane = 0; lane < kLanes; lane += hn::Lanes(d)) {
    Vec first[3], b[3][3];
    OwnTriangle own;
    for (std::size_t k = 0; k < 3; ++k) {
      first[k] = load(own_lanes.corner[0][k] + lane);
      own.second[k] = hn::Sub(load(own_lanes.corner[1][k] + lane), first[k]);
      own.third[k] = hn::Sub(load(own_lanes.corner[2][k] + lane), first[k]);
    }
    for (std::size_t c = 0; c < 3; ++c) {  // relative to one's own first corner
      const Vec p[3] = {load(other.corner[c][0] + lane), load(other.corner[c][1] + lane),
                        load(other.corner[c][2] + lane)};
      for (std::size_t k = 0; k < 3; ++k)
        b[c][k] = hn::Sub(hn::Add(dot(f.rotation.data() + 3 * k, p), hn::Set(d, f.translation[k])),
                          first[k]);
    }
    Vec u[3], v[3];
    for (std::size_t k = 0; k < 3; ++k) {
      u[k] = hn::Sub(b[1][k], b[0][k]);
      v[k] = hn::Sub(b[2][k], b[0][k]);
    }
    const Vec normal[3] = {cross(own.second, own.third, 0), cross(own.second, own.third, 1),
                           cross(own.second, own.third, 2)};
    const Vec b_normal[3] = {cross(u, v, 0), cross(u, v, 1), cross(u, v, 2)};
    const Vec b_heights[3] = {dot(normal, b[0]), dot(normal, b[1]), dot(normal, b[2])};
    const Vec on_b = dot(b_normal, b[0]);
    const Vec own_heights[3] = {hn::Neg(on_b), hn::Sub(dot(b_normal, own.second), on_b),
                                hn::Sub(dot(b_normal, own.third), on_b)};
    const MaskVerdicts edges = test_edges(own, b, b_heights, own_heights, f.slack);
    Mask apart = edges.apart;
    const Mask settled = hn::Or(apart, edges.touching);
    // A walk has held the planes against each other in floats: they part few that edges do not.
    if ((~bits_of(settled) & wanted >> lane & ((1U << hn::Lanes(d)) - 1)) != 0)
      apart =
          hn::Or(apart, hn::Or(parts(normal, own, b, f.slack), parts(b_normal, own, b, f.slack)));
    out.apart |= bits_of(apart) << lane;
    out.touching |= bits_of(edges.touching) << lane;
  }
  return {out.apart & wanted, out.touching & wanted};
}

}  // namespace nearmesh::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();
#endif
