// SPDX-License-Identifier: Apache-2.0
// Bad numbers in files: a trajectory, a scene. Each is refused with file, line and body named.
#include <cmath>
#include <filesystem>
#include <fstream>

#include "bad_motions.hpp"
#include "subscriber/program/scene.hpp"
#include "tests/support/folder.hpp"
#include "tests/unit/subscriber/peer/judge.hpp"

namespace nearmesh {
namespace {

using test::bad_motions;
using test::BadMotion;
using test::expect_names;

class BadNumbersInFiles : public ::testing::Test {
 protected:
  static std::string row(const Motion& motion) {
    std::string text;
    char cell[40];
    for (const double x : motion.pose.rotation)
      text.append(cell, static_cast<std::size_t>(std::snprintf(cell, sizeof cell, "%.17g,", x)));
    for (const double x : motion.pose.translation_m)
      text.append(cell, static_cast<std::size_t>(std::snprintf(cell, sizeof cell, "%.17g,", x)));
    text.back() = '\n';
    return text;
  }
  Result<subscriber::program::Scene> read(const std::string& rows, const std::string& pose = "{}") {
    std::ofstream(folder_ / "flight.csv") << "R00,R01,R02,R10,R11,R12,R20,R21,R22,T0,T1,T2\n"
                                          << rows;
    std::ofstream(folder_ / "scene.yaml")
        << "bodies:\n  - {name: ground, model: terrain, pose: " << pose
        << "}\n  - {name: one, model: aircraft}\nmoves:\n  - {body: one, trajectory: flight.csv}\n"
           "pairs:\n  - [ground, one]\n";
    return subscriber::program::read_scene((folder_ / "scene.yaml").string());
  }
  const test::Folder scratch_;
  const std::filesystem::path folder_ = scratch_.path();
};

TEST_F(BadNumbersInFiles, OfATrajectoryAreRefusedWithFileAndLine) {
  const test::Flight flight = test::make_flight(3, 1);
  const std::string good = row(flight.one[0]);
  ASSERT_TRUE(read(good + good).is_ok());
  for (const BadMotion& bad : bad_motions(flight.one[1])) {
    if (check_pose(bad.motion.pose, "x").is_ok()) continue;  // a file has no velocities
    const auto scene = read(good + row(bad.motion) + good);
    ASSERT_FALSE(scene.is_ok()) << bad.name;
    expect_names(scene.status().message(), "flight.csv:3: pose of one: ", bad.name);
  }
}

TEST_F(BadNumbersInFiles, OfATrajectoryThatJumpsFasterThanAnyPeerWouldTakeAreRefused) {
  Motion here, there;
  here.pose.translation_m = {-5e8, 0, 0};
  there.pose.translation_m = {5e8, 0, 0};
  const auto scene = read(row(here) + row(here) + row(there));
  ASSERT_FALSE(scene.is_ok());
  expect_names(scene.status().message(), "flight.csv:3: motion of one: linear_velocity_mps[0]", "");
}

TEST_F(BadNumbersInFiles, OfADenormalAreTakenOrRefusedAsTextThatIsNoNumber) {
  const std::string text = "1,0,0,0,1,0,0,0,1,";
  EXPECT_TRUE(read(text + "4.9406564584124654e-324,-0.0,0\n").is_ok());
  for (const char* tiny : {"1e-400", "1e400"}) {  // no double holds them
    const auto scene = read(text + tiny + ",0,0\n");
    ASSERT_FALSE(scene.is_ok());
    expect_names(scene.status().message(), "flight.csv:2: column T0: expected a number", tiny);
  }
}

TEST_F(BadNumbersInFiles, OfASceneAreRefusedWithFileAndLine) {
  const test::Flight flight = test::make_flight(3, 1);
  for (const BadMotion& bad : bad_motions(flight.one[1])) {
    if (check_pose(bad.motion.pose, "x").is_ok()) continue;
    const auto list = [](const auto& numbers) {
      std::string text = "[";
      char cell[40];
      for (const double x : numbers) {
        if (std::isnan(x))
          text += ".nan, ";
        else if (std::isinf(x))
          text += x > 0 ? ".inf, " : "-.inf, ";
        else
          text.append(cell,
                      static_cast<std::size_t>(std::snprintf(cell, sizeof cell, "%.17g, ", x)));
      }
      return text + "]";
    };
    const auto scene =
        read(row(flight.one[0]), "{rotation: " + list(bad.motion.pose.rotation) +
                                     ", translation: " + list(bad.motion.pose.translation_m) + "}");
    ASSERT_FALSE(scene.is_ok()) << bad.name;
    expect_names(scene.status().message(), "scene.yaml:2: ", bad.name);
    expect_names(scene.status().message(), "ground", bad.name);
  }
}

}  // namespace
}  // namespace nearmesh
