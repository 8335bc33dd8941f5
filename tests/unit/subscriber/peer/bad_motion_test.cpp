// SPDX-License-Identifier: Apache-2.0
// Bad numbers at the doors of a session: the host's call, a sample of another peer. Each is refused
// with the body named, and nobody else's answer changes by a bit.
#include "bad_motions.hpp"
#include "nearmesh/idl/messages/messages.hpp"
#include "world.hpp"

namespace nearmesh {
namespace {

using subscriber::PairAnswer;
using subscriber::Session;
using test::bad_motions;
using test::BadMotion;
using test::expect_names;
using test::FrameReport;
using test::kDenormal;
using test::kGround;
using test::kInfinity;
using test::kNan;
using test::kOne;
using test::kTwo;
using test::World;

/// Nothing is lost here, so nothing need be asked for twice, and no clock decides what a peer
/// holds.
const subscriber::SessionOptions kOptions{.request_timeout_s = 60};

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
    std::vector<Session::OwnMotion> motions{{kOne, flight_.one[frame]}};
    if (moves_two) motions.push_back({kTwo, flight_.two[frame]});
    std::array<FrameReport, 2> reports;
    for (std::size_t i = 0; i < 2; ++i) {
      EXPECT_TRUE(sides_[i].world.fly_frame(*sides_[i].session, frame, motions));
      reports[i] = sides_[i].world.round(*sides_[i].session, frame);
    }
    ASSERT_EQ(reports[0].answers.size(), reports[1].answers.size());
    for (std::size_t i = 0; i < reports[0].answers.size(); ++i) {
      const PairAnswer &a = reports[0].answers[i], &b = reports[1].answers[i];
      EXPECT_EQ(a.reason, "");
      EXPECT_EQ(digest(a.answer), digest(b.answer)) << "pair " << i;
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
    const auto refused =
        sides_[0].session->update(frame, 0.05, {{kOne, flight_.one[frame]}, {kTwo, bad.motion}}, 1);
    ASSERT_FALSE(refused.is_ok()) << bad.name;
    EXPECT_EQ(refused.status().code(), StatusCode::kInvalidArgument);
    expect_names(refused.status().message(), " of two", bad.name);
  }
  fly(frame, true);
  for (const double time_s : {kNan, kInfinity, -kInfinity}) {
    const auto refused = sides_[0].session->update(2, time_s, {{kOne, flight_.one[2]}}, 1);
    ASSERT_FALSE(refused.is_ok());
    expect_names(refused.status().message(), "time_s of frame 2", "time");
  }
  for (const BadMotion& bad : bad_motions({})) {  // scenery has no velocity
    if (!check_pose(bad.motion.pose, "x").is_ok())
      expect_names(sides_[0].session->place_body(kGround, bad.motion.pose).message(),
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
    // A channel hands over nothing that check() refuses (idl/dds/codec.hpp).
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
  // A translation of 5e-324 m is less than any cell: the posed integers, hence all answers, are
  // those of zero.
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
    EXPECT_TRUE(side.world.fly_frame(*side.session, 1, {{kOne, i == 0 ? still : rest}}));
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

}  // namespace
}  // namespace nearmesh
