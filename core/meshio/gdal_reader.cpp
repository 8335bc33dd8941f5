// SPDX-License-Identifier: Apache-2.0
#include "gdal_reader.hpp"

#ifdef NEARMESH_WITH_GDAL
#include <gdal.h>
#include <ogr_srs_api.h>
#endif

#include <algorithm>
#include <cmath>
#include <iterator>
#include <memory>

#include "text.hpp"
#include "wgs84.hpp"

namespace nearmesh {

bool has_gdal() {
#ifdef NEARMESH_WITH_GDAL
  return true;
#else
  return false;
#endif
}

namespace meshio {

bool is_for_gdal(std::string_view path, std::string_view bytes) {
  const std::size_t dot = path.rfind('.');
  const std::string_view ending = dot == std::string_view::npos ? "" : path.substr(dot + 1);
  for (const std::string_view known :
       {"tif", "tiff", "dt0", "dt1", "dt2", "dem", "bil", "flt", "img"})
    if (equal_ignoring_case(ending, known)) return true;
  using namespace std::string_view_literals;
  for (const std::string_view magic : {"II*\0"sv, "MM\0*"sv, "II+\0"sv, "MM\0+"sv, "UHL1"sv})
    if (bytes.starts_with(magic)) return true;
  return false;
}

#ifdef NEARMESH_WITH_GDAL
namespace {

Status unsupported(std::string message) {
  return {StatusCode::kUnsupported, "GDAL: " + std::move(message)};
}

/// Formats whose files hold the heights themselves: others, as VRT, name files or addresses to be
/// opened.
constexpr const char* kDrivers[] = {
    "GTiff", "DTED", "USGSDEM", "EHdr", "ENVI", "HFA", "AIG",  "AAIGrid", "GRASSASCIIGrid",
    "GSAG",  "GSBG", "GS7BG",   "SAGA", "RST",  "BT",  "NITF", nullptr};

struct Closer {
  void operator()(void* dataset) const { GDALClose(dataset); }
};

/// Metres in a unit of height. Errors: kUnsupported (another).
Result<double> height_unit(std::string_view name, double otherwise_m) {
  if (name.empty()) return otherwise_m;
  for (const std::string_view metre : {"m", "metre", "meter", "metres", "meters"})
    if (equal_ignoring_case(name, metre)) return 1.0;
  for (const std::string_view foot : {"ft", "foot", "feet"})
    if (equal_ignoring_case(name, foot)) return 0.3048;
  if (equal_ignoring_case(name, "us-ft") || equal_ignoring_case(name, "US survey foot"))
    return 1200.0 / 3937.0;
  return unsupported("expected heights in metres or feet, found " + quote(name) +
                     "; convert its heights before");
}

Status read_reference(GDALDatasetH dataset, HeightGrid& grid) {
  const OGRSpatialReferenceH reference = GDALGetSpatialRef(dataset);
  if (reference == nullptr) return Status::ok();
  const char* name = OSRGetName(reference);
  grid.crs = name == nullptr ? "" : name;
  if (OSRIsGeographic(reference) == 0) {
    grid.unit = GridUnit::kLength;
    grid.unit_m = OSRGetLinearUnits(reference, nullptr);
    return Status::ok();
  }
  grid.unit = GridUnit::kDegrees;
  constexpr double kDegree = 3.14159265358979323846 / 180;
  if (std::fabs(OSRGetAngularUnits(reference, nullptr) - kDegree) > 1e-9)
    return unsupported(
        "expected coordinates in degrees, found another angle; warp the file before (gdalwarp "
        "-t_srs EPSG:4326)");
  // GRS 80, that of NAD 83 and ETRS 89, is 0.1 mm narrower at the poles.
  const double axis_m = OSRGetSemiMajor(reference, nullptr),
               inverse = OSRGetInvFlattening(reference, nullptr);
  if (axis_m != kWgs84Axis_m || std::fabs(inverse - kWgs84InverseFlattening) > 2e-6)
    return unsupported("expected degrees on the ellipsoid of WGS 84, found " + quote(grid.crs) +
                       "; warp the file before (gdalwarp -t_srs EPSG:4326)");
  return Status::ok();
}

Status read_place(GDALDatasetH dataset, HeightGrid& grid) {
  std::array<double, 6> t{};
  if (GDALGetGeoTransform(dataset, t.data()) != CE_None) return Status::ok();
  for (const double x : t)
    if (!std::isfinite(x)) return {StatusCode::kCorrupt, "GDAL: expected a finite place"};
  if (t[2] != 0 || t[4] != 0 || t[1] == 0 || t[5] == 0)
    return unsupported(
        "expected columns to the north and rows to the east, found a turned grid; warp the file "
        "before (gdalwarp)");
  // A post stands in the middle of its pixel.
  grid.x = make_axis(t[0] + t[1] / 2, t[1], grid.columns);
  grid.y = make_axis(t[3] + t[5] / 2, t[5], grid.rows);
  grid.states_place = true;
  return Status::ok();
}

Status read_scale(GDALRasterBandH band, HeightGrid& grid) {
  const char* unit = GDALGetRasterUnitType(band);
  const std::string_view stated = unit == nullptr ? "" : unit;
  const double unit_m = grid.unit == GridUnit::kLength ? grid.unit_m : 1;
  const Result<double> height_m = height_unit(stated, unit_m);
  NEARMESH_RETURN_IF_ERROR(height_m);
  // Apart from offset and scale, which options may replace: what a sample's unit is does not change
  // thereby.
  grid.height_unit = height_m.value() / unit_m;
  grid.height_unit_is_assumed = stated.empty() && unit_m != 1;
  grid.offset = GDALGetRasterOffset(band, nullptr);
  grid.scale = GDALGetRasterScale(band, nullptr);
  grid.has_float_samples = GDALGetRasterDataType(band) == GDT_Float32;
  int is_stated = 0;
  const double nodata = GDALGetRasterNoDataValue(band, &is_stated);
  if (is_stated != 0) grid.nodata = nodata;
  return Status::ok();
}

/// A mask is looked for in files beside this one too, which GDAL opens with any driver that it has.
void leave_only_known_drivers() {
  GDALAllRegister();
  for (int k = GDALGetDriverCount(); k-- > 0;) {
    const GDALDriverH driver = GDALGetDriver(k);
    const std::string_view name = GDALGetDriverShortName(driver);
    const auto* end = std::end(kDrivers) - 1;
    if (std::find(std::begin(kDrivers), end, name) == end) GDALDeregisterDriver(driver);
  }
}

Status corrupt_row(int row) {
  return {StatusCode::kCorrupt, "GDAL: row " + std::to_string(row) + ": " + CPLGetLastErrorMsg()};
}

/// Posts that the file takes out beside its samples: by a mask, or by a band that says how opaque
/// each is. Such a band is a mask for GDAL only where it holds whole numbers.
Status read_mask(GDALDatasetH dataset, GDALRasterBandH band, HeightGrid& grid) {
  std::vector<GDALRasterBandH> masks;
  if ((GDALGetMaskFlags(band) & (GMF_PER_DATASET | GMF_ALPHA)) != 0)
    masks.push_back(GDALGetMaskBand(band));
  if (GDALGetRasterCount(dataset) == 2) masks.push_back(GDALGetRasterBand(dataset, 2));
  if (masks.empty()) return Status::ok();
  const int columns = static_cast<int>(grid.columns), rows = static_cast<int>(grid.rows);
  grid.is_masked.assign(grid.columns * grid.rows, false);
  std::vector<double> shown(grid.columns);
  for (const GDALRasterBandH mask : masks) {
    for (int row = 0; row < rows; ++row) {
      if (GDALRasterIO(mask, GF_Read, 0, row, columns, 1, shown.data(), columns, 1, GDT_Float64, 0,
                       0) != CE_None)
        return corrupt_row(row);
      for (std::size_t c = 0; c < shown.size(); ++c)
        if (shown[c] == 0) grid.is_masked[grid.columns * row + c] = true;
    }
  }
  return Status::ok();
}

/// One band, but for a second that says how opaque each post is.
Status check_bands(GDALDatasetH dataset) {
  const int count = GDALGetRasterCount(dataset);
  const bool has_alpha = count == 2 && GDALGetRasterColorInterpretation(
                                           GDALGetRasterBand(dataset, 2)) == GCI_AlphaBand;
  if (count == 1 || has_alpha) return Status::ok();
  return unsupported("expected one band of heights, found " + std::to_string(count) +
                     "; take one out before (gdal_translate -b 1)");
}

Result<HeightGrid> read_grid_with_gdal(const std::string& path) {
  CPLSetErrorHandler(CPLQuietErrorHandler);
  leave_only_known_drivers();
  const std::unique_ptr<void, Closer> dataset(
      GDALOpenEx(path.c_str(), GDAL_OF_RASTER | GDAL_OF_READONLY, kDrivers, nullptr, nullptr));
  if (!dataset) return unsupported(CPLGetLastErrorMsg());
  NEARMESH_RETURN_IF_ERROR(check_bands(dataset.get()));
  const int columns = GDALGetRasterXSize(dataset.get()), rows = GDALGetRasterYSize(dataset.get());
  HeightGrid grid{.columns = static_cast<std::uint64_t>(columns),
                  .rows = static_cast<std::uint64_t>(rows)};
  // What the file has room for, only GDAL knows; rows are held as they come.
  NEARMESH_RETURN_IF_ERROR(check_grid_size("GDAL", grid.columns, grid.rows, kMostPosts, 1));
  const GDALRasterBandH band = GDALGetRasterBand(dataset.get(), 1);
  if (GDALDataTypeIsComplex(GDALGetRasterDataType(band)) != 0)
    return unsupported("expected heights, found complex samples");
  NEARMESH_RETURN_IF_ERROR(read_reference(dataset.get(), grid));
  NEARMESH_RETURN_IF_ERROR(read_place(dataset.get(), grid));
  NEARMESH_RETURN_IF_ERROR(read_scale(band, grid));
  for (int row = 0; row < rows; ++row) {
    grid.samples.resize(grid.samples.size() + grid.columns);
    if (GDALRasterIO(band, GF_Read, 0, row, columns, 1, grid.samples.data() + grid.columns * row,
                     columns, 1, GDT_Float64, 0, 0) != CE_None)
      return corrupt_row(row);
  }
  NEARMESH_RETURN_IF_ERROR(read_mask(dataset.get(), band, grid));
  return grid;
}

}  // namespace

Result<SceneMesh> read_with_gdal(const std::string& path, const TerrainOptions& options) {
  Result<HeightGrid> grid = read_grid_with_gdal(path);
  NEARMESH_RETURN_IF_ERROR(grid);
  return to_scene(std::move(grid.value()), options);
}

#else

Result<SceneMesh> read_with_gdal(const std::string& /*path*/, const TerrainOptions& /*options*/) {
  return Status(StatusCode::kUnsupported,
                "only GDAL reads this grid, and it was not there when nearmesh was built: expected "
                "libgdal-dev and another build, or the file as HGT, ASC, PGM, PNG or raw samples, "
                "which need no GDAL (gdal_translate -of AAIGrid IN OUT.asc)");
}

#endif

}  // namespace meshio
}  // namespace nearmesh
