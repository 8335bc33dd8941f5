// SPDX-License-Identifier: Apache-2.0
// Grids of heights: what is read, where it comes to stand, what is refused.
#include <gtest/gtest.h>
#include <zlib.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <limits>
#include <map>
#include <utility>

#include "core/meshio/grid_formats.hpp"
#include "core/meshio/wgs84.hpp"
#include "nearmesh/core/mesh/clean.hpp"
#include "nearmesh/core/meshio/import.hpp"

namespace nearmesh {
namespace {

namespace fs = std::filesystem;
using Place = std::array<double, 3>;

constexpr TerrainOptions kFile{.frame = TerrainFrame::kFile};
constexpr TerrainOptions kEcef{.frame = TerrainFrame::kEcef};
TerrainOptions enu(double latitude_deg, double longitude_deg) {
  return {.frame = TerrainFrame::kEnu, .enu_origin_deg = {latitude_deg, longitude_deg}};
}
/// For a file that says nothing of its place.
TerrainOptions spaced(double spacing_m) { return {.spacing = {{spacing_m, spacing_m}}}; }

class GridFile {
 public:
  GridFile(const std::string& name, const std::string& bytes)
      : folder_(testing::TempDir() + "nearmesh_terrain_" +
                testing::UnitTest::GetInstance()->current_test_info()->name()),
        path_(folder_ + "/" + name) {
    fs::create_directories(folder_);
    std::ofstream(path_, std::ios::binary) << bytes;
  }
  ~GridFile() { fs::remove_all(folder_); }
  GridFile(const GridFile&) = delete;
  GridFile& operator=(const GridFile&) = delete;
  [[nodiscard]] const std::string& path() const { return path_; }

 private:
  std::string folder_, path_;
};

Result<ImportedMesh> import_grid(const std::string& name, const std::string& bytes,
                                 const TerrainOptions& options) {
  const GridFile file(name, bytes);
  ImportOptions all;
  all.terrain = options;
  return import_mesh(file.path(), all);
}

ImportedMesh import_good_grid(const std::string& name, const std::string& bytes,
                              const TerrainOptions& options) {
  auto imported = import_grid(name, bytes, options);
  EXPECT_TRUE(imported.is_ok()) << imported.status().message();
  return imported.is_ok() ? std::move(imported).value() : ImportedMesh{};
}

void expect_refused(const std::string& name, const std::string& bytes,
                    const TerrainOptions& options, StatusCode code, const std::string& part) {
  const auto imported = import_grid(name, bytes, options);
  ASSERT_FALSE(imported.is_ok()) << part;
  EXPECT_EQ(imported.status().code(), code) << imported.status().message();
  EXPECT_NE(imported.status().message().find(part), std::string::npos)
      << imported.status().message();
  EXPECT_NE(imported.status().message().find(name), std::string::npos);
}

std::string big_endian(std::uint64_t value, int bytes) {
  std::string out;
  for (int k = bytes - 1; k >= 0; --k) out += static_cast<char>(value >> (8 * k) & 0xff);
  return out;
}

std::string shorts(std::initializer_list<int> values) {
  std::string out;
  for (const int value : values) out += big_endian(static_cast<std::uint16_t>(value), 2);
  return out;
}

// --- the grid and its triangles ---

const std::string kSmallAsc =
    "ncols 3\nnrows 2\nxllcenter 100\nyllcenter 200\ncellsize 10\nNODATA_value -9999\n"
    "1 2 3\n4 5 6\n";

TEST(Terrain, AscGivesItsPostsFromTheNorthAndTwoTrianglesACell) {
  const ImportedMesh imported = import_good_grid("a.asc", kSmallAsc, kFile);

  const std::vector<Place> expected{{100, 210, 1}, {110, 210, 2}, {120, 210, 3},
                                    {100, 200, 4}, {110, 200, 5}, {120, 200, 6}};
  EXPECT_EQ(imported.mesh.positions_m, expected);
  // South-west, south-east, north-east; south-west, north-east, north-west.
  const std::vector<std::array<std::uint32_t, 3>> faces{{3, 4, 1}, {3, 1, 0}, {4, 5, 2}, {4, 2, 1}};
  EXPECT_EQ(imported.mesh.faces, faces);
  ASSERT_TRUE(imported.terrain);
  EXPECT_EQ(imported.terrain->columns, 3U);
  EXPECT_EQ(imported.terrain->rows, 2U);
  EXPECT_EQ(imported.origin.up, UpAxis::kZ);
}

TEST(Terrain, AscOfCellCornersPutsPostsInTheMiddleOfCells) {
  const ImportedMesh imported = import_good_grid(
      "a.asc", "NCOLS 2\nNROWS 2\nXLLCORNER 0\nYLLCORNER 0\nDX 4\nDY 2\n1 2\n3 4", kFile);
  const std::vector<Place> expected{{2, 3, 1}, {6, 3, 2}, {2, 1, 3}, {6, 1, 4}};
  EXPECT_EQ(imported.mesh.positions_m, expected);
}

TEST(Terrain, PostsWithoutDataAreHolesOrFilled) {
  std::string asc = kSmallAsc;
  asc.replace(asc.find("5 6"), 1, "-9999");

  const ImportedMesh holes = import_good_grid("a.asc", asc, kFile);
  EXPECT_EQ(holes.mesh.positions_m.size(), 5U);
  ASSERT_EQ(holes.mesh.faces.size(), 1U);  // the one without the post
  for (const std::uint32_t v : holes.mesh.faces[0]) EXPECT_NE(holes.mesh.positions_m[v][2], -9999);
  EXPECT_EQ(holes.terrain->posts_without_data, 1U);
  EXPECT_FALSE(holes.terrain->fill);

  TerrainOptions fill = kFile;
  fill.fill = -3.5;
  const ImportedMesh filled = import_good_grid("a.asc", asc, fill);
  EXPECT_EQ(filled.mesh.faces.size(), 4U);
  EXPECT_EQ(filled.mesh.positions_m[4], (Place{110, 200, -3.5}));
  EXPECT_EQ(filled.terrain->posts_without_data, 1U);
  EXPECT_EQ(filled.terrain->fill, -3.5);
}

TEST(Terrain, TheSampleWithoutDataMayBeSaidAndMayBeNaN) {
  std::string asc = kSmallAsc;
  asc.replace(asc.find("5 6"), 1, "nan");
  expect_refused("a.asc", asc, kFile, StatusCode::kInvalidArgument,
                 "row 1, column 1: expected a finite height, found nan");
  TerrainOptions nan = kFile;
  nan.nodata = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(import_good_grid("a.asc", asc, nan).terrain->posts_without_data, 1U);
  TerrainOptions six = kFile;
  six.nodata = 6;
  EXPECT_EQ(import_good_grid("a.asc", kSmallAsc, six).terrain->posts_without_data, 1U);
}

/// The bytes of floats, in the order that `order` says.
std::string floats(std::initializer_list<double> values, std::endian order) {
  std::string out;
  for (const double value : values) {
    std::string bytes = big_endian(std::bit_cast<std::uint32_t>(static_cast<float>(value)), 4);
    if (order == std::endian::little) std::reverse(bytes.begin(), bytes.end());
    out += bytes;
  }
  return out;
}

TEST(Terrain, TheSampleWithoutDataIsRoundedAsFloatsAre) {
  for (const double nodata : {-9999.9, 1e20, -3.4028235e38, -9999.0}) {
    TerrainOptions options = spaced(1);
    options.raw = RawGrid{3, 2, RawGrid::Kind::kFloat, 4, true};
    options.nodata = nodata;
    const GridFile file("a.raw", floats({1, 2, nodata, 4, 5, 6}, std::endian::big));
    ImportOptions all;
    all.terrain = options;
    const auto whole = import_mesh(file.path(), all);
    ASSERT_TRUE(whole.is_ok()) << whole.status().message();
    EXPECT_EQ(whole.value().terrain->posts_without_data, 1U) << nodata;
    EXPECT_FALSE(whole.value().terrain->unmatched_nodata) << nodata;
    const auto grid = TerrainFile::open(file.path(), all);
    ASSERT_TRUE(grid.is_ok() && grid.value());
    const auto part = grid.value()->read({.column = 1, .row = 0, .columns = 2, .rows = 2});
    ASSERT_TRUE(part.is_ok()) << part.status().message();
    EXPECT_EQ(part.value().terrain->posts_without_data, 1U) << nodata;
  }
  // Doubles are not rounded.
  TerrainOptions options = spaced(1);
  options.raw = RawGrid{2, 2, RawGrid::Kind::kFloat, 8, true};
  options.nodata = -9999.9;
  std::string doubles;
  for (const double height : {-9999.9, 1.0, 2.0, static_cast<double>(-9999.9F)})
    doubles += big_endian(std::bit_cast<std::uint64_t>(height), 8);
  EXPECT_EQ(import_good_grid("a.raw", doubles, options).terrain->posts_without_data, 1U);
}

TEST(Terrain, ASampleWithoutDataThatNoPostHasIsTold) {
  TerrainOptions options = kFile;
  EXPECT_FALSE(import_good_grid("a.asc", kSmallAsc, options).terrain->unmatched_nodata);
  options.nodata = -32768;
  EXPECT_EQ(import_good_grid("a.asc", kSmallAsc, options).terrain->unmatched_nodata, -32768);
  options.nodata = 6;
  EXPECT_FALSE(import_good_grid("a.asc", kSmallAsc, options).terrain->unmatched_nodata);
  // One that the file states as well is there, whoever is asked first.
  std::string asc = kSmallAsc;
  asc.replace(asc.find("5 6"), 1, "-9999");
  options.nodata = -9999;
  const auto both = import_good_grid("a.asc", asc, options);
  EXPECT_FALSE(both.terrain->unmatched_nodata);
  EXPECT_EQ(both.terrain->posts_without_data, 1U);
}

TEST(Terrain, HeightsAreOffsetAndStepTimesSample) {
  TerrainOptions options = kFile;
  options.heights = {{-100, 0.5}};
  EXPECT_EQ(import_good_grid("a.asc", kSmallAsc, options).mesh.positions_m[5][2], -97);
}

TEST(Terrain, AGridWithoutAnyDataHasNoFace) {
  TerrainOptions options = spaced(1);
  options.nodata = 0;
  expect_refused("a.pgm", "P5 2 2 65535\n" + shorts({0, 0, 0, 0}), options,
                 StatusCode::kInvalidArgument, "expected at least one face");
}

// --- formats ---

TEST(Terrain, PgmHasSixteenBitsBigEndianOrEight) {
  const auto sixteen = import_good_grid(
      "a.pgm", "P5\n# a comment\n2 2 # another\n65535\n" + shorts({256, 1, 2, 65535}), spaced(5));
  EXPECT_EQ(sixteen.mesh.positions_m,
            (std::vector<Place>{{0, 5, 256}, {5, 5, 1}, {0, 0, 2}, {5, 0, 65535}}));
  const auto eight = import_good_grid("a.pgm", "P5 2 2 200 \x01\x02\x03\xc8", spaced(1));
  ASSERT_EQ(eight.mesh.positions_m.size(), 4U);
  EXPECT_EQ(eight.mesh.positions_m[3][2], 200);
}

TEST(Terrain, PgmThatContradictsItsHeaderIsRefused) {
  const auto refused = [](const std::string& bytes, const std::string& part,
                          StatusCode code = StatusCode::kCorrupt) {
    expect_refused("a.pgm", bytes, spaced(1), code, part);
  };
  refused("P5 2 2 65535 abcdefg", "found only 7 bytes");
  refused("P5 2 2 65535 abcdefghi", "make 8 bytes, found 9");
  refused("P5 2 2 300 abcdefgh", "row 0, column 0: expected at most 300, found 24930");
  refused("P5 2 2 65536 abcdefgh", "greatest sample");
  refused("P5 2", "a width and a height");
  refused("P5 2 2 255", "a blank behind");
  refused("P5 1 4 255 abcd", "at least 2 x 2", StatusCode::kInvalidArgument);
  refused("P2 2 2 255 1 2 3 4", "P5", StatusCode::kUnsupported);
  refused("P5 4000000000 4000000000 255 abcd", "at most", StatusCode::kUnsupported);
  refused("P5 20000 20000 255 abcd", "found only 4 bytes");
  refused("P5 99999999999999999999 2 255 abcd", "a width and a height");
}

TEST(Terrain, RawSamplesHaveTheSizeAndTypeThatAreSaid) {
  using Kind = RawGrid::Kind;
  struct Case {
    RawGrid raw;
    std::string first;
    double height;
  };
  for (const Case& tested : {
           Case{{2, 2, Kind::kUnsigned, 1, false}, "\xff", 255},
           Case{{2, 2, Kind::kSigned, 1, false}, "\xff", -1},
           Case{{2, 2, Kind::kUnsigned, 2, false}, "\xfe\xff", 65534},
           Case{{2, 2, Kind::kSigned, 2, false}, "\xfe\xff", -2},
           Case{{2, 2, Kind::kSigned, 2, true}, "\xff\xfd", -3},
           Case{{2, 2, Kind::kSigned, 4, true}, "\xff\xff\xff\xfc", -4},
           Case{{2, 2, Kind::kUnsigned, 4, true}, "\xff\xff\xff\xfc", 4294967292},
           Case{{2, 2, Kind::kFloat, 4, true}, std::string("\x3f\xc0\0\0", 4), 1.5},
           Case{{2, 2, Kind::kFloat, 8, false}, std::string("\0\0\0\0\0\0\xf8\x3f", 8), 1.5},
           Case{{2, 2, Kind::kSigned, 8, false}, std::string(8, '\xff'), -1},
       }) {
    TerrainOptions options = spaced(1);
    options.raw = tested.raw;
    const auto imported = import_good_grid(
        "heights.ply", tested.first + std::string(3 * tested.raw.sample_bytes, '\0'), options);
    ASSERT_EQ(imported.mesh.positions_m.size(), 4U);
    EXPECT_EQ(imported.mesh.positions_m[0], (Place{0, 1, tested.height}));
  }
}

TEST(Terrain, RawSamplesOfAnotherSizeOrTypeAreRefused) {
  TerrainOptions options = spaced(1);
  options.raw = RawGrid{2, 2};
  expect_refused("a.raw", "1234567", options, StatusCode::kCorrupt, "found only 7 bytes");
  expect_refused("a.raw", "123456789", options, StatusCode::kCorrupt, "make 8 bytes, found 9");
  options.raw->sample_bytes = 0;
  expect_refused("a.raw", "12345678", options, StatusCode::kInvalidArgument, "found 0 bytes");
  options.raw = RawGrid{2, 2, RawGrid::Kind::kFloat, 2};
  expect_refused("a.raw", "12345678", options, StatusCode::kInvalidArgument, "found 2 bytes");
  options.raw = RawGrid{0xffffffff, 0xffffffff};
  expect_refused("a.raw", "12345678", options, StatusCode::kUnsupported, "at most");
}

TEST(Terrain, FloatsThatAreNoHeightsAreRefusedByPlace) {
  TerrainOptions options = spaced(1);
  options.raw = RawGrid{2, 2, RawGrid::Kind::kFloat, 4, true};
  const std::string bytes = std::string(12, '\0') + std::string("\x7f\x80\0\0", 4);
  expect_refused("a.raw", bytes, options, StatusCode::kInvalidArgument,
                 "row 1, column 1: expected a finite height, found inf");
}

std::string hgt(std::initializer_list<int> samples) { return shorts(samples); }

TEST(Terrain, HgtIsPlacedByItsNameAndSamplesOfMinus32768AreNone) {
  const std::string bytes = hgt({1, 2, 3, 4, 5, 6, 7, 8, -32768});
  const auto imported = import_good_grid("S02W071.hgt", bytes, enu(-2, -71));
  ASSERT_EQ(imported.mesh.positions_m.size(), 8U);
  EXPECT_EQ(imported.mesh.faces.size(), 7U);
  EXPECT_EQ(imported.terrain->posts_without_data, 1U);
  // The south-western post is the seventh, where the plane touches.
  const Place& corner = imported.mesh.positions_m[6];
  EXPECT_NEAR(corner[0], 0, 1e-8);
  EXPECT_NEAR(corner[1], 0, 1e-8);
  EXPECT_NEAR(corner[2], 7, 1e-8);
  const auto other = import_good_grid(
      "by_hand.hgt", bytes,
      {.frame = TerrainFrame::kEnu, .enu_origin_deg = {-2, -71}, .corner = {{-71, -2}}});
  EXPECT_EQ(other.mesh.positions_m, imported.mesh.positions_m);
}

TEST(Terrain, HgtThatDoesNotSayItsSizeOrPlaceIsRefused) {
  expect_refused("N00E010.hgt", "12345", kEcef, StatusCode::kCorrupt, "found 5 bytes");
  expect_refused("N00E010.hgt", hgt({1, 2, 3, 4, 5, 6}), kEcef, StatusCode::kCorrupt, "square");
  expect_refused("N00E010.hgt", hgt({1}), kEcef, StatusCode::kInvalidArgument, "2 x 2");
  for (const char* name : {"tile.hgt", "N00E01.hgt", "lenn00e010.hgt", "N00E0101.hgt"})
    expect_refused(name, hgt({1, 2, 3, 4}), kEcef, StatusCode::kInvalidArgument, "--corner");
  for (const char* name : {"srtm3_n00e010.hgt", "N00E010.SRTMGL1.hgt"})
    EXPECT_TRUE(import_grid(name, hgt({1, 2, 3, 4}), kEcef).is_ok()) << name;
}

TEST(Terrain, DamagedAscIsRefusedByPlace) {
  const auto refused = [](const std::string& from, const std::string& to, const std::string& part,
                          StatusCode code = StatusCode::kCorrupt) {
    std::string asc = kSmallAsc;
    asc.replace(asc.find(from), from.size(), to);
    expect_refused("a.asc", asc, kFile, code, part);
  };
  refused("4 5 6", "4 5", "row 1, column 2: expected a height, found the end of the file");
  refused("4 5 6", "4 5 6 7", "behind 6 heights, found \"7\"");
  refused("4 5 6", "4 five 6", "row 1, column 1: expected a height, found \"five\"");
  refused("4 5 6", "4 1e999 6", "row 1, column 1");
  refused("4 5 6", "4 inf 6", "row 1, column 1");
  refused("ncols 3", "ncols three", "line 1: expected a count");
  refused("ncols 3", "ncols -3", "line 1: expected a count");
  refused("ncols 3\n", "", "expected a line of ncols");
  refused("cellsize 10\n", "", "expected a line of cellsize");
  refused("cellsize 10", "cellsize 0", "above 0");
  refused("cellsize 10", "cellsize nan", "above 0");
  refused("cellsize 10", "cell 10", "found \"cell\"");
  refused("xllcenter 100", "xllcenter nan", "finite");
  refused("ncols 3", "ncols 1", "2 x 2", StatusCode::kInvalidArgument);
  refused("ncols 3", "ncols 300000", "found only");
  refused("ncols 3", "ncols 9000000000000000000", "at most", StatusCode::kUnsupported);
}

// --- PNG ---

struct Png {
  std::uint32_t columns = 0, rows = 0;
  int depth = 16, colour = 0, interlaced = 0;
  std::string scanlines;  ///< each behind its filter
  std::size_t piece = 1000;
  std::string transparent{};  ///< of the chunk tRNS; empty: there is none
};

std::string chunk(const std::string& type, const std::string& content) {
  const std::string checked = type + content;
  return big_endian(content.size(), 4) + checked +
         big_endian(crc32(0, reinterpret_cast<const Bytef*>(checked.data()),
                          static_cast<uInt>(checked.size())),
                    4);
}

std::string png_bytes(const Png& png) {
  std::string packed(compressBound(png.scanlines.size()), '\0');
  uLongf size = packed.size();
  EXPECT_EQ(compress(reinterpret_cast<Bytef*>(packed.data()), &size,
                     reinterpret_cast<const Bytef*>(png.scanlines.data()), png.scanlines.size()),
            Z_OK);
  packed.resize(size);
  std::string out = "\x89PNG\r\n\x1a\n";
  out += chunk("IHDR", big_endian(png.columns, 4) + big_endian(png.rows, 4) +
                           static_cast<char>(png.depth) + static_cast<char>(png.colour) +
                           std::string(2, '\0') + static_cast<char>(png.interlaced));
  out += chunk("tEXt", "words");
  if (!png.transparent.empty()) out += chunk("tRNS", png.transparent);
  for (std::size_t at = 0; at < packed.size(); at += png.piece)
    out += chunk("IDAT", packed.substr(at, png.piece));
  return out + chunk("IEND", "");
}

/// A row of 16-bit samples with a filter taken off it, as the standard defines them.
std::string filtered(int filter, const std::string& row, const std::string& above) {
  std::string out(1, static_cast<char>(filter));
  for (std::size_t i = 0; i < row.size(); ++i) {
    const auto at = [i](const std::string& bytes, std::size_t back) {
      return i < back || bytes.empty() ? 0 : static_cast<unsigned char>(bytes[i - back]);
    };
    const int a = at(row, 2), b = at(above, 0), c = at(above, 2);
    int guess = 0;
    if (filter == 1) guess = a;
    if (filter == 2) guess = b;
    if (filter == 3) guess = (a + b) / 2;
    if (filter == 4) {
      const int p = a + b - c;
      const std::array<int, 3> distances{std::abs(p - a), std::abs(p - b), std::abs(p - c)};
      guess = distances[0] <= distances[1] && distances[0] <= distances[2] ? a
              : distances[1] <= distances[2]                               ? b
                                                                           : c;
    }
    out += static_cast<char>(static_cast<unsigned char>(row[i]) - guess);
  }
  return out;
}

TEST(Terrain, PngOfSixteenBitsComesBackThroughEveryFilter) {
  Png png{.columns = 7, .rows = 10, .piece = 11};
  std::string above;
  std::vector<double> heights;
  for (int r = 0; r < 10; ++r) {
    std::string row;
    for (int c = 0; c < 7; ++c) {
      const int sample = (r * 7919 + c * c * 4931 + r * c * 77) % 65536;
      heights.push_back(sample);
      row += big_endian(static_cast<std::uint64_t>(sample), 2);
    }
    png.scanlines += filtered(r % 5, row, above);
    above = row;
  }
  const auto imported = import_good_grid("a.png", png_bytes(png), spaced(2));
  ASSERT_EQ(imported.mesh.positions_m.size(), heights.size());
  for (std::size_t i = 0; i < heights.size(); ++i)
    EXPECT_EQ(imported.mesh.positions_m[i][2], heights[i]) << i;
}

TEST(Terrain, PngOfColoursNeedsToBeToldItsHeights) {
  const Png whole{.columns = 2,
                  .rows = 2,
                  .depth = 8,
                  .colour = 2,
                  .scanlines = std::string("\0\1\2\3\0\0\0\0\0\0\1\0\0\0", 14)};
  expect_refused("a.png", png_bytes(whole), spaced(1), StatusCode::kInvalidArgument, "--heights");
  TerrainOptions mapbox = spaced(1);
  mapbox.heights = {{-10000, 0.1}};
  const auto imported = import_good_grid("a.png", png_bytes(whole), mapbox);
  EXPECT_EQ(imported.mesh.positions_m[0][2], -10000 + 0.1 * 66051);
  EXPECT_EQ(imported.mesh.positions_m[2][2], -10000 + 0.1 * 1);
}

TEST(Terrain, TheTransparentSampleOfAPngIsNoData) {
  const auto row = [](const std::string& samples) { return std::string(1, '\0') + samples; };
  Png png{.columns = 2,
          .rows = 2,
          .scanlines = row(shorts({256, 7})) + row(shorts({8, 65535})),
          .transparent = shorts({256})};
  const auto sixteen = import_good_grid("a.png", png_bytes(png), spaced(1));
  EXPECT_EQ(sixteen.terrain->posts_without_data, 1U);
  EXPECT_EQ(sixteen.mesh.positions_m, (std::vector<Place>{{1, 1, 7}, {0, 0, 8}, {1, 0, 65535}}));
  // Samples of eight bits are stated in two bytes, too.
  png.depth = 8;
  png.scanlines = row("\x09\x07") + row("\x08\x06");
  png.transparent = shorts({9});
  const auto eight = import_good_grid("a.png", png_bytes(png), spaced(1));
  EXPECT_EQ(eight.mesh.positions_m, (std::vector<Place>{{1, 1, 7}, {0, 0, 8}, {1, 0, 6}}));
  png.colour = 2;
  png.scanlines = row("\1\2\3\1\2\4") + row("\1\2\5\1\2\6");
  png.transparent = shorts({1, 2, 3});
  TerrainOptions heights = spaced(1);
  heights.heights = {{0, 1}};
  const auto colours = import_good_grid("a.png", png_bytes(png), heights);
  EXPECT_EQ(colours.mesh.positions_m,
            (std::vector<Place>{{1, 1, 66052}, {0, 0, 66053}, {1, 0, 66054}}));
  png.transparent = shorts({1});
  expect_refused("a.png", png_bytes(png), heights, StatusCode::kCorrupt,
                 "\"tRNS\": expected 6 bytes, found 2");
}

TEST(Terrain, DamagedPngIsRefused) {
  const Png good{.columns = 2, .rows = 2, .scanlines = std::string(10, '\0')};
  const std::string bytes = png_bytes(good);
  ASSERT_TRUE(import_grid("a.png", bytes, spaced(1)).is_ok());
  for (std::size_t size = 1; size < bytes.size(); ++size)
    EXPECT_FALSE(import_grid("a.png", bytes.substr(0, size), spaced(1)).is_ok()) << size;
  for (std::size_t at = 8; at < bytes.size(); ++at) {
    std::string changed = bytes;
    changed[at] = static_cast<char>(changed[at] ^ 0x10);
    EXPECT_FALSE(import_grid("a.png", changed, spaced(1)).is_ok()) << at;
  }
  const auto refused = [](Png png, const std::string& part, StatusCode code) {
    expect_refused("a.png", png_bytes(png), spaced(1), code, part);
  };
  Png png = good;
  png.scanlines[0] = 5;
  refused(png, "row 0: expected a filter", StatusCode::kCorrupt);
  png = good;
  png.scanlines.pop_back();
  refused(png, "row 1: expected 2 rows", StatusCode::kCorrupt);
  png = good;
  png.rows = 100'000;
  refused(png, "found only", StatusCode::kCorrupt);
  png.columns = png.rows = 0xffffffff;
  refused(png, "at most", StatusCode::kUnsupported);
  for (const auto& [depth, colour, interlaced] :
       {std::array{16, 2, 0}, std::array{8, 3, 0}, std::array{8, 4, 0}, std::array{4, 0, 0},
        std::array{16, 0, 1}}) {
    png = good;
    png.depth = depth;
    png.colour = colour;
    png.interlaced = interlaced;
    refused(png, "PNG: expected", StatusCode::kUnsupported);
  }
}

// --- frames ---

TEST(Terrain, WhatTheFileDoesNotSayIsAskedForByOption) {
  const std::string pgm = "P5 2 2 255 abcd", tile = hgt({1, 2, 3, 4});
  constexpr auto kInvalid = StatusCode::kInvalidArgument;
  expect_refused("N01E001.hgt", tile, {}, kInvalid, "--crs enu:LAT,LON");
  expect_refused("N01E001.hgt", tile, kFile, kInvalid, "found --crs file");
  expect_refused("a.asc", kSmallAsc, {}, kInvalid, "--crs file");
  expect_refused("a.pgm", pgm, {}, kInvalid, "--spacing");
  // And nothing is taken that contradicts the file.
  TerrainOptions options = spaced(1);
  options.frame = TerrainFrame::kFile;
  expect_refused("a.asc", kSmallAsc, options, kInvalid, "neither --spacing");
  options.spacing.reset();
  options.corner = {{0, 0}};
  expect_refused("a.asc", kSmallAsc, options, kInvalid, "nor --corner");
}

TEST(Terrain, OptionsThatAreNoNumbersOrNoPlacesAreRefused) {
  const std::string pgm = "P5 2 2 255 abcd";
  constexpr auto kInvalid = StatusCode::kInvalidArgument;
  const double nan = std::nan("");
  for (const double bad : {0.0, -1.0, nan, std::numeric_limits<double>::infinity()})
    expect_refused("a.pgm", pgm, spaced(bad), kInvalid, "--spacing");
  TerrainOptions options = spaced(1);
  options.corner = {{nan, 0}};
  expect_refused("a.pgm", pgm, options, kInvalid, "--corner");
  options = spaced(1);
  options.heights = {{0, nan}};
  expect_refused("a.pgm", pgm, options, kInvalid, "--heights");
  options = spaced(1);
  options.fill = nan;
  expect_refused("a.pgm", pgm, options, kInvalid, "--fill");
  options = spaced(1);
  options.frame = TerrainFrame::kEcef;
  options.corner = {{0, 89.5}};
  expect_refused("a.pgm", pgm, options, kInvalid, "latitude of a row");
  options.corner = {{360, 0}};
  expect_refused("a.pgm", pgm, options, kInvalid, "longitude of a column");
  expect_refused("a.asc", kSmallAsc, kEcef, kInvalid, "latitude of a row");
  for (const std::array<double, 2> origin : {std::array{91.0, 0.0}, {nan, 0.0}, {0.0, 361.0}})
    expect_refused("N01E001.hgt", hgt({1, 2, 3, 4}), enu(origin[0], origin[1]), kInvalid,
                   "of --crs enu");
}

TEST(Terrain, MeshesTakeNoOptionsOfGridsAndGridsNone) {
  expect_refused("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", kFile,
                 StatusCode::kInvalidArgument, "found a mesh");
  const GridFile file("a.pgm", "P5 2 2 255 abcd");
  ImportOptions options{.up = UpAxis::kY};
  options.terrain = spaced(1);
  EXPECT_EQ(import_mesh(file.path(), options).status().code(), StatusCode::kInvalidArgument);
  options = {.node = "hill"};
  options.terrain = spaced(1);
  EXPECT_EQ(import_mesh(file.path(), options).status().code(), StatusCode::kNotFound);
}

TEST(Terrain, UnitsAndScalesAreThoseOfMeshes) {
  const GridFile file("a.asc", kSmallAsc);
  ImportOptions options{.unit_m = 0.5, .scale = 4};
  options.terrain = kFile;
  const auto imported = import_mesh(file.path(), options);
  ASSERT_TRUE(imported.is_ok()) << imported.status().message();
  EXPECT_EQ(imported.value().mesh.positions_m[5], (Place{240, 400, 12}));
  // Degrees become metres: there is no unit left to say.
  const GridFile tile("N01E001.hgt", hgt({1, 2, 3, 4}));
  options.terrain = kEcef;
  EXPECT_EQ(import_mesh(tile.path(), options).status().code(), StatusCode::kInvalidArgument);
}

TEST(Terrain, AGridIsOneNodeNamedAfterItsFile) {
  const GridFile file("hill.asc", kSmallAsc);
  ImportOptions options;
  options.terrain = kFile;
  const auto nodes = import_nodes(file.path(), options);
  ASSERT_TRUE(nodes.is_ok()) << nodes.status().message();
  ASSERT_EQ(nodes.value().nodes.size(), 1U);
  EXPECT_EQ(nodes.value().nodes[0].name, "hill");
  EXPECT_TRUE(nodes.value().terrain);
}

TEST(Wgs84, SinesOfDegreesAreThoseOfTheLibraryWithinTwoUnits) {
  for (int i = -3600; i <= 3600; ++i) {
    const double deg = i / 10.0 + (i % 7) * 0.0137;
    if (std::fabs(deg) > 360) continue;
    const long double x = static_cast<long double>(deg) * 3.14159265358979323846264338328L / 180;
    const meshio::SinCos found = meshio::sin_cos_deg(deg);
    EXPECT_NEAR(found.sine, static_cast<double>(std::sin(x)), 2.3e-16) << deg;
    EXPECT_NEAR(found.cosine, static_cast<double>(std::cos(x)), 2.3e-16) << deg;
  }
  for (const double quarter : {-360.0, -90.0, 0.0, 90.0, 180.0, 270.0}) {
    const meshio::SinCos found = meshio::sin_cos_deg(quarter);
    EXPECT_EQ(std::fabs(found.sine) + std::fabs(found.cosine), 1) << quarter;
  }
}

/// Independent of the formula: in ellipsoidal coordinates the point lies at that height on the
/// normal.
TEST(Wgs84, GeocentricPlacesLieOnTheNormalOfTheEllipsoid) {
  constexpr double kA = 6378137.0, kB = 6356752.314245179;
  for (const double latitude : {-90.0, -47.3, 0.0, 0.5, 34.2, 89.9})
    for (const double longitude : {-180.0, -71.0, 0.0, 10.75, 200.0}) {
      const auto lat = meshio::sin_cos_deg(latitude), lon = meshio::sin_cos_deg(longitude);
      const Place foot = meshio::to_ecef(lat, lon, 0), above = meshio::to_ecef(lat, lon, 5000);
      EXPECT_NEAR(
          (foot[0] * foot[0] + foot[1] * foot[1]) / (kA * kA) + foot[2] * foot[2] / (kB * kB), 1,
          1e-15);
      const Place gradient{foot[0] / (kA * kA), foot[1] / (kA * kA), foot[2] / (kB * kB)};
      const double length = std::sqrt(gradient[0] * gradient[0] + gradient[1] * gradient[1] +
                                      gradient[2] * gradient[2]);
      for (std::size_t k = 0; k < 3; ++k)
        EXPECT_NEAR(above[k] - foot[k], 5000 * gradient[k] / length, 1e-8);
    }
  // NIMA TR8350.2's axes.
  EXPECT_NEAR(meshio::to_ecef({0, 1}, {0, 1}, 0)[0], 6378137.0, 1e-9);
  EXPECT_NEAR(meshio::to_ecef({1, 0}, {0, 1}, 0)[2], 6356752.3142, 1e-4);
}

TEST(Wgs84, TheTangentPlaneIsAMotion) {
  const double latitude = 34.3, longitude = -118.1;
  const meshio::TangentPlane plane(latitude, longitude);
  const auto at = [&](double north_deg, double east_deg, double up_m) {
    return plane.from_ecef(meshio::to_ecef(meshio::sin_cos_deg(latitude + north_deg),
                                           meshio::sin_cos_deg(longitude + east_deg), up_m));
  };
  const Place up = at(0, 0, 100), east = at(0, 1e-3, 0), north = at(1e-3, 0, 0);
  for (const std::size_t k : {0, 1}) EXPECT_NEAR(up[k], 0, 1e-8);
  EXPECT_NEAR(up[2], 100, 1e-8);
  // Radii of curvature at 34.3 degrees: 6384924 m along the parallel's plane, 6355746 m north.
  EXPECT_NEAR(east[0], 6384924.0 * std::cos(34.3 * M_PI / 180) * 1e-3 * M_PI / 180, 1e-2);
  EXPECT_NEAR(east[1], 0, 1e-2);
  EXPECT_NEAR(north[1], 6355746.0 * 1e-3 * M_PI / 180, 1e-2);
  EXPECT_NEAR(north[0], 0, 1e-8);
  EXPECT_LT(north[2], 0);
  const auto a = meshio::to_ecef(meshio::sin_cos_deg(10), meshio::sin_cos_deg(20), 7),
             b = meshio::to_ecef(meshio::sin_cos_deg(-50), meshio::sin_cos_deg(80), -9);
  const auto distance = [](const Place& p, const Place& q) {
    return std::sqrt((p[0] - q[0]) * (p[0] - q[0]) + (p[1] - q[1]) * (p[1] - q[1]) +
                     (p[2] - q[2]) * (p[2] - q[2]));
  };
  EXPECT_NEAR(distance(plane.from_ecef(a), plane.from_ecef(b)), distance(a, b), 1e-8);
}

TEST(Terrain, FacesLookUpInEveryFrame) {
  const std::string tile = hgt({10, 20, 30, 40, 50, 60, 70, 80, 90});
  const auto plane = import_good_grid("N46E007.hgt", tile, enu(46.5, 7.5)).mesh;
  const auto geocentric = import_good_grid("N46E007.hgt", tile, kEcef).mesh;
  ASSERT_EQ(plane.faces.size(), 8U);
  for (const auto& mesh : {plane, geocentric})
    for (const auto& [a, b, c] : mesh.faces) {
      const Place &p = mesh.positions_m[a], &q = mesh.positions_m[b], &r = mesh.positions_m[c];
      Place normal{};
      for (std::size_t k = 0; k < 3; ++k) {
        const std::size_t i = (k + 1) % 3, j = (k + 2) % 3;
        normal[k] = (q[i] - p[i]) * (r[j] - p[j]) - (q[j] - p[j]) * (r[i] - p[i]);
      }
      const Place up = std::fabs(p[0]) < 1e6 ? Place{0, 0, 1} : p;  // geocentric: outward
      EXPECT_GT(normal[0] * up[0] + normal[1] * up[1] + normal[2] * up[2], 0);
    }
}

TEST(Terrain, NeighboursOfWholeFractionsShareTheBitsOfTheirPosts) {
  // Text of three arc-seconds, cut after fifteen digits, as it is found in files.
  const std::string west =
                        "ncols 3\nnrows 3\nxllcenter 10.99833333333333\nyllcenter 0\n"
                        "cellsize 0.000833333333333\n1 2 3\n4 5 6\n7 8 9\n",
                    east =
                        "ncols 3\nnrows 3\nxllcenter 11\nyllcenter 0\n"
                        "cellsize 0.000833333333333\n3 2 3\n6 5 6\n9 8 9\n";
  for (const TerrainOptions& options : {kEcef, enu(0.5, 11)}) {
    const auto a = import_good_grid("a.asc", west, options).mesh,
               b = import_good_grid("b.asc", east, options).mesh;
    ASSERT_EQ(a.positions_m.size(), 9U);
    for (std::size_t row = 0; row < 3; ++row)
      EXPECT_EQ(a.positions_m[3 * row + 2], b.positions_m[3 * row]) << row;
  }
}

TEST(GridAxis, TakesQuotientsOnlyWhereTheyMoveNoPost) {
  const auto thirds = meshio::make_axis(2, -1.0 / 3, 4);
  EXPECT_EQ(thirds.denominator, 3);
  EXPECT_EQ(thirds.at(3), 1);
  const auto halves = meshio::make_axis(0.05, 0.1, 100);  // the middle of cells
  EXPECT_EQ(halves.denominator, 20);
  EXPECT_EQ(halves.at(1), 3.0 / 20);
  for (const auto& [first, step] : {std::array{0.03, 0.1}, {0.0, 0.1001}, {0.0, 30.0}, {0.0, 0.7}})
    EXPECT_EQ(meshio::make_axis(first, step, 100).denominator, 0) << first << " " << step;
  EXPECT_EQ(meshio::make_axis(5, 30, 100).at(2), 65);
}

// --- GDAL ---

/// What a build without GDAL says; one with it finds no raster there.
TEST(Terrain, WhatOnlyGdalReadsIsRefusedWithWhatToDo) {
  const auto imported = import_grid("a.tif", "II*\0 this is no raster", kFile);
  ASSERT_FALSE(imported.is_ok());
  EXPECT_EQ(imported.status().code(), StatusCode::kUnsupported);
  EXPECT_NE(imported.status().message().find(has_gdal() ? "GDAL: " : "libgdal-dev"),
            std::string::npos)
      << imported.status().message();
}

/// GeoTIFF of 3 x 3 posts of one or two bands of floats, 10 m apart.
struct Tiff {
  std::string samples;           ///< 36 bytes a band, post by post
  int bands = 1;                 ///< the second says how opaque each post is
  std::string nodata{}, mask{};  ///< of a mask: a byte a row, the western post in its highest bit
  int epsg = 0;                  ///< of projected coordinates; 0: not stated
  std::string metadata{};        ///< GDAL's own, XML
};

class TiffWriter {
 public:
  std::string write(const Tiff& tiff) {
    const std::string bits = little({32, 32}), kinds = little({3, 3});
    const auto band_shorts = [&](const std::string& two) {
      return two.substr(0, 2 * static_cast<std::size_t>(tiff.bands));
    };
    add(258, kShort, band_shorts(bits));
    add(259, kShort, little({1}));
    add(262, kShort, little({1}));
    add_size(tiff.samples);
    add(277, kShort, little({tiff.bands}));
    add(339, kShort, band_shorts(kinds));
    if (tiff.bands == 2) add(338, kShort, little({2}));  // opacity
    add(33550, kDouble, doubles({10, 10, 0}));
    add(33922, kDouble, doubles({0, 0, 0, 100, 200, 0}));
    if (tiff.epsg != 0)
      add(34735, kShort, little({1, 1, 0, 3, 1024, 0, 1, 1, 1025, 0, 1, 1, 3072, 0, 1, tiff.epsg}));
    if (!tiff.metadata.empty()) add(42112, kText, tiff.metadata + '\0');
    if (!tiff.nodata.empty()) add(42113, kText, tiff.nodata + '\0');
    std::size_t next = end_directory(4);
    if (!tiff.mask.empty()) {
      add(254, kLong, little_4(4));  // of the other image
      add(258, kShort, little({1}));
      add(259, kShort, little({1}));
      add(262, kShort, little({4}));
      add_size(tiff.mask);
      add(277, kShort, little({1}));
      end_directory(next);
    }
    return bytes_;
  }

 private:
  static constexpr int kText = 2, kShort = 3, kLong = 4, kDouble = 12;

  static std::string reversed(std::string bytes) {
    std::reverse(bytes.begin(), bytes.end());
    return bytes;
  }
  static std::string little(std::initializer_list<int> values) {
    std::string out;
    for (const int value : values)
      out += reversed(big_endian(static_cast<std::uint64_t>(value), 2));
    return out;
  }
  static std::string little_4(std::size_t value) { return reversed(big_endian(value, 4)); }
  static std::string doubles(std::initializer_list<double> values) {
    std::string out;
    for (const double value : values)
      out += reversed(big_endian(std::bit_cast<std::uint64_t>(value), 8));
    return out;
  }
  std::size_t place(const std::string& content) {
    const std::size_t at = bytes_.size();
    bytes_ += content + std::string(content.size() % 2, '\0');
    return at;
  }
  void add(int tag, int type, const std::string& content) {
    const std::size_t size = type == kText ? 1 : type == kShort ? 2 : type == kLong ? 4 : 8;
    std::string value = content;
    if (content.size() > 4) value = little_4(place(content));
    value.resize(4, '\0');
    tags_[tag] = little({tag, type}) + little_4(content.size() / size) + value;
  }
  /// Three rows of three, in one piece.
  void add_size(const std::string& samples) {
    add(256, kShort, little({3}));
    add(257, kShort, little({3}));
    add(273, kLong, little_4(place(samples)));
    add(278, kShort, little({3}));
    add(279, kLong, little_4(samples.size()));
  }
  /// Gives where the next one is to be named; `named_at`: where this one is.
  std::size_t end_directory(std::size_t named_at) {
    std::string directory = little({static_cast<int>(tags_.size())});
    for (const auto& [tag, entry] : tags_) directory += entry;
    const std::size_t at = place(directory + std::string(4, '\0'));
    bytes_.replace(named_at, 4, little_4(at));
    tags_.clear();
    return at + directory.size();
  }

  std::string bytes_ = std::string("II*\0\0\0\0\0", 8);
  std::map<int, std::string> tags_;
};

#define SKIP_WITHOUT_GDAL() \
  if (!has_gdal()) GTEST_SKIP() << "this build has no GDAL"

const std::string kNineFloats = floats({1, 2, 3, 4, 5, 6, 7, 8, 9}, std::endian::little);

TEST(TerrainByGdal, TheSampleWithoutDataIsRoundedAsFloatsAre) {
  SKIP_WITHOUT_GDAL();
  for (const auto& [text, nodata] :
       {std::pair{"-9999.9", -9999.9}, {"1e20", 1e20}, {"-3.4e+38", -3.4e38}}) {
    const std::string samples = floats({1, 2, 3, 4, nodata, 6, 7, 8, 9}, std::endian::little);
    const auto stated =
        import_good_grid("a.tif", TiffWriter().write({.samples = samples, .nodata = text}), kFile);
    ASSERT_TRUE(stated.terrain) << text;
    EXPECT_EQ(stated.terrain->posts_without_data, 1U) << text;
    TerrainOptions options = kFile;
    options.nodata = nodata;
    const auto said = import_good_grid("a.tif", TiffWriter().write({.samples = samples}), options);
    ASSERT_TRUE(said.terrain) << text;
    EXPECT_EQ(said.terrain->posts_without_data, 1U) << text;
    EXPECT_FALSE(said.terrain->unmatched_nodata) << text;
  }
  const GridFile file("a.flt", floats({1, 2, 3, -9999.9}, std::endian::little));
  std::ofstream(fs::path(file.path()).replace_extension(".hdr"))
      << "NCOLS 2\nNROWS 2\nXLLCORNER 0\nYLLCORNER 0\nCELLSIZE 10\nNODATA_VALUE -9999.9\n"
         "BYTEORDER LSBFIRST\nNBITS 32\nPIXELTYPE FLOAT\n";
  ImportOptions options;
  options.terrain = kFile;
  const auto esri = import_mesh(file.path(), options);
  ASSERT_TRUE(esri.is_ok()) << esri.status().message();
  EXPECT_EQ(esri.value().terrain->posts_without_data, 1U);
}

TEST(TerrainByGdal, WhatAMaskTakesOutIsNoData) {
  SKIP_WITHOUT_GDAL();
  const auto expect_hole = [](const Tiff& tiff) {
    const auto imported = import_good_grid("a.tif", TiffWriter().write(tiff), kFile);
    ASSERT_TRUE(imported.terrain);
    EXPECT_EQ(imported.terrain->posts_without_data, 1U);
    ASSERT_EQ(imported.mesh.positions_m.size(), 8U);
    for (const Place& p : imported.mesh.positions_m) EXPECT_NE(p[2], 5);
  };
  const std::string mask = "\xe0\xa0\xe0";
  expect_hole({.samples = kNineFloats, .mask = mask});
  // One that the file states beside it counts as well.
  const auto both = import_good_grid(
      "a.tif", TiffWriter().write({.samples = kNineFloats, .nodata = "9", .mask = mask}), kFile);
  ASSERT_TRUE(both.terrain);
  EXPECT_EQ(both.terrain->posts_without_data, 2U);
  std::string opaque;
  for (std::size_t i = 0; i < 9; ++i)
    opaque += kNineFloats.substr(4 * i, 4) + floats({i == 4 ? 0.0 : 255.0}, std::endian::little);
  expect_hole({.samples = opaque, .bands = 2});
}

/// A mask stands in a file of its own, too, which is opened by the same drivers as the grid alone.
TEST(TerrainByGdal, AMaskThatNamesOtherFilesIsNotFollowed) {
  SKIP_WITHOUT_GDAL();
  const GridFile file("a.tif", TiffWriter().write({.samples = kNineFloats}));
  ImportOptions options;
  options.terrain = kFile;
  const std::string mask = file.path() + ".msk", other = file.path() + ".other";
  const std::string zeros = floats({0, 0, 0, 0, 0, 0, 0, 0, 0}, std::endian::little);
  std::ofstream(other, std::ios::binary) << TiffWriter().write({.samples = zeros});
  std::ofstream(mask) << "<VRTDataset rasterXSize=\"3\" rasterYSize=\"3\"><Metadata><MDI "
                         "key=\"INTERNAL_MASK_FLAGS_1\">2</MDI></Metadata><VRTRasterBand "
                         "dataType=\"Byte\" band=\"1\"><SimpleSource><SourceFilename>"
                      << other << "</SourceFilename></SimpleSource></VRTRasterBand></VRTDataset>";
  const auto imported = import_mesh(file.path(), options);
  ASSERT_TRUE(imported.is_ok()) << imported.status().message();
  EXPECT_EQ(imported.value().terrain->posts_without_data, 0U);
}

TEST(TerrainByGdal, TheUnitOfHeightsStaysWhereOptionsSayOffsetAndStep) {
  SKIP_WITHOUT_GDAL();
  const std::string feet =
      R"(<GDALMetadata><Item name="UNITTYPE" sample="0" role="unittype">ft</Item></GDALMetadata>)";
  const std::string bytes =
      TiffWriter().write({.samples = kNineFloats, .epsg = 32633, .metadata = feet});
  const auto as_stated = import_good_grid("a.tif", bytes, kFile);
  ASSERT_EQ(as_stated.mesh.positions_m.size(), 9U);
  EXPECT_DOUBLE_EQ(as_stated.mesh.positions_m[8][2], 9 * 0.3048);
  EXPECT_FALSE(as_stated.terrain->height_unit_is_assumed);
  TerrainOptions options = kFile;
  options.heights = {{100, 2}};
  const auto imported = import_good_grid("a.tif", bytes, options);
  ASSERT_EQ(imported.mesh.positions_m.size(), 9U);
  EXPECT_DOUBLE_EQ(imported.mesh.positions_m[8][2], 118 * 0.3048);
}

TEST(TerrainByGdal, PostsAreFilledInTheUnitOfTheFilesHeights) {
  SKIP_WITHOUT_GDAL();
  const auto metadata = [](const std::string& unit) {
    return R"(<GDALMetadata><Item name="UNITTYPE" sample="0" role="unittype">)" + unit +
           "</Item></GDALMetadata>";
  };
  const std::string in_feet =
      TiffWriter().write({.samples = kNineFloats, .epsg = 32633, .metadata = metadata("ft")});
  TerrainOptions options = kFile;
  options.nodata = 5;
  options.fill = 8;
  // As the post that states this height; by options that say what samples mean it is the same.
  using Heights = std::optional<std::array<double, 2>>;
  for (const Heights& heights : {Heights{}, Heights{std::array{100.0, 2.0}}}) {
    options.heights = heights;
    const auto imported = import_good_grid("a.tif", in_feet, options);
    ASSERT_EQ(imported.mesh.positions_m.size(), 9U);
    EXPECT_EQ(imported.mesh.positions_m[4][2], 8 * 0.3048);
    EXPECT_EQ(imported.terrain->posts_without_data, 1U);
    EXPECT_EQ(imported.terrain->fill, 8);
  }
  // Of coordinates in feet metres are more than can be told.
  options.fill = 1e308;
  expect_refused(
      "a.tif",
      TiffWriter().write({.samples = kNineFloats, .epsg = 2225, .metadata = metadata("m")}),
      options, StatusCode::kInvalidArgument, "--fill: expected a finite height");
}

TEST(TerrainByGdal, HeightsWithoutAUnitBesideFeetAreToldToBeAssumed) {
  SKIP_WITHOUT_GDAL();
  // California, zone 1, in feet.
  const auto feet =
      import_good_grid("a.tif", TiffWriter().write({.samples = kNineFloats, .epsg = 2225}), kFile);
  ASSERT_EQ(feet.mesh.positions_m.size(), 9U);
  EXPECT_TRUE(feet.terrain->height_unit_is_assumed);
  EXPECT_NEAR(feet.mesh.positions_m[8][2], 9 * 1200.0 / 3937.0, 1e-9);
  for (const int epsg : {32633, 0}) {
    const auto other = import_good_grid(
        "a.tif", TiffWriter().write({.samples = kNineFloats, .epsg = epsg}), kFile);
    ASSERT_TRUE(other.terrain);
    EXPECT_FALSE(other.terrain->height_unit_is_assumed) << epsg;
  }
}

/// Of formats in which a file can name other files or addresses.
TEST(Terrain, FilesThatNameOthersAreNotFollowed) {
  const GridFile grid("a.asc", kSmallAsc);
  const std::string vrt =
      "<VRTDataset rasterXSize=\"3\" rasterYSize=\"2\"><VRTRasterBand "
      "dataType=\"Float32\" band=\"1\"><SimpleSource><SourceFilename>" +
      grid.path() + "</SourceFilename></SimpleSource></VRTRasterBand></VRTDataset>";
  std::ofstream(grid.path() + ".vrt") << vrt;
  ImportOptions options;
  options.terrain = kFile;
  const auto imported = import_mesh(grid.path() + ".vrt", options);
  ASSERT_FALSE(imported.is_ok());
  EXPECT_EQ(imported.status().code(), StatusCode::kUnsupported);
}

// --- the shared test data ---

const fs::path kTerrain = fs::path(NEARMESH_TEST_DATA) / "terrain";

#define SKIP_WITHOUT_TERRAIN() \
  if (!fs::exists(kTerrain))   \
  GTEST_SKIP() << "no test data at " << kTerrain << "; set NEARMESH_TEST_DATA"

IndexedMesh import_shared(const std::string& name, const TerrainOptions& options) {
  ImportOptions all;
  all.terrain = options;
  auto imported = import_mesh((kTerrain / name).string(), all);
  EXPECT_TRUE(imported.is_ok()) << imported.status().message();
  return imported.is_ok() ? std::move(imported.value().mesh) : IndexedMesh{};
}

TEST(SharedTerrain, NeighbouringTilesShareTheBitsOfTheirCommonColumn) {
  SKIP_WITHOUT_TERRAIN();
  constexpr std::size_t kSide = 1201;
  for (const TerrainOptions& options : {enu(0.5, 11), enu(-33.3, 151.7), kEcef}) {
    const IndexedMesh west = import_shared("srtm3_N00E010.hgt", options),
                      east = import_shared("srtm3_N00E011.hgt", options);
    ASSERT_EQ(west.positions_m.size(), kSide * kSide);
    ASSERT_EQ(east.positions_m.size(), kSide * kSide);
    EXPECT_EQ(west.faces.size(), 2 * (kSide - 1) * (kSide - 1));
    std::size_t equal = 0;
    for (std::size_t row = 0; row < kSide; ++row)
      equal += west.positions_m[row * kSide + kSide - 1] == east.positions_m[row * kSide] ? 1 : 0;
    EXPECT_EQ(equal, kSide);
  }
}

TEST(SharedTerrain, TheSamePostsInTwoFormatsAreTheSameMesh) {
  SKIP_WITHOUT_TERRAIN();
  const IndexedMesh hgt_mesh = import_shared("srtm3_N00E010.hgt", enu(0.5, 10.5));
  TerrainOptions options = enu(0.5, 10.5);
  options.spacing = {{1.0 / 1200, 1.0 / 1200}};
  options.corner = {{10, 0}};
  const IndexedMesh pgm_mesh = import_shared("srtm3_N00E010.pgm", options);
  EXPECT_EQ(pgm_mesh.positions_m, hgt_mesh.positions_m);
  EXPECT_EQ(pgm_mesh.faces, hgt_mesh.faces);
  options.raw = RawGrid{1201, 1201, RawGrid::Kind::kSigned, 2, true};
  EXPECT_EQ(import_shared("srtm3_N00E010.hgt", options).positions_m, hgt_mesh.positions_m);
}

TEST(SharedTerrain, GridsHaveTheHeightsListed) {
  SKIP_WITHOUT_TERRAIN();
  TerrainOptions mapbox = spaced(3);
  mapbox.heights = {{-10000, 0.1}};
  struct Listed {
    const char* file;
    TerrainOptions options;
    std::size_t posts;
    double low, high;
  };
  for (const Listed& listed : {Listed{"jacksboro_fault_dem.pgm", spaced(90), 138632, 236, 1076},
                               Listed{"srtm3_N00E010.pgm", spaced(90), 1442401, 1, 1005},
                               Listed{"terrain_rgb_14-2625-6369.png", mapbox, 262144, 19, 251.8}}) {
    const IndexedMesh mesh = import_shared(listed.file, listed.options);
    ASSERT_EQ(mesh.positions_m.size(), listed.posts) << listed.file;
    double low = 1e9, high = -1e9;
    for (const Place& p : mesh.positions_m) {
      low = std::min(low, p[2]);
      high = std::max(high, p[2]);
    }
    EXPECT_NEAR(low, listed.low, 1e-9) << listed.file;
    EXPECT_NEAR(high, listed.high, 1e-9) << listed.file;
  }
}

TEST(SharedTerrain, GeoTiffIsReadWhereGdalIsThere) {
  SKIP_WITHOUT_TERRAIN();
  const auto imported = import_mesh((kTerrain / "bigtujunga.tif").string(), ImportOptions{});
  if (!has_gdal()) GTEST_SKIP() << "this build has no GDAL";
  ASSERT_TRUE(imported.is_ok()) << imported.status().message();
  const IndexedMesh& mesh = imported.value().mesh;
  ASSERT_EQ(mesh.positions_m.size(), 769671U);
  ASSERT_TRUE(imported.value().terrain);
  EXPECT_EQ(imported.value().terrain->columns, 1197U);
  EXPECT_EQ(imported.value().terrain->stated_crs, "WGS 84 / UTM zone 11N");
  // The corner of its first pixel, by its tie point, and half a pixel of 30 m.
  EXPECT_DOUBLE_EQ(mesh.positions_m[0][0], 376313.6554542635 + 15);
  EXPECT_DOUBLE_EQ(mesh.positions_m[0][1], 3807917.8276283755 - 15);
  EXPECT_EQ(imported.value().origin.unit_source, OriginSource::kFile);
  ImportOptions degrees;
  degrees.terrain = kEcef;
  const auto refused = import_mesh((kTerrain / "bigtujunga.tif").string(), degrees);
  EXPECT_EQ(refused.status().code(), StatusCode::kInvalidArgument);
}

}  // namespace
}  // namespace nearmesh
