// SPDX-License-Identifier: Apache-2.0
#pragma once
// Which boxes of a world's pages a probe may meet: grown as those of a tree are
// (core/query/ray_walk.cpp).

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <span>

#include "core/query/probe_needs.hpp"
#include "page.hpp"

namespace nearmesh {

/// What may meet a box, as seen from the world's grid.
struct Reach {
  std::array<double, 3> lo{}, hi{};
};
[[nodiscard]] inline bool meets(const Reach& reach, const CellBox& box) {
  for (std::size_t k = 0; k < 3; ++k)
    if (reach.hi[k] < static_cast<double>(box.lo[k]) ||
        reach.lo[k] > static_cast<double>(box.hi[k]))
      return false;
  return true;
}

/// A ray as seen from the world's grid.
class SeenRay {
 public:
  SeenRay(const GridView& view, const LatticeRay& ray) : margin_(view.margin) {
    from_ = view.point(ray.from);
    const std::array<double, 3> to = view.point(ray.to);
    for (std::size_t k = 0; k < 3; ++k) {
      constexpr double kLeast = 0x1p-20;
      way_[k] = to[k] - from_[k];
      if (std::abs(way_[k]) < kLeast) way_[k] = kLeast;
    }
  }
  /// When it enters the box at the earliest; none where it does not.
  [[nodiscard]] std::optional<double> enters(const CellBox& box) const {
    double in = 0, out = 1;
    for (std::size_t k = 0; k < 3; ++k) {
      const double one = (static_cast<double>(box.lo[k]) - margin_[k] - from_[k]) / way_[k],
                   two = (static_cast<double>(box.hi[k]) + margin_[k] - from_[k]) / way_[k];
      in = std::max(in, std::min(one, two));
      out = std::min(out, std::max(one, two));
    }
    return in <= out ? std::optional(in) : std::nullopt;
  }

 private:
  std::array<double, 3> margin_, from_{}, way_{};
};

/// Around world points, as seen from the grid, and so much around them; with room for all rounding.
[[nodiscard]] inline Reach reach_of(const GridView& view, const PosedFrame& frame,
                                    std::span<const std::array<double, 3>> points_m,
                                    double around_m) {
  Reach reach;
  reach.lo.fill(std::numeric_limits<double>::infinity());
  reach.hi.fill(-std::numeric_limits<double>::infinity());
  const double around = around_m * std::ldexp(1.0, -frame.grid.exponent) * (1 + 1e-4);
  for (const auto& point_m : points_m) {
    // Beyond 2^60 lattice cells there is nothing of any world.
    LatticePoint at;
    for (std::size_t k = 0; k < 3; ++k)
      at.v[k] = static_cast<std::int64_t>(
          std::floor(std::clamp(std::ldexp(point_m[k], -frame.lattice_exp), -0x1p60, 0x1p60)));
    const std::array<double, 3> seen = view.point(at);
    for (std::size_t k = 0; k < 3; ++k) {
      // A lattice cell for the floor, a cell of the grid for a box's rounded extents, and what
      // doubles lose far away.
      const double room = 4 + view.margin[k] + around + std::abs(seen[k]) * 0x1p-40;
      reach.lo[k] = std::min(reach.lo[k], seen[k] - room);
      reach.hi[k] = std::max(reach.hi[k], seen[k] + room);
    }
  }
  return reach;
}

[[nodiscard]] inline Reach reach_of(const GridView& view, const PosedFrame& frame,
                                    const BallProbe& ball) {
  return reach_of(view, frame, std::span(&ball.center_m, 1), ball.radius_m);
}

[[nodiscard]] inline Reach reach_of(const GridView& view, const PosedFrame& frame,
                                    const BoxProbe& box) {
  std::array<std::array<double, 3>, 8> corners;
  for (std::size_t corner = 0; corner < 8; ++corner)
    for (std::size_t k = 0; k < 3; ++k) {
      corners[corner][k] = box.pose.translation_m[k];
      for (std::size_t axis = 0; axis < 3; ++axis)
        corners[corner][k] += box.pose.rotation[3 * k + axis] *
                              ((corner >> axis & 1U) != 0 ? box.half_m[axis] : -box.half_m[axis]);
    }
  // Its half extents are rounded to cells of the grid, or coarser ones where it is very large: that
  // is below 2^-28 of its size.
  const double most_m = std::max({box.half_m[0], box.half_m[1], box.half_m[2]});
  return reach_of(view, frame, corners, most_m * 0x1p-26);
}

}  // namespace nearmesh
