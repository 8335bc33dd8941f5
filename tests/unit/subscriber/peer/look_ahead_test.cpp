// SPDX-License-Identifier: Apache-2.0
// How often a session looks ahead, which costs more than most answers.
#include "world.hpp"

namespace nearmesh {
namespace {

using test::FrameReport;
using test::kOne;
using test::kTwo;
using test::Vector3;
using test::World;

constexpr double kFrame_s = 0.001;
constexpr int kFrames = 60;  // less than an eighth of the look-ahead: one look is due for each pair

/// Updates until nothing has been asked for in a second.
double settle(World& world, subscriber::Session& session, const Motion& one, const Motion& two) {
  double time_s = 0, asked_s = 0;
  std::uint64_t requests = 0;
  for (std::uint64_t frame = 0; time_s < asked_s + 1; ++frame) {
    world.bus.tick();
    static_cast<void>(world.service().step(time_s));
    EXPECT_TRUE(session.update(frame, time_s, {{kOne, one}, {kTwo, two}}, 1).is_ok());
    time_s += 0.05;
    if (std::exchange(requests, session.stats().requests) != session.stats().requests)
      asked_s = time_s;
    if (time_s > 1000) {
      ADD_FAILURE() << "it never ends";
      break;
    }
  }
  return time_s;
}

TEST(LookAhead, IsNotRepeatedInEachFrameWhereNothingIsLacking) {
  World world;
  world.bus.most_splits = kMaxRequestSplits;
  world.start_publisher();
  const BakedModel& ground = test::terrain().model;
  Random random(5);
  for (int scene = 0; scene < 12; ++scene) {
    SCOPED_TRACE(scene);
    // Both low above the ground and near each other, slow, turning.
    Motion one, two;
    Vector3 at =
        test::position_m(ground.header, ground.store, {random.below(ground.header.vertex_count)});
    at[2] += random.between(5, 40);
    one.pose.translation_m = two.pose.translation_m = at;
    two.pose.translation_m[0] += random.between(20, 60);
    one.linear_velocity_mps = {random.between(-1, 1), random.between(-1, 1), 0};
    two.angular_velocity_radps = {0, 0, random.between(-0.1, 0.1)};
    const auto session = world.make_peer({.lookahead_s = 0.5});
    const double settled_s = settle(world, *session, one, two);

    const subscriber::SessionStats before = session->stats();
    for (int frame = 1; frame <= kFrames; ++frame) {
      const double time_s = settled_s + 0.1 + frame * kFrame_s;
      const auto report = session->update(static_cast<std::uint64_t>(100000 + frame), time_s,
                                          {{kOne, one}, {kTwo, two}}, 1);
      ASSERT_TRUE(report.is_ok());
      ASSERT_TRUE(report.value().all_certified());
    }
    const subscriber::SessionStats after = session->stats();
    EXPECT_EQ(after.requests, before.requests);
    const std::uint64_t looks = after.looks_ahead - before.looks_ahead;
    EXPECT_GT(looks, 0U);
    EXPECT_LE(looks, 3U) << "one for each pair";
  }
}

/// In how many frames of some flights, one update each, all was certified. No publisher serves both
/// models of the pairs with the ground.
std::size_t certified_by_region(double lookahead_s) {
  std::size_t certified = 0;
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    World world;
    world.bus.most_splits = kMaxRequestSplits;
    world.start_publisher_of("terrain", test::terrain(), 0xa1);
    world.start_publisher_of("aircraft", test::aircraft(), 0xa2);
    const auto session = world.make_peer({.lookahead_s = lookahead_s});
    const test::Flight flight = test::make_flight(seed);
    certified += world.fly(*session, flight, 0, flight.frames(), 1);
  }
  return certified;
}

TEST(LookAhead, WhatIsAskedForByRegionIsHereBeforeItIsNeeded) {
  const std::size_t ahead = certified_by_region(0.5), without = certified_by_region(0);
  EXPECT_GT(ahead, without + 20) << "of 200 frames";
}

}  // namespace
}  // namespace nearmesh
