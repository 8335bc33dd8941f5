// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/subscriber/predict.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <queue>

namespace nearmesh::subscriber {
namespace {

using Eigen::Vector3d;
using Rotation = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;

Vector3d vector(const std::array<double, 3>& v) { return {v[0], v[1], v[2]}; }
Rotation rotation(const Pose& pose) { return Eigen::Map<const Rotation>(pose.rotation.data()); }

struct MetreBox {
  Vector3d center, half;
};

MetreBox in_metres(const Grid& grid, const GridBox& box) {
  Vector3d lo, hi;
  for (int k = 0; k < 3; ++k) {
    lo[k] = std::ldexp(box.lo[k], grid.exponent);
    hi[k] = std::ldexp(box.hi[k], grid.exponent);
  }
  return {vector(grid.origin_m) + (lo + hi) / 2, (hi - lo) / 2};
}

std::int32_t clamp_grid(double x) {
  return static_cast<std::int32_t>(std::clamp(x, -2147483648.0, 2147483647.0));
}

}  // namespace

std::vector<GridBox> swept_region(const TreeView& own, const Motion& own_motion,
                                  const TreeView& other, const Motion& other_motion,
                                  double lookahead_s, double margin_m, std::size_t max_boxes) {
  // Into own's model frame.
  const Rotation to_own = rotation(own_motion.pose).transpose();
  const Rotation turn = to_own * rotation(other_motion.pose);
  const Vector3d offset =
      to_own * (vector(other_motion.pose.translation_m) - vector(own_motion.pose.translation_m));
  // Drift of the other body over the look-ahead; turning is covered by growing each box.
  const Vector3d drift =
      to_own * (vector(other_motion.linear_velocity_mps) - vector(own_motion.linear_velocity_mps)) *
      lookahead_s;
  const double own_turn = vector(own_motion.angular_velocity_radps).norm() * lookahead_s;
  const double other_turn = vector(other_motion.angular_velocity_radps).norm() * lookahead_s;
  const double cell = std::ldexp(1.0, own.grid->exponent);

  const auto sweep = [&](const GridBox& box) {
    const MetreBox m = in_metres(*other.grid, box);
    const Vector3d center = offset + turn * m.center;
    const Vector3d half = turn.cwiseAbs() * m.half;
    const double grow = margin_m + other_turn * reach_m(*other.grid, box) +
                        own_turn * (center.norm() + half.norm() + drift.norm()) + cell;
    const Vector3d lo = center - half + drift.cwiseMin(0) - Vector3d::Constant(grow);
    const Vector3d hi = center + half + drift.cwiseMax(0) + Vector3d::Constant(grow);
    GridBox swept;
    for (int k = 0; k < 3; ++k) {
      const double origin = own.grid->origin_m[static_cast<std::size_t>(k)];
      swept.lo[k] = clamp_grid(std::floor((lo[k] - origin) / cell));
      swept.hi[k] = clamp_grid(std::ceil((hi[k] - origin) / cell));
    }
    return swept;
  };
  const auto extent = [](const GridBox& box) {
    std::int64_t sum = 0;
    for (int k = 0; k < 3; ++k) sum += std::int64_t{box.hi[k]} - box.lo[k];
    return sum;
  };

  // Largest first, so that the boxes end up alike in size.
  struct Open {
    std::int64_t extent;
    std::uint32_t order;
    TreeEntry part;
    bool operator<(const Open& o) const {
      return extent != o.extent ? extent < o.extent : order > o.order;
    }
  };
  std::priority_queue<Open> open;
  std::uint32_t order = 0;
  std::vector<GridBox> region;
  const GridBox reachable = own.root().box;
  const auto offer = [&](const TreeEntry& part) {
    if (part.kind() == TreeEntry::Kind::kEmpty || !sweep(part.box).meets(reachable)) return;
    if (part.kind() == TreeEntry::Kind::kInner) {
      open.push({extent(part.box), order++, part});
    } else {
      region.push_back(sweep(part.box));
    }
  };
  offer(other.root());
  // A part is opened only where all its children go in.
  while (!open.empty() && open.size() - 1 + region.size() + kLanes <= max_boxes) {
    const TreeEntry part = open.top().part;
    open.pop();
    other.for_each_child(part, offer);
  }
  for (; !open.empty(); open.pop()) region.push_back(sweep(open.top().part.box));
  return region;
}

}  // namespace nearmesh::subscriber
