// SPDX-License-Identifier: Apache-2.0
#pragma once
// True half-spaces of nodes, as tight as their stored form is.

#include <algorithm>
#include <optional>
#include <vector>

#include "brute_force.hpp"
#include "nearmesh/core/geometry/detail/box_overlap.hpp"
#include "nearmesh/core/spm/detail/half_space.hpp"

namespace nearmesh::test {

/// Where another body is, in a model's grid units; or nothing.
using Target = std::optional<std::array<double, 3>>;
/// A vertex of the other body.
inline Target random_target(const PosedFrame& own, const PosedFrame& other,
                            const SplitStore& other_store, Random& random) {
  const RelativeFrame f = make_relative_frame(own, other);
  const GridPoint at = other_store.position({random.below(other_store.vertex_count())});
  return to_a_units(f, {at, at, at})[0];
}

/// Of a complete store, by all faces of each node.
class TrueHalfSpaces {
 public:
  explicit TrueHalfSpaces(const SplitStore& store) : store_(store), truth_(store) {}
  /// Nothing where no code reaches as far.
  [[nodiscard]] std::optional<HalfSpace> tightest(NodeSpan node, std::uint16_t direction) const {
    std::int64_t reach = 0;
    truth_.for_each_corner(node, [&](const GridPoint& p) {
      reach =
          std::max(reach, way_along(half_space_normal(direction), store_.position(node.first), p));
    });
    const std::optional<std::uint8_t> code = half_space_reach_code(reach);
    if (!code) return std::nullopt;
    return HalfSpace{direction, *code};
  }
  /// Up to `most` of a node, ascending; most of them look about to `target`.
  [[nodiscard]] std::vector<HalfSpace> some(NodeSpan node, Random& random, std::size_t most,
                                            const Target& target = {}) const {
    std::vector<HalfSpace> out;
    for (std::uint32_t n = random.below(static_cast<std::uint32_t>(most) + 1); n > 0; --n) {
      auto direction = static_cast<std::uint16_t>(random.below(1U << kDirectionBits));
      if (target && random.below(4) > 0) {
        const GridPoint& from = store_.position(node.first);
        std::array<double, 3> way{};
        double size = 1;
        for (std::size_t k = 0; k < 3; ++k) {
          way[k] = (*target)[k] - from.v[k];
          size = std::max(size, std::abs(way[k]));
        }
        for (double& x : way) x += random.between(-0.5, 0.5) * size;
        direction = nearest_direction(way);
      }
      if (const auto h = tightest(node, direction)) add_half_space(*h, out);
    }
    return out;
  }

 private:
  const SplitStore& store_;
  TrueBoxes truth_;
};

/// Gives half of a model's unresolved nodes some.
inline void tell_half_spaces(LocalModel& model, const TrueHalfSpaces& truth, Random& random,
                             const Target& target = {}) {
  RefineDelta delta;
  for (const NodeSpan& node : unresolved_nodes(model.mesh)) {
    if (random.below(2) == 0) continue;
    for (const HalfSpace& half_space : truth.some(node, random, 9, target))
      model.mesh.add_half_space(node, half_space, delta);
  }
  model.tree.update(delta);
}

/// Of nodes that a treelet makes and does not divide, of half as many of its other nodes' children,
/// and of some roots.
inline std::vector<NodeHalfSpace> random_half_spaces(const SplitStore& store,
                                                     const Treelet& treelet,
                                                     const TrueHalfSpaces& truth, Random& random,
                                                     const Target& target = {}) {
  std::vector<NodeSpan> nodes;
  for (const TreeletSplit& split : treelet) {
    if (!split.left_included) nodes.push_back(split.node.left_of(split.split));
    if (!split.right_included) nodes.push_back(split.node.right_of(split.split));
  }
  // Nodes beside the treelet, which a receiver may hold or not.
  const auto is_beside = [&](NodeSpan node) {
    return std::none_of(treelet.begin(), treelet.end(), [&](const TreeletSplit& split) {
      return split.node.begin() < node.end() && node.begin() < split.node.end();
    });
  };
  for (const BaseRoot& root : store.roots())
    if (is_beside(root.node)) nodes.push_back(root.node);
  std::sort(nodes.begin(), nodes.end());
  std::vector<NodeHalfSpace> out;
  for (const NodeSpan& node : nodes) {
    if (node.size < 2 || random.below(2) == 0) continue;
    for (const HalfSpace& half_space : truth.some(node, random, 5, target))
      out.push_back({node, half_space});
  }
  return out;
}

}  // namespace nearmesh::test
