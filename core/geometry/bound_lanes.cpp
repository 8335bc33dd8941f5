// SPDX-License-Identifier: Apache-2.0
// A box and a slab around eight parts at once. The slab's normal is the mean of what it bounds: of
// faces each as long as the face is large, of parts each as large as its box tells. Sums over lanes
// stand in one order, whatever the vectors.
#undef HWY_TARGET_INCLUDE
// NOLINTNEXTLINE(readability-identifier-naming): Highway's name
#define HWY_TARGET_INCLUDE "core/geometry/bound_lanes.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include <limits>

#include "nearmesh/core/geometry/detail/lanes.hpp"
#include "vectors.hpp"

HWY_BEFORE_NAMESPACE();
namespace nearmesh::HWY_NAMESPACE {

using Units = hn::CappedTag<std::int32_t, kLanes>;
constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// Which of the lanes from `lane` on are among `lanes`.
template <class D>
HWY_INLINE hn::Mask<D> mask_of(D d, std::uint32_t lanes, std::size_t lane) {
  const std::uint8_t bits[8] = {static_cast<std::uint8_t>(lanes >> lane)};
  return hn::LoadMaskBits(d, bits);
}
HWY_INLINE double least_of(Vec v) { return hn::GetLane(hn::MinOfLanes(Doubles(), v)); }
HWY_INLINE double most_of(Vec v) { return hn::GetLane(hn::MaxOfLanes(Doubles(), v)); }

HWY_INLINE std::array<double, 3> sums_of(double (&v)[3][kLanes]) {
  std::array<double, 3> sums;
  for (std::size_t k = 0; k < 3; ++k) {
    for (std::size_t half = kLanes / 2; half > 0; half /= 2)
      for (std::size_t i = 0; i < half; ++i) v[k][i] += v[k][i + half];
    sums[k] = v[k][0];
  }
  return sums;
}
HWY_INLINE bool has_length(const std::array<double, 3>& v) {
  return v[0] != 0 || v[1] != 0 || v[2] != 0;
}

/// Number by number: a whole slab would be put together in memory first.
HWY_INLINE void set(Slab& slab, const std::array<std::int8_t, 3>& normal, double from, double to) {
  for (std::size_t k = 0; k < 3; ++k) slab.normal[k] = normal[k];
  slab.from = rounded_down(from);
  slab.to = -rounded_down(-to);
}

HWY_INLINE GridBox box_around(const BoxLanes& boxes, std::uint32_t lanes) {
  const Units d;
  GridBox box;
  for (int k = 0; k < 3; ++k) {
    auto lo = hn::Set(d, box.lo[k]), hi = hn::Set(d, box.hi[k]);
    for (std::size_t lane = 0; lane < kLanes; lane += hn::Lanes(d)) {
      const auto used = mask_of(d, lanes, lane);
      lo = hn::Min(lo, hn::IfThenElse(used, hn::LoadU(d, boxes.lo[k] + lane), lo));
      hi = hn::Max(hi, hn::IfThenElse(used, hn::LoadU(d, boxes.hi[k] + lane), hi));
    }
    box.lo[k] = hn::GetLane(hn::MinOfLanes(d, lo));
    box.hi[k] = hn::GetLane(hn::MaxOfLanes(d, hi));
  }
  return box;
}

/// Bounds of normal . (x - origin) over all x that lanes [lane, lane + Lanes) bound: a part between
/// the planes of its own slab, normal s, has normal . x = a (s . x) + (normal - a s) . x for any a.
struct Spans {
  Vec from, to;
};
HWY_INLINE Spans spans_along(const std::array<std::int8_t, 3>& normal, const GridPoint& origin,
                             const BoxLanes& boxes, std::size_t lane) {
  const Doubles d;
  const auto at = [&d](double x) { return hn::Set(d, x); };
  Vec n[3], s[3], center[3], half[3];
  load_boxes(boxes, lane, center, half);
  for (std::size_t k = 0; k < 3; ++k) {
    n[k] = at(normal[k]);
    s[k] = load(boxes.normal[k] + lane);
    center[k] = hn::Sub(center[k], at(origin.v[k]));
  }
  const Vec square = dot(s, s), middle = dot(n, center);
  const Vec a = hn::Div(dot(n, s), hn::Max(square, at(1)));  // 0 where there is no slab
  Vec rest[3];
  for (std::size_t k = 0; k < 3; ++k) rest[k] = hn::Abs(hn::Sub(n[k], hn::Mul(a, s[k])));
  const Vec reach = dot(rest, half);
  const Vec x = hn::Mul(a, load(boxes.from + lane)), y = hn::Mul(a, load(boxes.to + lane));
  const Vec rounding = at(0x1p-6);  // terms below 2^42, some ten roundings
  return {hn::Sub(hn::Sub(hn::Add(middle, hn::Min(x, y)), reach), rounding),
          hn::Add(hn::Add(hn::Add(middle, hn::Max(x, y)), reach), rounding)};
}

void bound_boxes(const BoxLanes& boxes, const float* sizes, std::uint32_t lanes, GridBox& box,
                 Slab& slab) {
  const Doubles d;
  double directions[3][kLanes];
  for (std::size_t lane = 0; lane < kLanes; lane += hn::Lanes(d)) {
    const Vec size = hn::IfThenElseZero(mask_of(d, lanes, lane), load(sizes + lane));
    for (std::size_t k = 0; k < 3; ++k)
      hn::StoreU(hn::Mul(hn::Mul(size, size), load(boxes.normal[k] + lane)), d,
                 directions[k] + lane);
  }
  box = box_around(boxes, lanes);
  slab = {};
  const std::array<double, 3> direction = sums_of(directions);
  if (!has_length(direction)) return;
  const std::array<std::int8_t, 3> normal = make_slab_normal(direction);
  Vec from = hn::Set(d, kInfinity), to = hn::Set(d, -kInfinity);
  for (std::size_t lane = 0; lane < kLanes; lane += hn::Lanes(d)) {
    const Mask used = mask_of(d, lanes, lane);
    const Spans spans = spans_along(normal, box.lo, boxes, lane);
    from = hn::Min(from, hn::IfThenElse(used, spans.from, from));
    to = hn::Max(to, hn::IfThenElse(used, spans.to, to));
  }
  double middle = 0;  // the box's centre, from its lower corner
  for (std::size_t k = 0; k < 3; ++k)
    middle += normal[k] * (0.5 * (static_cast<double>(box.hi.v[k]) - box.lo.v[k]));
  set(slab, normal, least_of(from) - middle, most_of(to) - middle);
}

void bound_triangles(const TriangleLanes& triangles, std::uint32_t count, GridBox& box,
                     Slab& slab) {
  const Units units;
  for (int k = 0; k < 3; ++k) {
    auto lo = hn::LoadU(units, triangles.corner[0][k]), hi = lo;
    for (const auto& corner : triangles.corner)
      for (std::size_t lane = 0; lane < kLanes; lane += hn::Lanes(units)) {
        const auto at = hn::LoadU(units, corner[k] + lane);
        lo = hn::Min(lo, at);
        hi = hn::Max(hi, at);
      }
    box.lo[k] = hn::GetLane(hn::MinOfLanes(units, lo));
    box.hi[k] = hn::GetLane(hn::MaxOfLanes(units, hi));
  }
  slab = {};
  const Doubles d;
  double directions[3][kLanes];
  for (std::size_t lane = 0; lane < kLanes; lane += hn::Lanes(d)) {
    const Mask used = mask_of(d, (1U << count) - 1, lane);
    Vec u[3], v[3];
    for (std::size_t k = 0; k < 3; ++k) {
      const Vec origin = load(triangles.corner[0][k] + lane);
      u[k] = hn::Sub(load(triangles.corner[1][k] + lane), origin);
      v[k] = hn::Sub(load(triangles.corner[2][k] + lane), origin);
    }
    for (std::size_t k = 0; k < 3; ++k)
      hn::StoreU(hn::IfThenElseZero(used, cross(u, v, k)), d, directions[k] + lane);
  }
  const std::array<double, 3> direction = sums_of(directions);
  if (!has_length(direction)) return;
  const std::array<std::int8_t, 3> normal = make_slab_normal(direction);
  // Exact: |n . (x - c)| < 2^41 in halves.
  const Vec n[3] = {hn::Set(d, normal[0]), hn::Set(d, normal[1]), hn::Set(d, normal[2])};
  Vec center[3];
  for (std::size_t k = 0; k < 3; ++k)
    center[k] = hn::Set(d, 0.5 * (static_cast<double>(box.lo.v[k]) + box.hi.v[k]));
  Vec from = hn::Set(d, kInfinity), to = hn::Set(d, -kInfinity);
  for (const auto& corner : triangles.corner)
    for (std::size_t lane = 0; lane < kLanes; lane += hn::Lanes(d)) {
      Vec at[3];
      for (std::size_t k = 0; k < 3; ++k) at[k] = hn::Sub(load(corner[k] + lane), center[k]);
      const Vec along = dot(n, at);
      from = hn::Min(from, along);
      to = hn::Max(to, along);
    }
  // Of 0 and -0 vectors take either.
  set(slab, normal, least_of(from) + 0.0, most_of(to) + 0.0);
}

}  // namespace nearmesh::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace nearmesh {

HWY_EXPORT(bound_boxes);
HWY_EXPORT(bound_triangles);

void bound(const BoxLanes& boxes, const float (&sizes)[kLanes], std::uint32_t lanes, GridBox& box,
           Slab& slab) {
  HWY_DYNAMIC_DISPATCH(bound_boxes)(boxes, sizes, lanes, box, slab);
}

void bound(const TriangleLanes& triangles, std::uint32_t count, GridBox& box, Slab& slab) {
  HWY_DYNAMIC_DISPATCH(bound_triangles)(triangles, count, box, slab);
}

}  // namespace nearmesh
#endif
