// SPDX-License-Identifier: Apache-2.0
#include "planner.hpp"

#include <algorithm>

#include "core/query/choose_half_spaces.hpp"

namespace nearmesh::chart {
namespace {

constexpr std::size_t kMostHalfSpaces = 3;
// Beyond these, half-spaces are not tried; the last two an instant.
constexpr std::size_t kMostPoints = 20'000, kMostParts = 64, kMostObstacles = 400;

GridPoint middle_of(const GridBox& box) {
  GridPoint middle;
  for (std::size_t k = 0; k < 3; ++k) middle.v[k] = (box.lo.v[k] + box.hi.v[k]) / 2;
  return middle;
}

bool is_clear(const Part& own, const Part& other, const Instant& at) {
  const Obstacle theirs{&at.other_in_own, {}, other.box, {}},
      ours{&at.own_in_other, {}, own.box, {}};
  const auto clears = [](const Part& part, const Obstacle& obstacle) {
    return std::any_of(part.half_spaces.begin(), part.half_spaces.end(),
                       [&](HalfSpace h) { return keeps_clear(h, part.middle, obstacle); });
  };
  return boxes_apart(at.other_in_own, own.box, other.box) || clears(own, theirs) ||
         clears(other, ours);
}

}  // namespace

Planner::Plan Planner::plan(const std::vector<Part>& others) {
  std::vector<Placed> all;
  for (const Instant& at : instants_)
    for (const Part& part : others) all.push_back({&part, &at});
  Plan plan{.bits = solve(0, all), .opened = {}, .told = {}, .parts = {}};
  collect(0, plan);
  return plan;
}

Part Planner::part_of(std::uint32_t i) const {
  const GridBox& box = own_.node(i).box;
  Part part{centered(box), middle_of(box)};
  if (const auto at = told_.find(i); at != told_.end()) part.half_spaces = at->second;
  return part;
}

// Empty: half-spaces cannot do it. `clear`: nothing stands in the way after all.
std::vector<HalfSpace> Planner::choose(std::uint32_t i, const Part& own,
                                       const std::vector<Placed>& close, bool& clear) const {
  if (close.size() > kMostParts * instants_.size()) return {};
  std::vector<Obstacle> obstacles;
  for (const auto& [part, at] : close) {
    const RelativeFrame& frame = at->other_in_own;
    if (part->open == nullptr) {
      obstacles.push_back({&frame, {}, part->box, {}});
      continue;
    }
    for (const TreeFace& face : part->open->faces)
      if (const DoubleTriangle triangle = to_a_units(frame, face.corners);
          !box_triangle_apart(frame, own.box, triangle))
        obstacles.push_back({&frame, triangle, {}, {}});
  }
  std::erase_if(obstacles, [&](const Obstacle& obstacle) {
    return std::any_of(own.half_spaces.begin(), own.half_spaces.end(),
                       [&](HalfSpace h) { return keeps_clear(h, own.middle, obstacle); });
  });
  clear = obstacles.empty();
  if (clear || obstacles.size() > kMostObstacles * instants_.size()) return {};
  std::vector<GridPoint> points;
  if (!gather(i, points)) return {};
  ChosenHalfSpaces chosen = choose_half_spaces(points, own.middle, obstacles, kMostHalfSpaces);
  return chosen.left == 0 ? std::move(chosen.half_spaces) : std::vector<HalfSpace>();
}

bool Planner::gather(std::uint32_t i, std::vector<GridPoint>& points) const {
  const Node& node = own_.node(i);
  for (const TreeFace& face : node.faces)
    points.insert(points.end(), face.corners.begin(), face.corners.end());
  return points.size() <= kMostPoints &&
         std::all_of(node.children.begin(), node.children.end(),
                     [&](std::uint32_t child) { return gather(child, points); });
}

double Planner::solve(std::uint32_t i, const std::vector<Placed>& above) {
  const Part own = part_of(i);
  std::vector<Placed> close;
  for (const Placed& placed : above)
    if (!is_clear(own, *placed.part, *placed.at)) close.push_back(placed);
  choices_[i] = {};
  if (close.empty()) return 0;
  bool clear = false;
  std::vector<HalfSpace> half_spaces = choose(i, own, close, clear);
  if (clear) return 0;
  const Node& node = own_.node(i);
  double open_bits = known_.contains(i) ? 0 : node.bits;
  const double told_bits = kHalfSpaceBits * static_cast<double>(half_spaces.size());
  if (half_spaces.empty() || open_bits < told_bits)
    for (const std::uint32_t child : node.children) open_bits += solve(child, close);
  if (half_spaces.empty() || open_bits < told_bits) {
    choices_[i].opens = true;
    return open_bits;
  }
  choices_[i].half_spaces = std::move(half_spaces);
  return told_bits;
}

void Planner::collect(std::uint32_t i, Plan& plan) const {
  const Choice& choice = choices_.at(i);
  const Node& node = own_.node(i);
  if (choice.opens) plan.opened.push_back(i);
  if (choice.opens && node.faces.empty()) {
    for (const std::uint32_t child : node.children) collect(child, plan);
    return;
  }
  Part part = part_of(i);
  if (choice.opens) part.open = &node;
  part.half_spaces.insert(part.half_spaces.end(), choice.half_spaces.begin(),
                          choice.half_spaces.end());
  if (!choice.half_spaces.empty()) plan.told[i] = choice.half_spaces;
  plan.parts.push_back(std::move(part));
}

std::vector<Part> all_open(const Clusters& clusters) {
  std::vector<Part> parts;
  for (std::uint32_t i = 0; i < clusters.size(); ++i)
    if (const Node& node = clusters.node(i); !node.faces.empty())
      parts.push_back({centered(node.box), middle_of(node.box), &node});
  return parts;
}

}  // namespace nearmesh::chart
