// SPDX-License-Identifier: Apache-2.0
#pragma once
// Half-spaces: "no face with a vertex in this node reaches farther along this direction than so far
// beyond the vertex that stands for the node". A claim like a box, true in all poses, in 20 bits.
// All of it is integers, so every peer reads alike.
//
// The distance is told from the node's vertex, not in parts of the node's box: the vertex has one
// place for all, but who holds a part of a model may pass on a wider box than the model's own, and
// then one code would stand for two planes.

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <unordered_map>
#include <vector>

#include "nearmesh/core/spm/detail/types.hpp"

namespace nearmesh {

/// So many are kept of a node, and told of one in a batch.
inline constexpr std::size_t kMaxHalfSpaces = 8;

/// The normal, about 127 long.
[[nodiscard]] const std::array<std::int8_t, 3>& half_space_normal(std::uint16_t direction);
/// Grid units times the normal's length: 0, then 64 * 2^((code - 1) / 8), rounded down.
[[nodiscard]] std::int64_t half_space_reach(std::uint8_t code);
/// The least code that reaches as far. Nothing where none does: 2^30 grid units and more.
/// Precondition: reach >= 0.
[[nodiscard]] std::optional<std::uint8_t> half_space_reach_code(std::int64_t reach);
/// The direction whose normal is nearest. Precondition: not 0, finite.
[[nodiscard]] std::uint16_t nearest_direction(const std::array<double, 3>& v);

/// normal . (to - from): exact.
[[nodiscard]] inline std::int64_t way_along(const std::array<std::int8_t, 3>& normal,
                                            const GridPoint& from, const GridPoint& to) {
  std::int64_t sum = 0;
  for (int k = 0; k < 3; ++k)
    sum += std::int64_t{normal[static_cast<std::size_t>(k)]} * (std::int64_t{to[k]} - from[k]);
  return sum;
}
[[nodiscard]] inline bool contains(const HalfSpace& half_space, const GridPoint& from,
                                   const GridPoint& point) {
  return way_along(half_space_normal(half_space.direction), from, point) <=
         half_space_reach(half_space.reach);
}

/// Adds one to those of a node. Of one direction the narrower stays, and the kMaxHalfSpaces of the
/// least directions: a function of the set of all that were added, whatever their order. False
/// where nothing changed.
bool add_half_space(const HalfSpace& half_space, std::vector<HalfSpace>& to);

/// Half-spaces by the first vertex of their node.
class HalfSpaces {
 public:
  /// Ascending by direction. Valid until the next change.
  [[nodiscard]] std::span<const HalfSpace> of(VertexId first) const {
    if (by_first_.empty()) return {};
    const auto at = by_first_.find(first.value);
    return at == by_first_.end() ? std::span<const HalfSpace>() : at->second;
  }
  [[nodiscard]] bool is_empty() const { return by_first_.empty(); }
  /// False where nothing changed.
  bool add(VertexId first, const HalfSpace& half_space) {
    return add_half_space(half_space, by_first_[first.value]);
  }
  void erase(VertexId first) { by_first_.erase(first.value); }

 private:
  std::unordered_map<std::uint32_t, std::vector<HalfSpace>> by_first_;  // none is empty
};

}  // namespace nearmesh
