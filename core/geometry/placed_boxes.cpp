// SPDX-License-Identifier: Apache-2.0
#undef HWY_TARGET_INCLUDE
// NOLINTNEXTLINE(readability-identifier-naming): Highway's name
#define HWY_TARGET_INCLUDE "core/geometry/placed_boxes.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include <algorithm>
#include <cmath>

#include "placed_boxes.hpp"
//
#include "box_kernels.hpp"
#include "kernels_for_tests.hpp"
#include "triangle_kernels.hpp"

HWY_BEFORE_NAMESPACE();
namespace nearmesh::HWY_NAMESPACE {

void place_boxes_all(const Placing& placing, const BoxLanes& boxes, PlacedBoxes& out) {
  place_boxes_inline(placing, boxes, out);
}
void place_faces_all(const Placing& placing, const TriangleLanes& faces, PlacedFaces& out) {
  place_faces_inline(placing, faces, out);
}
std::uint32_t boxes_apart_all(const Placing& placing, const PlacedBoxes& own,
                              const PlacedBoxes& other, std::uint32_t i) {
  return boxes_apart_inline<false>(own, other, i, placing.cells_ratio, nullptr);
}
std::uint32_t faces_apart_all(const Placing& placing, const PlacedFaces& own,
                              const PlacedBoxes& other, std::uint32_t i) {
  return faces_apart_inline<false>(own, kAllLanes, other, i, placing.cells_ratio);
}
PairVerdicts test_triangles_all(const RelativeFrame& f, const TriangleLanes& own,
                                const TriangleLanes& other) {
  return test_triangles_inline(f, own, other, kAllLanes);
}

}  // namespace nearmesh::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace nearmesh {

HWY_EXPORT(place_boxes_all);
HWY_EXPORT(place_faces_all);
HWY_EXPORT(boxes_apart_all);
HWY_EXPORT(faces_apart_all);
HWY_EXPORT(test_triangles_all);

Placing::Placing(const RelativeFrame& own_in_other_units, const RelativeFrame& other_in_own,
                 const GridBox& bounds)
    : own_in_other(own_in_other_units),
      cells_ratio(
          static_cast<float>(own_in_other_units.metres_per_unit / other_in_own.metres_per_unit)),
      has_slabs(cells_ratio < 0x1p56F && cells_ratio > 0x1p-56F) {
  const RelativeFrame& f = own_in_other;
  const CenteredBox box = centered(bounds);
  double own[3], own_most = 0, other_most = 0;
  for (std::size_t k = 0; k < 3; ++k) {
    own[k] = std::abs(box.center[k]) + box.half[k];
    own_most = std::max(own_most, own[k]);
  }
  for (std::size_t k = 0; k < 3; ++k) {
    const double* row = f.abs_rotation.data() + 3 * k;
    other_most = std::max(other_most, std::abs(f.translation[k]) + row[0] * own[0] +
                                          row[1] * own[1] + row[2] * own[2]);
    for (std::size_t j = 0; j < 3; ++j) {
      abs_rotation[3 * k + j] = static_cast<float>(row[j]);
      turned_back[3 * k + j] = static_cast<float>(f.inverse[3 * j + k]);
    }
  }
  // Half a unit in the last place of floats, and what doubles and the sums of rooms may add.
  constexpr double kHalfUlp = 0x1.01p-24;
  own_room = static_cast<float>(kHalfUlp * own_most);
  const double other_room = kHalfUlp * other_most, slack = f.slack * (1 + 0x1p-20);
  reach_room = static_cast<float>(slack + other_room);
  slab_room = static_cast<float>(2 * slack + other_room * (1 + 0x1p-18));
}

void place_boxes(const Placing& placing, const BoxLanes& boxes, PlacedBoxes& out) {
  HWY_DYNAMIC_DISPATCH(place_boxes_all)(placing, boxes, out);
}

void place_faces(const Placing& placing, const TriangleLanes& faces, PlacedFaces& out) {
  HWY_DYNAMIC_DISPATCH(place_faces_all)(placing, faces, out);
}

std::uint32_t boxes_apart(const Placing& placing, const PlacedBoxes& own, const PlacedBoxes& other,
                          std::uint32_t other_lane) {
  return HWY_DYNAMIC_DISPATCH(boxes_apart_all)(placing, own, other, other_lane);
}

std::uint32_t faces_apart(const Placing& placing, const PlacedFaces& own, const PlacedBoxes& other,
                          std::uint32_t other_lane) {
  return HWY_DYNAMIC_DISPATCH(faces_apart_all)(placing, own, other, other_lane);
}

PairVerdicts test_triangles(const RelativeFrame& other_in_own, const TriangleLanes& own,
                            const TriangleLanes& other) {
  return HWY_DYNAMIC_DISPATCH(test_triangles_all)(other_in_own, own, other);
}

}  // namespace nearmesh
#endif
