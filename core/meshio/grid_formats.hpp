// SPDX-License-Identifier: Apache-2.0
#pragma once
// Our own readers of grids of heights: SRTM's HGT, ESRI's ASCII grid, PGM, PNG, and raw samples. What else GDAL reads is
// gdal_reader.hpp's.

#include <optional>
#include <string>
#include <string_view>

#include "height_grid.hpp"

namespace nearmesh::meshio {

enum class GridFormat : std::uint8_t { kHgt, kAsc, kPgm, kPng, kRaw };

/// By the options (raw), the path's ending, or the first bytes where they are telling.
[[nodiscard]] std::optional<GridFormat> find_grid_format(const std::string& path,
                                                         std::string_view bytes,
                                                         const TerrainOptions& options);

/// In: all bytes of the file; its path, whose last part names an HGT's tile. Out: memory in
/// proportion to the grid, which the bytes have room for (PNG: zlib packs a thousandfold at most).
/// Errors, the message without the path: kCorrupt, kUnsupported, kInvalidArgument (below 2 x 2 posts; an
/// HGT of which neither name nor options say where it lies).
[[nodiscard]] Result<HeightGrid> read_grid(GridFormat format, const std::string& path,
                                           std::string_view bytes, const TerrainOptions& options);

[[nodiscard]] Result<HeightGrid> read_png(std::string_view bytes);

/// The sample at the front of `bytes`.
[[nodiscard]] double decode_sample(std::string_view bytes, const RawGrid& type);

}  // namespace nearmesh::meshio
