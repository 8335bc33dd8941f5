// SPDX-License-Identifier: Apache-2.0
#include "height_grid.hpp"

#include <cmath>
#include <limits>

#include "nearmesh/core/base/detail/assert.hpp"
#include "text.hpp"
#include "wgs84.hpp"

namespace nearmesh::meshio {
namespace {

Status invalid(std::string message) { return {StatusCode::kInvalidArgument, std::move(message)}; }

bool takes_degrees(TerrainFrame frame) {
  return frame == TerrainFrame::kEnu || frame == TerrainFrame::kEcef;
}

std::string named(const HeightGrid& grid) { return grid.crs.empty() ? "" : " (" + grid.crs + ")"; }

/// Which frame is meant, where that can be said without a guess.
Result<TerrainFrame> find_frame(const HeightGrid& grid, const TerrainOptions& options) {
  const bool degrees = takes_degrees(options.frame);
  if (grid.unit == GridUnit::kDegrees && !degrees)
    return invalid("its coordinates are degrees" + named(grid) +
                   ", no lengths: expected --crs enu:LAT,LON (metres in the plane that touches the "
                   "ellipsoid there) or --crs ecef (geocentric metres)" +
                   (options.frame == TerrainFrame::kFile ? ", found --crs file" : ""));
  if (grid.unit == GridUnit::kLength && degrees)
    return invalid("its coordinates are lengths" + named(grid) +
                   ", no degrees: expected --crs file; for another frame, warp the file to degrees "
                   "before (gdalwarp -t_srs EPSG:4326)");
  if (options.frame != TerrainFrame::kUnstated) return options.frame;
  if (grid.unit == GridUnit::kUnstated && grid.states_place)
    return invalid(
        "it does not state whether its coordinates are metres or degrees: expected --crs file "
        "(metres), or --crs enu:LAT,LON or --crs ecef (degrees)");
  return TerrainFrame::kFile;
}

Status place_posts(HeightGrid& grid, const TerrainOptions& options) {
  if (grid.states_place) {
    if (options.spacing || (options.corner && !grid.takes_corner))
      return invalid("it states where its posts stand: expected neither --spacing nor --corner");
    return Status::ok();
  }
  if (!options.spacing)
    return invalid(
        "it does not state how far apart its posts are: expected --spacing EAST,NORTH in metres, "
        "or in degrees with --crs enu:LAT,LON or --crs ecef");
  const auto [east, north] = *options.spacing;
  const auto [x, y] = options.corner.value_or(std::array<double, 2>{});
  for (const double step : {east, north})
    if (!std::isfinite(step) || step <= 0)
      return invalid("--spacing: expected distances above 0, found " + std::to_string(step));
  if (!std::isfinite(x) || !std::isfinite(y))
    return invalid("--corner: expected finite coordinates");
  grid.x = make_axis(x, east, grid.columns);
  grid.y = make_axis(y + north * static_cast<double>(grid.rows - 1), -north, grid.rows);
  return Status::ok();
}

Status check_degrees(const HeightGrid& grid, const TerrainOptions& options) {
  const auto check = [](const char* what, double deg, double most) {
    if (std::fabs(deg) <= most) return Status::ok();
    return invalid(std::string(what) + ": expected degrees from -" + quote_number(most) + " to " +
                   quote_number(most) + ", found " + quote_number(deg));
  };
  constexpr double kMostLatitude = 90 + 1e-9, kMostLongitude = 360;  // a quotient may be rounded
  for (const std::uint64_t row : {std::uint64_t{0}, grid.rows - 1})
    NEARMESH_RETURN_IF_ERROR(check("latitude of a row", grid.y.at(row), kMostLatitude));
  for (const std::uint64_t column : {std::uint64_t{0}, grid.columns - 1})
    NEARMESH_RETURN_IF_ERROR(check("longitude of a column", grid.x.at(column), kMostLongitude));
  if (options.frame != TerrainFrame::kEnu) return Status::ok();
  NEARMESH_RETURN_IF_ERROR(check("latitude of --crs enu", options.enu_origin_deg[0], 90));
  return check("longitude of --crs enu", options.enu_origin_deg[1], kMostLongitude);
}

Status set_heights(HeightGrid& grid, const TerrainOptions& options) {
  if (grid.needs_heights && !options.heights)
    return invalid(
        "its samples are colours: expected --heights OFFSET,STEP, for heights of OFFSET + STEP x "
        "(65536 red + 256 green + blue); -10000,0.1 for Mapbox's, -32768,0.00390625 for "
        "Terrarium's");
  if (options.heights) {
    grid.offset = (*options.heights)[0];
    grid.scale = (*options.heights)[1];
  }
  if (!std::isfinite(grid.offset) || !std::isfinite(grid.scale))
    return invalid("--heights: expected finite numbers");
  if (options.fill && !std::isfinite(*options.fill * grid.height_unit))
    return invalid("--fill: expected a finite height in the unit of the file's heights");
  return Status::ok();
}

struct PostsWithoutData {
  std::uint64_t count = 0, by_option = 0;
};

/// What means "no data", as samples of the grid would hold it: -9999.9 is no float.
std::optional<double> as_sample(const HeightGrid& grid, std::optional<double> nodata) {
  if (!nodata || !grid.has_float_samples) return nodata;
  return static_cast<double>(static_cast<float>(*nodata));
}

/// Samples become heights; those without data NaN, or the fill.
Result<PostsWithoutData> fill_heights(HeightGrid& grid, const TerrainOptions& options) {
  // A height as the others are, so in their unit, and no sample: offset and scale are no matter of
  // it.
  const double instead =
      options.fill ? *options.fill * grid.height_unit : std::numeric_limits<double>::quiet_NaN();
  const auto is = [](std::optional<double> nodata, double sample) {
    return nodata && (sample == *nodata || (std::isnan(*nodata) && std::isnan(sample)));
  };
  const std::optional<double> by_file = as_sample(grid, grid.nodata),
                              by_option = as_sample(grid, options.nodata);
  PostsWithoutData missing;
  for (std::size_t i = 0; i < grid.samples.size(); ++i) {
    double& sample = grid.samples[i];
    const bool is_by_option = is(by_option, sample);
    missing.by_option += is_by_option ? 1 : 0;
    if (is_by_option || is(by_file, sample) || (!grid.is_masked.empty() && grid.is_masked[i])) {
      sample = instead;
      ++missing.count;
      continue;
    }
    const double height = (grid.offset + grid.scale * sample) * grid.height_unit;
    if (!std::isfinite(height))
      return invalid("post in row " + std::to_string(grid.y.begin + i / grid.columns) +
                     ", column " + std::to_string(grid.x.begin + i % grid.columns) +
                     ": expected a finite height, found " + quote_number(sample) +
                     "; --nodata says which samples are no heights");
    sample = height;
  }
  return missing;
}

/// Gives each post its place in the model's frame.
class Placer {
 public:
  Placer(const HeightGrid& grid, const TerrainOptions& options, TerrainFrame frame)
      : grid_(grid),
        frame_(frame),
        plane_(frame == TerrainFrame::kEnu
                   ? TangentPlane(options.enu_origin_deg[0], options.enu_origin_deg[1])
                   : TangentPlane(0, 0)) {
    if (frame == TerrainFrame::kFile) return;
    longitudes_.reserve(grid.columns);
    for (std::uint64_t c = 0; c < grid.columns; ++c)
      longitudes_.push_back(sin_cos_deg(grid.x.at(c)));
  }
  void begin_row(std::uint64_t row) {
    y_ = grid_.y.at(row);
    if (frame_ != TerrainFrame::kFile) latitude_ = sin_cos_deg(y_);
  }
  [[nodiscard]] std::array<double, 3> place(std::uint64_t column, double height) const {
    if (frame_ == TerrainFrame::kFile) return {grid_.x.at(column), y_, height};
    const auto point = to_ecef(latitude_, longitudes_[column], height);
    return frame_ == TerrainFrame::kEnu ? plane_.from_ecef(point) : point;
  }

 private:
  const HeightGrid& grid_;
  TerrainFrame frame_;
  TangentPlane plane_;
  std::vector<SinCos> longitudes_;
  double y_ = 0;
  SinCos latitude_;
};

IndexedMesh make_mesh(const HeightGrid& grid, Placer placer, std::uint64_t missing) {
  constexpr std::uint32_t kNone = 0xffffffff;
  IndexedMesh mesh;
  mesh.positions_m.reserve(grid.columns * grid.rows - missing);
  if (missing == 0) mesh.faces.reserve(2 * (grid.columns - 1) * (grid.rows - 1));
  const bool east = grid.x.step > 0, south = grid.y.step < 0;
  // Vertices of the row before and of this one.
  std::vector<std::uint32_t> before(grid.columns, kNone), here(grid.columns, kNone);
  const auto add = [&mesh](std::uint32_t a, std::uint32_t b, std::uint32_t c) {
    if (a != kNone && b != kNone && c != kNone) mesh.faces.push_back({a, b, c});
  };
  for (std::uint64_t r = 0; r < grid.rows; ++r) {
    placer.begin_row(r);
    for (std::uint64_t c = 0; c < grid.columns; ++c) {
      const double height = grid.samples[r * grid.columns + c];
      here[c] = kNone;
      if (std::isnan(height)) continue;
      here[c] = static_cast<std::uint32_t>(mesh.positions_m.size());
      mesh.positions_m.push_back(placer.place(c, height));
    }
    const auto &north_row = south ? before : here, &south_row = south ? here : before;
    for (std::uint64_t c = 0; r > 0 && c + 1 < grid.columns; ++c) {
      const std::uint64_t w = east ? c : c + 1, e = east ? c + 1 : c;
      add(south_row[w], south_row[e], north_row[e]);
      add(south_row[w], north_row[e], north_row[w]);
    }
    before.swap(here);
  }
  return mesh;
}

FileConvention convention_of(const HeightGrid& grid, TerrainFrame frame) {
  FileConvention out;
  if (frame != TerrainFrame::kEcef) {
    out.up = UpAxis::kZ;
    out.up_source = OriginSource::kFormat;
  }
  if (takes_degrees(frame)) {
    out.unit_source = OriginSource::kFormat;
    out.unit_is_fixed = true;
  } else if (grid.unit_m > 0) {
    out.unit_m = grid.unit_m;
    out.unit_source = OriginSource::kFile;
    out.unit_is_fixed = true;
  }
  return out;
}

}  // namespace

GridAxis make_axis(double first, double step, std::uint64_t count) {
  GridAxis axis{.first = first, .step = step};
  if (!std::isfinite(first) || !std::isfinite(step) || !(std::fabs(step) < 1)) return axis;
  const double sign = step < 0 ? -1 : 1, tolerance = std::fabs(step) * 1e-4;
  // Posts in the middle of cells stand at odd halves of a cell.
  for (const double parts : {1.0, 2.0}) {
    const double denominator = std::round(parts / std::fabs(step));
    if (!(denominator <= 1e7)) return axis;
    const double numerator = std::round(first * denominator);
    if (!(std::fabs(numerator) < 1e15)) return axis;
    const double drift = sign * parts / denominator - step;
    if (std::fabs(numerator / denominator - first) + std::fabs(drift) * static_cast<double>(count) >
        tolerance)
      continue;
    axis.numerator = numerator;
    axis.numerator_step = sign * parts;
    axis.denominator = denominator;
    return axis;
  }
  return axis;
}

Status check_grid_size(const std::string& format, std::uint64_t columns, std::uint64_t rows,
                       std::uint64_t bytes, double per_byte) {
  const std::string size = std::to_string(columns) + " x " + std::to_string(rows) + " posts";
  if (columns < 2 || rows < 2)
    return invalid(format + ": expected at least 2 x 2 posts, found " + size);
  if (columns > kMostPosts / rows)
    return {StatusCode::kUnsupported,
            format + ": expected at most " + std::to_string(kMostPosts) + " posts, found " + size};
  if (static_cast<double>(columns * rows) > static_cast<double>(bytes) * per_byte)
    return {StatusCode::kCorrupt, format + ": " + size + " announced, found only " +
                                      std::to_string(bytes) + " bytes for them"};
  return Status::ok();
}

Result<TerrainFrame> settle_grid(HeightGrid& grid, const TerrainOptions& options) {
  const Result<TerrainFrame> frame = find_frame(grid, options);
  NEARMESH_RETURN_IF_ERROR(frame);
  NEARMESH_RETURN_IF_ERROR(place_posts(grid, options));
  if (takes_degrees(frame.value())) NEARMESH_RETURN_IF_ERROR(check_degrees(grid, options));
  NEARMESH_RETURN_IF_ERROR(set_heights(grid, options));
  return frame;
}

HeightGrid window_of(const HeightGrid& grid, const GridWindow& window) {
  NEARMESH_ASSERT(grid.is_masked.empty());  // GDAL alone gives masks, and reads no windows
  HeightGrid out{.columns = window.columns,
                 .rows = window.rows,
                 .x = grid.x,
                 .y = grid.y,
                 .states_place = grid.states_place,
                 .takes_corner = grid.takes_corner,
                 .unit = grid.unit,
                 .unit_m = grid.unit_m,
                 .nodata = grid.nodata,
                 .has_float_samples = grid.has_float_samples,
                 .offset = grid.offset,
                 .scale = grid.scale,
                 .height_unit = grid.height_unit,
                 .height_unit_is_assumed = grid.height_unit_is_assumed,
                 .needs_heights = grid.needs_heights,
                 .crs = grid.crs};
  out.x.begin = window.column;
  out.y.begin = window.row;
  return out;
}

Result<SceneMesh> to_scene(HeightGrid grid, const TerrainOptions& options) {
  const Result<TerrainFrame> frame = settle_grid(grid, options);
  NEARMESH_RETURN_IF_ERROR(frame);
  return to_scene(std::move(grid), frame.value(), options);
}

Result<SceneMesh> to_scene(HeightGrid grid, TerrainFrame frame, const TerrainOptions& options) {
  const Result<PostsWithoutData> missing = fill_heights(grid, options);
  NEARMESH_RETURN_IF_ERROR(missing);
  const std::uint64_t count = missing.value().count;
  SceneMesh scene;
  scene.convention = convention_of(grid, frame);
  scene.terrain = ImportedTerrain{
      .columns = grid.columns,
      .rows = grid.rows,
      .posts_without_data = count,
      .unmatched_nodata = missing.value().by_option == 0 ? options.nodata : std::nullopt,
      .fill = options.fill,
      .height_unit_is_assumed = grid.height_unit_is_assumed,
      .frame = frame,
      .enu_origin_deg = options.enu_origin_deg,
      .stated_crs = grid.crs};
  scene.mesh = make_mesh(grid, Placer(grid, options, frame), options.fill ? 0 : count);
  return scene;
}

}  // namespace nearmesh::meshio
