// SPDX-License-Identifier: Apache-2.0
#pragma once
// How far apart two bodies are, at least.

#include "walk.hpp"

namespace nearmesh {

/// A lower bound, metres, of the distance of two bodies whose surfaces do not touch; infinite when either has no face. An
/// unresolved node counts with its whole box. Cost: some thousands of steps at most, and then the bound is smaller.
[[nodiscard]] double clearance_m(const Scene& scene, QueryStats& stats);

}  // namespace nearmesh
