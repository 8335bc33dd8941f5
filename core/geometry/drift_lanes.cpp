// SPDX-License-Identifier: Apache-2.0
// boxes_stay_apart and box_triangle_stay_apart of box_overlap.cpp, eight at a time: the same
// operations in the same order, so each lane says what they say. The proofs stand there.
#undef HWY_TARGET_INCLUDE
// NOLINTNEXTLINE(readability-identifier-naming): Highway's name
#define HWY_TARGET_INCLUDE "core/geometry/drift_lanes.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include <cmath>

#include "nearmesh/core/geometry/detail/lanes.hpp"
#include "vectors.hpp"

HWY_BEFORE_NAMESPACE();
namespace nearmesh::HWY_NAMESPACE {

/// Boxes and what they are held against, a lane each; own ones grown by what is around.
struct BoxVectors {
  Vec own_center[3], own_half[3], other_center[3], other_half[3];
};
HWY_INLINE Mask boxes_part(const RelativeFrame& f, const std::array<double, 3>& way,
                           const BoxVectors& boxes) {
  const Doubles d;
  const auto at = [&d](double x) { return hn::Set(d, x); };
  const Vec(&ha)[3] = boxes.own_half;
  const Vec(&hb)[3] = boxes.other_half;
  Vec between[3];
  Mask apart = hn::FirstN(d, 0);
  for (std::size_t k = 0; k < 3; ++k) {
    between[k] =
        hn::Sub(hn::Add(dot(f.rotation.data() + 3 * k, boxes.other_center), at(f.translation[k])),
                boxes.own_center[k]);
    const Vec gap =
        hn::Sub(hn::Abs(between[k]), hn::Add(ha[k], dot(f.abs_rotation.data() + 3 * k, hb)));
    apart = hn::Or(apart, hn::Gt(gap, at(std::abs(way[k]))));
  }
  if (hn::AllTrue(d, apart)) return apart;
  for (std::size_t k = 0; k < 3; ++k) {
    const double* n = f.inverse.data() + 3 * k;
    const Vec gap =
        hn::Sub(hn::Abs(dot(n, between)), hn::Add(hb[k], dot(f.abs_inverse.data() + 3 * k, ha)));
    apart = hn::Or(apart, hn::Gt(gap, at(std::abs(n[0] * way[0] + n[1] * way[1] + n[2] * way[2]))));
  }
  if (hn::AllTrue(d, apart)) return apart;
  for (std::size_t i = 0; i < 3; ++i) {
    const std::size_t i1 = (i + 1) % 3, i2 = (i + 2) % 3;
    for (std::size_t j = 0; j < 3; ++j) {
      const std::size_t j1 = (j + 1) % 3, j2 = (j + 2) % 3;
      const double n1 = f.rotation[3 * i2 + j], n2 = f.rotation[3 * i1 + j];
      const Vec reach_own = hn::Add(hn::Mul(ha[i1], at(f.abs_rotation[3 * i2 + j])),
                                    hn::Mul(ha[i2], at(f.abs_rotation[3 * i1 + j])));
      const Vec reach_other = hn::Add(hn::Mul(hb[j1], at(f.abs_cofactor[3 * i + j2])),
                                      hn::Mul(hb[j2], at(f.abs_cofactor[3 * i + j1])));
      const Vec gap =
          hn::Sub(hn::Abs(hn::Sub(hn::Mul(at(n2), between[i2]), hn::Mul(at(n1), between[i1]))),
                  hn::Add(reach_own, reach_other));
      apart = hn::Or(apart, hn::Gt(gap, at(std::abs(n2 * way[i2] - n1 * way[i1]))));
    }
  }
  return apart;
}
HWY_INLINE void set_box(const CenteredBox& box, Vec (&center)[3], Vec (&half)[3]) {
  for (std::size_t k = 0; k < 3; ++k) {
    center[k] = hn::Set(Doubles(), box.center[k]);
    half[k] = hn::Set(Doubles(), box.half[k]);
  }
}
HWY_INLINE void grow_own(const double* around, BoxVectors& boxes) {
  for (Vec& half : boxes.own_half) half = hn::Add(half, hn::LoadU(Doubles(), around));
}

/// Own box, grown by slack and drift, against the other's triangles from `lane` on.
HWY_INLINE Mask triangles_part(const RelativeFrame& f, const CenteredBox& own,
                               const TriangleLanes& other, std::size_t lane) {
  const Doubles d;
  const auto at = [&d](double x) { return hn::Set(d, x); };
  const Vec half[3] = {at(own.half[0]), at(own.half[1]), at(own.half[2])};
  Vec v[3][3];
  for (std::size_t c = 0; c < 3; ++c) {
    const Vec p[3] = {load(other.corner[c][0] + lane), load(other.corner[c][1] + lane),
                      load(other.corner[c][2] + lane)};
    for (std::size_t k = 0; k < 3; ++k)
      v[c][k] = hn::Sub(hn::Add(dot(f.rotation.data() + 3 * k, p), at(f.translation[k])),
                        at(own.center[k]));
  }
  const auto is_beyond = [](Vec lo, Vec hi, Vec reach) {
    return hn::Or(hn::Gt(lo, reach), hn::Lt(hi, hn::Neg(reach)));
  };
  Mask apart = hn::FirstN(d, 0);
  for (std::size_t k = 0; k < 3; ++k)
    apart = hn::Or(apart, is_beyond(hn::Min(hn::Min(v[0][k], v[1][k]), v[2][k]),
                                    hn::Max(hn::Max(v[0][k], v[1][k]), v[2][k]), half[k]));
  if (hn::AllTrue(d, apart)) return apart;
  Vec edges[3][3];
  for (std::size_t c = 0; c < 3; ++c)
    for (std::size_t k = 0; k < 3; ++k) edges[c][k] = hn::Sub(v[(c + 1) % 3][k], v[c][k]);
  {
    Vec n[3];
    for (std::size_t k = 0; k < 3; ++k) n[k] = cross(edges[0], edges[1], k);
    const Vec abs_n[3] = {hn::Abs(n[0]), hn::Abs(n[1]), hn::Abs(n[2])};
    const Vec x = dot(n, v[0]), y = dot(n, v[1]), z = dot(n, v[2]);
    apart = hn::Or(
        apart, is_beyond(hn::Min(hn::Min(x, y), z), hn::Max(hn::Max(x, y), z), dot(abs_n, half)));
  }
  for (std::size_t c = 0; c < 3; ++c) {
    const Vec(&e)[3] = edges[c];
    const Vec(&on_edge)[3] = v[c];  // both ends of the edge project alike
    const Vec(&opposite)[3] = v[(c + 2) % 3];
    for (std::size_t k = 0; k < 3; ++k) {
      const std::size_t i = (k + 1) % 3, j = (k + 2) % 3;
      const Vec x = cross(e, on_edge, k), y = cross(e, opposite, k);
      const Vec reach = hn::Add(hn::Mul(hn::Abs(e[j]), half[i]), hn::Mul(hn::Abs(e[i]), half[j]));
      apart = hn::Or(apart, is_beyond(hn::Min(x, y), hn::Max(x, y), reach));
    }
  }
  return apart;
}

std::uint32_t box_parts_lanes(const RelativeFrame& f, const std::array<double, 3>& way,
                              const double* around, const CenteredBox& own, const BoxLanes& other) {
  std::uint32_t apart = 0;
  for (std::size_t lane = 0; lane < kLanes; lane += hn::Lanes(Doubles())) {
    BoxVectors boxes;
    set_box(own, boxes.own_center, boxes.own_half);
    load_boxes(other, lane, boxes.other_center, boxes.other_half);
    grow_own(around + lane, boxes);
    apart |= bits_of(boxes_part(f, way, boxes)) << lane;
  }
  return apart;
}
std::uint32_t lanes_part_box(const RelativeFrame& f, const std::array<double, 3>& way,
                             const double* around, const BoxLanes& own, const CenteredBox& other) {
  std::uint32_t apart = 0;
  for (std::size_t lane = 0; lane < kLanes; lane += hn::Lanes(Doubles())) {
    BoxVectors boxes;
    load_boxes(own, lane, boxes.own_center, boxes.own_half);
    set_box(other, boxes.other_center, boxes.other_half);
    grow_own(around + lane, boxes);
    apart |= bits_of(boxes_part(f, way, boxes)) << lane;
  }
  return apart;
}
std::uint32_t triangles_part_lanes(const RelativeFrame& f, const CenteredBox& own,
                                   const TriangleLanes& other) {
  std::uint32_t apart = 0;
  for (std::size_t lane = 0; lane < kLanes; lane += hn::Lanes(Doubles()))
    apart |= bits_of(triangles_part(f, own, other, lane)) << lane;
  return apart;
}

}  // namespace nearmesh::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace nearmesh {

HWY_EXPORT(box_parts_lanes);
HWY_EXPORT(lanes_part_box);
HWY_EXPORT(triangles_part_lanes);

namespace {

/// By how much own boxes grow: as boxes_stay_apart() lets them.
std::array<double, kLanes> grown_by(const RelativeFrame& f, const DriftLanes& drift) {
  std::array<double, kLanes> around;
  for (std::size_t lane = 0; lane < kLanes; ++lane)
    around[lane] = f.slack + reach({drift.along, drift.around[lane]});
  return around;
}

}  // namespace

std::uint32_t boxes_stay_apart(const RelativeFrame& f, const DriftLanes& drift,
                               const CenteredBox& own, const BoxLanes& other) {
  return HWY_DYNAMIC_DISPATCH(box_parts_lanes)(f, drift.along, grown_by(f, drift).data(), own,
                                               other);
}
std::uint32_t boxes_stay_apart(const RelativeFrame& f, const DriftLanes& drift, const BoxLanes& own,
                               const CenteredBox& other) {
  return HWY_DYNAMIC_DISPATCH(lanes_part_box)(f, drift.along, grown_by(f, drift).data(), own,
                                              other);
}

std::uint32_t box_triangles_stay_apart(const RelativeFrame& f, const Drift& drift,
                                       const CenteredBox& a, const TriangleLanes& b) {
  CenteredBox grown = a;
  for (std::size_t k = 0; k < 3; ++k) {
    grown.half[k] += reach(drift) + std::abs(drift.along[k]);
    grown.half[k] += f.slack;
  }
  return HWY_DYNAMIC_DISPATCH(triangles_part_lanes)(f, grown, b);
}

}  // namespace nearmesh
#endif
