// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/subscriber/predict.hpp"

#include <algorithm>
#include <cmath>
#include <queue>

namespace nearmesh::subscriber {
namespace {

using Vector = std::array<double, 3>;

double length(const Vector& v) { return std::sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]); }

struct MetreBox {
  Vector center{}, half{};
};

MetreBox in_metres(const Grid& grid, const GridBox& box) {
  MetreBox m;
  for (int k = 0; k < 3; ++k) {
    const auto axis = static_cast<std::size_t>(k);
    const double lo = grid.origin_m[axis] + std::ldexp(box.lo[k], grid.exponent);
    const double hi = grid.origin_m[axis] + std::ldexp(box.hi[k], grid.exponent);
    m.center[axis] = (lo + hi) / 2;
    m.half[axis] = (hi - lo) / 2;
  }
  return m;
}

// Greatest distance of a point of the box from the model's origin, about which the body turns.
double reach_m(const MetreBox& box) {
  Vector far;
  for (std::size_t k = 0; k < 3; ++k) far[k] = std::abs(box.center[k]) + box.half[k];
  return length(far);
}

// Rotation and translation that take `other`'s model frame into `own`'s.
struct Relative {
  std::array<double, 9> rotation{};
  Vector translation{};
};

Relative relative(const Pose& own, const Pose& other) {
  Relative r;
  Vector d;
  for (std::size_t k = 0; k < 3; ++k) d[k] = other.translation_m[k] - own.translation_m[k];
  for (std::size_t i = 0; i < 3; ++i) {
    for (std::size_t j = 0; j < 3; ++j)
      for (std::size_t k = 0; k < 3; ++k)
        r.rotation[3 * i + j] += own.rotation[3 * k + i] * other.rotation[3 * k + j];
    for (std::size_t k = 0; k < 3; ++k) r.translation[i] += own.rotation[3 * k + i] * d[k];
  }
  return r;
}

std::int32_t clamp_grid(double x) {
  return static_cast<std::int32_t>(std::clamp(x, -2147483648.0, 2147483647.0));
}

}  // namespace

double closing_speed_mps(const TreeView& a, const Motion& motion_a, const TreeView& b,
                         const Motion& motion_b) {
  return length(motion_a.linear_velocity_mps) + length(motion_b.linear_velocity_mps) +
         length(motion_a.angular_velocity_radps) * reach_m(in_metres(*a.grid, a.nodes[a.root].box)) +
         length(motion_b.angular_velocity_radps) * reach_m(in_metres(*b.grid, b.nodes[b.root].box));
}

std::vector<GridBox> swept_region(const TreeView& own, const Motion& own_motion,
                                  const TreeView& other, const Motion& other_motion,
                                  double lookahead_s, double margin_m, std::size_t max_boxes) {
  const Relative map = relative(own_motion.pose, other_motion.pose);
  // Drift of the other body in own's frame over the look-ahead; turning is covered by growing each box.
  Vector drift{};
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t k = 0; k < 3; ++k)
      drift[i] += own_motion.pose.rotation[3 * k + i] *
                  (other_motion.linear_velocity_mps[k] - own_motion.linear_velocity_mps[k]) *
                  lookahead_s;
  const double own_turn = length(own_motion.angular_velocity_radps) * lookahead_s;
  const double other_turn = length(other_motion.angular_velocity_radps) * lookahead_s;
  const double cell = std::ldexp(1.0, own.grid->exponent);

  const auto sweep = [&](const GridBox& box) {
    const MetreBox m = in_metres(*other.grid, box);
    GridBox swept;
    Vector center = map.translation, half{};
    for (std::size_t i = 0; i < 3; ++i)
      for (std::size_t k = 0; k < 3; ++k) {
        center[i] += map.rotation[3 * i + k] * m.center[k];
        half[i] += std::abs(map.rotation[3 * i + k]) * m.half[k];
      }
    const double grow = margin_m + other_turn * reach_m(m) +
                        own_turn * (length(center) + length(half) + length(drift)) + cell;
    for (std::size_t i = 0; i < 3; ++i) {
      const double lo = center[i] - half[i] + std::min(0.0, drift[i]) - grow;
      const double hi = center[i] + half[i] + std::max(0.0, drift[i]) + grow;
      swept.lo.v[i] = clamp_grid(std::floor((lo - own.grid->origin_m[i]) / cell));
      swept.hi.v[i] = clamp_grid(std::ceil((hi - own.grid->origin_m[i]) / cell));
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
    std::uint32_t node;
    bool operator<(const Open& o) const {
      return extent != o.extent ? extent < o.extent : node > o.node;
    }
  };
  std::priority_queue<Open> open;
  std::vector<GridBox> region;
  const GridBox& reachable = own.nodes[own.root].box;
  const auto offer = [&](std::uint32_t place) {
    const TreeNode& node = other.nodes[place];
    if (node.kind() == TreeNode::Kind::kEmpty || !sweep(node.box).meets(reachable)) return;
    if (node.kind() == TreeNode::Kind::kInner) {
      open.push({extent(node.box), place});
    } else {
      region.push_back(sweep(node.box));
    }
  };
  offer(other.root);
  while (!open.empty() && open.size() + region.size() < max_boxes) {
    const std::uint32_t place = open.top().node;
    open.pop();
    offer(other.nodes[place].first);
    offer(other.nodes[place].first + 1);
  }
  for (; !open.empty(); open.pop()) region.push_back(sweep(other.nodes[open.top().node].box));
  if (region.size() > max_boxes) {  // one pair of children may go over by one
    region[max_boxes - 1].add(region[max_boxes]);
    region.resize(max_boxes);
  }
  return region;
}

}  // namespace nearmesh::subscriber
