// SPDX-License-Identifier: Apache-2.0
#include "spare_splits.hpp"

#include <algorithm>
#include <array>
#include <iterator>

#include "core/query/lacking_ahead.hpp"
#include "node_hull.hpp"

namespace nearmesh {
namespace {

/// What a half-space takes on the wire.
constexpr double kHalfSpaceBits = kDirectionBits + kReachBits + 1;
/// A node that meets more than that is split.
constexpr std::size_t kMostObstacles = 1024;
/// A hull of more points is made coarser.
constexpr std::size_t kMostPoints = 2048;
/// Steps of the choice for each point and obstacle, as so many tests.
constexpr std::uint64_t kTestsAPoint = 8;

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
  for (const TreeletSplit& split : treelet_of(mirror.file().store(), splits))
    nodes_.push_back({.split = split, .half_spaces = {}});
  std::sort(kept_.begin(), kept_.end());
  // What a split of this model takes on the average, all boxes included.
  split_bits_ =
      8.0 * static_cast<double>(mirror.file().mesh_bytes()) / mirror.file().header().vertex_count;
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
  std::array<std::vector<GridPoint>, 2> hulls;
  std::size_t child = i + 1;
  for (const std::size_t side : {0U, 1U}) {
    if (!(side == 0 ? node.split.left_included : node.split.right_included)) continue;
    hulls[side] = std::move(nodes_[child].hull);
    child += nodes_[child].count;
  }
  const std::size_t known = hulls[0].size() + hulls[1].size();
  if (known == 0 || known > kMostPoints) {
    Result<std::vector<GridPoint>> whole = hull_of_node(mirror_->file(), span);
    NEARMESH_RETURN_IF_ERROR(whole);
    node.hull = std::move(whole).value();
    return Status::ok();
  }
  for (const std::size_t side : {0U, 1U}) {
    if (!hulls[side].empty()) continue;
    Result<std::vector<GridPoint>> part = hull_of_node(mirror_->file(), parts[side]);
    NEARMESH_RETURN_IF_ERROR(part);
    hulls[side] = std::move(part).value();
  }
  std::set_union(hulls[0].begin(), hulls[0].end(), hulls[1].begin(), hulls[1].end(),
                 std::back_inserter(node.hull));
  return Status::ok();
}

Result<std::uint64_t> SplitSparer::look() {
  Node& node = nodes_[--at_];
  node.bits = split_bits_;
  std::size_t child = at_ + 1;
  for (const bool included : {node.split.left_included, node.split.right_included}) {
    if (!included) continue;
    node.count += nodes_[child].count;
    node.bits += nodes_[child].bits;
    child += nodes_[child].count;
  }
  if (!may_be_spared(at_)) return std::uint64_t{0};
  std::uint64_t tests = 0;
  std::vector<Obstacles> met;
  std::vector<Obstacle> all;
  for (const ToClear& to_clear : others_) {
    Result<Obstacles> found =
        obstacles_ahead(mirror_->model().view(), to_clear.own_motion, "own", node.split.node,
                        to_clear.other->model().view(), to_clear.other_motion, "other",
                        to_clear.duration_s, to_clear.margin_m, kMostObstacles);
    NEARMESH_RETURN_IF_ERROR(found);
    tests += found.value().tests;
    all.insert(all.end(), found.value().obstacles.begin(), found.value().obstacles.end());
    met.push_back(std::move(found).value());
    if (!met.back().is_all || all.size() > kMostObstacles) return tests;
  }
  if (!all.empty()) {
    NEARMESH_RETURN_IF_ERROR(find_hull(at_));
    tests += kTestsAPoint * (node.hull.size() + all.size());
    const GridPoint& from = mirror_->file().store().position(node.split.node.first);
    ChosenHalfSpaces chosen = choose_half_spaces(node.hull, from, all);
    if (chosen.left > 0) return tests;
    node.half_spaces = std::move(chosen.half_spaces);
  }
  node.can_be_spared = true;
  const double bits = kHalfSpaceBits * static_cast<double>(node.half_spaces.size());
  if (bits < node.bits) {
    node.bits = bits;
    node.is_spared = true;
  }
  return tests;
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
