// SPDX-License-Identifier: Apache-2.0
#pragma once
// A grid of heights as its reader leaves it, and the triangles that it becomes.

#include <cstdint>
#include <string>
#include <vector>

#include "nearmesh/core/meshio/terrain.hpp"
#include "scene_mesh.hpp"

namespace nearmesh::meshio {

/// Posts take a vertex each, and two faces: clean_mesh takes no more.
inline constexpr std::uint64_t kMostPosts = std::uint64_t{1} << 29;

/// Coordinates of columns or rows, in the file's unit. Where posts stand at whole fractions of a
/// unit, as in grids of arc-seconds, each is a quotient of whole numbers: neighbouring grids then
/// give the posts that they share the same bits, which first + step * i would not.
struct GridAxis {
  double first = 0, step = 1;  ///< step may be negative
  double numerator = 0, numerator_step = 0;
  double denominator = 0;   ///< 0: there are none
  std::uint64_t begin = 0;  ///< of a window: its first in the whole grid

  [[nodiscard]] double at(std::uint64_t i) const {
    const auto index = static_cast<double>(begin + i);
    return denominator > 0 ? (numerator + numerator_step * index) / denominator
                           : first + step * index;
  }
};

/// With the quotients, where they move no post by more than a ten-thousandth of the step.
[[nodiscard]] GridAxis make_axis(double first, double step, std::uint64_t count);

enum class GridUnit : std::uint8_t { kUnstated, kLength, kDegrees };

struct HeightGrid {
  std::uint64_t columns = 0, rows = 0;
  std::vector<double> samples;  ///< row by row
  GridAxis x, y;
  bool states_place = false;  ///< else options say where the posts stand
  bool takes_corner = false;  ///< where it does: an option may say the corner all the same
  GridUnit unit = GridUnit::kUnstated;
  double unit_m = 0;             ///< of kLength; 0: not stated
  std::optional<double> nodata;  ///< a sample that means none
  /// Samples are of 4 bytes in the file: what means none was rounded to such, too.
  bool has_float_samples = false;
  std::vector<bool> is_masked;   ///< each post: without data, whatever its sample; empty: none
  double offset = 0, scale = 1;  ///< height, in the unit of heights, = offset + scale * sample
  double height_unit = 1;        ///< of coordinates in one of heights, whatever options say
  bool height_unit_is_assumed = false;  ///< as in ImportedTerrain
  bool needs_heights = false;           ///< colours: options must say what they mean
  std::string crs;                      ///< what the file or its format calls its coordinates
};

/// Whether a grid can be that large and `bytes` of the file can hold it, `per_byte` posts at most
/// in each.
/// Errors: kInvalidArgument (below 2 x 2), kUnsupported (above kMostPosts), kCorrupt.
[[nodiscard]] Status check_grid_size(const std::string& format, std::uint64_t columns,
                                     std::uint64_t rows, std::uint64_t bytes, double per_byte);

/// What options say beside the file, without a look at samples: places and the meaning of samples
/// enter the grid. Gives the model's frame.
/// Errors: kInvalidArgument (options are missing, contradict the file, or make no sense).
[[nodiscard]] Result<TerrainFrame> settle_grid(HeightGrid& grid, const TerrainOptions& options);
/// A part of a settled grid, without samples. Its posts are those of the whole, to the bit.
[[nodiscard]] HeightGrid window_of(const HeightGrid& grid, const GridWindow& window);
/// Of a settled grid, or a window of one: as below.
[[nodiscard]] Result<SceneMesh> to_scene(HeightGrid grid, TerrainFrame frame,
                                         const TerrainOptions& options);

/// Two triangles a cell, counter-clockwise from above; their common edge runs from south-west to
/// north-east. A triangle with a corner without data is left out, where it is not filled.
/// Errors: kInvalidArgument (options are missing, contradict the file, or make no sense; a height
/// or a place that is no number).
[[nodiscard]] Result<SceneMesh> to_scene(HeightGrid grid, const TerrainOptions& options);

}  // namespace nearmesh::meshio
