// SPDX-License-Identifier: Apache-2.0
// Many bodies, all pairs of them: what is listed, what is free by bounds, what is unknown.
// nearmesh-soak-bounds holds what is free by bounds against the full meshes.
#include <atomic>
#include <thread>

#include "local_host.hpp"
#include "swarm.hpp"
#include "world.hpp"

namespace nearmesh {
namespace {

using subscriber::Readiness;
using subscriber::ReadyStage;
using test::kGround;
using test::LocalHost;
using test::Swarm;

constexpr double kStep_s = 0.05;

/// A session that watches all; the ground is there, aircraft come.
struct Host : LocalHost {
  explicit Host(SessionOptions options = {.lookahead_s = 0.2}) : LocalHost(options) {
    session->watch_all();
  }
  BodyId add(const std::string& name, std::uint32_t group = 1, std::uint32_t mask = ~0U) {
    return session
        ->add_body({.name = name, .model = "aircraft", .own = true, .group = group, .mask = mask})
        .value();
  }
};

using test::BodyId;
using test::FrameReport;
using test::PairAnswer;
using test::Session;

TEST(WatchAll, AnswersThoseNearAsWatchingThemWould) {
  Host all;
  LocalHost named({.lookahead_s = 0.2});
  std::vector<BodyId> bodies;
  for (int i = 0; i < 6; ++i) {
    bodies.push_back(all.add("a" + std::to_string(i)));
    ASSERT_EQ(named.spawn("a" + std::to_string(i)), bodies.back());
    for (const BodyId before : bodies)
      if (before != bodies.back()) {
        ASSERT_TRUE(named.session->watch(before, bodies.back()).is_ok());
      }
  }
  Swarm swarm(test::terrain().model, 9, bodies.size());
  std::uint64_t compared = 0;
  for (int frame = 0; frame < 40; ++frame, swarm.step(kStep_s)) {
    std::vector<Session::OwnMotion> own;
    for (std::size_t i = 0; i < bodies.size(); ++i) own.push_back({bodies[i], swarm.motions[i]});
    ASSERT_GT(all.settle(own), 0);
    ASSERT_GT(named.settle(own), 0);
    const FrameReport some = all.update(), each = named.update();
    for (const PairAnswer& answer : some.answers) {
      const PairAnswer* other = each.find(answer.a, answer.b);
      ASSERT_NE(other, nullptr);
      EXPECT_EQ(answer.answer.status, other->answer.status);
      EXPECT_EQ(answer.answer.pairs, other->answer.pairs);
      ++compared;
    }
    EXPECT_EQ(some.answers.size() + some.free_by_bounds.pairs, each.answers.size());
  }
  EXPECT_GT(compared, 60U);
}

TEST(WatchAll, WhatIsUnknownIsNeverFree) {
  Host host;
  const BodyId one = host.add("one"), two = host.add("two");
  const BodyId ghost =
      host.session->add_body({.name = "ghost", .model = "spectre", .own = true}).value();
  FrameReport report = host.update({{one, test::above_ground(0, 9000)}});
  // The local channel hands headers over at once, but "two" has no pose and "ghost" no model.
  ASSERT_EQ(report.unknown.size(), 2U);
  EXPECT_EQ(report.unknown[0].body, two);
  EXPECT_EQ(report.unknown[0].reason, "no pose of body two has come");
  EXPECT_EQ(report.unknown[1].reason, "model spectre of body ghost: no publisher serves it");
  EXPECT_EQ(report.free_by_bounds.pairs, 1U);  // ground and one
  EXPECT_EQ(report.unknown_pairs, 5U);
  EXPECT_TRUE(report.answers.empty());
  EXPECT_FALSE(report.all_certified());
  EXPECT_EQ(host.session->readiness(one).value().stage, ReadyStage::kWaiting);

  report =
      host.update({{two, test::above_ground(0, 18000)}, {ghost, test::above_ground(0, 90000)}});
  EXPECT_EQ(report.free_by_bounds.pairs, 3U);
  EXPECT_EQ(report.unknown_pairs, 3U);
  ASSERT_TRUE(host.session->remove_body(ghost).is_ok());
  report = host.update();
  EXPECT_TRUE(report.all_certified());
  EXPECT_EQ(report.unknown_pairs, 0U);
  const Readiness ready = host.session->readiness(one).value();
  EXPECT_EQ(ready.stage, ReadyStage::kCertified) << ready.reason;
  // What was said of a place says nothing of another.
  ASSERT_TRUE(host.session->place_body(kGround, {}).is_ok());
  EXPECT_EQ(host.session->readiness(one).value().stage, ReadyStage::kWaiting);
}

TEST(WatchAll, BodiesComeGoAndChangeBetweenUpdates) {
  Host host;
  const BodyId one = host.add("one"), two = host.add("two");
  const Motion high = test::above_ground(0, 300);
  Motion beside = high;
  beside.pose.translation_m[0] += 1;  // into each other
  EXPECT_GT(host.settle({{one, high}, {two, beside}}), 0);
  FrameReport report = host.update();
  ASSERT_NE(report.find(one, two), nullptr);
  EXPECT_EQ(report.find(two, one)->answer.status, AnswerStatus::kContact);
  EXPECT_EQ(host.session->add_body({.name = "two", .model = "aircraft"}).status().code(),
            StatusCode::kConflict);

  ASSERT_TRUE(host.session->remove_body(two).is_ok());
  EXPECT_EQ(host.session->remove_body(two).code(), StatusCode::kNotFound);
  EXPECT_EQ(host.session->watch(one, two).code(), StatusCode::kNotFound);
  report = host.update();
  EXPECT_EQ(report.find(one, two), nullptr);
  EXPECT_EQ(report.answers.size() + report.free_by_bounds.pairs, 1U);

  const BodyId again = host.add("two");  // the name is free; the number is new
  EXPECT_NE(again, two);
  report = host.update();
  EXPECT_EQ(report.unknown_pairs, 2U);
  EXPECT_GT(host.settle({{again, beside}}), 0);
  EXPECT_EQ(host.update().find(one, again)->answer.status, AnswerStatus::kContact);

  // Another model in the same place: the ground's is far too large to be clear of the aircraft's
  // box.
  ASSERT_TRUE(host.session->replace_model(again, "spectre").is_ok());
  report = host.update();
  EXPECT_EQ(report.find(one, again), nullptr);
  EXPECT_EQ(report.unknown_pairs, 2U);
  ASSERT_TRUE(host.session->replace_model(again, "aircraft").is_ok());
  EXPECT_GT(host.settle(), 0);
  EXPECT_EQ(host.update().find(one, again)->answer.status, AnswerStatus::kContact);
  EXPECT_EQ(host.session->replace_model(again, "").code(), StatusCode::kInvalidArgument);
  EXPECT_EQ(host.session->replace_model(two, "aircraft").code(), StatusCode::kNotFound);
}

TEST(WatchAll, AModelThatNobodyUsesHoldsNoDetail) {
  Host host;
  const BodyId one = host.add("one"), two = host.add("two");
  Motion high = test::above_ground(0, 300);
  Motion beside = high;
  beside.pose.translation_m[0] += 1;
  ASSERT_GT(host.settle({{one, high}, {two, beside}}), 0);
  EXPECT_GT(host.session->stats().held_splits, 50U);
  ASSERT_TRUE(host.session->remove_body(one).is_ok());
  EXPECT_GT(host.session->stats().held_splits, 50U);
  ASSERT_TRUE(host.session->remove_body(two).is_ok());
  EXPECT_EQ(host.session->stats().held_splits, 0U);
}

TEST(WatchAll, AModelThatNothingWasNearForLongHoldsNoDetail) {
  for (const bool is_by_name : {false, true}) {
    Host host;
    const BodyId one = host.add("one"), two = host.add("two");
    if (is_by_name) {
      ASSERT_TRUE(host.session->watch(one, two).is_ok());
      ASSERT_TRUE(host.session->watch(kGround, one).is_ok());
    }
    const Motion low = test::above_ground(0, 1), high = test::above_ground(0, 30e3);
    Motion beside = low;
    beside.pose.translation_m[0] += 1;
    const std::vector<Session::OwnMotion> near{{one, low}, {two, beside}},
        far{{one, high}, {two, test::above_ground(0, 90e3)}};
    ASSERT_GT(host.settle(near), 0);
    const std::uint64_t held = host.session->stats().held_splits;
    EXPECT_GT(held, 50U);
    for (const double time_s : {4.0, 9.0}) {  // near for all of it
      host.time_s = time_s;
      host.update(near);
    }
    for (const double time_s : {12.0, 18.9}) {
      host.time_s = time_s;
      host.update(far);
      EXPECT_EQ(host.session->stats().held_splits, held) << time_s;
    }
    host.time_s = 20.1;
    EXPECT_TRUE(host.update(far).all_certified());
    EXPECT_EQ(host.session->stats().held_splits, 0U);
    EXPECT_GT(host.settle(near), 0);
    EXPECT_EQ(host.session->stats().held_splits, held);
  }
}

TEST(WatchAll, WatchedByNameIsListedWhereverItIs) {
  Host host;
  const BodyId one = host.add("one", 2, 2), two = host.add("two", 4, 4);
  const std::vector<Session::OwnMotion> far{{one, test::above_ground(0, 9000)},
                                            {two, test::above_ground(0, 18000)}};
  FrameReport report = host.update(far);
  EXPECT_TRUE(report.answers.empty());
  EXPECT_EQ(report.free_by_bounds.pairs,
            0U);  // their groups do not mind each other, nor the ground
  ASSERT_TRUE(host.session->watch(two, one).is_ok());
  ASSERT_TRUE(host.session->watch(one, two).is_ok());  // one pair
  report = host.update();
  ASSERT_EQ(report.answers.size(), 1U);
  EXPECT_EQ(report.answers[0].a, two);
  EXPECT_EQ(report.answers[0].answer.status, AnswerStatus::kFree);
  ASSERT_TRUE(host.session->unwatch(one, two).is_ok());
  EXPECT_EQ(host.session->unwatch(one, two).code(), StatusCode::kNotFound);
  EXPECT_TRUE(host.update().answers.empty());
}

TEST(WatchAll, DigestsTellWorldsApartAndNotTheirHistories) {
  const auto digest_of = [](bool other_order, double moved_m, int jumps) {
    Host host;
    const BodyId first = host.add(other_order ? "two" : "one");
    const BodyId second = host.add(other_order ? "one" : "two");
    const BodyId one = other_order ? second : first, two = other_order ? first : second;
    Motion high = test::above_ground(0, 9000), higher = test::above_ground(0, 18000);
    for (int i = 1; i <= jumps; ++i)
      host.update(
          {{one, test::above_ground(0, 9000.0 * i)}, {two, test::above_ground(9, 50.0 * i)}});
    higher.pose.translation_m[0] += moved_m;
    const FrameReport report = host.update({{one, high}, {two, higher}});
    EXPECT_EQ(report.free_by_bounds.pairs, 3U);
    return report.free_by_bounds.digest;
  };
  const std::uint64_t digest = digest_of(false, 0, 0);
  EXPECT_EQ(digest_of(true, 0, 0), digest);
  EXPECT_EQ(digest_of(false, 0, 7), digest);
  EXPECT_EQ(digest_of(true, 0, 3), digest);
  EXPECT_NE(digest_of(false, 0x1p-20, 0), digest);
}

TEST(WatchAll, SceneryIsNoPairWithScenery) {
  Host host;
  const BodyId still = host.session->add_body({.name = "still", .model = "aircraft"}).value();
  ASSERT_TRUE(host.session->place_body(still, test::above_ground(0, 1).pose).is_ok());
  const FrameReport report = host.update();
  EXPECT_TRUE(report.answers.empty());
  EXPECT_EQ(report.free_by_bounds.pairs, 0U);
  EXPECT_EQ(report.unknown_pairs, 0U);
}

/// Jobs on threads of their own, the last first.
void run_on_threads(std::size_t count, const std::function<void(std::size_t)>& job) {
  constexpr std::size_t kThreads = 3;
  std::atomic<std::size_t> left{count};
  std::vector<std::thread> threads;
  for (std::size_t t = 0; t < kThreads; ++t)
    threads.emplace_back([&] {
      for (;;) {
        std::size_t before = left.load();
        while (before > 0 && !left.compare_exchange_weak(before, before - 1)) {
        }
        if (before == 0) return;
        job(before - 1);
      }
    });
  for (std::thread& thread : threads) thread.join();
}

TEST(WatchAll, AnswersAreTheSameOnAnyNumberOfThreads) {
  SessionOptions alone{.lookahead_s = 0.2, .sweep_s = 0.1, .contacts = true};
  SessionOptions threads = alone;
  std::size_t jobs = 0;
  threads.run_jobs = [&jobs](std::size_t count, const std::function<void(std::size_t)>& job) {
    jobs += count;
    run_on_threads(count, job);
  };
  Host one(alone), many(threads);
  std::vector<BodyId> bodies;
  for (int i = 0; i < 8; ++i) {
    bodies.push_back(one.add(std::to_string(i)));
    ASSERT_EQ(many.add(std::to_string(i)), bodies.back());
  }
  Swarm swarm(test::terrain().model, 5, bodies.size());
  for (int frame = 0; frame < 30; ++frame, swarm.step(kStep_s)) {
    std::vector<Session::OwnMotion> own;
    for (std::size_t i = 0; i < bodies.size(); ++i) own.push_back({bodies[i], swarm.motions[i]});
    for (int round = 0; round < 5; ++round) {
      const FrameReport a = one.update(own), b = many.update(own);
      ASSERT_EQ(a.answers_digest, b.answers_digest);
      ASSERT_EQ(a.state_digest, b.state_digest);
      ASSERT_EQ(a.answers.size(), b.answers.size());
      for (std::size_t i = 0; i < a.answers.size(); ++i) {
        EXPECT_EQ(a.answers[i].answer.clearance_m, b.answers[i].answer.clearance_m);
        EXPECT_EQ(a.answers[i].safe_horizon_s, b.answers[i].safe_horizon_s);
        EXPECT_EQ(a.answers[i].swept.has_value(), b.answers[i].swept.has_value());
      }
    }
  }
  EXPECT_EQ(one.session->stats().looks_ahead, many.session->stats().looks_ahead);
  EXPECT_GT(jobs, 500U);
}

// Far more pairs than one request may name, and more regions than one may hold.
class ThreeHundredOverOneTerrain : public ::testing::TestWithParam<bool> {};

TEST_P(ThreeHundredOverOneTerrain, AreAllCertified) {
  test::World world;
  const bool by_region = GetParam();
  if (by_region) {  // nobody has both models, so nobody chooses
    world.start_publisher_of("terrain", test::terrain(), test::kPublisher);
    world.start_publisher_of("aircraft", test::aircraft(), test::kPublisher + 1);
  } else {
    world.start_publisher();
  }
  Session session(world.bus.make_peer(test::kPeer), test::quick_options());
  session.watch_all();
  ASSERT_EQ(session.add_body({.name = "ground", .model = "terrain"}).value(), kGround);
  ASSERT_TRUE(session.place_body(kGround, {}).is_ok());
  Random random(3);
  std::vector<Session::OwnMotion> own;
  for (int i = 0; i < 300; ++i) {
    const std::uint32_t vertices = test::terrain().model.header.vertex_count;
    Motion motion = test::above_ground(random.below(vertices), random.between(-2, 20));
    motion.pose.rotation = test::random_rotation(random);
    const auto id = session.add_body({.name = std::to_string(i), .model = "aircraft", .own = true});
    own.push_back({id.value(), motion});
  }
  FrameReport report;
  int rounds = 0;
  do report = world.round(session, 0, own);
  while (!report.all_certified() && ++rounds < 400);
  EXPECT_TRUE(report.all_certified()) << rounds;
  EXPECT_GT(report.answers.size(), 300U);
}

INSTANTIATE_TEST_SUITE_P(WhoeverChooses, ThreeHundredOverOneTerrain, ::testing::Bool(),
                         [](const auto& chosen) {
                           return chosen.param ? "ThePeer" : "ThePublisher";
                         });

}  // namespace
}  // namespace nearmesh
