// SPDX-License-Identifier: Apache-2.0
// nearmesh-model query --contacts and --max-pairs, from mesh files to JSON lines.
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "shapes.hpp"
#include "test_models.hpp"

namespace nearmesh {
namespace {

using nlohmann::json;

class ContactsProgram : public ::testing::Test {
 protected:
  void SetUp() override {
    if (!std::filesystem::exists(program())) GTEST_SKIP() << program() << " is not built";
    build(test::make_plane(4, 16), plane_.path());
    build(generate_sphere(32, 0), sphere_.path());
    // A sphere sunk into the plane by a fifth of its radius, and one above it.
    std::ofstream poses(poses_.path());
    poses << "id";
    for (const char* body : {"A_", "B_"}) {
      for (const char* r : {"R00", "R01", "R02", "R10", "R11", "R12", "R20", "R21", "R22"})
        poses << ',' << body << r;
      for (const char* t : {"T0", "T1", "T2"}) poses << ',' << body << t;
    }
    const std::string upright = ",1,0,0,0,1,0,0,0,1";
    poses << "\nsunk" << upright << ",0,0,0" << upright << ",0.1,0.2,0.8";
    poses << "\nabove" << upright << ",0,0,0" << upright << ",0.1,0.2,1.5\n";
  }
  static std::string program() { return std::string(NEARMESH_BIN_DIR) + "/nearmesh-model"; }
  static void build(const IndexedMesh& mesh, const std::string& out) {
    const test::TempFile ply(".ply");
    ASSERT_TRUE(write_ply(mesh, ply.path()).is_ok());
    const std::string command =
        program() + " build " + ply.path() + " -o " + out + " --json > /dev/null 2>&1";
    ASSERT_EQ(std::system(command.c_str()), 0) << command;
  }
  /// The line of each pose.
  [[nodiscard]] std::map<std::string, json> run(const std::string& more) const {
    const test::TempFile out(".json");
    const std::string command = program() + " query " + plane_.path() + " " + sphere_.path() +
                                " --poses " + poses_.path() + " " + more + " --json > " +
                                out.path();
    EXPECT_EQ(std::system(command.c_str()), 0) << command;
    std::map<std::string, json> lines;
    std::ifstream in(out.path());
    for (std::string text; std::getline(in, text);) {
      json line = json::parse(text);
      lines[line.at("id")] = line;
    }
    return lines;
  }
  test::TempFile plane_, sphere_, poses_{".csv"};
};

TEST_F(ContactsProgram, GivesThePatchesOfEveryMethod) {
  for (const char* method : {"certified", "full", "global --splits 60", "grid"}) {
    SCOPED_TRACE(method);
    auto lines = run(std::string("--contacts --method ") + method);
    EXPECT_TRUE(lines["above"]["patches"].empty());
    ASSERT_EQ(lines["sunk"]["patches"].size(), 1U);
    const json& patch = lines["sunk"]["patches"][0];
    EXPECT_EQ(patch["normal"], json({0.0, 0.0, 1.0}));
    EXPECT_EQ(patch["normal_of"], "a");
    EXPECT_LT(patch["normal_error_rad"], 1e-12);
    EXPECT_GE(patch["segments"], lines["sunk"]["pairs"]);
    const bool coarse = std::string(method).starts_with("global");
    EXPECT_NEAR(patch["centroid_m"][0], 0.1, coarse ? 0.05 : 0.01);
    EXPECT_NEAR(patch["length_m"], 3.77, coarse ? 0.6 : 0.05);
    EXPECT_EQ(patch["approximate"], coarse);
    EXPECT_EQ(patch["uncertainty_m"] > 0, coarse);
    EXPECT_GT(lines["sunk"]["position_error_m"], 0);
    EXPECT_LT(lines["sunk"]["position_error_m"], 1e-14);
  }
}

TEST_F(ContactsProgram, SaysWhenTheListIsCut) {
  auto all = run("--list-pairs");
  EXPECT_FALSE(all["sunk"].contains("truncated"));
  EXPECT_FALSE(all["sunk"].contains("patches"));
  for (const char* method : {"certified", "full", "global --splits 60", "grid"}) {
    SCOPED_TRACE(method);
    auto cut = run(std::string("--list-pairs --contacts --max-pairs 5 --method ") + method);
    EXPECT_EQ(cut["sunk"]["pairs"], 5);
    EXPECT_EQ(cut["sunk"]["faces"].size(), 5U);
    EXPECT_EQ(cut["sunk"]["truncated"], true);
    EXPECT_GT(cut["sunk"]["pair_total"], 5);
    if (!std::string(method).starts_with("global")) {
      EXPECT_EQ(cut["sunk"]["pair_total"], all["sunk"]["pairs"]);
    }
    std::size_t segments = 0;
    for (const json& patch : cut["sunk"]["patches"]) segments += std::size_t{patch["segments"]};
    EXPECT_EQ(segments, 5U);
    EXPECT_EQ(cut["above"]["truncated"], false);
  }
}

TEST_F(ContactsProgram, EndsASearchAfterSoManyTests) {
  for (const char* method : {"certified", "full", "global --splits 60"}) {
    SCOPED_TRACE(method);
    auto all = run(std::string("--method ") + method);
    EXPECT_EQ(all["sunk"]["status"], "contact");
    EXPECT_FALSE(all["sunk"].contains("exhausted"));
    auto ended = run(std::string("--max-tests 100 --method ") + method);
    EXPECT_EQ(ended["sunk"]["exhausted"], true);
    EXPECT_TRUE(ended["sunk"]["status"] == "partial" || ended["sunk"]["status"] == "uncertain");
    EXPECT_LT(ended["sunk"]["pairs"], all["sunk"]["pairs"]);
    EXPECT_EQ(ended["above"]["status"], "free");
    EXPECT_FALSE(ended["above"].contains("exhausted"));
    EXPECT_EQ(run(std::string("--max-tests 100000000 --method ") + method)["sunk"]["pairs"],
              all["sunk"]["pairs"]);
  }
}

}  // namespace
}  // namespace nearmesh
