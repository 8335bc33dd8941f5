// SPDX-License-Identifier: Apache-2.0
#pragma once
// What build is told of a grid of heights, and what it says of one.

#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "commands.hpp"
#include "nearmesh/core/base/mesh_origin.hpp"
#include "nearmesh/core/meshio/terrain.hpp"

namespace nearmesh::program {

/// None where no such option was given. Errors: kInvalidArgument naming the option.
[[nodiscard]] Result<std::optional<TerrainOptions>> terrain_options(const BuildOptions& options);

[[nodiscard]] nlohmann::ordered_json terrain_json(const ImportedTerrain& terrain);
void print_terrain(const ImportedTerrain& terrain);
/// What of a grid may not be as it was meant.
[[nodiscard]] std::vector<std::string> terrain_doubts(const ImportedTerrain& terrain,
                                                      const MeshOrigin& origin);

}  // namespace nearmesh::program
