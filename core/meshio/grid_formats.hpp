// SPDX-License-Identifier: Apache-2.0
#pragma once
// Our own readers of grids of heights: SRTM's HGT, ESRI's ASCII grid, PGM, PNG, and raw samples.
// What else GDAL reads is gdal_reader.hpp's.

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

/// Where the samples of a grid stand in its file, of formats that store nothing else behind their
/// header.
struct SampleLayout {
  HeightGrid grid;  ///< but for its samples
  RawGrid type;
  std::uint64_t offset = 0;  ///< of the first sample
  double greatest = 0;       ///< that the header allows; 0: any
  std::string format;
};
/// Whether a grid of this format can be read by windows, without the rest.
[[nodiscard]] bool has_layout(GridFormat format);
/// In: how the file begins, kLayoutBytes or all of it, and how many bytes it has. Errors: as
/// read_grid's.
inline constexpr std::size_t kLayoutBytes = 4096;
[[nodiscard]] Result<SampleLayout> find_layout(GridFormat format, const std::string& path,
                                               std::string_view begins, std::uint64_t file_bytes,
                                               const TerrainOptions& options);
/// Appends the samples that stand in `bytes`, whose first is post (row, column). Errors: kCorrupt.
[[nodiscard]] Status decode_samples(const SampleLayout& layout, std::string_view bytes,
                                    std::uint64_t row, std::uint64_t column,
                                    std::vector<double>& samples);

/// In: all bytes of the file; its path, whose last part names an HGT's tile. Out: memory in
/// proportion to the grid, which the bytes have room for (PNG: zlib packs a thousandfold at most).
/// Errors, the message without the path: kCorrupt, kUnsupported, kInvalidArgument (below 2 x 2
/// posts; an HGT of which neither name nor options say where it lies).
[[nodiscard]] Result<HeightGrid> read_grid(GridFormat format, const std::string& path,
                                           std::string_view bytes, const TerrainOptions& options);

[[nodiscard]] Result<HeightGrid> read_png(std::string_view bytes);

/// The sample at the front of `bytes`.
[[nodiscard]] double decode_sample(std::string_view bytes, const RawGrid& type);

}  // namespace nearmesh::meshio
