// SPDX-License-Identifier: Apache-2.0
#pragma once
// How far apart two bodies are, at least.

#include "walk.hpp"

namespace nearmesh {

struct ClearanceBound {
  double at_least_m = 0;
  double share = 0;  ///< Answer::clearance_share
};

/// A lower bound of the distance of two bodies whose surfaces do not touch; infinite when either has no face. An
/// unresolved node counts with its whole box. `sought` is not kNone. Cost: by steps, at most as many as `sought` allows.
[[nodiscard]] ClearanceBound clearance(const Scene& scene, Clearance sought, QueryStats& stats);

}  // namespace nearmesh
