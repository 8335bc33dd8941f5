// SPDX-License-Identifier: Apache-2.0
// Solid bodies by the nearmesh-model program: a closed terrain, an aircraft below it, recorded
// answers.
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "test_models.hpp"

namespace nearmesh {
namespace {

using nlohmann::json;

class ModelSolidProgram : public ::testing::Test {
 protected:
  void SetUp() override {
    if (!std::filesystem::exists(program())) GTEST_SKIP() << program() << " is not built";
    ASSERT_EQ(make("terrain --size 20 --floor-m -3000", land_), 0);
    ASSERT_EQ(make("terrain --size 20", sheet_), 0);
    ASSERT_EQ(make("aircraft --size 600", aircraft_), 0);
    std::ofstream out(poses_.path());
    out << "id";
    for (const char* body : {"A", "B"}) {
      for (int i = 0; i < 9; ++i) out << ',' << body << "_R" << i / 3 << i % 3;
      for (int k = 0; k < 3; ++k) out << ',' << body << "_T" << k;
    }
    for (const int z : {-2500, 2500, -4000})
      out << "\n" << z << ",1,0,0,0,1,0,0,0,1,0,0,0,1,0,0,0,1,0,0,0,1,40,30," << z;
    out << "\n";
  }
  static std::string program() { return std::string(NEARMESH_BIN_DIR) + "/nearmesh-model"; }
  static int make(const std::string& what, const test::TempFile& model) {
    const test::TempFile mesh(".ply");
    return std::system((program() + " generate " + what + " -o " + mesh.path() +
                        " > /dev/null && " + program() + " build " + mesh.path() + " -o " +
                        model.path() + " > /dev/null 2>&1")
                           .c_str());
  }
  /// Exit code and what was printed, both streams.
  static std::pair<int, std::string> run(const std::string& arguments) {
    const test::TempFile out(".txt");
    const int code =
        std::system((program() + " " + arguments + " > " + out.path() + " 2>&1").c_str());
    std::ifstream in(out.path());
    return {code, {std::istreambuf_iterator<char>(in), {}}};
  }
  std::vector<json> query(const std::string& more) const {
    const auto [code, text] = run("query " + land_.path() + " " + aircraft_.path() + " --poses " +
                                  poses_.path() + " --json " + more);
    EXPECT_EQ(code, 0) << text;
    std::vector<json> lines;
    std::istringstream in(text);
    for (std::string line; std::getline(in, line);) lines.push_back(json::parse(line));
    return lines;
  }
  std::string content_of(const std::string& path) const {
    return json::parse(run("info --json " + path).second).at("content_hash");
  }
  /// Checks one recorded answer of the aircraft under the ground, with changes.
  std::pair<int, std::string> check(const json& changes) const {
    json line = {{"a", "ground"},
                 {"b", "plane"},
                 {"model_a", std::filesystem::path(land_.path()).stem()},
                 {"model_b", std::filesystem::path(aircraft_.path()).stem()},
                 {"content_a", content_of(land_.path())},
                 {"content_b", content_of(aircraft_.path())},
                 {"status", "contained"},
                 {"contained", "b_in_a"},
                 {"solid_a", true},
                 {"solid_b", false},
                 {"pairs", 0},
                 {"pairs_digest", std::to_string(digest(std::vector<FacePair>{}))},
                 {"pose_a", {1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0}},
                 {"pose_b", {1, 0, 0, 0, 1, 0, 0, 0, 1, 40, 30, -2500}}};
    line.update(changes);
    const test::TempFile answers(".jsonl");
    std::ofstream(answers.path()) << line.dump() << '\n';
    return run("check " + land_.path() + " " + sheet_.path() + " " + aircraft_.path() +
               " --answers " + answers.path());
  }

  test::TempFile land_, sheet_, aircraft_, poses_{".csv"};
};

TEST_F(ModelSolidProgram, QueryFindsTheAircraftUnderGround) {
  for (const std::string method : {"full", "certified"}) {
    const std::vector<json> lines = query("--solid-a --solid-b --method " + method);
    ASSERT_EQ(lines.size(), 3U);
    EXPECT_EQ(lines[0].at("status"), "contained") << method;
    EXPECT_EQ(lines[0].at("contained"), "b_in_a");
    EXPECT_EQ(lines[1].at("status"), "free");
    EXPECT_FALSE(lines[1].contains("contained"));
    EXPECT_EQ(lines[2].at("status"), "free");
    EXPECT_EQ(query("--solid-b --method " + method)[0].at("status"), "free");
    EXPECT_EQ(query("--method " + method)[0].at("status"), "free");
  }
}

// 300 grains are too many parts to be proved outside a solid among them: that is said of this pose,
// as by `full`, and the next one is answered.
TEST_F(ModelSolidProgram, QueryGoesOnAfterAPoseThatIsUncertain) {
  const test::TempFile mesh(".obj"), dust, ball, poses(".csv");
  {
    std::ofstream obj(mesh.path());
    for (int i = 0; i < 300; ++i) {
      const int x = 4 * i, v = x + 1;
      obj << "v " << x << " 0 0\nv " << x << ".2 0 0\nv " << x << " .2 0\nv " << x << " 0 .2\n"
          << "f " << v << ' ' << v + 2 << ' ' << v + 1 << "\nf " << v << ' ' << v + 1 << ' '
          << v + 3 << "\nf " << v << ' ' << v + 3 << ' ' << v + 2 << "\nf " << v + 1 << ' ' << v + 2
          << ' ' << v + 3 << "\n";
    }
    std::ifstream in(poses_.path());
    std::string header;
    std::getline(in, header);
    std::ofstream out(poses.path());
    out << header;
    for (const int y : {500, 0, -500})
      out << "\n" << y << ",1,0,0,0,1,0,0,0,1,0,0,0,1,0,0,0,1,0,0,0,1,402," << y << ",0";
    out << "\n";
  }
  ASSERT_EQ(run("build " + mesh.path() + " -o " + dust.path()).first, 0);
  ASSERT_EQ(make("sphere --size 8", ball), 0);
  for (const std::string method : {"full", "certified"}) {
    const auto [code, text] = run("query " + dust.path() + " " + ball.path() + " --poses " +
                                  poses.path() + " --json --solid-b --method " + method);
    EXPECT_EQ(code, 0) << text;
    std::string found;
    std::istringstream in(text);
    for (std::string line; std::getline(in, line);)
      found += json::parse(line, nullptr, false).value("status", "none") + " ";
    EXPECT_EQ(found, "free uncertain free ") << method << ": " << text;
  }
}

TEST_F(ModelSolidProgram, QueryRefusesASheetWithTheReason) {
  const auto [code, text] = run("query " + sheet_.path() + " " + aircraft_.path() + " --poses " +
                                poses_.path() + " --solid-a");
  EXPECT_NE(code, 0);
  EXPECT_NE(text.find("80 boundary edges, and an open sheet has no inside"), std::string::npos)
      << text;
}

TEST_F(ModelSolidProgram, QueryRefusesMethodsThatKnowNoInside) {
  const auto [code, text] = run("query " + land_.path() + " " + aircraft_.path() + " --poses " +
                                poses_.path() + " --solid-a --method base");
  EXPECT_NE(code, 0);
  EXPECT_NE(text.find("base knows no inside"), std::string::npos) << text;
}

TEST_F(ModelSolidProgram, InfoSaysWhetherTheSurfaceIsClosed) {
  EXPECT_TRUE(json::parse(run("info --json " + land_.path()).second).at("closed"));
  EXPECT_EQ(json::parse(run("info --json " + aircraft_.path()).second).at("components"), 8);
  const json sheet = json::parse(run("info --json " + sheet_.path()).second);
  EXPECT_FALSE(sheet.at("closed"));
  EXPECT_EQ(sheet.at("boundary_edges"), 80);
  EXPECT_NE(run("info " + sheet_.path()).second.find("open: 80 boundary edges"), std::string::npos);
}

TEST_F(ModelSolidProgram, CheckHonoursRecordedSolids) {
  EXPECT_EQ(check(json::object()).first, 0) << check(json::object()).second;
  EXPECT_NE(check({{"status", "free"}}).first, 0);
  EXPECT_NE(check({{"contained", "a_in_b"}}).first, 0);
  EXPECT_NE(check({{"solid_a", false}}).first, 0);
  EXPECT_EQ(check({{"solid_a", false}, {"status", "free"}}).first, 0);
  const auto sheet = check({{"model_a", std::filesystem::path(sheet_.path()).stem()},
                            {"content_a", content_of(sheet_.path())}});
  EXPECT_NE(sheet.first, 0);
  EXPECT_NE(sheet.second.find("boundary edges"), std::string::npos) << sheet.second;
}

TEST_F(ModelSolidProgram, CheckRefusesAnswersAboutOtherContent) {
  const std::string other = content_of(sheet_.path());
  const auto [code, text] = check({{"content_a", other}});
  EXPECT_NE(code, 0);
  EXPECT_NE(text.find("the answer is about content " + other), std::string::npos) << text;
  EXPECT_NE(text.find("the .spm file given is " + content_of(land_.path())), std::string::npos)
      << text;
}

TEST_F(ModelSolidProgram, GenerateRefusesAFloorOnlyTerrainHas) {
  const test::TempFile out(".ply");
  EXPECT_NE(run("generate sphere --floor-m -5 -o " + out.path()).first, 0);
  EXPECT_NE(run("generate terrain --size 20 --floor-m 1000 -o " + out.path()).first, 0);
}

}  // namespace
}  // namespace nearmesh
