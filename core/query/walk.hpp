// SPDX-License-Identifier: Apache-2.0
#pragma once
// The walk of two trees at once that every query starts with: which exact faces touch, and which
// unresolved parts may.

#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

#include "nearmesh/core/geometry/detail/box_overlap.hpp"
#include "nearmesh/core/query/query.hpp"

namespace nearmesh {

/// Two bodies in their places. Threads: one at a time.
struct Scene {
  const TreeView &a, &b;
  const PosedFrame &frame_a, &frame_b;
  RelativeFrame b_in_a;
  double cell_a_m, cell_b_m;

  Scene(const TreeView& tree_a, const PosedFrame& posed_a, const TreeView& tree_b,
        const PosedFrame& posed_b);
  /// Made when it is first asked for: bodies far apart do without.
  [[nodiscard]] const RelativeFrame& a_in_b() const;

 private:
  mutable std::optional<RelativeFrame> a_in_b_;
};

/// An entry in its place.
struct Part {
  Part(const TreeView& tree, TreePlace at)
      : place(at), node(tree.nodes[at / kLanes]), lane(at % kLanes) {}
  [[nodiscard]] TreeEntry::Kind kind() const { return node.kind(lane); }
  [[nodiscard]] std::uint32_t first() const { return node.first[lane]; }
  [[nodiscard]] std::uint32_t count() const { return node.kind_and_count[lane] >> 2; }
  [[nodiscard]] double size() const { return static_cast<double>(node.size[lane]); }
  /// Whether an unresolved node is in it.
  [[nodiscard]] bool is_coarse() const { return node.is_coarse(lane); }
  /// The lanes of a block that hold faces.
  [[nodiscard]] std::uint32_t faces() const { return (1U << count()) - 1; }

  TreePlace place;
  const TreeNode& node;
  std::uint32_t lane;
};

/// Whether the next step goes into a's children: the larger of two inner parts is opened first, a
/// of equals.
[[nodiscard]] inline bool opens_a(const Scene& scene, const Part& a, const Part& b) {
  return a.kind() == TreeEntry::Kind::kInner &&
         (b.kind() != TreeEntry::Kind::kInner ||
          a.size() * scene.cell_a_m >= b.size() * scene.cell_b_m);
}

/// Whether an unresolved node has half-spaces.
[[nodiscard]] inline bool has_half_spaces(const TreeView& tree, const TreeEntry& node) {
  return tree.half_spaces != nullptr && !tree.half_spaces->of({node.first}).empty();
}
/// A half-space of a node whose vertex stands at `from`.
[[nodiscard]] inline BoundedPart bounded_part(const HalfSpace& half_space, const GridPoint& from) {
  const std::array<std::int8_t, 3>& normal = half_space_normal(half_space.direction);
  return {{static_cast<double>(normal[0]), static_cast<double>(normal[1]),
           static_cast<double>(normal[2])},
          static_cast<double>(half_space_reach(half_space.reach) + way_along(normal, {}, from))};
}
/// Whether `apart` (BoundedPart -> bool) says so of one of the half-spaces of an unresolved node.
template <class Apart>
[[nodiscard]] bool half_spaces_part(const TreeView& tree, const TreeEntry& node,
                                    const Apart& apart) {
  if (tree.half_spaces == nullptr) return false;
  const VertexId first{node.first};
  for (const HalfSpace& half_space : tree.half_spaces->of(first))
    if (apart(bounded_part(half_space, tree.store->position(first)))) return true;
  return false;
}

/// Parts of both that may meet, at least one of them unresolved; of a part that holds faces, those
/// that may, as bits.
struct UnresolvedPair {
  TreePlace a, b;
  std::uint32_t faces;
};

/// What a walk looks for.
enum class Seeks : std::uint8_t {
  kPairs,       ///< all pairs of faces that touch, and unresolved parts
  kAnyPair,     ///< the same, but it ends at the first pair of faces
  kUnresolved,  ///< unresolved parts alone: faces are not held against faces
};

/// What a walk finds. It is handed on before it is much.
struct WalkFinds {
  std::vector<FacePair> pairs;
  std::vector<UnresolvedPair> unresolved;
  /// Called when there are more than so many of either; takes them away, or some. Adds its own
  /// tests to the statistics.
  std::size_t most_pairs = kAllPairs, most_unresolved = 4096;
  std::function<void()> hand_on;
};

/// How long a walk may be: as in QueryOptions.
struct WalkLimits {
  std::uint64_t max_tests = kAllTests;
  const IsOver* is_over = nullptr;
};

/// Adds pairs of faces that touch, and pairs that need detail, each in an order that follows from
/// the trees' shapes. Ends at the limits; false then. Threads: any.
[[nodiscard]] bool walk_trees(const Scene& scene, Seeks seeks, const WalkLimits& limits,
                              WalkFinds& finds, QueryStats& stats);

}  // namespace nearmesh
