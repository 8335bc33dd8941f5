// SPDX-License-Identifier: Apache-2.0
#pragma once
// The current mesh of a replica, for whoever draws it.

#include <array>
#include <vector>

#include "replica.hpp"

namespace nearmesh {

/// Adds the corners of its faces, three each, in metres in the model's frame: of faces of the full
/// mesh, and of those that stand for what is missing. Cost: O(faces).
void add_triangles(const Replica& replica, std::vector<std::array<double, 3>>& exact_m,
                   std::vector<std::array<double, 3>>& coarse_m);

}  // namespace nearmesh
