// SPDX-License-Identifier: Apache-2.0
// nearmesh-model build on grids of heights: its options, and what it says.
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "test_models.hpp"

namespace nearmesh {
namespace {

using nlohmann::json;
using test::TempFile;

class ModelTerrainProgram : public ::testing::Test {
 protected:
  void SetUp() override {
    if (!std::filesystem::exists(program())) GTEST_SKIP() << program() << " is not built";
    std::ofstream(grid_.path(), std::ios::binary)
        << "ncols 4\nnrows 3\nxllcenter 10\nyllcenter 20\ncellsize 0.5\nNODATA_value -9999\n"
           "1 2 3 4\n5 -9999 7 8\n9 10 11 12\n";
  }
  static std::string program() { return std::string(NEARMESH_BIN_DIR) + "/nearmesh-model"; }
  struct Ended {
    int code = -1;
    std::string out, err;
  };
  [[nodiscard]] Ended build(const std::string& flags) const {
    const TempFile out(".txt"), err(".txt");
    const std::string command = program() + " build " + grid_.path() + " -o " + model_.path() +
                                " " + flags + " > " + out.path() + " 2> " + err.path();
    const int code = std::system(command.c_str());
    const auto text = [](const TempFile& file) {
      const auto bytes = file.read();
      return std::string(bytes.begin(), bytes.end());
    };
    return {code, text(out), text(err)};
  }

  const TempFile grid_{".asc"}, model_;
};

TEST_F(ModelTerrainProgram, SaysWhatBecameOfTheGrid) {
  const json holes = json::parse(build("--crs file --json").out, nullptr, false);
  const json& terrain = holes.at("terrain");
  EXPECT_EQ(terrain.at("columns"), 4);
  EXPECT_EQ(terrain.at("rows"), 3);
  EXPECT_EQ(terrain.at("posts_without_data"), 1);
  EXPECT_EQ(terrain.at("fill"), nullptr);
  EXPECT_EQ(terrain.at("crs"), "file");
  EXPECT_EQ(holes.at("faces_in"), 6);
  const json filled = json::parse(build("--crs enu:20,10 --fill 6 --json").out, nullptr, false);
  EXPECT_EQ(filled.at("terrain").at("fill"), 6);
  EXPECT_EQ(filled.at("terrain").at("enu_origin_deg"), json({20.0, 10.0}));
  EXPECT_EQ(filled.at("faces_in"), 12);
  EXPECT_EQ(filled.at("warnings").size(), 0U) << "a terrain may be longer than ten kilometres";
  const std::string text = build("--crs ecef --nodata 12").out;
  EXPECT_NE(text.find("4 x 3 posts, 2 without data: holes"), std::string::npos) << text;
  EXPECT_NE(text.find("geocentric, WGS 84; heights taken as above its ellipsoid"),
            std::string::npos)
      << text;
}

TEST_F(ModelTerrainProgram, SamplesWithoutAHeaderAreDescribedByOptions) {
  std::ofstream(grid_.path(), std::ios::binary) << std::string("\xff\xff\0\2\0\3\0\4\0\5\0\6", 12);
  const Ended ended =
      build("--raw 3x2,i16be --spacing 2,4 --corner 100,200 --heights 10,0.5 --nodata -1 --json");
  ASSERT_EQ(ended.code, 0) << ended.err;
  const json report = json::parse(ended.out, nullptr, false);
  EXPECT_EQ(report.at("box_min_m"), json({100.0, 200.0, 11.0}));
  EXPECT_EQ(report.at("box_max_m"), json({104.0, 204.0, 13.0}));
  EXPECT_EQ(report.at("terrain").at("posts_without_data"), 1);
}

TEST_F(ModelTerrainProgram, OptionsThatSayNothingAreRefusedByName) {
  for (const std::string flags :
       {"--crs enu",     "--crs enu:1",  "--crs enu:1,x",   "--crs enu:1,2,3", "--crs utm",
        "--raw 3x2",     "--raw 3x2,",   "--raw 3x2,i16",   "--raw 3x2,u8le",  "--raw 3x2,f16le",
        "--raw 3,i16le", "--raw x2,u8",  "--raw 3x2,x32le", "--raw 3x2,i24le", "--spacing 1",
        "--spacing 1,",  "--corner a,b", "--heights 1",     "--nodata none",   "--fill deep"}) {
    const Ended ended = build(flags);
    EXPECT_NE(ended.code, 0) << flags;
    EXPECT_NE(ended.err.find(flags.substr(0, flags.find(' '))), std::string::npos)
        << flags << ": " << ended.err;
  }
}

}  // namespace
}  // namespace nearmesh
