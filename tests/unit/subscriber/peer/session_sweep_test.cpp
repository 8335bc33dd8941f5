// SPDX-License-Identifier: Apache-2.0
// The swept answers of a session, held against the full meshes at instants ahead.
#include "nearmesh/subscriber/peer/session.hpp"
#include "world.hpp"

namespace nearmesh {
namespace {

using subscriber::SessionOptions;
using test::BodyId;
using test::Flight;
using test::FrameReport;
using test::kGround;
using test::kOne;
using test::kTwo;
using test::make_flight;
using test::quick_options;
using test::World;

TEST(SessionSweep, SweepsOnlyWhenAsked) {
  World world;
  world.start_publisher();
  const auto session = world.make_peer();
  const Flight flight = make_flight(1, 1);
  world.on_report = [](const FrameReport& report) {
    for (const auto& answer : report.answers) EXPECT_FALSE(answer.swept.has_value());
  };
  world.fly(*session, flight);
}

TEST(SessionSweep, SweptAnswersAreNeverWrongAndWhatTheyLackComes) {
  World world;
  world.start_publisher();
  SessionOptions options = quick_options();
  options.lookahead_s = 0;  // nothing comes ahead but for the sweeps
  options.sweep_s = 0.15;
  const auto session = world.make_peer(options);
  const Flight* now = nullptr;
  std::size_t frame = 0;
  bool complete = false;
  std::array<int, 4> settled{};
  int lacking = 0, checked = 0;
  Random random(11);
  const auto motion_of = [&](BodyId body) {
    return body == kGround ? Motion{} : body == kOne ? now->one[frame] : now->two[frame];
  };
  world.on_report = [&](const FrameReport& report) {
    complete = true;
    for (const auto& answer : report.answers) {
      EXPECT_EQ(answer.swept.has_value(), answer.reason.empty());
      complete = complete && answer.swept && answer.swept->missing_a.empty() &&
                 answer.swept->missing_b.empty();
      if (!answer.swept) continue;
      const SweptAnswer& swept = *answer.swept;
      lacking += !swept.missing_a.empty() || !swept.missing_b.empty();
      const Motion a = motion_of(answer.a), b = motion_of(answer.b);
      const auto touch = [&](double t) {
        return !world.judge.touching(answer, pose_at(a, t), pose_at(b, t)).empty();
      };
      for (int i = 0; i < 3 && swept.free_until_s > 0; ++i) {
        const double t = swept.free_until_s * (1 - std::exp2(random.between(-20, 0)));
        EXPECT_FALSE(touch(t)) << t << " of " << swept.free_until_s;
        ++checked;
      }
      if (swept.hit_s <= options.sweep_s) {
        EXPECT_TRUE(touch(swept.hit_s));
      }
    }
    if (!complete) return;
    for (const auto& answer : report.answers)
      ++settled[static_cast<std::size_t>(answer.swept->status)];
  };
  for (std::uint64_t seed = 1; seed <= 3 && !HasFailure(); ++seed) {
    const Flight flight = make_flight(seed, 3);
    now = &flight;
    for (frame = 0; frame < flight.frames() && !HasFailure(); frame += 2) {
      ASSERT_TRUE(
          world.fly_frame(*session, frame, {{kOne, flight.one[frame]}, {kTwo, flight.two[frame]}}));
      const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(100);
      while (!complete && std::chrono::steady_clock::now() < deadline) world.round(*session, frame);
      ASSERT_TRUE(complete) << "frame " << frame << " of flight " << seed;
    }
  }
  EXPECT_GT(lacking, 10);
  EXPECT_GT(checked, 100);
  EXPECT_GT(settled[static_cast<std::size_t>(AnswerStatus::kFree)], 5);
  EXPECT_GT(settled[static_cast<std::size_t>(AnswerStatus::kContact)], 5);
}

TEST(SessionSweep, AMotionThatCannotBeSweptIsComplainedAbout) {
  World world;
  world.start_publisher();
  SessionOptions options = quick_options();
  options.sweep_s = 60;
  const auto session = world.make_peer(options);
  Motion one, two;
  one.pose.translation_m = {0, 0, 9000};
  two.pose.translation_m = {300, 0, 9000};
  two.angular_velocity_radps = {0, 0, 1e6};
  ASSERT_TRUE(world.fly_frame(*session, 0, {{kOne, one}, {kTwo, two}}));
  const FrameReport report = world.round(*session);
  EXPECT_TRUE(report.answers[0].swept.has_value());   // ground and one
  EXPECT_FALSE(report.answers[1].swept.has_value());  // ground and two
  EXPECT_TRUE(world.has_complaint("no swept answer: motion of two"));
}

}  // namespace
}  // namespace nearmesh
