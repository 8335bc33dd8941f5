// SPDX-License-Identifier: Apache-2.0
#include "spare_splits.hpp"

#include <algorithm>
#include <array>
#include <iterator>

#include "core/query/lacking_ahead.hpp"

namespace nearmesh {
namespace {

/// What a half-space takes on the wire.
constexpr std::uint32_t kHalfSpaceBits = kDirectionBits + kReachBits + 1;
/// A hull of more points is made coarser.
constexpr std::size_t kMostPoints = 2048;
/// A node is split where half-spaces for so many obstacles did not suffice.
constexpr std::size_t kMostObstacles = 1024;
/// Obstacles between two choices of half-spaces.
constexpr std::size_t kAtOnce = 16;
/// Steps of the choice for each point and obstacle, as so many tests.
constexpr std::uint64_t kTestsAPoint = 8;

/// Whether an obstacle of another node's meets this one's box as well.
bool meets(const Obstacle& obstacle, const CenteredBox& box) {
  const RelativeFrame& f = *obstacle.other_in_own;
  return obstacle.face ? !box_triangle_stay_apart(f, obstacle.drift, box, *obstacle.face)
                       : !boxes_stay_apart(f, obstacle.drift, box, obstacle.box);
}

}  // namespace

Treelet treelet_of(const SplitStore& store, std::span<const VertexId> splits) {
  std::vector<VertexId> sorted(splits.begin(), splits.end());
  std::sort(sorted.begin(), sorted.end());
  const auto is_among = [&](NodeSpan node) {
    const VertexId split = node.size < 2 ? VertexId{} : store.split_of(node);
    return split.is_valid() && std::binary_search(sorted.begin(), sorted.end(), split);
  };
  Treelet treelet;
  treelet.reserve(sorted.size());
  for (const VertexId split : sorted) {
    const NodeSpan node = store.node_of(split);
    treelet.push_back({node, split, is_among(node.left_of(split)), is_among(node.right_of(split))});
  }
  std::sort(treelet.begin(), treelet.end(),
            [](const TreeletSplit& x, const TreeletSplit& y) { return x.node < y.node; });
  return treelet;
}

SplitSparer::SplitSparer(Mirror& mirror, std::span<const VertexId> splits,
                         std::vector<NodeSpan> kept, std::vector<ToClear> others)
    : mirror_(&mirror), kept_(std::move(kept)), others_(std::move(others)) {
  const SplitStore& store = mirror.file().store();
  const Treelet treelet = treelet_of(store, splits);
  const std::vector<SplitBits> bits = bits_of(mirror.file().header(), store, treelet);
  std::vector<std::uint32_t> expected;  // boxes of the nodes that come next, the first one last
  for (std::size_t i = 0; i < treelet.size(); ++i) {
    Node node{.split = treelet[i], .half_spaces = {}, .split_bits = bits[i].record};
    if (!expected.empty()) {
      node.box_bits = expected.back();
      expected.pop_back();
    }
    // Right, then left: preorder.
    for (const bool left : {false, true}) {
      const std::uint32_t box = left ? bits[i].left_box : bits[i].right_box;
      if (left ? treelet[i].left_included : treelet[i].right_included)
        expected.push_back(box + 1);
      else if (box > 0)
        node.split_bits += box + 1;
    }
    nodes_.push_back(std::move(node));
  }
  std::sort(kept_.begin(), kept_.end());
  at_ = nodes_.size();
}

// Its parts that were split can be kept clear.
bool SplitSparer::may_be_spared(std::size_t i) const {
  const Node& node = nodes_[i];
  std::size_t child = i + 1;
  if (node.split.left_included) {
    if (!nodes_[child].can_be_spared) return false;
    child += nodes_[child].count;
  }
  if (node.split.right_included && !nodes_[child].can_be_spared) return false;
  return !std::binary_search(kept_.begin(), kept_.end(), node.split.node);
}

// The faces of a node are those of its two parts.
Status SplitSparer::find_hull(std::size_t i) {
  Node& node = nodes_[i];
  const NodeSpan span = node.split.node;
  const std::array<NodeSpan, 2> parts{span.left_of(node.split.split),
                                      span.right_of(node.split.split)};
  std::array<NodeHull, 2> hulls;
  std::size_t child = i + 1;
  for (const std::size_t side : {0U, 1U}) {
    if (!(side == 0 ? node.split.left_included : node.split.right_included)) continue;
    hulls[side] = std::move(nodes_[child].hull);
    child += nodes_[child].count;
  }
  const std::size_t known = hulls[0].size() + hulls[1].size();
  if (known == 0 || known > kMostPoints) {
    Result<NodeHull> whole = hull_of_node(mirror_->file(), span);
    NEARMESH_RETURN_IF_ERROR(whole);
    node.hull = std::move(whole).value();
    return Status::ok();
  }
  for (const std::size_t side : {0U, 1U}) {
    if (hulls[side].size() != 0) continue;
    Result<NodeHull> part = hull_of_node(mirror_->file(), parts[side]);
    NEARMESH_RETURN_IF_ERROR(part);
    hulls[side] = std::move(part).value();
  }
  node.hull = std::move(hulls[0]);
  node.hull.add(hulls[1]);
  return Status::ok();
}

Status SplitSparer::find_obstacles(std::size_t i, std::span<const HalfSpace> told,
                                   std::vector<Obstacle>& to, Looked& looked) {
  if (obstacles_.empty()) {
    for (const ToClear& to_clear : others_) {
      auto made = ObstaclesAhead::make(mirror_->model().view(), to_clear.own_motion, "own",
                                       to_clear.other->model().view(), to_clear.other_motion,
                                       "other", to_clear.duration_s, to_clear.margin_m);
      NEARMESH_RETURN_IF_ERROR(made);
      obstacles_.push_back(std::move(made).value());
    }
  }
  const std::size_t most = to.size() + kAtOnce;
  for (const std::unique_ptr<ObstaclesAhead>& obstacles : obstacles_) {
    const std::uint64_t tests = obstacles->find(nodes_[i].split.node, told, most, kLookTests, to);
    looked.tests += tests;
    looked.is_to_be_split |= tests > kLookTests;
  }
  return Status::ok();
}

/// The narrowest half-space that holds the points, in the direction that was chosen last:
/// neighbours have the same things in their way.
std::vector<HalfSpace> SplitSparer::guess(std::span<const GridPoint> points,
                                          const GridPoint& from) const {
  std::vector<HalfSpace> guessed;
  if (last_direction_)
    if (const auto half_space = tightest_half_space(points, from, *last_direction_))
      guessed.push_back(*half_space);
  return guessed;
}

/// Nothing where some obstacle cannot be parted from the points.
std::optional<std::vector<HalfSpace>> SplitSparer::choose(std::span<const GridPoint> points,
                                                          const GridPoint& from,
                                                          std::span<const Obstacle> obstacles,
                                                          Looked& looked) {
  looked.tests += kTestsAPoint * (points.size() + obstacles.size());
  ChosenHalfSpaces chosen =
      choose_half_spaces(points, from, obstacles, kMaxHalfSpaces, last_direction_);
  if (chosen.left == 0) return std::move(chosen.half_spaces);
  looked.is_to_be_split = true;
  return std::nullopt;
}

// Nearly all that cannot be kept clear are nodes of two vertices, by the contact itself. Their
// hulls take the most of their time, and two vertices and what was in the way of the node before
// mostly show it.
Status SplitSparer::look_at_pair(std::size_t i, Looked& looked) {
  const NodeSpan node = nodes_[i].split.node;
  const SplitStore& store = mirror_->file().store();
  const GridPoint& from = store.position(node.first);
  const Result<NodeHull> below = hull_below(mirror_->file(), node);
  NEARMESH_RETURN_IF_ERROR(below);
  const std::vector<GridPoint> points = below.value().points(store);
  const CenteredBox box = centered(store.box(node));
  std::vector<Obstacle> met;
  std::copy_if(in_the_way_.begin(), in_the_way_.end(), std::back_inserter(met),
               [&](const Obstacle& obstacle) { return meets(obstacle, box); });
  if (!met.empty() && !choose(points, from, met, looked)) return Status::ok();
  met.clear();
  NEARMESH_RETURN_IF_ERROR(find_obstacles(i, guess(points, from), met, looked));
  if (!met.empty() && !choose(points, from, met, looked)) in_the_way_ = std::move(met);
  return Status::ok();
}

// Half-spaces for what has been met; then what these do not keep clear is met, until nothing is. So
// few obstacles are looked at of many.
Status SplitSparer::look_at(std::size_t i, Looked& looked) {
  Node& node = nodes_[i];
  const GridPoint& from = mirror_->file().store().position(node.split.node.first);
  NEARMESH_RETURN_IF_ERROR(find_hull(i));
  const std::vector<GridPoint> points = node.hull.points(mirror_->file().store());
  std::vector<Obstacle> met;
  for (node.half_spaces = guess(points, from);;) {
    const std::size_t before = met.size();
    NEARMESH_RETURN_IF_ERROR(find_obstacles(i, node.half_spaces, met, looked));
    looked.is_to_be_split |= met.size() > kMostObstacles;
    if (met.size() == before || looked.is_to_be_split) break;
    std::optional<std::vector<HalfSpace>> chosen = choose(points, from, met, looked);
    if (!chosen) {
      in_the_way_ = std::move(met);
      break;
    }
    node.half_spaces = std::move(*chosen);
  }
  if (!node.half_spaces.empty() && !looked.is_to_be_split)
    last_direction_ = node.half_spaces.front().direction;
  return Status::ok();
}

Result<std::uint64_t> SplitSparer::look() {
  Node& node = nodes_[--at_];
  node.bits = node.split_bits;
  std::size_t child = at_ + 1;
  for (const bool included : {node.split.left_included, node.split.right_included}) {
    if (!included) continue;
    node.count += nodes_[child].count;
    node.bits += nodes_[child].bits;
    child += nodes_[child].count;
  }
  Looked looked;
  if (!may_be_spared(at_)) return looked.tests;
  if (node.split.node.size == 2) NEARMESH_RETURN_IF_ERROR(look_at_pair(at_, looked));
  if (!looked.is_to_be_split) NEARMESH_RETURN_IF_ERROR(look_at(at_, looked));
  if (looked.is_to_be_split) return looked.tests;
  node.can_be_spared = true;
  const auto bits =
      node.box_bits + kHalfSpaceBits * static_cast<std::uint32_t>(node.half_spaces.size());
  if (bits < node.bits) {
    node.bits = bits;
    node.is_spared = true;
  }
  return looked.tests;
}

std::vector<NodeSpan> SplitSparer::apply() {
  ActiveMesh& mesh = mirror_->model().mesh;
  std::vector<NodeSpan> told;
  RefineDelta delta;
  for (std::size_t i = at_; i < nodes_.size();) {
    const Node& node = nodes_[i];
    if (!node.is_spared) {
      ++i;
      continue;
    }
    mesh.collapse(node.split.node, delta);
    for (const HalfSpace& half_space : node.half_spaces)
      static_cast<void>(mesh.add_half_space(node.split.node, half_space, delta));
    if (!node.half_spaces.empty()) told.push_back(node.split.node);
    i += node.count;
  }
  mirror_->model().tree.update(delta);
  return told;
}

}  // namespace nearmesh
