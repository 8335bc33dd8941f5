// SPDX-License-Identifier: Apache-2.0
// Why boxes that do not meet prove more than the corners of the boxes: core/THEOREM.md, "Free by
// bounds".
#include "body_bounds.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/base/hash.hpp"
#include "core/geometry/motion_bounds.hpp"

namespace nearmesh {
namespace {

/// Covers the rounding of a sum of four products, and of the sums that follow.
constexpr double kRounding = 0x1p-48;

/// A header may tell of a model so large, or so far from its origin, that sums of its places are
/// beyond doubles. Bounds that are no numbers would meet nothing: where there are none the body may
/// be anywhere.
void open_where_unknown(WorldBox& box) {
  constexpr double kEverywhere = std::numeric_limits<double>::infinity();
  for (std::size_t k = 0; k < 3; ++k) {
    if (std::isfinite(box.lo_m[k]) && std::isfinite(box.hi_m[k])) continue;
    box.lo_m[k] = -kEverywhere;
    box.hi_m[k] = kEverywhere;
  }
}

}  // namespace

ModelBounds::ModelBounds(const Grid& grid, const SplitStore& store)
    : ModelBounds(grid, store.whole_box()) {}

ModelBounds::ModelBounds(const Grid& grid, const GridBox& box)
    : grid_(grid),
      // The lattice of a pair is at most the coarser of what the two have alone. It moves points of
      // both, and neither body knows the other: each counts its own twice.
      lattice_exponent_(nearmesh::lattice_exponent(grid, grid) + 1) {
  reach_m_ = nearmesh::reach_m(grid, box);
  for (int k = 0; k < 3; ++k) {
    const auto axis = static_cast<std::size_t>(k);
    const double lo_m = grid.origin_m[axis] + std::ldexp(box.lo[k], grid.exponent);
    const double hi_m = grid.origin_m[axis] + std::ldexp(box.hi[k], grid.exponent);
    center_m_[axis] = (lo_m + hi_m) / 2;
    half_m_[axis] = (hi_m - lo_m) / 2;
  }
}

double ModelBounds::way_m(const Motion& motion, double duration_s) const {
  if (duration_s == 0) return 0;
  return speed_bound_mps(motion, reach_m_) * duration_s * (1 + kRounding);
}

WorldBox ModelBounds::around(const Motion& motion, double duration_s, double margin_m) const {
  const double grown_m = posing_error_m(motion, reach_m_, duration_s, grid_, lattice_exponent_) +
                         way_m(motion, duration_s) + margin_m;
  WorldBox box;
  for (std::size_t k = 0; k < 3; ++k) {
    const double* row = motion.pose.rotation.data() + 3 * k;
    const double center_m = row[0] * center_m_[0] + row[1] * center_m_[1] + row[2] * center_m_[2] +
                            motion.pose.translation_m[k];
    const double half_m = std::abs(row[0]) * half_m_[0] + std::abs(row[1]) * half_m_[1] +
                          std::abs(row[2]) * half_m_[2] + grown_m;
    const double rounding_m =
        kRounding * (4 * reach_m_ + half_m + std::abs(motion.pose.translation_m[k]));
    box.lo_m[k] = center_m - half_m - rounding_m;
    box.hi_m[k] = center_m + half_m + rounding_m;
  }
  open_where_unknown(box);
  return box;
}

WorldBox ModelBounds::around_ball(const std::array<double, 3>& center_m, double radius_m,
                                  double margin_m) const {
  // Rotations of poses stretch by less.
  constexpr double kStretch = 1 + 0x1p-10;
  Motion farthest;  // of all poses with the origin in the ball
  for (std::size_t k = 0; k < 3; ++k)
    farthest.pose.translation_m[k] = std::abs(center_m[k]) + radius_m;
  const double half_m = radius_m + kStretch * reach_m_ + margin_m +
                        posing_error_m(farthest, reach_m_, 0, grid_, lattice_exponent_);
  WorldBox box;
  for (std::size_t k = 0; k < 3; ++k) {
    const double rounding_m = kRounding * (4 * reach_m_ + half_m + std::abs(center_m[k]));
    box.lo_m[k] = center_m[k] - half_m - rounding_m;
    box.hi_m[k] = center_m[k] + half_m + rounding_m;
  }
  open_where_unknown(box);
  return box;
}

double roam_s(std::uint64_t number) { return 4 * (1 + static_cast<double>(mix(number) % 16) / 16); }

WorldBox roam_along(const WorldBox& box, const std::array<double, 3>& way_m, double aside_m) {
  WorldBox roam;
  for (std::size_t k = 0; k < 3; ++k) {
    roam.lo_m[k] = box.lo_m[k] + std::min(way_m[k], 0.0) - aside_m;
    roam.hi_m[k] = box.hi_m[k] + std::max(way_m[k], 0.0) + aside_m;
  }
  return roam;
}

WorldBox hull(const WorldBox& a, const WorldBox& b) {
  WorldBox both;
  for (std::size_t k = 0; k < 3; ++k) {
    both.lo_m[k] = std::min(a.lo_m[k], b.lo_m[k]);
    both.hi_m[k] = std::max(a.hi_m[k], b.hi_m[k]);
  }
  return both;
}

}  // namespace nearmesh
