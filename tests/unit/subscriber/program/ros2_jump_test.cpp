// SPDX-License-Identifier: Apache-2.0
// Localisation jumps, and simulators are reset: a flight tells of it and goes on.
#include <gtest/gtest.h>

#include "nearmesh/subscriber/peer/local_channel.hpp"
#include "subscriber/program/ros2_flight.hpp"

namespace nearmesh::subscriber::program {
namespace {

TEST(Ros2Jump, ABodyThatJumpsOutOfItsPromisesIsToldOfOnceAndTheFlightGoesOn) {
  Session session(std::make_unique<LocalChannel>());
  const BodyId drone =
      session.add_body({.name = "drone", .model = "m", .own = true, .max_speed_mps = 10}).value();
  Ros2Jumps jumps;
  std::vector<std::string> lines;
  double time_s = 0;
  const auto update = [&](double x_m) {
    Motion motion;
    motion.pose.translation_m[0] = x_m;
    std::vector<Session::OwnMotion> motions{{drone, motion}};
    jumps.take_out(session, time_s, motions, lines);
    const auto report = session.update(0, time_s, motions, 1);
    EXPECT_TRUE(report.is_ok()) << report.status().message();
    time_s += 0.5;
    return session.motion_of(drone).has_value();
  };
  EXPECT_TRUE(update(0));
  EXPECT_TRUE(update(1));
  EXPECT_TRUE(lines.empty());
  EXPECT_FALSE(update(1000));
  EXPECT_FALSE(update(1000));
  ASSERT_EQ(lines.size(), 1U);
  EXPECT_NE(lines[0].find("ros2: body drone is "), std::string::npos) << lines[0];
  EXPECT_NE(lines[0].find("max_speed_mps, 10"), std::string::npos) << lines[0];
  EXPECT_TRUE(update(2)) << "it is back";
  EXPECT_FALSE(update(1000));
  EXPECT_EQ(lines.size(), 2U);
  int frames = 0;
  while (!update(1000) && frames < 100) ++frames;
  EXPECT_LE(frames, 17) << "8 s";
  EXPECT_EQ(lines.size(), 2U);
}

}  // namespace
}  // namespace nearmesh::subscriber::program
