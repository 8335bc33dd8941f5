// SPDX-License-Identifier: Apache-2.0
// Bodies of others that are known by promises: what rests on them, when their full poses come, and
// what is refused.
#include <map>

#include "rounds.hpp"
#include "world.hpp"

namespace nearmesh {
namespace {

using subscriber::BodyId;
using subscriber::BodyOptions;
using test::FrameReport;
using test::PairAnswer;
using test::Session;
using test::SessionOptions;
using test::Vector3;
using test::World;

constexpr wire::SessionId kMover = 0xc1, kWatcher = 0xc2;
constexpr double kPromiseFrame_s = 0.05;  // as World::round has it
constexpr double kMostSpeed_mps = 200;

Motion flying(const Vector3& from_m, const Vector3& velocity_mps, double time_s) {
  Motion motion;
  for (std::size_t k = 0; k < 3; ++k)
    motion.pose.translation_m[k] = from_m[k] + velocity_mps[k] * time_s;
  motion.linear_velocity_mps = velocity_mps;
  return motion;
}

/// One moves "far" and promises where it stays, another moves "own" and watches its pairs.
class Promises : public ::testing::Test {
 protected:
  Promises() {
    world_.judges = false;  // bodies have other names here
    world_.start_publisher();
    mover_ = join(kMover);
    watcher_ = join(kWatcher);
    far_ = mover_->add_body(moved_body("far", kMostSpeed_mps)).value();
    own_ = watcher_->add_body(moved_body("own", 0)).value();
    watcher_->watch_own();
    watcher_->discover_bodies();
  }
  std::unique_ptr<Session> join(wire::SessionId id) {
    return std::make_unique<Session>(world_.bus.make_peer(id), test::quick_options());
  }
  static BodyOptions moved_body(const std::string& name, double max_speed_mps) {
    return {.name = name, .model = "aircraft", .own = true, .max_speed_mps = max_speed_mps};
  }
  FrameReport watch(std::uint64_t frame) {
    FrameReport report;
    for (int round = 0; round < 12; ++round)
      report = world_.round(*watcher_, frame,
                            round == 0 ? std::vector<Session::OwnMotion>{{own_, Motion{}}}
                                       : std::vector<Session::OwnMotion>{});
    return report;
  }
  /// The frame of both.
  FrameReport fly(std::uint64_t frame, const Motion& far) {
    if (mover_ != nullptr) world_.round(*mover_, frame, {{far_, far}});
    return watch(frame);
  }
  BodyId far_here() const { return BodyId{1}; }

  World world_;
  std::unique_ptr<Session> mover_, watcher_;
  BodyId far_, own_;
};

TEST_F(Promises, AFarBodyIsFreeByThemAloneAndFewGoOut) {
  FrameReport report;
  for (std::uint64_t frame = 0; frame < 200; ++frame) {
    report = fly(frame,
                 flying({50'000, 0, 0}, {0, 150, 0}, static_cast<double>(frame) * kPromiseFrame_s));
    if (frame < 2) continue;
    ASSERT_EQ(report.free_by_bounds.pairs, 1U) << frame;
    ASSERT_EQ(report.promised, 1U);
    ASSERT_TRUE(report.all_certified());
    ASSERT_GT(report.free_by_bounds.clearance_m, 0);
  }
  EXPECT_EQ(world_.bus.promises.size(), 3U);  // at 0, 4 and 8 s
  EXPECT_EQ(world_.bus.near_poses, 0U);
  EXPECT_TRUE(world_.bus.wanted.empty());
  EXPECT_EQ(world_.bus.common_poses, 200U);  // of "own", of which nothing is promised
  EXPECT_EQ(watcher_->options_of(far_here()).value().max_speed_mps, kMostSpeed_mps);
  EXPECT_FALSE(watcher_->motion_of(far_here()));
}

TEST_F(Promises, FullPosesComeInTimeAndGoNoMoreWhenItIsFar) {
  std::uint64_t listed = 0, touched = 0, by_pose = 0;
  const Vector3 from{-4000, 0, 0}, velocity{kMostSpeed_mps, 0, 0};
  for (std::uint64_t frame = 0; frame < 800; ++frame) {
    const Motion far = flying(from, velocity, static_cast<double>(frame) * kPromiseFrame_s);
    const FrameReport report = fly(frame, far);
    if (frame < 2) continue;
    ASSERT_TRUE(report.all_certified())
        << "frame " << frame << ": " << (report.answers.empty() ? "" : report.answers[0].reason);
    by_pose += report.promised == 0 ? 1U : 0U;
    if (report.answers.empty()) continue;
    ++listed;
    EXPECT_EQ(watcher_->motion_of(far_here())->pose.translation_m, far.pose.translation_m);
    touched += report.answers[0].answer.status == AnswerStatus::kContact ? 1U : 0U;
  }
  EXPECT_GT(listed, 10U);
  EXPECT_GT(touched, 0U);
  EXPECT_GT(by_pose, 40U);
  EXPECT_LT(by_pose, 500U);
  EXPECT_LT(world_.bus.near_poses, 500U);
  EXPECT_TRUE(world_.bus.wanted.back().parts.empty());
}

TEST_F(Promises, WatchedByNameItIsAskedForAtOnce) {
  fly(0, flying({50'000, 0, 0}, {}, 0));
  ASSERT_TRUE(watcher_->watch(own_, far_here()).is_ok());
  fly(1, flying({50'000, 0, 0}, {}, 0));
  const FrameReport report = fly(2, flying({50'000, 0, 0}, {}, 0));
  ASSERT_EQ(report.answers.size(), 1U);
  EXPECT_TRUE(is_certified(report.answers[0].answer.status)) << report.answers[0].reason;
  EXPECT_TRUE(report.answers[0].asked);
}

TEST_F(Promises, NearWithoutAPoseIsUncertainAndSaysWhy) {
  world_.bus.on_poses.lose = 1;
  for (std::uint64_t frame = 0; frame < 3; ++frame) fly(frame, flying({60, 0, 0}, {}, 0));
  const FrameReport report = fly(3, flying({60, 0, 0}, {}, 0));
  ASSERT_EQ(report.answers.size(), 1U);
  EXPECT_EQ(report.answers[0].answer.status, AnswerStatus::kUncertain);
  EXPECT_EQ(report.answers[0].reason,
            "body far is known by a promise alone, its full poses are asked for");
  EXPECT_EQ(report.free_by_bounds.pairs, 0U);
}

TEST_F(Promises, ThatHaveEndedSayNothing) {
  fly(0, flying({50'000, 0, 0}, {}, 0));
  world_.bus.on_promises.lose = 1;
  for (std::uint64_t frame = 1; frame <= 160; ++frame) {
    const FrameReport report = fly(frame, flying({50'000, 0, 0}, {}, 0));
    ASSERT_TRUE(report.all_certified()) << frame;  // to 8 s
  }
  FrameReport report = fly(161, flying({50'000, 0, 0}, {}, 0));
  EXPECT_EQ(report.unknown_pairs, 1U);
  EXPECT_EQ(report.free_by_bounds.pairs, 0U);
  ASSERT_EQ(report.unknown.size(), 1U);
  EXPECT_EQ(report.unknown[0].reason,
            "the promise of where body far stays ended 0.050000 s before the frame's time");
  world_.bus.on_promises.lose = 0;
  for (std::uint64_t frame = 162; frame < 300; ++frame)
    report = fly(frame, flying({50'000, 0, 0}, {}, 0));
  EXPECT_EQ(report.free_by_bounds.pairs, 1U);
}

TEST_F(Promises, HoldForFramesBetweenThoseOfTheOneBefore) {
  for (std::uint64_t frame = 0; frame <= 80; ++frame) fly(frame, flying({50'000, 0, 0}, {}, 0));
  ASSERT_EQ(world_.bus.promises.size(), 2U);  // at 0 and 4 s
  EXPECT_EQ(watch(79).free_by_bounds.pairs, 1U);
  EXPECT_EQ(watch(0).free_by_bounds.pairs, 1U);
  // Of the time before the first nobody has said anything.
  const FrameReport report = watcher_->update(0, -0.05, {{own_, Motion{}}}, 1).value();
  EXPECT_EQ(report.unknown_pairs, 1U);
  EXPECT_EQ(report.unknown[0].reason,
            "the promise of where body far stays begins 4.050000 s after the frame's time");
}

TEST_F(Promises, ThatComeLateOrInAnotherOrderTakeNothingBack) {
  std::vector<wire::BodyPromise> kept;
  world_.bus.promise_filter = [&](wire::BodyPromise& promise) {
    kept.push_back(promise);
    return promise.from_s > 3;
  };
  for (std::uint64_t frame = 0; frame <= 90; ++frame) fly(frame, flying({50'000, 0, 0}, {}, 0));
  EXPECT_EQ(watch(90).free_by_bounds.pairs, 1U);
  // The first comes last: the latest still says where it is, and the first of what was before.
  world_.bus.promise_filter = nullptr;
  world_.bus.inject(world_.bus.promises.front());
  EXPECT_EQ(watch(170).free_by_bounds.pairs, 1U);
  EXPECT_EQ(watch(10).free_by_bounds.pairs, 1U);
  EXPECT_EQ(kept.size(), 2U);
}

TEST_F(Promises, AreNotBroken) {
  fly(0, flying({50'000, 0, 0}, {}, 0));
  const auto at = [&](double x, double time_s) {
    return mover_->update(1, time_s, {{far_, flying({x, 0, 0}, {}, 0)}}, 1).status();
  };
  EXPECT_EQ(at(50'120, 0.5).code(), StatusCode::kInvalidArgument);  // 100 m, and a quantum of 16
  EXPECT_NE(at(50'120, 0.5).message().find("body far is 1"), std::string::npos);
  EXPECT_NE(at(50'120, 0.5).message().find("max_speed_mps, 200"), std::string::npos);
  EXPECT_EQ(world_.bus.promises.size(), 1U);
  EXPECT_EQ(mover_->motion_of(far_)->pose.translation_m[0], 50'000);
  EXPECT_TRUE(at(50'100, 0.5).is_ok());
  EXPECT_TRUE(at(50'900, 4.5).is_ok());
  EXPECT_EQ(at(52'000, 4.5).code(), StatusCode::kInvalidArgument);
  EXPECT_EQ(mover_->place_body(far_, {}).code(), StatusCode::kInvalidArgument);
  // A jump is a body that goes, and another.
  ASSERT_TRUE(mover_->remove_body(far_).is_ok());
  far_ = mover_->add_body(moved_body("far", kMostSpeed_mps)).value();
  EXPECT_TRUE(at(-70'000, 4.6).is_ok());
  EXPECT_EQ(watch(92).free_by_bounds.pairs, 1U);
}

// A body that comes has a promise made of all of its part. Who has not heard that one rests on an
// earlier one.
TEST_F(Promises, AreNotBrokenByThoseThatFollow) {
  fly(0, flying({50'000, 0, 0}, {}, 0));
  Status status;
  int frame = 0;
  while (status.is_ok() && frame < 20) {
    ++frame;
    const double time_s = frame * kPromiseFrame_s;
    const BodyId next =
        mover_->add_body(moved_body("next " + std::to_string(frame), kMostSpeed_mps)).value();
    // 260 m/s: less than a quantum of 16 m beyond what is promised in each frame.
    status = mover_
                 ->update(static_cast<std::uint64_t>(frame), time_s,
                          {{far_, flying({50'000 + 13.0 * frame, 0, 0}, {}, 0)},
                           {next, flying({0, 50'000, 0}, {}, 0)}},
                          1)
                 .status();
  }
  EXPECT_EQ(status.code(), StatusCode::kInvalidArgument);
  EXPECT_EQ(frame, 6) << "78 m where 60 m and a quantum were promised at first";
}

TEST_F(Promises, AreNotBrokenByAClockThatGoesBack) {
  const auto at = [&](double x, double time_s) {
    return mover_->update(1, time_s, {{far_, flying({x, 0, 0}, {}, 0)}}, 1).status();
  };
  for (const double time_s : {0.0, 4.0, 8.5}) ASSERT_TRUE(at(50'000, time_s).is_ok());
  ASSERT_EQ(world_.bus.promises.size(), 3U);
  // Whoever has heard the first two of them takes it for there.
  EXPECT_EQ(at(60'000, 2).code(), StatusCode::kInvalidArgument);
  EXPECT_TRUE(at(50'100, 2).is_ok());
  EXPECT_TRUE(at(50'100, 2.05).is_ok());
  EXPECT_EQ(world_.bus.promises.size(), 4U) << "it is said again once, not in each frame";
}

TEST_F(Promises, OfAMoverThatLeftAreVoidAndThoseOfTheNextCount) {
  fly(0, flying({50'000, 0, 0}, {}, 0));
  EXPECT_EQ(watch(1).free_by_bounds.pairs, 1U);
  mover_.reset();
  FrameReport report = watch(2);
  EXPECT_EQ(report.unknown_pairs, 1U);
  EXPECT_EQ(report.unknown[0].reason, "the peer that moves body far has left");
  mover_ = join(kMover + 0x10);
  far_ = mover_->add_body(moved_body("far", kMostSpeed_mps)).value();
  // Near now: the promise of before said otherwise.
  for (std::uint64_t frame = 3; frame < 8; ++frame) report = fly(frame, flying({40, 0, 0}, {}, 0));
  ASSERT_EQ(report.answers.size(), 1U);
  EXPECT_TRUE(is_certified(report.answers[0].answer.status)) << report.answers[0].reason;
}

TEST_F(Promises, OfAMoverThatLeftSayNothingOfAnotherBodyOfTheName) {
  fly(0, flying({50'000, 0, 0}, {}, 0));
  EXPECT_EQ(watch(1).free_by_bounds.pairs, 1U);
  mover_.reset();
  mover_ = join(kMover + 0x10);
  far_ = mover_->add_body(moved_body("far", 0)).value();
  FrameReport report;
  for (std::uint64_t frame = 2; frame < 8; ++frame) report = fly(frame, flying({40, 0, 0}, {}, 0));
  EXPECT_EQ(report.free_by_bounds.pairs, 0U);
  ASSERT_EQ(report.answers.size(), 1U);
  EXPECT_TRUE(is_certified(report.answers[0].answer.status)) << report.answers[0].reason;
}

TEST_F(Promises, OfABodyThatIsRemovedSayNothingOfTheNextOfItsName) {
  // Declared here, so the body stays the same whatever its mover has.
  ASSERT_TRUE(watcher_->add_body({.name = "far", .model = "aircraft"}).is_ok());
  fly(0, flying({50'000, 0, 0}, {}, 0));
  EXPECT_EQ(watch(1).free_by_bounds.pairs, 1U);
  ASSERT_TRUE(mover_->remove_body(far_).is_ok());
  far_ = mover_->add_body(moved_body("far", 0)).value();
  FrameReport report;
  for (std::uint64_t frame = 2; frame < 8; ++frame) report = fly(frame, flying({40, 0, 0}, {}, 0));
  EXPECT_EQ(report.free_by_bounds.pairs, 0U);
  EXPECT_EQ(report.answers.size(), 1U);
}

// A jump: here a body goes, and there another of its name comes, whose promise is heard before its
// poses.
TEST_F(Promises, ThePoseOfABodyThatIsRemovedIsNotThatOfTheNextOfItsName) {
  // Declared here, so the body stays the same whatever its mover has.
  ASSERT_TRUE(watcher_->add_body({.name = "far", .model = "aircraft"}).is_ok());
  FrameReport report;
  for (std::uint64_t frame = 0; frame < 5; ++frame) report = fly(frame, flying({60, 0, 0}, {}, 0));
  ASSERT_EQ(report.answers.size(), 1U);
  ASSERT_TRUE(is_certified(report.answers[0].answer.status)) << report.answers[0].reason;
  ASSERT_TRUE(mover_->remove_body(far_).is_ok());
  far_ = mover_->add_body(moved_body("far", kMostSpeed_mps)).value();
  report = fly(5, flying({1, 0, 0}, {}, 0));
  ASSERT_EQ(report.answers.size(), 1U);
  EXPECT_EQ(report.answers[0].answer.status, AnswerStatus::kUncertain);
  EXPECT_EQ(report.answers[0].reason,
            "body far is known by a promise alone, its full poses are asked for");
  EXPECT_FALSE(watcher_->motion_of(far_here()));
  for (std::uint64_t frame = 6; frame < 9; ++frame) report = fly(frame, flying({1, 0, 0}, {}, 0));
  ASSERT_EQ(report.answers.size(), 1U);
  EXPECT_EQ(report.answers[0].reason, "");
  EXPECT_EQ(watcher_->motion_of(far_here())->pose.translation_m[0], 1);
}

TEST_F(Promises, ThePoseOfAMoverThatLeftIsNotThatOfTheNextWhoPromises) {
  ASSERT_TRUE(watcher_->add_body({.name = "far", .model = "aircraft"}).is_ok());
  ASSERT_TRUE(watcher_->watch(own_, far_here()).is_ok());
  mover_ = join(kMover + 0x10);
  far_ = mover_->add_body(moved_body("far", 0)).value();
  FrameReport report;
  for (std::uint64_t frame = 0; frame < 5; ++frame) report = fly(frame, flying({60, 0, 0}, {}, 0));
  ASSERT_TRUE(report.all_certified()) << report.answers[0].reason;
  mover_.reset();
  EXPECT_EQ(watch(4).answers[0].reason, "the peer that moves body far has left");
  mover_ = join(kMover);
  far_ = mover_->add_body(moved_body("far", kMostSpeed_mps)).value();
  world_.round(*mover_, 5, {{far_, flying({1, 0, 0}, {}, 0)}});
  world_.bus.tell_of_mover(kMover, wire::Mover::kThere);  // of this one
  EXPECT_EQ(watch(5).answers[0].reason,
            "body far is known by a promise alone, its full poses are asked for");
}

TEST_F(Promises, OfAStrangerAboutAnOwnBodyAreIgnored) {
  fly(0, flying({50'000, 0, 0}, {}, 0));
  auto stranger = join(0xdd);
  const BodyId false_own = stranger->add_body(moved_body("own", 10)).value();
  world_.round(*stranger, 1, {{false_own, flying({1e6, 0, 0}, {}, 0)}});
  world_.complaints.clear();
  const FrameReport report = watch(1);
  EXPECT_EQ(report.free_by_bounds.pairs, 1U);
  EXPECT_EQ(
      world_.complaints,
      (std::vector<std::string>{"another peer also moves body own; its promises are ignored"}));
}

TEST_F(Promises, OptionsThatMakeNoneAreRefused) {
  for (const double speed : {-1.0, std::numeric_limits<double>::quiet_NaN(),
                             std::numeric_limits<double>::infinity(), 2e6}) {
    BodyOptions options = moved_body("bad", speed);
    EXPECT_EQ(mover_->add_body(options).status().code(), StatusCode::kInvalidArgument) << speed;
  }
  EXPECT_EQ(
      mover_->add_body({.name = "bad", .model = "aircraft", .max_speed_mps = 5}).status().code(),
      StatusCode::kInvalidArgument);
}

TEST_F(Promises, OwnPairsAreThoseOfOwnBodies) {
  const BodyId second = mover_->add_body(moved_body("second", kMostSpeed_mps)).value();
  mover_->watch_own();
  mover_->discover_bodies();
  FrameReport of_mover, of_watcher;
  for (std::uint64_t frame = 0; frame < 3; ++frame) {
    of_mover = world_.round(
        *mover_, frame,
        {{far_, flying({50'000, 0, 0}, {}, 0)}, {second, flying({0, 50'000, 0}, {}, 0)}});
    of_watcher = watch(frame);
  }
  EXPECT_EQ(of_watcher.free_by_bounds.pairs, 2U);  // "own" with both, not these two
  EXPECT_EQ(of_mover.free_by_bounds.pairs, 3U);
  watcher_->watch_all();
  EXPECT_EQ(watch(3).free_by_bounds.pairs, 3U);
}

/// Whatever is lost, late, or in another order: what is free is free.
TEST(PromisesUnderFaults, EveryPairThatIsFreeByThemIsFreeOfTheFullMeshes) {
  std::uint64_t by_promise = 0, near = 0, certified = 0, unknown = 0;
  for (int seed = 1; seed <= test::rounds(3); ++seed) {
    Random random(static_cast<std::uint64_t>(seed));
    World world(static_cast<std::uint64_t>(seed));
    world.judges = false;
    world.start_publisher();
    world.bus.on_promises = {.lose = 0.4, .repeat = 0.1, .max_delay = 120};
    SessionOptions options = test::quick_options();
    options.promise_s = 2;
    options.lookahead_s = 0.1;
    constexpr std::size_t kCount = 8;
    constexpr double kMost_mps = 60;
    Session mover(world.bus.make_peer(kMover), options),
        watcher(world.bus.make_peer(kWatcher), options);
    watcher.watch_own();
    watcher.discover_bodies();
    const auto fly_off = [&] {
      Motion motion;
      for (double& x : motion.pose.translation_m) x = random.between(-150, 150);
      motion.pose.rotation = test::random_rotation(random);
      return motion;
    };
    const auto turn_off = [&](Motion& motion) {
      for (double& v : motion.linear_velocity_mps) v = random.between(-34, 34);
      for (double& w : motion.angular_velocity_radps) w = random.between(-3, 3);
    };
    struct Flown {
      std::string name;
      BodyId id;
      Motion motion;
    };
    std::vector<Flown> flown;
    std::uint64_t visits = 0;
    const auto spawn = [&] {
      const std::string name = "a" + std::to_string(++visits);
      Flown one{
          name,
          mover
              .add_body(
                  {.name = name, .model = "aircraft", .own = true, .max_speed_mps = kMost_mps})
              .value(),
          fly_off()};
      turn_off(one.motion);
      return one;
    };
    for (std::size_t i = 0; i < kCount; ++i) flown.push_back(spawn());
    Motion own;
    const BodyId own_id =
        watcher.add_body({.name = "own", .model = "aircraft", .own = true}).value();
    for (std::uint64_t frame = 0; frame < 160; ++frame) {
      std::vector<Session::OwnMotion> motions;
      for (Flown& one : flown) {
        // A jump is another body, told once the first is gone.
        if (random.unit() < 0.01) {
          ASSERT_TRUE(mover.remove_body(one.id).is_ok());
          one = spawn();
        }
        motions.push_back({one.id, one.motion});
      }
      world.round(mover, frame, motions);
      own.pose.translation_m = {20 * std::sin(0.02 * static_cast<double>(frame)), 0, 0};
      FrameReport report;
      for (int round = 0; round < 8; ++round)
        report = world.round(watcher, frame,
                             round == 0 ? std::vector<Session::OwnMotion>{{own_id, own}}
                                        : std::vector<Session::OwnMotion>{});
      by_promise += report.promised;
      unknown += report.unknown_pairs;
      // World::round ticks, so a promise may have come meanwhile: the report is of the last.
      std::set<std::string> not_known;
      for (const auto& body : report.unknown) not_known.insert(watcher.name_of(body.body));
      std::set<std::string> known;
      for (std::uint32_t id = 1; id <= visits; ++id)
        if (const std::string name = watcher.name_of(BodyId{id}); !name.empty()) known.insert(name);
      for (const Flown& one : flown) {
        if (!known.contains(one.name) || not_known.contains(one.name)) continue;
        const PairAnswer* answer = nullptr;
        for (const PairAnswer& listed : report.answers)
          if (watcher.name_of(listed.a) == one.name || watcher.name_of(listed.b) == one.name)
            answer = &listed;
        if (answer != nullptr) {
          ++near;
          if (!is_certified(answer->answer.status)) continue;
          ++certified;
          ASSERT_EQ((answer->a == own_id ? answer->pose_b : answer->pose_a).translation_m,
                    one.motion.pose.translation_m);
          continue;
        }
        const test::FullModel& full = test::aircraft().full;
        const auto posed = pose_pair(full.tree.grid, own.pose, "own", full.tree.grid,
                                     orthonormal(one.motion.pose), "other");
        ASSERT_TRUE(posed.is_ok());
        const Answer truth = query(full.tree.view(), posed.value().a, full.tree.view(),
                                   posed.value().b, {.clearance = Clearance::kExact});
        ASSERT_EQ(truth.status, AnswerStatus::kFree) << "seed " << seed << ", frame " << frame;
        ASSERT_LE(report.free_by_bounds.clearance_m, truth.clearance_m);
      }
      for (Flown& one : flown) {
        one.motion.pose = test::moved(one.motion, kPromiseFrame_s);
        for (std::size_t k = 0; k < 3; ++k)  // back into the room
          if (std::abs(one.motion.pose.translation_m[k]) > 200)
            one.motion.linear_velocity_mps[k] =
                -std::copysign(30.0, one.motion.pose.translation_m[k]);
        if (random.unit() < 0.05) turn_off(one.motion);
      }
    }
  }
  std::printf("bodies by promise: %llu, listed: %llu (%llu certified), unknown: %llu\n",
              static_cast<unsigned long long>(by_promise), static_cast<unsigned long long>(near),
              static_cast<unsigned long long>(certified), static_cast<unsigned long long>(unknown));
  EXPECT_GT(by_promise, 200U);
  EXPECT_GT(certified, 150U);
  EXPECT_GT(unknown, 20U);
}

}  // namespace
}  // namespace nearmesh
