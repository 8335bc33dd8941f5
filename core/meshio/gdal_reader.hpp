// SPDX-License-Identifier: Apache-2.0
#pragma once
// The one place that calls GDAL, where the build found it. Runs in the child process (child.hpp),
// as assimp does.

#include <string>
#include <string_view>

#include "height_grid.hpp"

namespace nearmesh::meshio {

/// Whether the path's ending or the first bytes are those of a grid that only GDAL reads.
[[nodiscard]] bool is_for_gdal(std::string_view path, std::string_view bytes);

/// The one band of a raster as a mesh. Formats that name other files or addresses are refused.
/// Errors, the message without the path: kUnsupported (the build has no GDAL, or what it found is
/// no grid of heights that is known how to take), kCorrupt, and those of to_scene.
[[nodiscard]] Result<SceneMesh> read_with_gdal(const std::string& path,
                                               const TerrainOptions& options);

}  // namespace nearmesh::meshio
