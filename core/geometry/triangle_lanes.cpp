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
HWY_EXPORT(place_triangles_all);

void extents_gaps_m(const RelativeFrame& other_in_own, const DoubleTriangle& own,
                    const PlacedTriangles& other, double (&gaps_m)[kLanes]) {
  HWY_DYNAMIC_DISPATCH(extents_gaps_lanes)(other_in_own, own, other, gaps_m);
}

void place_triangles(const RelativeFrame& other_in_own, const TriangleLanes& other,
                     PlacedTriangles& out) {
  HWY_DYNAMIC_DISPATCH(place_triangles_all)(other_in_own, other, out);
}

}  // namespace nearmesh
#endif
