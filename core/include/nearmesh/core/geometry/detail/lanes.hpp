// SPDX-License-Identifier: Apache-2.0
#pragma once
// Eight boxes or triangles of one model side by side: what bounds them, and lower bounds of the
// distance of all of them at once from one box or triangle of another model. Whether they are
// apart: placed_boxes.hpp. By whatever vectors the processor has; each operation stands in one
// order and none is contracted, so every lane gives the same bits on every machine.
//
// Slabs. Beside its box, what lies in it may be known to lie between two parallel planes: a patch
// of surface is much thinner than its box, unless it happens to be parallel to an axis. Two patches
// near to touching are almost parallel, and there the slabs part what the boxes cannot. Measured in
// ARCHITECTURE.md.

#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>

#include "nearmesh/core/geometry/detail/box_overlap.hpp"

namespace nearmesh {

inline constexpr std::uint32_t kLanes = 8;
/// All lanes, as bits.
inline constexpr std::uint32_t kAllLanes = (1U << kLanes) - 1;

/// How long the normals of slabs are, nearly.
inline constexpr double kSlabLength = 127;

/// from <= normal . (x - centre of the box beside it) <= to, in grid units, for all points x of
/// what the box bounds. Normal 0: nothing is known.
struct Slab {
  std::array<std::int8_t, 3> normal{};
  float from = 0, to = 0;
  bool operator==(const Slab&) const = default;
};

/// Boxes and slabs of up to eight parts of a model, in its grid units. Unused lanes hold zeros.
struct BoxLanes {
  std::int32_t lo[3][kLanes] = {}, hi[3][kLanes] = {};
  float from[kLanes] = {}, to[kLanes] = {};
  std::int8_t normal[3][kLanes] = {};

  /// Precondition: the box is not empty.
  void set(std::uint32_t lane, const GridBox& box, const Slab& slab) {
    for (int k = 0; k < 3; ++k) {
      lo[k][lane] = box.lo[k];
      hi[k][lane] = box.hi[k];
      normal[k][lane] = slab.normal[static_cast<std::size_t>(k)];
    }
    from[lane] = slab.from;
    to[lane] = slab.to;
  }
  [[nodiscard]] GridBox box(std::uint32_t lane) const {
    return {{{lo[0][lane], lo[1][lane], lo[2][lane]}}, {{hi[0][lane], hi[1][lane], hi[2][lane]}}};
  }
  [[nodiscard]] Slab slab(std::uint32_t lane) const {
    return {{normal[0][lane], normal[1][lane], normal[2][lane]}, from[lane], to[lane]};
  }
};

/// Up to eight triangles, in grid units: [corner][axis][lane]. Unused lanes repeat a used one.
struct TriangleLanes {
  std::int32_t corner[3][3][kLanes] = {};

  void set(std::uint32_t lane, const std::array<GridPoint, 3>& corners) {
    for (std::size_t c = 0; c < 3; ++c)
      for (int k = 0; k < 3; ++k) corner[c][k][lane] = corners[c][k];
  }
  [[nodiscard]] std::array<GridPoint, 3> corners(std::uint32_t lane) const {
    std::array<GridPoint, 3> out;
    for (std::size_t c = 0; c < 3; ++c)
      for (int k = 0; k < 3; ++k) out[c][k] = corner[c][k][lane];
    return out;
  }
};

/// The greatest float that is not above x: slabs are rounded outwards.
[[nodiscard]] inline float rounded_down(double x) {
  const auto nearest = static_cast<float>(x);
  const bool is_above = static_cast<double>(nearest) > x;
  if (nearest == 0) return is_above ? -std::numeric_limits<float>::denorm_min() : nearest;
  // No branch on which side it fell to: that is hard to foretell.
  const auto bits = std::bit_cast<std::int32_t>(nearest);
  return std::bit_cast<float>(bits + (bits >> 31 | 1) * -static_cast<std::int32_t>(is_above));
}
/// An integer direction close to `direction`, whose length is in [2^-500, 2^500], of a length close
/// to kSlabLength.
[[nodiscard]] inline std::array<std::int8_t, 3> make_slab_normal(
    const std::array<double, 3>& direction) {
  double square = 0;
  for (const double x : direction) square += x * x;
  const double scale = kSlabLength / std::sqrt(square);
  std::array<std::int8_t, 3> normal{};
  for (std::size_t k = 0; k < 3; ++k)
    normal[k] = static_cast<std::int8_t>(direction[k] * scale + std::copysign(0.5, direction[k]));
  return normal;
}

/// Sets a box, and a slab about the mean normal of what it bounds; no slab where that has none.
/// Around boxes and their slabs in the lanes of which the bits are set; the box is empty where none
/// is. Large parts count as the square of their size.
void bound(const BoxLanes& boxes, const float (&sizes)[kLanes], std::uint32_t lanes, GridBox& box,
           Slab& slab);
/// Around the first `count` triangles, which count as their areas. Precondition: 1 <= count <=
/// kLanes.
void bound(const TriangleLanes& triangles, std::uint32_t count, GridBox& box, Slab& slab);

/// Parts of the other model as they are seen from one's own grid: made once, tested against many.
/// In doubles, beside the floats of placed_boxes.hpp, since here the gap itself is the answer:
/// clearances are compared bit by bit, between peers and with recordings. Of floats the walk asks
/// only whether there is a gap. They would bound clearances too, but by less: with gaps smaller by
/// 2^-18 of themselves 22 of the 59 lines of nearmesh-digest change, and the recorded session of
/// the tests is no longer proved.
struct PlacedLanes {
  double center[3][kLanes];         ///< own units
  double half[3][kLanes];           ///< half extents in the other's units
  double reach_own[3][kLanes];      ///< half extents along own axes, with the slack
  double reach_other[3][kLanes];    ///< half extents along the other's normals, with the slack
  double normal[3][kLanes];         ///< of the slab, as a direction of own units; 0: none
  double from[kLanes], to[kLanes];  ///< of the slab about the centre, with the slack
  double per_square[kLanes];        ///< 1 / |normal|^2; 0 where there is none
};
void place_lanes(const RelativeFrame& other_in_own, const BoxLanes& other, PlacedLanes& out);

/// Lower bounds, metres, of the distance between one lane of the other model's and each of one's
/// own: the greater of the gaps along a slab's normal, and along a box's three axes together; 0
/// where none parts them. Unused lanes: any.
struct BoxGaps {
  double on_own_m[kLanes];    ///< by own boxes' axes and slabs
  double on_other_m[kLanes];  ///< by the other's
};
void find_box_gaps(const RelativeFrame& other_in_own, const PlacedLanes& other,
                   std::uint32_t other_lane, const BoxLanes& own, BoxGaps& gaps);

/// A way from one's own model to the other, along which their parts are held apart: that between
/// the nearest that are known, say.
struct ApartWay {
  std::array<double, 3> way;  ///< own units; any serves
  /// Against it, along the other's axes: what a unit of the other's goes back.
  std::array<double, 3> back;
  double origins;  ///< from one's own origin to the other's, times the way's length
  double room;     ///< what is rounded, likewise
  double metres;   ///< that a length along the way stands for, at least

  /// Precondition: the way is not 0.
  ApartWay(const RelativeFrame& other_in_own, const std::array<double, 3>& from_own_to_other);
};
/// Lower bounds, metres, of the distance between one lane of the other model's and each of one's
/// own, by what their boxes and slabs reach along the way; not positive where they overlap there.
/// Unused lanes: any.
void find_gaps_along(const RelativeFrame& other_in_own, const ApartWay& way,
                     const PlacedLanes& other, std::uint32_t other_lane, const BoxLanes& own,
                     double (&gaps_m)[kLanes]);

/// How far each of some triangles reaches along a direction: own units, times its length. Between
/// triangles of two models there are way.origins - way.room, less the one's reach along way.way,
/// less the other's along way.back, times way.metres. Unused lanes: any.
void find_reaches(const TriangleLanes& own, const std::array<double, 3>& direction,
                  double (&reaches)[kLanes]);

/// The other's triangles in own units, as to_a_units places them.
struct PlacedTriangles {
  double corner[3][3][kLanes];
};
void place_triangles(const RelativeFrame& other_in_own, const TriangleLanes& other,
                     PlacedTriangles& out);
/// Lower bounds, metres, of the distance between an own triangle (by as_doubles) and each of the
/// other's, by their extents along one's own axes.
void extents_gaps_m(const RelativeFrame& other_in_own, const DoubleTriangle& own,
                    const PlacedTriangles& other, double (&gaps_m)[kLanes]);
/// The same by the direction between their closest edges, or corner and face: triangles_gap_m of
/// each, to the bit.
void triangles_gaps_m(const RelativeFrame& other_in_own, const DoubleTriangle& own,
                      const PlacedTriangles& other, double (&gaps_m)[kLanes]);

/// How eight parts may move: all the same way, and each by so much around.
struct DriftLanes {
  std::array<double, 3> along{};
  std::array<double, kLanes> around{};
};
/// boxes_stay_apart of one box and each of eight, as bits. Unused lanes: any.
[[nodiscard]] std::uint32_t boxes_stay_apart(const RelativeFrame& other_in_own,
                                             const DriftLanes& drift, const CenteredBox& own,
                                             const BoxLanes& other);
[[nodiscard]] std::uint32_t boxes_stay_apart(const RelativeFrame& other_in_own,
                                             const DriftLanes& drift, const BoxLanes& own,
                                             const CenteredBox& other);
/// box_triangle_stay_apart of an own box and each of the other's triangles, as bits.
[[nodiscard]] std::uint32_t box_triangles_stay_apart(const RelativeFrame& other_in_own,
                                                     const Drift& drift, const CenteredBox& own,
                                                     const TriangleLanes& other);

}  // namespace nearmesh
