// SPDX-License-Identifier: Apache-2.0
#pragma once
// How far apart two bodies are, at least and at most.

#include "walk.hpp"

namespace nearmesh {

struct DistanceBounds {
  double at_least_m = 0;
  double share = 0;        ///< Answer::clearance_share
  double by_larger_m = 0;  ///< Answer::clearance_by_larger_m
  /// As Answer::distance_at_most_m and the points there.
  double at_most_m = std::numeric_limits<double>::infinity();
  std::array<double, 3> nearest_a_m{}, nearest_b_m{};
};

/// Bounds of the distance of two bodies of which no faces are known to touch; infinite when either
/// has no face. Below, an unresolved node counts with its whole box, above with the vertex that
/// stands for it. `sought` is not kNone. Cost: by steps, at most as many as `sought` allows.
[[nodiscard]] DistanceBounds find_distance(const Scene& scene, Clearance sought, QueryStats& stats);

}  // namespace nearmesh
