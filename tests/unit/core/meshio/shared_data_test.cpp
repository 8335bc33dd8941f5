// SPDX-License-Identifier: Apache-2.0
// The shared test data: every file loads or is refused as its table says.
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include "nearmesh/core/mesh/clean.hpp"
#include "nearmesh/core/meshio/import.hpp"

namespace nearmesh {
namespace {

namespace fs = std::filesystem;

const fs::path kData = NEARMESH_TEST_DATA;

#define SKIP_WITHOUT(folder)         \
  if (!fs::exists(kData / (folder))) \
  GTEST_SKIP() << "no test data at " << (kData / (folder)) << "; set NEARMESH_TEST_DATA"

Result<CleanResult> load(const fs::path& path) {
  const auto mesh = import_mesh(path.string());
  if (!mesh.is_ok()) return mesh.status();
  return clean_mesh(mesh.value());
}

TEST(SharedData, BadFilesLoadOrAreRefusedAsListed) {
  SKIP_WITHOUT("bad/bad_expected.csv");
  std::ifstream table(kData / "bad/bad_expected.csv");
  std::string row;
  std::getline(table, row);  // heading
  int checked = 0;
  while (std::getline(table, row)) {
    const std::size_t comma = row.find(','), next = row.find(',', comma + 1);
    const std::string name = row.substr(0, comma);
    const std::string verdict = row.substr(comma + 1, next - comma - 1);
    const auto result = load(kData / "bad" / name);
    if (verdict == "load") {
      EXPECT_TRUE(result.is_ok()) << result.status().message();
    } else if (verdict == "reject") {
      EXPECT_FALSE(result.is_ok()) << name;
    } else {
      EXPECT_EQ(verdict, "either");
    }
    ++checked;
  }
  EXPECT_GT(checked, 60);
}

TEST(SharedData, BadFilesLoadWithTheCountsListed) {
  SKIP_WITHOUT("bad/bad_expected.csv");
  std::ifstream table(kData / "bad/bad_expected.csv");
  std::string row;
  std::getline(table, row);
  while (std::getline(table, row)) {
    if (row.find(",load,") == std::string::npos) continue;
    std::istringstream fields(row);
    std::string name, verdict, vertices, faces;
    std::getline(fields, name, ',');
    std::getline(fields, verdict, ',');
    std::getline(fields, vertices, ',');
    std::getline(fields, faces, ',');
    const auto mesh = import_mesh((kData / "bad" / name).string());
    ASSERT_TRUE(mesh.is_ok()) << mesh.status().message();
    EXPECT_EQ(mesh.value().positions_m.size(), std::stoul(vertices)) << name;
    if (name != "gen_1000gon.obj" && name != "gen_quads_cube.off") {  // counted as polygons
      EXPECT_EQ(mesh.value().faces.size(), std::stoul(faces)) << name;
    }
  }
}

TEST(SharedData, EveryOtherFileComesToAnAnswer) {
  SKIP_WITHOUT("bad");
  for (const auto& entry : fs::recursive_directory_iterator(kData)) {
    if (!entry.is_regular_file() || entry.file_size() > 3'000'000) continue;
    const auto result = load(entry.path());
    if (!result.is_ok()) {
      EXPECT_FALSE(result.status().message().empty()) << entry.path();
    }
  }
}

struct Known {
  const char* file;
  std::size_t vertices, faces;
  std::uint64_t boundary;
};

/// After exact welding, from the table of the data's README; the grid welds nothing more in these.
TEST(SharedData, ReferenceMeshesHaveTheirKnownShape) {
  SKIP_WITHOUT("scans");
  for (const Known& known :
       {Known{"scans/armadillo_86k.obj", 43243, 86482, 0},
        Known{"scans/armadillo_346k_loop.ply", 172966, 345928, 0},
        Known{"scans/camelhead.off", 11381, 22704, 56}, Known{"scans/fertility.off", 4494, 9000, 0},
        Known{"scans/stanford_bunny.obj", 34834, 69451, 223},
        Known{"assembly/factory_bolt_m16_loose.obj", 12836, 25668, 0},
        Known{"assembly/factory_round_hole_8mm_subdiv_3x.obj", 464, 900, 36},
        Known{"bad/cgal_cube-shuffled.off", 8, 12, 0},
        Known{"bad/cgal_oblong-shuffled.off", 422, 840, 0}}) {
    const auto result = load(kData / known.file);
    ASSERT_TRUE(result.is_ok()) << result.status().message();
    EXPECT_EQ(result.value().mesh.positions.size(), known.vertices) << known.file;
    EXPECT_EQ(result.value().mesh.faces.size(), known.faces) << known.file;
    EXPECT_EQ(result.value().report.edges_boundary, known.boundary) << known.file;
  }
}

TEST(SharedData, EveryScanAndAssemblyPartLoads) {
  SKIP_WITHOUT("scans");
  for (const char* folder : {"scans", "assembly"})
    for (const auto& entry : fs::directory_iterator(kData / folder)) {
      if (entry.path().extension() == ".yaml") continue;
      const auto result = load(entry.path());
      EXPECT_TRUE(result.is_ok()) << result.status().message();
    }
}

}  // namespace
}  // namespace nearmesh
