// SPDX-License-Identifier: Apache-2.0
// Bad numbers at every door: the host's call, a sample of another peer, a trajectory, a scene. Each is refused with the
// body (or file and line) named, and nobody else's answer changes by a bit.
#include <filesystem>
#include <fstream>
#include <limits>

#include "nearmesh/idl/messages/messages.hpp"
#include "subscriber/program/scene.hpp"
#include "world.hpp"

namespace nearmesh {
namespace {

using subscriber::PairAnswer;
using subscriber::Session;
using test::FrameReport;
using test::World;

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kDenormal = std::numeric_limits<double>::denorm_min();

struct BadMotion {
  std::string name;
  Motion motion;
};

/// `good` with every field spoilt in every way.
std::vector<BadMotion> bad_motions(const Motion& good) {
  std::vector<BadMotion> bad;
  const auto add = [&](const std::string& name, const auto& spoil) {
    bad.push_back({name, good});
    spoil(bad.back().motion);
  };
  for (const double x : {kNan, kInfinity, -kInfinity, 1e308, -1e308}) {
    const std::string to = " = " + std::to_string(x);
    for (std::size_t i = 0; i < 9; ++i)
      add("rotation" + std::to_string(i) + to, [&](Motion& m) { m.pose.rotation[i] = x; });
    for (std::size_t i = 0; i < 3; ++i) {
      const std::string at = std::to_string(i) + to;
      add("translation" + at, [&](Motion& m) { m.pose.translation_m[i] = x; });
      add("linear velocity" + at, [&](Motion& m) { m.linear_velocity_mps[i] = x; });
      add("angular velocity" + at, [&](Motion& m) { m.angular_velocity_radps[i] = x; });
    }
  }
  for (std::size_t i = 0; i < 9; ++i)  // a rotation has no row or column of almost zeros
    add("denormal row " + std::to_string(i / 3), [&](Motion& m) {
      for (std::size_t k = 0; k < 3; ++k) m.pose.rotation[i / 3 * 3 + k] = kDenormal;
    });
  add("reflection", [](Motion& m) {
    for (std::size_t i = 0; i < 3; ++i) m.pose.rotation[i] = -m.pose.rotation[i];
  });
  add("skewed", [](Motion& m) {
    for (std::size_t i = 0; i < 3; ++i) m.pose.rotation[i] += 1e-3 * m.pose.rotation[3 + i];
  });
  for (const double scale : {1.001, 0.999, 1e-200, 1e200})
    add("scaled by " + std::to_string(scale), [&](Motion& m) {
      for (double& x : m.pose.rotation) x *= scale;
    });
  add("all zero", [](Motion& m) { m.pose.rotation = {}; });
  add("far away", [](Motion& m) { m.pose.translation_m = {7e8, 7e8, 7e8}; });
  return bad;
}

void expect_names(const std::string& message, const std::string& what, const std::string& name) {
  EXPECT_NE(message.find(what), std::string::npos) << name << " gave: " << message;
}

/// Nothing is lost here, so nothing need be asked for twice, and no clock decides what a peer holds.
constexpr subscriber::SessionOptions kOptions{.request_timeout_s = 60};

/// Two worlds alike; bad numbers reach only one of them.
class BadNumbers : public ::testing::Test {
 protected:
  struct Side {
    World world;
    std::unique_ptr<Session> session;
  };
  void start(bool moves_two) {
    for (Side& side : sides_) {
      side.world.start_publisher();
      side.session = side.world.make_peer(kOptions, test::kPeer, true, moves_two);
    }
  }
  /// One frame on both sides; then all answers must be the same.
  void fly(std::uint64_t frame, bool moves_two) {
    std::vector<Session::OwnMotion> motions{{"one", flight_.one[frame]}};
    if (moves_two) motions.push_back({"two", flight_.two[frame]});
    std::array<FrameReport, 2> reports;
    for (std::size_t i = 0; i < 2; ++i) {
      EXPECT_TRUE(sides_[i].world.fly_frame(*sides_[i].session, frame, motions));
      reports[i] = sides_[i].world.round(*sides_[i].session, frame);
    }
    ASSERT_EQ(reports[0].answers.size(), reports[1].answers.size());
    for (std::size_t i = 0; i < reports[0].answers.size(); ++i) {
      const PairAnswer &a = reports[0].answers[i], &b = reports[1].answers[i];
      EXPECT_EQ(a.reason, "");
      EXPECT_EQ(digest(a.answer), digest(b.answer)) << a.body_a << " and " << a.body_b;
      EXPECT_EQ(a.pose_a.translation_m, b.pose_a.translation_m);
      EXPECT_EQ(a.pose_b.translation_m, b.pose_b.translation_m);
    }
  }

  test::Flight flight_ = test::make_flight(3, 1);
  std::array<Side, 2> sides_;
};

TEST_F(BadNumbers, InTheHostsCallAreRefusedAndChangeNoAnswer) {
  start(true);
  fly(0, true);
  std::uint64_t frame = 1;
  for (const BadMotion& bad : bad_motions(flight_.two[frame])) {
    const auto refused = sides_[0].session->update(
        frame, 0.05, {{"one", flight_.one[frame]}, {"two", bad.motion}}, 1);
    ASSERT_FALSE(refused.is_ok()) << bad.name;
    EXPECT_EQ(refused.status().code(), StatusCode::kInvalidArgument);
    expect_names(refused.status().message(), " of two", bad.name);
  }
  fly(frame, true);
  for (const double time_s : {kNan, kInfinity, -kInfinity}) {
    const auto refused = sides_[0].session->update(2, time_s, {{"one", flight_.one[2]}}, 1);
    ASSERT_FALSE(refused.is_ok());
    expect_names(refused.status().message(), "time_s of frame 2", "time");
  }
  for (const BadMotion& bad : bad_motions({})) {  // scenery has no velocity
    if (!check_pose(bad.motion.pose, "x").is_ok())
      expect_names(sides_[0].session->place_body("ground", bad.motion.pose).message(),
                   "pose of ground", bad.name);
  }
  fly(2, true);
}

TEST_F(BadNumbers, OnTheWireAreRefusedAndChangeNoAnswer) {
  start(false);
  wire::BodyPose message;
  message.peer = test::kPeer + 1;
  message.body = "two";
  const auto send = [&](const Motion& motion) {
    message.pose = motion.pose;
    message.linear_velocity_mps = motion.linear_velocity_mps;
    message.angular_velocity_radps = motion.angular_velocity_radps;
    const Status status = wire::check(message);
    if (status.is_ok())
      for (Side& side : sides_) side.world.bus.inject(message);
    return status;
  };
  ASSERT_TRUE(send(flight_.two[0]).is_ok());
  fly(0, false);
  for (const BadMotion& bad : bad_motions(flight_.two[1])) {
    // A channel hands over nothing that check() refuses (wire/codec.hpp).
    const Status status = send(bad.motion);
    ASSERT_FALSE(status.is_ok()) << bad.name;
    expect_names(status.message(), " of two", bad.name);
  }
  message.time_s = kNan;
  expect_names(send(flight_.two[1]).message(), "pose of two: time_s", "time");
  message.time_s = 0;
  fly(1, false);
  ASSERT_TRUE(send(flight_.two[2]).is_ok());
  fly(2, false);
}

TEST_F(BadNumbers, DenormalsAreSmallNumbers) {
  start(true);
  fly(0, true);
  // A translation of 5e-324 m is less than any cell: the posed integers, hence all answers, are those of zero.
  Motion rest{.pose = flight_.one[1].pose}, still = rest;
  rest.pose.translation_m = {0, 0, 100};
  still.pose.translation_m = {kDenormal, -kDenormal, 100};
  still.linear_velocity_mps = {kDenormal, 0, 0};
  for (std::size_t i = 0; i < 3; ++i) {
    if (rest.pose.rotation[i] != 0) continue;
    still.pose.rotation[i] = kDenormal;
  }
  std::array<FrameReport, 2> reports;
  for (std::size_t i = 0; i < 2; ++i) {
    Side& side = sides_[i];
    EXPECT_TRUE(side.world.fly_frame(*side.session, 1, {{"one", i == 0 ? still : rest}}));
    reports[i] = side.world.round(*side.session, 1);
  }
  for (std::size_t i = 0; i < 3; ++i)
    EXPECT_EQ(digest(reports[0].answers[i].answer), digest(reports[1].answers[i].answer));
  Pose identity, almost;
  almost.rotation[1] = kDenormal;
  almost.rotation[3] = -kDenormal;
  almost.translation_m = {kDenormal, -kDenormal, 0};
  const Grid grid = test::aircraft().model.header.grid;
  const auto x = pose_pair(grid, identity, "x", grid, almost, "y");
  ASSERT_TRUE(x.is_ok()) << x.status().message();
  EXPECT_EQ(x.value().a.translation, x.value().b.translation);
  EXPECT_EQ(x.value().a.rotation, x.value().b.rotation);
}

// ---- files --------------------------------------------------------------------------------------

class BadNumbersInFiles : public ::testing::Test {
 protected:
  void SetUp() override {
    std::string name = ::testing::TempDir() + "nearmesh_bad_XXXXXX";
    ASSERT_NE(::mkdtemp(name.data()), nullptr);
    folder_ = name;
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }
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
  Result<subscriber::Scene> read(const std::string& rows, const std::string& pose = "{}") {
    std::ofstream(folder_ / "flight.csv") << "R00,R01,R02,R10,R11,R12,R20,R21,R22,T0,T1,T2\n"
                                          << rows;
    std::ofstream(folder_ / "scene.yaml")
        << "bodies:\n  - {name: ground, model: terrain, pose: " << pose
        << "}\n  - {name: one, model: aircraft}\nmoves:\n  - {body: one, trajectory: flight.csv}\n"
           "pairs:\n  - [ground, one]\n";
    return subscriber::read_scene((folder_ / "scene.yaml").string());
  }
  std::filesystem::path folder_;
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
