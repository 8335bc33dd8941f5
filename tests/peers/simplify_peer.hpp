// SPDX-License-Identifier: Apache-2.0
#pragma once
// meshoptimizer's simplification, for the errors beside ours.

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "nearmesh/core/mesh/clean.hpp"

namespace nearmesh {

/// Faces with corners among the mesh's vertices, as many as `faces` or a few less, and of no bound
/// of error. `seconds` of processor time.
[[nodiscard]] std::vector<std::array<std::uint32_t, 3>> simplify_by_meshoptimizer(
    const GridMesh& mesh, std::size_t faces, double& seconds);
[[nodiscard]] std::string meshoptimizer_version();

}  // namespace nearmesh
