// SPDX-License-Identifier: Apache-2.0
// A session with solid bodies: what is under ground is contained, on any network, and for little
// detail.
#include "solids.hpp"
#include "world.hpp"

namespace nearmesh {
namespace {

using namespace test;

const ServedModel& closed_terrain() {
  static const ServedModel served(bake_mesh(make_closed_terrain(40, 7, -3000), 16));
  return served;
}
/// A ball of one kilometre.
const ServedModel& ball() {
  static const ServedModel served([] {
    IndexedMesh mesh;
    append(mesh, generate_sphere(96, 0), {}, 1000);
    return bake_mesh(mesh, 16);
  }());
  return served;
}
const ServedModel& dust() {
  static const ServedModel served([] {
    IndexedMesh mesh;
    for (std::uint32_t i = 0; i <= kMaxComponentSeeds; ++i)
      append(mesh, make_cube(1, 1), {200.0 * (i % 16), 200.0 * (i / 16), 0});
    return bake_mesh(mesh, 16);
  }());
  return served;
}

/// A peer that moves one aircraft against one ground, either of which may be solid.
std::unique_ptr<Session> make_peer(World& world, bool solid_ground, bool solid_aircraft = false,
                                   SessionOptions options = quick_options()) {
  auto session = std::make_unique<Session>(world.bus.make_peer(kPeer), options);
  EXPECT_EQ(
      session->add_body({.name = "ground", .model = "terrain", .solid = solid_ground}).value(),
      kGround);
  EXPECT_TRUE(session->place_body(kGround, {}).is_ok());
  EXPECT_EQ(
      session->add_body({.name = "one", .model = "aircraft", .own = true, .solid = solid_aircraft})
          .value(),
      kOne);
  EXPECT_TRUE(session->watch(kGround, kOne).is_ok());
  return session;
}

std::vector<Session::OwnMotion> aircraft_at(double x, double y, double z, double speed_mps = 0) {
  Motion motion;
  motion.pose.translation_m = {x, y, z};
  motion.linear_velocity_mps = {0, 0, speed_mps};
  return {{kOne, motion}};
}

TEST(SolidSession, DiveThroughTheGroundAndTheFloorOnABadNetwork) {
  for (const std::uint64_t seed : {1U, 2U}) {
    World world(seed);
    world.judge.ground = &closed_terrain();
    world.judge.solid_ground = true;
    world.bus.on_batches = {.lose = 0.1, .repeat = 0.1, .max_delay = 3};
    world.bus.on_subscriptions = {.lose = 0.1};
    world.start_publisher(kPublisher, closed_terrain());
    const auto session = make_peer(world, true);
    for (int frame = 0; frame < 50; ++frame)
      ASSERT_TRUE(world.fly_frame(*session, static_cast<std::uint64_t>(frame),
                                  aircraft_at(100 + frame, 60, 1500 - 100 * frame, -2000)))
          << frame;
    EXPECT_GT(world.judge.free, 5U);
    EXPECT_GT(world.judge.contained, 10U);
  }
}

TEST(SolidSession, WithoutTheFlagTheAircraftUnderGroundIsFree) {
  World world;
  world.judge.ground = &closed_terrain();
  world.start_publisher(kPublisher, closed_terrain());
  const auto session = make_peer(world, false);
  ASSERT_TRUE(world.fly_frame(*session, 0, aircraft_at(100, 60, -2500)));
  EXPECT_GT(world.judge.free, 0U);
  EXPECT_EQ(world.judge.contained, 0U);
}

TEST(SolidSession, FarInsideOneRequestAlongTheRayIsEnough) {
  World world;
  world.judge.ground = &ball();
  world.judge.solid_ground = true;
  world.start_publisher(kPublisher, ball());
  SessionOptions options = quick_options();
  options.lookahead_s = 0;
  options.request_timeout_s = 5;
  const auto session = make_peer(world, true, false, options);
  std::uint32_t contained = 0;
  world.on_report = [&](const FrameReport& report) {
    if (report.answers[0].answer.status != AnswerStatus::kContained) return;
    ++contained;
    EXPECT_GT(report.answers[0].answer.clearance_m, 0);
    EXPECT_TRUE(std::isinf(report.answers[0].safe_horizon_s));
  };
  ASSERT_TRUE(world.fly_frame(*session, 0, aircraft_at(90, 60, 30)));
  EXPECT_EQ(contained, 1U);
  EXPECT_LE(session->stats().requests, 6U);
  EXPECT_LT(session->stats().held_splits, 400U)
      << "of " << ball().model.header.split_count() + aircraft().model.header.split_count();
}

TEST(SolidSession, AnOpenModelIsNeverCertifiedAndNamed) {
  World world;
  world.start_publisher();
  const auto session = make_peer(world, true);
  EXPECT_FALSE(world.fly_frame(*session, 0, aircraft_at(100, 60, 3000), 30));
  EXPECT_EQ(world.judge.certified(), 0U);
  const FrameReport report = world.round(*session);
  EXPECT_NE(report.answers[0].reason.find("ground cannot be solid"), std::string::npos)
      << report.answers[0].reason;
  EXPECT_NE(report.answers[0].reason.find("160 boundary edges"), std::string::npos);
  EXPECT_TRUE(std::isinf(report.answers[0].answer.uncertainty_m));
  EXPECT_EQ(session->stats().requests, 0U);
}

TEST(SolidSession, AModelOfTooManyPartsNearASolidIsNamed) {
  World world;
  world.judge.ground = &dust();
  world.start_publisher(kPublisher, dust());
  const auto session = make_peer(world, true, true);
  EXPECT_FALSE(world.fly_frame(*session, 0, aircraft_at(100, 100, 0), 30));
  EXPECT_EQ(world.judge.certified(), 0U);
  const FrameReport near = world.round(*session);
  EXPECT_NE(near.answers[0].reason.find("body ground has more than 256 parts"), std::string::npos)
      << near.answers[0].reason;
  EXPECT_TRUE(world.fly_frame(*session, 1, aircraft_at(100, 100, 900), 30));
  EXPECT_GT(world.judge.free, 0U);
}

}  // namespace
}  // namespace nearmesh
