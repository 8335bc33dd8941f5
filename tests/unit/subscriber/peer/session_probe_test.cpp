// SPDX-License-Identifier: Apache-2.0
// Probes of a session's bodies: uncertain, asked for, then as of the full mesh. And what else a
// host hands in: poses that it heard, rotations of floats.

#include <limits>

#include "local_host.hpp"

namespace nearmesh::test {
namespace {

using subscriber::ProbeReport;

std::vector<RayProbe> heights_above(const BakedModel& ground, std::size_t count) {
  Random random(3);
  std::vector<RayProbe> rays(count);
  for (RayProbe& ray : rays) {
    ray.origin_m =
        position_m(ground.header, ground.store, {random.below(ground.header.vertex_count)});
    for (std::size_t k = 0; k < 2; ++k) ray.origin_m[k] += random.between(-1, 1);
    ray.origin_m[2] += 500;
  }
  return rays;
}

/// As of the full mesh.
void expect_true(const BakedModel& model, const Pose& pose, const std::vector<RayProbe>& rays,
                 const std::vector<RayAnswer>& answers) {
  const TriangleTree full = *build_full_tree(model.header, model.store);
  std::vector<RayAnswer> truth(rays.size());
  ASSERT_TRUE(probe(full.view(), pose, rays, truth).is_ok());
  for (std::size_t i = 0; i < rays.size(); ++i) {
    EXPECT_EQ(answers[i].status, truth[i].status);
    EXPECT_EQ(answers[i].face, truth[i].face);
    EXPECT_EQ(answers[i].at_most_m, truth[i].at_most_m);
    EXPECT_EQ(answers[i].at_least_m, truth[i].at_least_m);
  }
}

ProbeReport probe_ground(LocalHost& host, const std::vector<RayProbe>& rays,
                         std::vector<RayAnswer>& answers) {
  const auto report = host.session->probe(kGround, rays, answers);
  EXPECT_TRUE(report.is_ok()) << report.status().message();
  return report.value();
}

TEST(SessionProbe, IsUncertainThenAskedForThenAsOfTheFullMesh) {
  LocalHost host;
  const std::vector<RayProbe> rays = heights_above(terrain().model, 200);
  std::vector<RayAnswer> answers(rays.size());
  const ProbeReport none = probe_ground(host, rays, answers);
  EXPECT_NE(none.reason.find("no publisher found"), std::string::npos) << none.reason;
  for (const RayAnswer& answer : answers) {
    EXPECT_EQ(answer.status, ProbeStatus::kUncertain);
    EXPECT_EQ(answer.at_least_m, 0);
  }
  host.update();
  const ProbeReport coarse = probe_ground(host, rays, answers);
  EXPECT_EQ(coarse.reason, "");
  EXPECT_GT(coarse.missing, 0U);
  EXPECT_NE(coarse.awaited.find("nodes of model terrain are missing"), std::string::npos)
      << coarse.awaited;
  int updates = 0;
  while (probe_ground(host, rays, answers).missing != 0) {
    ASSERT_LT(++updates, 30);
    host.update();
  }
  EXPECT_LE(updates, 20);
  expect_true(terrain().model, {}, rays, answers);
  EXPECT_GT(host.session->stats().held_splits, 0U);
  EXPECT_LT(host.session->stats().held_splits, terrain().model.header.split_count());
  // Nothing more is asked for.
  const std::uint64_t requests = host.session->stats().requests;
  for (int i = 0; i < 5; ++i) host.update();
  EXPECT_EQ(host.session->stats().requests, requests);
}

TEST(SessionProbe, TakesTurnsWithPairsThatMove) {
  LocalHost host;
  host.spawn("one");
  const std::vector<RayProbe> rays = heights_above(terrain().model, 50);
  std::vector<RayAnswer> answers(rays.size());
  int updates = 0;
  for (; updates < 80; ++updates) {
    host.update({{kOne, above_ground(static_cast<std::uint32_t>(7 * updates), 0)}});
    const ProbeReport probed = probe_ground(host, rays, answers);
    if (updates > 2 && probed.missing == 0) break;
  }
  EXPECT_LT(updates, 60);
  expect_true(terrain().model, {}, rays, answers);
  EXPECT_TRUE(host.settle() > 0);
}

TEST(SessionProbe, WhatItLacksIsNotGivenUpBeforeItIsProbedAgain) {
  SessionOptions options;
  options.max_held_splits = 1;
  LocalHost host(options);
  const std::vector<RayProbe> rays = heights_above(terrain().model, 5);
  std::vector<RayAnswer> answers(rays.size());
  int updates = 0;
  do {
    host.update();
  } while (probe_ground(host, rays, answers).missing != 0 && ++updates < 40);
  EXPECT_LT(updates, 40);
  expect_true(terrain().model, {}, rays, answers);
}

TEST(SessionProbe, BallsBoxesAndPointsToo) {
  LocalHost host;
  host.update();
  const auto at = position_m(terrain().model.header, terrain().model.store, {777});
  const std::vector<BallProbe> balls{{.center_m = at, .radius_m = 1},
                                     {.center_m = {at[0], at[1], at[2] + 5000}, .radius_m = 1}};
  BoxProbe box{.pose = {}, .half_m = {2, 2, 2}};
  box.pose.translation_m = at;
  std::vector<ShapeAnswer> of_balls(2), of_box(1);
  for (int i = 0; i < 30; ++i) {
    ASSERT_TRUE(host.session->probe(kGround, balls, of_balls).is_ok());
    ASSERT_TRUE(host.session->probe(kGround, std::span(&box, 1), of_box).is_ok());
    host.update();
  }
  EXPECT_EQ(of_balls[0].status, ProbeStatus::kHit);
  EXPECT_EQ(of_balls[1].status, ProbeStatus::kMiss);
  EXPECT_EQ(of_box[0].status, ProbeStatus::kHit);
  std::vector<PointAnswer> of_point(1);
  const auto open = host.session->probe(kGround, std::span(&at, 1), of_point);
  ASSERT_FALSE(open.is_ok());  // a terrain has no inside
  EXPECT_NE(open.status().message().find("ground"), std::string::npos) << open.status().message();
  EXPECT_EQ(host.session->probe(BodyId{99}, balls, of_balls).status().code(),
            StatusCode::kNotFound);
}

// ---- poses that the host heard ------------------------------------------------------------------

class HeardPoses : public ::testing::Test {
 protected:
  void SetUp() override {
    for (LocalHost* host : {&by_host, &by_bus}) {
      const auto other = host->session->add_body({.name = "other", .model = "aircraft"});
      ASSERT_TRUE(other.is_ok());
      ASSERT_EQ(other.value(), kOne);
      ASSERT_TRUE(host->session->watch(kGround, kOne).is_ok());
    }
  }
  static Result<FrameReport> update(LocalHost& host, std::uint64_t frame, double time_s) {
    return host.session->update(frame, time_s, {}, 1);
  }
  LocalHost by_host, by_bus;
};

TEST_F(HeardPoses, CountAndAgeAsThoseOfTheBus) {
  Motion motion = above_ground(700, 4);
  motion.linear_velocity_mps = {3, 0, 0};
  int certified = 0;
  for (std::uint64_t frame = 0; frame < 60; ++frame) {
    const double time_s = 0.1 * static_cast<double>(frame);
    if (frame < 30) {  // then its mover falls silent
      motion.pose.translation_m[0] += 0.3;
      const Session::HeardPose heard{kOne, time_s - 0.02, motion};
      ASSERT_TRUE(by_host.session->hear(std::span(&heard, 1)).is_ok());
      ASSERT_TRUE(by_bus.channel
                      ->deliver({.peer = 77,
                                 .body = "other",
                                 .frame = frame,
                                 .time_s = time_s - 0.02,
                                 .pose = motion.pose,
                                 .linear_velocity_mps = motion.linear_velocity_mps})
                      .is_ok());
    }
    const auto one = update(by_host, frame, time_s), two = update(by_bus, frame, time_s);
    ASSERT_TRUE(one.is_ok() && two.is_ok());
    EXPECT_EQ(one.value().answers_digest, two.value().answers_digest);
    const PairAnswer& answer = *one.value().find(kGround, kOne);
    EXPECT_EQ(answer.age_b_s, two.value().find(kGround, kOne)->age_b_s);
    EXPECT_EQ(answer.reason, two.value().find(kGround, kOne)->reason);
    certified += is_certified(answer.answer.status) ? 1 : 0;
    if (frame > 55) {
      EXPECT_NE(answer.reason.find("old"), std::string::npos) << answer.reason;
    }
    EXPECT_EQ(by_host.session->heard_time_s(), by_bus.session->heard_time_s());
  }
  EXPECT_GT(certified, 25);
}

TEST_F(HeardPoses, AreRefusedWholeWhereOneIsNoPoseOfAnothersBody) {
  const BodyId own =
      by_host.session->add_body({.name = "mine", .model = "aircraft", .own = true}).value();
  const Session::HeardPose good{kOne, 0, above_ground(700, 4)};
  Session::HeardPose bad_motion = good;
  bad_motion.motion.pose.rotation[0] = 2;
  for (const Session::HeardPose& bad :
       {Session::HeardPose{own, 0, {}}, Session::HeardPose{BodyId{99}, 0, {}},
        Session::HeardPose{kOne, std::numeric_limits<double>::infinity(), {}}, bad_motion}) {
    const std::vector<Session::HeardPose> both{good, bad};
    EXPECT_FALSE(by_host.session->hear(both).is_ok());
  }
  ASSERT_TRUE(update(by_host, 0, 0).is_ok());
  EXPECT_FALSE(by_host.session->motion_of(kOne).has_value());
}

TEST_F(HeardPoses, OfABodyThatIsRemovedSayNothingOfTheNextOfItsName) {
  const Session::HeardPose heard{kOne, 0, above_ground(700, 4)};
  ASSERT_TRUE(by_host.session->hear(std::span(&heard, 1)).is_ok());
  ASSERT_TRUE(by_host.session->remove_body(kOne).is_ok());
  const BodyId next = by_host.session->add_body({.name = "other", .model = "aircraft"}).value();
  ASSERT_TRUE(update(by_host, 0, 0).is_ok());
  EXPECT_FALSE(by_host.session->motion_of(next).has_value());
}

TEST_F(HeardPoses, FromBeforeABodyWasPlacedDoNotMoveIt) {
  const Session::HeardPose heard{kOne, 0, above_ground(700, 4)};
  ASSERT_TRUE(by_host.session->hear(std::span(&heard, 1)).is_ok());
  const Pose place = above_ground(300, 9).pose;
  ASSERT_TRUE(by_host.session->place_body(kOne, place).is_ok());
  ASSERT_TRUE(update(by_host, 0, 0).is_ok());
  EXPECT_EQ(by_host.session->motion_of(kOne)->pose.translation_m, place.translation_m);
}

// ---- rotations of floats ------------------------------------------------------------------------

TEST(FloatRotations, AreTakenAsTheRotationNextToThem) {
  Random random(5);
  LocalHost host;
  host.spawn("one");
  for (int i = 0; i < 5; ++i) {
    Motion motion = above_ground(800, 100);
    for (double& x : motion.pose.rotation) x = 0;
    motion.pose.rotation = random_rotation(random);
    for (double& x : motion.pose.rotation) x = static_cast<double>(static_cast<float>(x));
    const FrameReport report = host.update({{kOne, motion}});
    if (i == 0) continue;  // the header comes
    const Pose asked = report.answers.at(0).pose_b;
    EXPECT_EQ(asked.rotation, orthonormal(motion.pose).rotation);
    EXPECT_NE(asked.rotation, motion.pose.rotation);
    for (std::size_t c = 0; c < 3; ++c) {
      double square = 0;
      for (std::size_t r = 0; r < 3; ++r)
        square += asked.rotation[3 * r + c] * asked.rotation[3 * r + c];
      EXPECT_NEAR(square, 1, 1e-14);
    }
  }
}

}  // namespace
}  // namespace nearmesh::test
