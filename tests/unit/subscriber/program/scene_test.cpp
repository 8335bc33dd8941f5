// SPDX-License-Identifier: Apache-2.0
#include "subscriber/program/scene.hpp"

#include <filesystem>

#include "test_models.hpp"
#include "tests/support/folder.hpp"

namespace nearmesh {
namespace {

using subscriber::program::read_scene;
using subscriber::program::Scene;

/// With a flight of three frames.
class Folder : public test::Folder {
 public:
  Folder() {
    write("flight1.csv",
          "t,R00,R01,R02,R10,R11,R12,R20,R21,R22,T0,T1,T2\n"
          "0,1,0,0,0,1,0,0,0,1,0,0,100\n"
          "0.05,1,0,0,0,1,0,0,0,1,8,0,100\n"
          "0.1,1,0,0,0,1,0,0,0,1,20,0,100\n");
  }
};

constexpr const char* kScene =
    "bodies:\n"                                                              // 1
    "  - {name: terrain, model: terrain, pose: {translation: [1, 2, 3]}}\n"  // 2
    "  - {name: one, model: aircraft}\n"                                     // 3
    "  - {name: two, model: aircraft}\n"                                     // 4
    "moves:\n"                                                               // 5
    "  - {body: one, trajectory: flight1.csv}\n"                             // 6
    "pairs:\n"                                                               // 7
    "  - [terrain, one]\n"                                                   // 8
    "  - [one, two]\n"                                                       // 9
    "frame_rate_hz: 20\n"                                                    // 10
    "budget_ms: 5\n"                                                         // 11
    "lookahead_s: 0.3\n";                                                    // 12

// The scene with one piece of text replaced.
std::string changed(const std::string& from, const std::string& to) {
  std::string text = kScene;
  const std::size_t at = text.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  return text.replace(at, from.size(), to);
}

TEST(ReadScene, ReadsTheDemo) {
  Folder folder;
  for (const char* number : {"1", "2"}) {
    const std::string name = std::string("peer") + number + ".yaml";
    std::filesystem::copy(std::string(NEARMESH_DEMO_DIR) + "/" + name, folder.file(name));
    folder.write("flight2.csv",
                 "R00,R01,R02,R10,R11,R12,R20,R21,R22,T0,T1,T2\n1,0,0,0,1,0,0,0,1,0,0,0\n");
    const Result<Scene> scene = read_scene(folder.file(name));
    ASSERT_TRUE(scene.is_ok()) << scene.status().message();
    EXPECT_EQ(scene.value().bodies.size(), 3U);
    EXPECT_EQ(scene.value().pairs.size(), 2U);
  }
}

TEST(ReadScene, PosesMayBeAsOldAsItSays) {
  Folder folder;
  folder.write("scene.yaml", kScene);
  EXPECT_EQ(read_scene(folder.file("scene.yaml")).value().session.max_pose_age_s, 2);
  folder.write("scene.yaml", changed("budget_ms: 5", "budget_ms: 5\nmax_pose_age_s: 0.5"));
  EXPECT_EQ(read_scene(folder.file("scene.yaml")).value().session.max_pose_age_s, 0.5);
  folder.write("scene.yaml", changed("{name: two, model", "{name: two, max_pose_age_s: 60, model"));
  const Result<Scene> scene = read_scene(folder.file("scene.yaml"));
  ASSERT_TRUE(scene.is_ok()) << scene.status().message();
  EXPECT_EQ(scene.value().session.max_pose_age_s, 2);
  EXPECT_EQ(scene.value().bodies[1].max_pose_age_s, std::nullopt);
  EXPECT_EQ(scene.value().bodies[2].max_pose_age_s, 60);
  folder.write("scene.yaml", changed("{name: two, model", "{name: two, max_pose_age_s: -1, model"));
  EXPECT_NE(read_scene(folder.file("scene.yaml")).status().message().find("max_pose_age_s"),
            std::string::npos);
}

TEST(ReadScene, AnswersHaveBoundsOfTests) {
  Folder folder;
  folder.write("scene.yaml", changed("budget_ms: 5",
                                     "max_tests: 1000\nmax_sweep_tests: 200\nmax_depth_tests: 30"));
  const Result<Scene> scene = read_scene(folder.file("scene.yaml"));
  ASSERT_TRUE(scene.is_ok()) << scene.status().message();
  EXPECT_EQ(scene.value().session.max_tests, 1000U);
  EXPECT_EQ(scene.value().session.max_sweep_tests, 200U);
  EXPECT_EQ(scene.value().session.max_depth_tests, 30U);
}

TEST(ReadScene, ABodyIsSolidWhereItSaysSo) {
  Folder folder;
  folder.write("scene.yaml", changed("{name: one, model", "{name: one, solid: true, model"));
  const Result<Scene> scene = read_scene(folder.file("scene.yaml"));
  ASSERT_TRUE(scene.is_ok()) << scene.status().message();
  EXPECT_FALSE(scene.value().bodies[0].solid);
  EXPECT_TRUE(scene.value().bodies[1].solid);
}

TEST(ReadScene, ContentIsPinnedWhereItSaysSo) {
  Folder folder;
  // Digits alone are no number here.
  const std::string digits = "12345678901234567890123456789012";
  folder.write("scene.yaml",
               changed("{name: one, model", "{name: one, content: " + digits + ", model"));
  const Result<Scene> scene = read_scene(folder.file("scene.yaml"));
  ASSERT_TRUE(scene.is_ok()) << scene.status().message();
  EXPECT_FALSE(scene.value().bodies[0].content.is_set());
  EXPECT_EQ(to_hex(scene.value().bodies[1].content), digits);
}

TEST(ReadScene, ReadsAllOfIt) {
  Folder folder;
  folder.write("scene.yaml",
               std::string(kScene) +
                   "margin_m: 2\nsweep_s: 1.5\nmax_held_splits: 5000\nstart_timeout_s: 7\n"
                   "contacts: true\nclearance: exact\ncache: kept\n");
  const Result<Scene> result = read_scene(folder.file("scene.yaml"));
  ASSERT_TRUE(result.is_ok()) << result.status().message();
  const Scene& scene = result.value();
  ASSERT_EQ(scene.bodies.size(), 3U);
  EXPECT_EQ(scene.bodies[0].name, "terrain");
  EXPECT_EQ(scene.bodies[0].model, "terrain");
  ASSERT_TRUE(scene.bodies[0].fixed_pose.has_value());
  EXPECT_EQ(scene.bodies[0].fixed_pose->translation_m, (std::array<double, 3>{1, 2, 3}));
  EXPECT_EQ(scene.bodies[1].model, "aircraft");
  EXPECT_FALSE(scene.bodies[1].fixed_pose.has_value());
  EXPECT_TRUE(scene.bodies[2].trajectory.empty());
  EXPECT_EQ(scene.pairs, (std::vector<std::pair<std::size_t, std::size_t>>{{0, 1}, {1, 2}}));
  EXPECT_EQ(scene.frames, 3U);
  EXPECT_EQ(scene.frame_rate_hz, 20);
  EXPECT_DOUBLE_EQ(scene.budget_s, 0.005);
  EXPECT_EQ(scene.start_timeout_s, 7);
  EXPECT_EQ(scene.session.lookahead_s, 0.3);
  EXPECT_EQ(scene.session.margin_m, 2);
  EXPECT_EQ(scene.session.sweep_s, 1.5);
  EXPECT_EQ(scene.session.max_held_splits, 5000U);
  EXPECT_TRUE(scene.session.contacts);
  EXPECT_EQ(scene.session.clearance, Clearance::kExact);
  EXPECT_FALSE(scene.watches_all);
  EXPECT_EQ(scene.session.cache_folder, folder.file("kept"));
}

TEST(ReadScene, MayWatchAllPairs) {
  Folder folder;
  folder.write("scene.yaml",
               changed("pairs:\n  - [terrain, one]\n  - [one, two]\n", "pairs: all\n"));
  const Result<Scene> result = read_scene(folder.file("scene.yaml"));
  ASSERT_TRUE(result.is_ok()) << result.status().message();
  EXPECT_TRUE(result.value().watches_all);
  EXPECT_TRUE(result.value().pairs.empty());
  EXPECT_EQ(result.value().session.clearance, Clearance::kBound);
}

TEST(ReadScene, MayWatchThePairsOfItsOwnBodiesWhoseSpeedsItSays) {
  Folder folder;
  folder.write("flight1.csv",
               "R00,R01,R02,R10,R11,R12,R20,R21,R22,T0,T1,T2\n1,0,0,0,1,0,0,0,1,0,0,0\n");
  folder.write("scene.yaml",
               "bodies:\n  - {name: one, model: aircraft, max_speed_mps: 250}\n"
               "moves:\n  - {body: one, trajectory: flight1.csv}\npairs: own\n");
  const Result<Scene> result = read_scene(folder.file("scene.yaml"));
  ASSERT_TRUE(result.is_ok()) << result.status().message();
  EXPECT_TRUE(result.value().watches_all);
  EXPECT_TRUE(result.value().watches_only_own);
  EXPECT_EQ(result.value().bodies[0].max_speed_mps, 250);
  folder.write("scene.yaml", "bodies:\n  - {name: one, model: m, max_speed_mps: -1}\npairs: own\n");
  EXPECT_NE(read_scene(folder.file("scene.yaml")).status().message().find("max_speed_mps"),
            std::string::npos);
}

TEST(ReadScene, ATrajectoryIsNoFasterThanItsBodyMayBe) {
  Folder folder;
  folder.write("flight1.csv",
               "QW,QX,QY,QZ,T0,T1,T2\n1,0,0,0,0,0,0\n1,0,0,0,3,4,0\n1,0,0,0,9,12,0\n");
  const auto read = [&](const std::string& max_speed_mps) {
    folder.write("scene.yaml",
                 "bodies:\n  - {name: one, model: m, max_speed_mps: " + max_speed_mps +
                     "}\nmoves:\n  - {body: one, trajectory: flight1.csv}\n"
                     "pairs: own\nframe_rate_hz: 10\n");
    return read_scene(folder.file("scene.yaml")).status().message();
  };
  EXPECT_EQ(read("100"), "");
  EXPECT_NE(read("99").find("scene.yaml:4: trajectory of one: frame 1 goes at 100.000000 m/s, "
                            "faster than max_speed_mps, 99.000000"),
            std::string::npos)
      << read("99");
}

TEST(ReadScene, ReadsWhichLinksARobotHas) {
  Folder folder;
  folder.write("scene.yaml", changed("  - {body: one, trajectory: flight1.csv}\n",
                                     "  - {body: one, trajectory: flight1.csv}\n"
                                     "  - {body: two, trajectory: flight1.csv}\n"
                                     "robots:\n  - [two, one]\n"));
  const Result<Scene> scene = read_scene(folder.file("scene.yaml"));
  ASSERT_TRUE(scene.is_ok()) << scene.status().message();
  EXPECT_EQ(scene.value().robots, (std::vector<std::vector<std::size_t>>{{2, 1}}));
}

TEST(ReadScene, DerivesVelocitiesFromTheNextFrame) {
  Folder folder;
  // A quarter turn about z in 256 frames would be small; this one turns by 0.01 rad a frame.
  const double c = std::cos(0.01), s = std::sin(0.01);
  char line[256];
  std::snprintf(line, sizeof line, "%.17g,%.17g,0,%.17g,%.17g,0,0,0,1,8,4,0\n", c, -s, s, c);
  folder.write(
      "flight1.csv",
      std::string("R00,R01,R02,R10,R11,R12,R20,R21,R22,T0,T1,T2\n1,0,0,0,1,0,0,0,1,0,0,0\n") +
          line);
  folder.write("scene.yaml", kScene);
  const Result<Scene> scene = read_scene(folder.file("scene.yaml"));
  ASSERT_TRUE(scene.is_ok()) << scene.status().message();
  const auto& motions = scene.value().bodies[1].trajectory;
  ASSERT_EQ(motions.size(), 2U);
  for (const auto& motion : motions) {  // the last keeps the velocity of the one before
    EXPECT_NEAR(motion.linear_velocity_mps[0], 160, 1e-9);
    EXPECT_NEAR(motion.linear_velocity_mps[1], 80, 1e-9);
    EXPECT_NEAR(motion.angular_velocity_radps[2], 0.2, 1e-4);
    EXPECT_NEAR(motion.angular_velocity_radps[0], 0, 1e-9);
  }
}

// A quarter turn a frame, and half of one: by its sine the first would be a third too slow, and the
// second none.
TEST(ReadScene, FastTurnsAreAsFastAsTheyAre) {
  constexpr double kQuarterTurn = 1.5707963267948966;
  Folder folder;
  folder.write("flight1.csv",
               "R00,R01,R02,R10,R11,R12,R20,R21,R22,T0,T1,T2\n1,0,0,0,1,0,0,0,1,0,0,0\n"
               "0,-1,0,1,0,0,0,0,1,0,0,0\n0,1,0,-1,0,0,0,0,1,0,0,0\n");
  folder.write("scene.yaml", kScene);
  const Result<Scene> scene = read_scene(folder.file("scene.yaml"));
  ASSERT_TRUE(scene.is_ok()) << scene.status().message();
  const auto& motions = scene.value().bodies[1].trajectory;
  EXPECT_NEAR(motions[0].angular_velocity_radps[2], 20 * kQuarterTurn, 1e-9);
  EXPECT_NEAR(std::abs(motions[1].angular_velocity_radps[2]), 40 * kQuarterTurn, 1e-9);
}

struct Bad {
  std::string from, to;
  int line;
  std::string message;
};

TEST(ReadScene, RefusesWithFileAndLine) {
  const std::vector<Bad> bad = {
      // unknown keys
      {"lookahead_s: 0.3", "look_ahead: 0.3", 12,
       "unknown key look_ahead; the nearest is lookahead_s"},
      {"model: aircraft}\n  - {name: two", "mesh: aircraft}\n  - {name: two", 3,
       "unknown key mesh"},
      {"{body: one, traj", "{body: one, speed: 3, traj", 6, "unknown key speed"},
      {"{translation:", "{position:", 2, "unknown key position"},
      // what stands twice
      {"budget_ms: 5", "frame_rate_hz: 5", 11, "scene: frame_rate_hz stands twice"},
      {"{name: one, model", "{name: one, model: ball, model", 3, "body: model stands twice"},
      {"{name: two, model: aircraft}", "{name: one, model: aircraft}\n  - {name: two, model: ball}",
       4, "body one is declared twice"},
      {"flight1.csv}\n", "flight1.csv}\n  - {body: one, trajectory: flight1.csv}\n", 7,
       "moves: body one is moved twice"},
      {"{name: one, model", "{name: one, pose: {}, model", 6, "moves: body one has a fixed pose"},
      // what a session refuses
      {"{name: two, model: aircraft}", "{name: two, model: H\u00e4her}", 4, "model name"},
      {"model: aircraft}\n  - {name: two,",
       "model: aircraft, content: 8f1c42d0a97be35561d09f7c2e04ab83}\n  - {name: two, content: "
       "8f1c42d0a97be35561d09f7c2e04ab84,",
       4, "body two pins model aircraft to content"},
      {"[terrain, one]", "[one, one]", 8, "body one against itself"},
      {"budget_ms: 5", "robots:\n  - [one]", 12, "links of a robot: expected 2 to 256, found 1"},
      // wrong types
      {"lookahead_s: 0.3", "lookahead_s: soon", 12, "lookahead_s: expected a number"},
      {"lookahead_s: 0.3", "lookahead_s: [1, 2]", 12, "lookahead_s: expected a number"},
      {"lookahead_s: 0.3", "lookahead_s: .nan", 12, "lookahead_s: expected a number in"},
      {"lookahead_s: 0.3", "lookahead_s: -1", 12, "lookahead_s: expected a number in"},
      {"lookahead_s: 0.3", "sweep_s: 61", 12, "sweep_s: expected a number in"},
      {"frame_rate_hz: 20", "frame_rate_hz: 0", 10, "frame_rate_hz: expected a number in"},
      {"budget_ms: 5", "any: perhaps", 11, "any: expected true or false"},
      {"budget_ms: 5", "max_pairs: -1", 11,
       "max_pairs: expected a whole number in [0, 1000000000000000], found -1"},
      // cut off, they would mean something else: of 0.5 tests none is left, and 0 splits are no
      // limit
      {"budget_ms: 5", "max_pairs: 1.5", 11, "max_pairs: expected a whole number in"},
      {"budget_ms: 5", "max_tests: 0.5", 11, "max_tests: expected a whole number in"},
      {"budget_ms: 5", "max_sweep_tests: 1.5", 11, "max_sweep_tests: expected a whole number in"},
      {"budget_ms: 5", "max_depth_tests: 1e-3", 11, "max_depth_tests: expected a whole number in"},
      {"budget_ms: 5", "max_held_splits: 0.5", 11,
       "max_held_splits: expected a whole number in [0, 4000000000], found 0.5"},
      {"budget_ms: 5", "max_pairs: .nan", 11, "max_pairs: expected a whole number in"},
      {"budget_ms: 5", "max_tests: many", 11, "max_tests: expected a number"},
      {"budget_ms: 5", "contacts: perhaps", 11, "contacts: expected true or false"},
      {"budget_ms: 5", "clearance: some", 11,
       "clearance: expected none, bound or exact, found some"},
      {"budget_ms: 5", "budget_ms: .inf", 11, "budget_ms: expected a number in"},
      {"{name: one, model", "{name: one, solid: maybe, model", 3, "solid: expected true or false"},
      {"{name: one, model", "{name: one, content: 0x12, model", 3,
       "content: expected 32 hexadecimal digits, as nearmesh-model info prints them, found '0x12'"},
      {"{name: one, model", "{name: one, content: 00000000000000000000000000000000, model", 3,
       "content: expected 32"},
      {"{name: one, model", "{name: one, content: [1], model", 3, "content: expected hexadecimal"},
      {"[1, 2, 3]", "[1, 2, x]", 2, "translation: expected three numbers"},
      {"[1, 2, 3]", "[1, 2]", 2, "expected three numbers, found 2"},
      {"[1, 2, 3]", "7", 2, "translation: expected three numbers"},
      {"{translation: [1, 2, 3]}", "{rotation: [1, 2, 3]}", 2, "expected nine numbers, found 3"},
      {"[terrain, one]", "[terrain]", 8, "pairs: expected two names, found 1"},
      {"[terrain, one]", "[terrain, {a: b}]", 8, "pairs: expected a list of two names"},
      {"[terrain, one]", "[terrain, six]", 8,
       "pairs: no body named six among the bodies: terrain, one, two"},
      {"{name: one, model", "{name: [one], model", 3, "name: expected a name"},
      {"{name: one, model: aircraft}", "{name: one}", 3,
       "body: expected the key model, found none"},
      {"{name: one, model: aircraft}", "one", 3, "body: expected a map"},
      {"bodies:\n", "bodies: 3\nx:\n", 2, "unknown key x"},
      {"{body: one, trajectory: flight1.csv}", "{body: six, trajectory: flight1.csv}", 6,
       "no body named six"},
      {"{body: one, trajectory: flight1.csv}", "{trajectory: flight1.csv}", 6,
       "move: expected the key body, found none"},
      {"budget_ms: 5", "robots: one", 11, "robots: expected a list"},
      {"budget_ms: 5", "robots: [one, two]", 11, "robots: expected a list of links' names each"},
      {"budget_ms: 5", "robots: [[one, six]]", 11, "robots: no body named six"},
      {"budget_ms: 5", "robots: [[one, two]]", 11, "robots: link two is not moved here"},
      // poses
      {"[1, 2, 3]", "[1, .nan, 3]", 2, "terrain"},
      {"[1, 2, 3]", "[1, .inf, 3]", 2, "terrain"},
      {"[1, 2, 3]", "[1, 2e12, 3]", 2, "terrain"},
      {"{translation: [1, 2, 3]}", "{rotation: [2, 0, 0, 0, 1, 0, 0, 0, 1]}", 2, "terrain"},
      // files
      {"flight1.csv", "nowhere.csv", 6, "nowhere.csv"},
  };
  Folder folder;
  for (const Bad& b : bad) {
    folder.write("scene.yaml", changed(b.from, b.to));
    const Result<Scene> scene = read_scene(folder.file("scene.yaml"));
    if (scene.is_ok()) {
      ADD_FAILURE() << b.to << " was accepted";
      continue;
    }
    const std::string& message = scene.status().message();
    const std::string where = folder.file("scene.yaml") + ":" + std::to_string(b.line) + ": ";
    EXPECT_EQ(message.substr(0, where.size()), where) << b.to;
    EXPECT_NE(message.find(b.message), std::string::npos) << b.to << "\n  gave " << message;
  }
}

TEST(ReadScene, WhoOnlyLooksOnNeedsNeitherBodiesNorMoves) {
  Folder folder;
  folder.write("scene.yaml", "pairs: all\n");
  const Result<Scene> scene = read_scene(folder.file("scene.yaml"));
  ASSERT_TRUE(scene.is_ok()) << scene.status().message();
  EXPECT_TRUE(scene.value().watches_all);
  EXPECT_TRUE(scene.value().bodies.empty());
  EXPECT_EQ(scene.value().frames, Scene::kForEver);
  folder.write("scene.yaml", "pairs: all\nduration_s: 1.5\nframe_rate_hz: 10\n");
  EXPECT_EQ(read_scene(folder.file("scene.yaml")).value().frames, 15U);
}

TEST(ReadScene, RefusesASceneThatLacksSomething) {
  Folder folder;
  const std::string file = folder.file("scene.yaml");
  for (const auto& [text, expected] : std::vector<std::pair<std::string, std::string>>{
           {"pairs: []\n", "bodies: expected a list"},
           {"bodies: []\n", "pairs: expected a list, all, or own"},
           {"bodies: []\npairs: some\n", "pairs: expected a list, all, or own"},
           {"bodies: 3\npairs: all\n", "bodies: expected a list"},
           {"pairs: all\nduration_s: -1\n", "duration_s: expected a number"},
           {"- a\n- b\n", "scene: expected a map"},
           {"", "scene: expected a map"},
           {"bodies: [\n", file + ":"},
           {"? [a, b]\n: 3\n", file + ":"}}) {
    folder.write("scene.yaml", text);
    const Result<Scene> scene = read_scene(file);
    if (scene.is_ok()) {
      ADD_FAILURE() << text << " was accepted";
      continue;
    }
    EXPECT_NE(scene.status().message().find(expected), std::string::npos)
        << scene.status().message();
    EXPECT_EQ(scene.status().message().find(file + ":"), 0U) << scene.status().message();
  }
}

TEST(ReadScene, RefusesAMissingFile) {
  const Result<Scene> scene = read_scene("/nowhere/scene.yaml");
  ASSERT_FALSE(scene.is_ok());
  EXPECT_EQ(scene.status().code(), StatusCode::kIo);
  EXPECT_EQ(scene.status().message(), "/nowhere/scene.yaml: cannot open");
}

TEST(ReadScene, NamesTheRowOfABadTrajectory) {
  const std::string head =
      "R00,R01,R02,R10,R11,R12,R20,R21,R22,T0,T1,T2\n1,0,0,0,1,0,0,0,1,0,0,0\n";
  Folder folder;
  folder.write("scene.yaml", kScene);
  for (const auto& [rows, expected] : std::vector<std::pair<std::string, std::string>>{
           {"1,0,0,0,1,0,0,0,1,nan,0,0\n", "flight1.csv"},
           {"1,0,0,0,1,0,0,0,1,0,0\n", "flight1.csv"},
           {"1,0,0,0,1,0,0,0,1,0,0,x\n", "flight1.csv"},
           {"3,0,0,0,1,0,0,0,1,0,0,0\n", "flight1.csv:3: pose of one"}}) {
    folder.write("flight1.csv", head + rows);
    const Result<Scene> scene = read_scene(folder.file("scene.yaml"));
    if (scene.is_ok()) {
      ADD_FAILURE() << rows << " was accepted";
      continue;
    }
    EXPECT_NE(scene.status().message().find(expected), std::string::npos)
        << scene.status().message();
  }
  folder.write("flight1.csv", "R00,R01,R02,R10,R11,R12,R20,R21,R22,T0,T1,T2\n");
  EXPECT_FALSE(read_scene(folder.file("scene.yaml")).is_ok());
  folder.write("flight1.csv", "R00,R01\n1,0\n");
  EXPECT_FALSE(read_scene(folder.file("scene.yaml")).is_ok());
}

TEST(Scene, RotationsMayBeQuaternions) {
  const Folder folder;
  folder.write("flight1.csv",
               "QW,QX,QY,QZ,T0,T1,T2\n"
               "1,0,0,0,0,0,100\n"
               "0.70710678,0,0,0.70710678,8,0,100\n"
               "0,0,0,1,20,0,100\n");
  folder.write("scene.yaml", changed("{translation: [1, 2, 3]}",
                                     "{quaternion: [0, 1, 0, 0], translation: [1, 2, 3]}"));
  const auto scene = read_scene(folder.file("scene.yaml"));
  ASSERT_TRUE(scene.is_ok()) << scene.status().message();
  const std::array<double, 9> half_turn{1, 0, 0, 0, -1, 0, 0, 0, -1};
  EXPECT_EQ(scene.value().bodies[0].fixed_pose->rotation, half_turn);
  const auto& flown = scene.value().bodies[1].trajectory;
  ASSERT_EQ(flown.size(), 3U);
  EXPECT_NEAR(flown[1].pose.rotation[3], 1, 1e-12);  // x is where y was
  EXPECT_NEAR(flown[1].pose.rotation[0], 0, 1e-7);
  EXPECT_TRUE(check_pose(flown[1].pose, "it").is_ok());
}

TEST(Scene, RefusesQuaternionsThatAreNone) {
  for (const char* pose : {"quaternion: [0, 0, 0, 0]", "quaternion: [1, 0, 0]",
                           "quaternion: [2, 0, 0, 0]", "quaternion: [.nan, 0, 0, 0]",
                           "quaternion: [1, 0, 0, 0], rotation: [1, 0, 0, 0, 1, 0, 0, 0, 1]"}) {
    const Folder folder;
    folder.write("scene.yaml", changed("{translation: [1, 2, 3]}", "{" + std::string(pose) + "}"));
    const auto scene = read_scene(folder.file("scene.yaml"));
    ASSERT_FALSE(scene.is_ok()) << pose;
    EXPECT_NE(scene.status().message().find("quaternion"), std::string::npos)
        << scene.status().message();
  }
  const Folder folder;
  folder.write("flight1.csv", "QW,QX,QY,QZ,T0,T1,T2\n1,0,0,0,0,0,1\n1,1,0,0,0,0,1\n");
  folder.write("scene.yaml", kScene);
  const auto scene = read_scene(folder.file("scene.yaml"));
  ASSERT_FALSE(scene.is_ok());
  EXPECT_NE(scene.status().message().find("flight1.csv:3"), std::string::npos)
      << scene.status().message();
}

}  // namespace
}  // namespace nearmesh
