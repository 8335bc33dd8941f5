// SPDX-License-Identifier: Apache-2.0
#pragma once
// API (docs/api.md).
// What a grid of heights leaves open, and what import made of it (docs/terrain.md). Nothing is
// guessed: what neither the file nor these options say is an error that names the option.

#include <array>
#include <cstdint>
#include <optional>
#include <string>

namespace nearmesh {

/// Where the model's frame lies.
enum class TerrainFrame : std::uint8_t {
  kUnstated,
  kFile,  ///< the file's own coordinates, which are lengths: x east, y north, z up
  kEnu,   ///< the plane that touches the WGS 84 ellipsoid at a point: x east, y north, z up there
  kEcef,  ///< geocentric: z through the north pole, x through the meridian of Greenwich
};

/// Samples that no header describes: row by row, the northern row first, each from west to east.
struct RawGrid {
  enum class Kind : std::uint8_t { kUnsigned, kSigned, kFloat };
  std::uint32_t columns = 0, rows = 0;
  Kind kind = Kind::kSigned;
  std::uint8_t sample_bytes = 2;  ///< 1, 2, 4 or 8; a float: 4 or 8
  bool is_big_endian = false;
};

struct TerrainOptions {
  /// kEnu and kEcef take the file's coordinates as degrees, x the longitude.
  TerrainFrame frame = TerrainFrame::kUnstated;
  std::array<double, 2> enu_origin_deg{};  ///< of kEnu: latitude, longitude; height 0
  /// Between posts, to the east and to the north, above 0, of a file that does not state it. In
  /// metres; in degrees where `frame` takes degrees.
  std::optional<std::array<double, 2>> spacing;
  /// x and y of the south-western post, of a file that does not state it; 0, 0 without.
  std::optional<std::array<double, 2>> corner;
  /// The sample that means "no data", on top of the one that the file states; may be NaN. Where
  /// samples are floats of 4 bytes: the float nearest to it.
  std::optional<double> nodata;
  /// Height of a post without data: no sample, but in the unit that the file states of heights, as
  /// what `heights` gives. None: a hole.
  std::optional<double> fill;
  /// Height, in the unit that the file states of heights, = [0] + [1] x sample. A sample of a
  /// colour image is 65536 red + 256 green + blue.
  std::optional<std::array<double, 2>> heights;
  std::optional<RawGrid> raw;  ///< the file is of this kind, whatever its name
};

/// Posts of a grid, the northern row first as in its file.
struct GridWindow {
  std::uint64_t column = 0, row = 0;    ///< of the first
  std::uint64_t columns = 0, rows = 0;  ///< at least 2 of each
};

/// What a grid was, and what became of it.
struct ImportedTerrain {
  std::uint64_t columns = 0, rows = 0;
  std::uint64_t posts_without_data = 0;
  /// That of the options, where no sample is it; of a window, none in it.
  std::optional<double> unmatched_nodata;
  std::optional<double> fill;  ///< that of the options, which they got; none: holes
  /// The file states the unit of its coordinates, which is no metre, and none of its heights: taken
  /// as the same.
  bool height_unit_is_assumed = false;
  TerrainFrame frame = TerrainFrame::kFile;
  std::array<double, 2> enu_origin_deg{};
  std::string stated_crs;  ///< the name of the coordinates, by the file or its format; may be empty
};

/// Whether this build reads what only GDAL does: GeoTIFF, DTED and others.
[[nodiscard]] bool has_gdal();

}  // namespace nearmesh
