// SPDX-License-Identifier: Apache-2.0
// Errors. box_overlap.cpp bounds what rounding of posed corners and of doubles does to a projection
// on any axis n by slack |n|_1, half of which is left over there for the doubles. The sums here
// have the same terms: with d the vector between the centres, a slab of normal m bounds n . x by a
// (m . x) + (n - a m) . x for any number a, so its factor a needs no error bound, and |a m|, |n - a
// m| are at most |n| and a few per cent, since a is nearly the projection's. So the terms stay
// below those of box_overlap.cpp, and twice its slack, 2 slack |n|_1, covers this form of them; the
// slab of the other part is used as an axis and as a bound, and carries its 2 slack |e|_1 itself. A
// way between two models is an axis that is neither's normal, so both slabs may serve as bounds
// along it. With two such forms the terms are those of box_overlap.cpp twice and a few per cent:
// 132u M |n| and the 1.7322 c |n| of posing, less than 2 slack |n|_1 = (3.4644 c + 256u M) |n|_1.
// What triangles reach is measured from the grid's origin, not from a centre: M bounds these
// magnitudes, too.
#undef HWY_TARGET_INCLUDE
// NOLINTNEXTLINE(readability-identifier-naming): Highway's name
#define HWY_TARGET_INCLUDE "core/geometry/lanes.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include <algorithm>
#include <cmath>

#include "nearmesh/core/geometry/detail/lanes.hpp"
#include "slack.hpp"
#include "vectors.hpp"

HWY_BEFORE_NAMESPACE();
namespace nearmesh::HWY_NAMESPACE {
void place_lanes_all(const RelativeFrame& f, const BoxLanes& other, PlacedLanes& out) {
  const Doubles d;
  const auto at = [&d](double x) { return hn::Set(d, x); };
  for (std::size_t lane = 0; lane < kLanes; lane += hn::Lanes(d)) {
    Vec c[3], half[3], m[3];
    load_boxes(other, lane, c, half);
    for (std::size_t k = 0; k < 3; ++k) {
      hn::StoreU(half[k], d, out.half[k] + lane);
      m[k] = load(other.normal[k] + lane);
    }
    Vec square = hn::Zero(d), length = hn::Zero(d);
    for (std::size_t k = 0; k < 3; ++k) {
      const double* abs_n = f.abs_inverse.data() + 3 * k;
      const double column[3] = {f.inverse[k], f.inverse[3 + k], f.inverse[6 + k]};
      hn::StoreU(hn::Add(dot(f.rotation.data() + 3 * k, c), at(f.translation[k])), d,
                 out.center[k] + lane);
      hn::StoreU(hn::Add(dot(f.abs_rotation.data() + 3 * k, half), at(f.slack)), d,
                 out.reach_own[k] + lane);
      hn::StoreU(hn::Add(half[k], at((abs_n[0] + abs_n[1] + abs_n[2]) * f.slack)), d,
                 out.reach_other[k] + lane);
      const Vec n = dot(column, m);
      hn::StoreU(n, d, out.normal[k] + lane);
      square = hn::Add(square, hn::Mul(n, n));
      length = hn::Add(length, hn::Abs(n));
    }
    const Vec room = hn::Mul(at(2 * f.slack), length);
    hn::StoreU(hn::Sub(load(other.from + lane), room), d, out.from + lane);
    hn::StoreU(hn::Add(load(other.to + lane), room), d, out.to + lane);
    hn::StoreU(hn::IfThenElseZero(hn::Gt(square, hn::Zero(d)), hn::Div(at(1), square)), d,
               out.per_square + lane);
  }
}

/// How far the slabs part two boxes: along the other's normal, and along one's own, each times that
/// normal's length.
struct SlabGaps {
  Vec on_other, on_own;
};
HWY_INLINE SlabGaps slab_gaps(const RelativeFrame& f, const PlacedLanes& other, std::uint32_t i,
                              const BoxLanes& own, std::size_t lane, const Vec (&between)[3],
                              const Vec (&half)[3]) {
  const Doubles d;
  const auto at = [&d](double x) { return hn::Set(d, x); };
  Vec n[3];
  for (std::size_t k = 0; k < 3; ++k) n[k] = load(own.normal[k] + lane);
  const Vec own_from = load(own.from + lane), own_to = load(own.to + lane);
  const Vec e[3] = {at(other.normal[0][i]), at(other.normal[1][i]), at(other.normal[2][i])};
  const Vec other_from = at(other.from[i]), other_to = at(other.to[i]);
  const Vec along = dot(e, n);
  SlabGaps gaps{hn::Zero(d), hn::Zero(d)};
  if (other.per_square[i] > 0) {  // along the other's normal e = a n + rest
    const Vec a = hn::Mul(along, at(1.0 / (kSlabLength * kSlabLength)));  // |n|, nearly
    Vec rest[3];
    for (std::size_t k = 0; k < 3; ++k) rest[k] = hn::Abs(hn::Sub(e[k], hn::Mul(a, n[k])));
    const Vec reach = dot(rest, half), middle = dot(e, between);
    const Vec x = hn::Mul(a, own_from), y = hn::Mul(a, own_to);
    gaps.on_other = hn::Max(hn::Sub(hn::Sub(hn::Add(middle, hn::Min(x, y)), reach), other_to),
                            hn::Sub(other_from, hn::Add(hn::Add(middle, hn::Max(x, y)), reach)));
  }
  // Along one's own n = a e + rest; a lane without a slab has n = 0 and finds nothing.
  const Vec a = hn::Mul(along, at(other.per_square[i]));
  Vec rest[3], reach = hn::Zero(d);
  for (std::size_t k = 0; k < 3; ++k) rest[k] = hn::Sub(n[k], hn::Mul(a, e[k]));
  for (std::size_t j = 0; j < 3; ++j) {
    const double column[3] = {f.rotation[j], f.rotation[3 + j], f.rotation[6 + j]};
    reach = hn::Add(reach, hn::Mul(hn::Abs(dot(column, rest)), at(other.half[j][i])));
  }
  const Vec room =
      hn::Mul(at(2 * f.slack), hn::Add(hn::Add(hn::Abs(n[0]), hn::Abs(n[1])), hn::Abs(n[2])));
  const Vec middle = dot(n, between);  // from the other's centre to one's own
  const Vec x = hn::Mul(a, other_from), y = hn::Mul(a, other_to);
  const Vec from = hn::Sub(hn::Add(middle, own_from), room);
  const Vec to = hn::Add(hn::Add(middle, own_to), room);
  gaps.on_own = hn::Max(hn::Sub(from, hn::Add(hn::Max(x, y), reach)),
                        hn::Sub(hn::Sub(hn::Min(x, y), reach), to));
  return gaps;
}

/// Half extents of lanes, and the vectors from the other's centre.
HWY_INLINE void load_boxes_from(const PlacedLanes& other, std::uint32_t i, const BoxLanes& own,
                                std::size_t lane, Vec (&between)[3], Vec (&half)[3]) {
  load_boxes(own, lane, between, half);
  for (std::size_t k = 0; k < 3; ++k)
    between[k] = hn::Sub(between[k], hn::Set(Doubles(), other.center[k][i]));
}
/// Gaps along the boxes' axes; not positive where they overlap.
HWY_INLINE Vec gap_on_own(const PlacedLanes& other, std::uint32_t i, std::size_t k,
                          const Vec (&between)[3], const Vec (&half)[3]) {
  return hn::Sub(hn::Abs(between[k]), hn::Add(half[k], hn::Set(Doubles(), other.reach_own[k][i])));
}
HWY_INLINE Vec gap_on_other(const RelativeFrame& f, const PlacedLanes& other, std::uint32_t i,
                            std::size_t j, const Vec (&between)[3], const Vec (&half)[3]) {
  return hn::Sub(hn::Abs(dot(f.inverse.data() + 3 * j, between)),
                 hn::Add(dot(f.abs_inverse.data() + 3 * j, half),
                         hn::Set(Doubles(), other.reach_other[j][i])));
}

void find_box_gaps_lanes(const RelativeFrame& f, const PlacedLanes& other, std::uint32_t i,
                         const BoxLanes& own, BoxGaps& gaps) {
  const Doubles d;
  const auto at = [&d](double x) { return hn::Set(d, x); };
  const Vec zero = hn::Zero(d);
  const double per_length = std::sqrt(other.per_square[i]);
  for (std::size_t lane = 0; lane < kLanes; lane += hn::Lanes(d)) {
    Vec between[3], half[3];
    load_boxes_from(other, i, own, lane, between, half);
    // One's own axes are orthonormal in own units, the other's normals in its own, so gaps along
    // them add as squares.
    Vec on_own = zero, on_other = zero, square = zero;
    for (std::size_t k = 0; k < 3; ++k) {
      const Vec gap = hn::Max(gap_on_own(other, i, k, between, half), zero);
      on_own = hn::Add(on_own, hn::Mul(gap, gap));
      const Vec other_gap = hn::Max(gap_on_other(f, other, i, k, between, half), zero);
      on_other = hn::Add(on_other, hn::Mul(other_gap, other_gap));
      const Vec n = load(own.normal[k] + lane);
      square = hn::Add(square, hn::Mul(n, n));
    }
    const SlabGaps slabs = slab_gaps(f, other, i, own, lane, between, half);
    const Vec by_own =
        hn::Max(hn::Div(slabs.on_own, hn::Sqrt(hn::Max(square, at(1)))), hn::Sqrt(on_own));
    const Vec by_other = hn::Mul(slabs.on_other, at(per_length));
    hn::StoreU(hn::Mul(hn::Mul(by_own, at(f.least_metres_per_unit)), at(kGapShrink)), d,
               gaps.on_own_m + lane);
    hn::StoreU(hn::Mul(hn::Max(hn::Mul(by_other, at(f.least_metres_per_unit)),
                               hn::Mul(hn::Sqrt(on_other), at(f.least_metres_per_b_unit))),
                       at(kGapShrink)),
               d, gaps.on_other_m + lane);
  }
}

/// What the other's part reaches towards one's own along the way, about its centre.
HWY_INLINE double reach_back(const RelativeFrame& f, const ApartWay& way, const PlacedLanes& other,
                             std::uint32_t i) {
  double by_box = 0;
  for (std::size_t j = 0; j < 3; ++j) by_box += std::abs(way.back[j]) * other.half[j][i];
  if (!(other.per_square[i] > 0)) return by_box;
  const double e[3] = {other.normal[0][i], other.normal[1][i], other.normal[2][i]};
  const std::array<double, 3>& w = way.way;
  const double a = (w[0] * e[0] + w[1] * e[1] + w[2] * e[2]) * other.per_square[i];
  const double rest[3] = {w[0] - a * e[0], w[1] - a * e[1], w[2] - a * e[2]};
  double by_slab = -std::min(a * other.from[i], a * other.to[i]);
  for (std::size_t j = 0; j < 3; ++j)
    by_slab += std::abs(rest[0] * f.rotation[j] + rest[1] * f.rotation[3 + j] +
                        rest[2] * f.rotation[6 + j]) *
               other.half[j][i];
  return std::min(by_box, by_slab);
}

void find_gaps_along_lanes(const RelativeFrame& f, const ApartWay& way, const PlacedLanes& other,
                           std::uint32_t i, const BoxLanes& own, double* gaps_m) {
  const Doubles d;
  const auto at = [&d](double x) { return hn::Set(d, x); };
  const Vec w[3] = {at(way.way[0]), at(way.way[1]), at(way.way[2])};
  const Vec abs_w[3] = {hn::Abs(w[0]), hn::Abs(w[1]), hn::Abs(w[2])};
  const Vec back = at(reach_back(f, way, other, i) + way.room);
  for (std::size_t lane = 0; lane < kLanes; lane += hn::Lanes(d)) {
    Vec between[3], half[3], n[3], rest[3];
    load_boxes_from(other, i, own, lane, between, half);
    for (std::size_t k = 0; k < 3; ++k) n[k] = load(own.normal[k] + lane);
    // As in slab_gaps: the way is a n + rest, and a lane without a slab has n = 0, from = to = 0,
    // so that its box says the same.
    const Vec a = hn::Mul(dot(w, n), at(1.0 / (kSlabLength * kSlabLength)));
    for (std::size_t k = 0; k < 3; ++k) rest[k] = hn::Abs(hn::Sub(w[k], hn::Mul(a, n[k])));
    const Vec by_slab =
        hn::Add(hn::Max(hn::Mul(a, load(own.from + lane)), hn::Mul(a, load(own.to + lane))),
                dot(rest, half));
    const Vec reach = hn::Min(dot(abs_w, half), by_slab);
    const Vec apart = hn::Neg(dot(w, between));  // from one's own centre to the other's
    hn::StoreU(hn::Mul(hn::Sub(hn::Sub(apart, reach), back), at(way.metres)), d, gaps_m + lane);
  }
}

void find_reaches_lanes(const TriangleLanes& own, const std::array<double, 3>& direction,
                        double* reaches) {
  const Doubles d;
  const Vec w[3] = {hn::Set(d, direction[0]), hn::Set(d, direction[1]), hn::Set(d, direction[2])};
  for (std::size_t lane = 0; lane < kLanes; lane += hn::Lanes(d)) {
    Vec reach[3];
    for (std::size_t c = 0; c < 3; ++c) {
      const Vec p[3] = {load(own.corner[c][0] + lane), load(own.corner[c][1] + lane),
                        load(own.corner[c][2] + lane)};
      reach[c] = dot(w, p);
    }
    hn::StoreU(hn::Max(hn::Max(reach[0], reach[1]), reach[2]), d, reaches + lane);
  }
}

}  // namespace nearmesh::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace nearmesh {

HWY_EXPORT(place_lanes_all);
HWY_EXPORT(find_box_gaps_lanes);
HWY_EXPORT(find_gaps_along_lanes);
HWY_EXPORT(find_reaches_lanes);

void place_lanes(const RelativeFrame& other_in_own, const BoxLanes& other, PlacedLanes& out) {
  HWY_DYNAMIC_DISPATCH(place_lanes_all)(other_in_own, other, out);
}

void find_box_gaps(const RelativeFrame& other_in_own, const PlacedLanes& other,
                   std::uint32_t other_lane, const BoxLanes& own, BoxGaps& gaps) {
  HWY_DYNAMIC_DISPATCH(find_box_gaps_lanes)(other_in_own, other, other_lane, own, gaps);
}

ApartWay::ApartWay(const RelativeFrame& f, const std::array<double, 3>& from_own_to_other)
    : way(from_own_to_other) {
  double square = 0, length = 0;
  for (std::size_t k = 0; k < 3; ++k) {
    back[k] = -(way[0] * f.rotation[k] + way[1] * f.rotation[3 + k] + way[2] * f.rotation[6 + k]);
    square += way[k] * way[k];
    length += std::abs(way[k]);
  }
  origins = way[0] * f.translation[0] + way[1] * f.translation[1] + way[2] * f.translation[2];
  room = 2 * f.slack * length;
  metres = f.least_metres_per_unit * kGapShrink / std::sqrt(square);
}

void find_gaps_along(const RelativeFrame& other_in_own, const ApartWay& way,
                     const PlacedLanes& other, std::uint32_t other_lane, const BoxLanes& own,
                     double (&gaps_m)[kLanes]) {
  HWY_DYNAMIC_DISPATCH(find_gaps_along_lanes)(other_in_own, way, other, other_lane, own, gaps_m);
}

void find_reaches(const TriangleLanes& own, const std::array<double, 3>& direction,
                  double (&reaches)[kLanes]) {
  HWY_DYNAMIC_DISPATCH(find_reaches_lanes)(own, direction, reaches);
}

}  // namespace nearmesh
#endif
