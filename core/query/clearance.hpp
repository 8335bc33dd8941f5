// SPDX-License-Identifier: Apache-2.0
#pragma once
// How far apart two bodies are, at least and at most.

#include <optional>

#include "walk.hpp"

namespace nearmesh {

struct DistanceBounds {
  double at_least_m = 0;
  double share = 0;        ///< Answer::clearance_share
  double by_larger_m = 0;  ///< Answer::clearance_by_larger_m
  /// As Answer::distance_at_most_m and the points there.
  double at_most_m = std::numeric_limits<double>::infinity();
  std::array<double, 3> nearest_a_m{}, nearest_b_m{};
  /// Of kBound: the walk of the two trees would find nothing, neither faces nor nodes.
  bool is_clear = false;
};

/// Bounds of the distance of two bodies of which no faces are known to touch; infinite when either
/// has no face. Below, an unresolved node counts with its whole box, above with the vertex that
/// stands for it. `sought` is not kNone. Cost: by steps, at most as many as `sought` allows.
[[nodiscard]] DistanceBounds find_distance(const Scene& scene, Clearance sought, QueryStats& stats);
/// The bound, sought before the walk; nothing as soon as parts are met that the walk may find, too.
[[nodiscard]] std::optional<DistanceBounds> find_bound_if_clear(const Scene& scene,
                                                                QueryStats& stats);

/// A walk that would find nothing takes far fewer tests than this: it opens what the search did.
inline constexpr std::uint64_t kFreeTests = 65'536;

}  // namespace nearmesh
