// SPDX-License-Identifier: Apache-2.0
// How old a pose may be that an answer rests on, by the exercise's clock; and who moves a body and
// is there no more.

#include "local_host.hpp"
#include "nearmesh/subscriber/peer/wait_ready.hpp"
#include "world.hpp"

namespace nearmesh::test {
namespace {

constexpr wire::SessionId kMover = 0xb2, kListener = 0xb3;
constexpr double kFrame_s = 0.05;  ///< as World::round has it
/// The pairs of World::make_peer's peers.
constexpr std::size_t kGroundOne = 0, kGroundTwo = 1, kOneTwo = 2;

bool is_sure(const FrameReport& report, std::size_t pair) {
  return is_certified(report.answers.at(pair).answer.status);
}

/// One peer moves "one" and may die; the other moves "two" and watches.
class MovedByAnother : public ::testing::Test {
 protected:
  MovedByAnother() { world_.start_publisher(); }

  void join(SessionOptions options = quick_options()) {
    mover_ = world_.make_peer(options, kMover, true, false);
    watcher_ = world_.make_peer(options, kPeer, false, true);
  }
  /// All that the watcher is asked at the end of frames [first, last).
  std::vector<FrameReport> fly(std::size_t first, std::size_t last) {
    std::vector<FrameReport> reports;
    for (std::size_t i = first; i < last; ++i) {
      const std::size_t at = std::min(i, flight_.frames() - 1);
      if (mover_ != nullptr) world_.round(*mover_, i, {{kOne, flight_.one[at]}});
      for (int round = 0; round < 20; ++round) {
        const std::vector<Session::OwnMotion> own{{kTwo, flight_.two[at]}};
        reports.push_back(
            world_.round(*watcher_, i, round == 0 ? own : std::vector<Session::OwnMotion>{}));
        if (reports.back().all_certified() || round == 19) break;
        reports.pop_back();
      }
    }
    return reports;
  }

  World world_;
  Flight flight_ = make_flight(7, 10);
  std::unique_ptr<Session> mover_, watcher_;
};

TEST_F(MovedByAnother, KilledItGetsNoCertifiedAnswerAfterTheLimit) {
  join();
  constexpr std::size_t kKilled = 30, kFrames = kKilled + 320;  // 16 s
  const std::vector<FrameReport> alive = fly(0, kKilled);
  EXPECT_GT(std::count_if(alive.begin(), alive.end(),
                          [](const FrameReport& r) { return is_sure(r, kOneTwo); }),
            20);
  world_.bus.keep_quiet = true;  // nobody tells of it
  mover_.reset();
  const std::vector<FrameReport> reports = fly(kKilled, kFrames);
  int sure_before = 0, sure_after = 0, sure_of_others = 0;
  for (std::size_t i = 0; i < reports.size(); ++i) {
    const std::size_t frame = kKilled + i;
    const double age_s =
        static_cast<double>(frame) * kFrame_s - static_cast<double>(kKilled - 1) * kFrame_s;
    for (const std::size_t pair : {kGroundOne, kOneTwo}) {
      const PairAnswer& answer = reports[i].answers[pair];
      EXPECT_EQ(answer.a == kOne ? answer.age_a_s : answer.age_b_s, age_s);
      (age_s <= 2 ? sure_before : sure_after) += is_sure(reports[i], pair) ? 1 : 0;
      if (age_s > 2) {
        EXPECT_NE(answer.reason.find("the pose of body one is "), std::string::npos);
        EXPECT_NE(answer.reason.find(" s old, more than 2 s"), std::string::npos) << answer.reason;
        EXPECT_FALSE(answer.asked);
        EXPECT_TRUE(std::isinf(answer.answer.uncertainty_m));
      }
    }
    sure_of_others += is_sure(reports[i], kGroundTwo) ? 1 : 0;
  }
  EXPECT_GT(sure_before, 40);
  EXPECT_EQ(sure_after, 0);
  EXPECT_GT(sure_of_others, 300);
}

TEST_F(MovedByAnother, WhatHasLeftIsUncertainAtOnceAndCertifiedWhenItIsBack) {
  join();
  ASSERT_TRUE(is_sure(fly(0, 10).back(), kOneTwo));
  mover_.reset();
  const FrameReport gone = world_.round(*watcher_, 9);
  for (const std::size_t pair : {kGroundOne, kOneTwo})
    EXPECT_EQ(gone.answers[pair].reason, "the peer that moves body one has left");
  EXPECT_TRUE(is_sure(gone, kGroundTwo));
  mover_ = world_.make_peer(quick_options(), kMover + 5, true, false);
  EXPECT_TRUE(is_sure(fly(10, 12).back(), kOneTwo));
}

TEST_F(MovedByAnother, WhatIsSilentIsUncertainUntilItGivesASignOfLife) {
  join();
  ASSERT_TRUE(is_sure(fly(0, 10).back(), kOneTwo));
  world_.bus.tell_of_mover(kMover, wire::Mover::kSilent);
  const FrameReport silent = world_.round(*watcher_, 9);
  for (const std::size_t pair : {kGroundOne, kOneTwo})
    EXPECT_EQ(silent.answers[pair].reason, "the peer that moves body one gives no sign of life");
  world_.bus.tell_of_mover(kMover, wire::Mover::kThere);
  EXPECT_TRUE(is_sure(world_.round(*watcher_, 9), kOneTwo));
}

// A host that took nothing for long is told of all movers that are there, not of each that came and
// went.
TEST_F(MovedByAnother, WhoIsNotAmongAllMoversThatAreThereHasLeft) {
  join();
  ASSERT_TRUE(is_sure(fly(0, 10).back(), kOneTwo));
  world_.bus.inbox_of(kPeer).are_all_movers = true;
  world_.bus.inbox_of(kPeer).movers["one"] = wire::Mover::kThere;
  EXPECT_TRUE(is_sure(world_.round(*watcher_, 9), kOneTwo));
  world_.bus.inbox_of(kPeer).are_all_movers = true;
  const FrameReport gone = world_.round(*watcher_, 9);
  for (const std::size_t pair : {kGroundOne, kOneTwo})
    EXPECT_EQ(gone.answers[pair].reason, "the peer that moves body one has left");
  EXPECT_TRUE(is_sure(gone, kGroundTwo));
  EXPECT_TRUE(is_sure(fly(10, 12).back(), kOneTwo));
}

TEST_F(MovedByAnother, AtRestItStaysCertifiedForAMinute) {
  join();
  const auto listener = world_.bus.make_peer(kListener);
  const Motion rest = above_ground(800, 30);
  std::size_t sure = 0, said = 0;
  double oldest_s = 0;
  constexpr std::size_t kFrames = 1200;
  for (std::size_t i = 0; i < kFrames; ++i) {
    world_.round(
        *mover_, i,
        i == 0 ? std::vector<Session::OwnMotion>{{kOne, rest}} : std::vector<Session::OwnMotion>{});
    FrameReport report = world_.round(*watcher_, i);
    for (int more = 0; i == 0 && more < 100 && !is_sure(report, kGroundOne); ++more)
      report = world_.round(*watcher_, i);
    sure += is_sure(report, kGroundOne) ? 1 : 0;
    oldest_s = std::max(oldest_s, report.answers[kGroundOne].age_b_s);
    said += listener->take().poses.size();
  }
  EXPECT_EQ(sure, kFrames);
  EXPECT_LT(oldest_s, 0.51);
  EXPECT_EQ(said, 120U);  // two a second
}

// A pose is heard by who is there: whoever joins waits for the next, however old a pose may be.
TEST_F(MovedByAnother, AtRestItIsKnownSoonToWhoJoins) {
  SessionOptions options = quick_options();
  options.max_pose_age_s = 3600;
  join(options);
  const Motion rest = above_ground(800, 30);
  for (std::size_t i = 0; i < 41; ++i)
    world_.round(
        *mover_, i,
        i == 0 ? std::vector<Session::OwnMotion>{{kOne, rest}} : std::vector<Session::OwnMotion>{});
  const auto late = world_.bus.make_peer(kListener);
  std::size_t heard = 0;
  for (std::size_t i = 41; i < 51; ++i) {  // half a second
    world_.round(*mover_, i);
    heard += late->take().poses.size();
  }
  EXPECT_EQ(heard, 1U);
}

TEST_F(MovedByAnother, ItsTimeGoesBackNoMoreThanOnceInSilence) {
  join();
  ASSERT_TRUE(is_sure(fly(0, 60).back(), kGroundOne));
  const wire::BodyPose early{.peer = kMover, .body = "one", .time_s = 0.5};
  for (int i = 0; i < 3; ++i) {
    world_.bus.inject(early);
    const FrameReport report = world_.round(*watcher_, 59);
    EXPECT_EQ(report.answers[kGroundOne].age_b_s, 59 * kFrame_s - 0.5);  // the last word counts
    EXPECT_FALSE(is_sure(report, kGroundOne));
  }
  EXPECT_EQ(std::count_if(world_.complaints.begin(), world_.complaints.end(),
                          [](const std::string& line) {
                            return line.find("the time of body one's poses went back from 2.95") !=
                                   std::string::npos;
                          }),
            1);
}

/// A body that another moves, by a host's own word.
class PoseOf : public ::testing::Test {
 protected:
  void make(std::optional<double> body_limit_s = {}, SessionOptions options = {}) {
    host_ = std::make_unique<LocalHost>(options);
    const auto body = host_->session->add_body(
        {.name = "other", .model = "aircraft", .max_pose_age_s = body_limit_s});
    ASSERT_TRUE(body.is_ok());
    ASSERT_TRUE(host_->session->watch(kGround, body.value()).is_ok());
  }
  void deliver(double time_s, const Motion& motion = above_ground(800, 89)) {
    wire::BodyPose pose{.peer = 7, .body = "other", .time_s = time_s, .pose = motion.pose};
    pose.linear_velocity_mps = motion.linear_velocity_mps;
    ASSERT_TRUE(host_->channel->deliver(pose).is_ok());
  }
  PairAnswer at(double time_s, const std::vector<Session::OwnMotion>& own = {}) {
    FrameReport report;
    for (int i = 0; i < 20 && (i == 0 || !report.all_certified()); ++i) {
      auto updated = host_->session->update(1, time_s, i == 0 ? own : no_motions_, 1);
      EXPECT_TRUE(updated.is_ok()) << updated.status().message();
      report = std::move(updated).value();
      complaints_.insert(complaints_.end(), report.complaints.begin(), report.complaints.end());
      host_->judge.check(report);
    }
    return report.answers.back();
  }

  std::unique_ptr<LocalHost> host_;
  std::vector<std::string> complaints_;
  const std::vector<Session::OwnMotion> no_motions_;
};

TEST_F(PoseOf, HeardOnceAnHourAgoAndFallingIsUncertain) {
  make();
  Motion falling = above_ground(800, 89);
  falling.linear_velocity_mps = {0, 0, -9.81};
  deliver(0, falling);
  EXPECT_EQ(at(0).answer.status, AnswerStatus::kFree);
  const PairAnswer later = at(3600);
  EXPECT_EQ(later.answer.status, AnswerStatus::kUncertain);
  EXPECT_EQ(later.reason, "the pose of body other is 3600 s old, more than 2 s");
  EXPECT_EQ(later.age_b_s, 3600);
  EXPECT_EQ(later.age_a_s, 0);  // in place
  EXPECT_EQ(later.safe_horizon_s, 0);
}

TEST_F(PoseOf, LimitsAreInclusiveAndOfSessionAndBody) {
  make();
  deliver(10);
  EXPECT_TRUE(is_certified(at(12).answer.status));
  EXPECT_FALSE(is_certified(at(12.01).answer.status));
  make({}, {.max_pose_age_s = 0.5});
  deliver(10);
  EXPECT_TRUE(is_certified(at(10.5).answer.status));
  EXPECT_FALSE(is_certified(at(10.6).answer.status));
  make(7, {.max_pose_age_s = 0.5});
  deliver(10);
  EXPECT_TRUE(is_certified(at(17).answer.status));
  EXPECT_FALSE(is_certified(at(17.1).answer.status));
  for (const double limit_s : {-1.0, std::numeric_limits<double>::quiet_NaN()}) {
    const auto refused =
        host_->session->add_body({.name = "bad", .model = "aircraft", .max_pose_age_s = limit_s});
    EXPECT_EQ(refused.status().code(), StatusCode::kInvalidArgument);
    EXPECT_NE(refused.status().message().find("body bad: max_pose_age_s"), std::string::npos);
  }
}

TEST_F(PoseOf, OfTheFutureIsHeldToTheSameLimit) {
  make();
  deliver(11.5);
  const PairAnswer near = at(10);
  EXPECT_TRUE(is_certified(near.answer.status));
  EXPECT_EQ(near.age_b_s, -1.5);
  deliver(12.5);
  EXPECT_EQ(at(10).reason,
            "the pose of body other is 2.5 s ahead of the frame's time, more than 2 s");
  EXPECT_EQ(host_->session->heard_time_s(), 12.5);
}

// Whoever goes on from what is heard would be past all times for ever, by one word of anybody's.
TEST_F(PoseOf, ATimeThatNoExerciseHasIsNotToBeFollowed) {
  make();
  deliver(12.5);
  static_cast<void>(at(10));
  for (const double strange_s : {0.999 * wire::kMaxTime_s, 2 * wire::kMaxFollowed_s}) {
    deliver(strange_s);
    EXPECT_FALSE(is_certified(at(10).answer.status));
    EXPECT_EQ(host_->session->heard_time_s(), 12.5);
  }
  EXPECT_EQ(host_->session->stats().strange_times, 2U);
  deliver(wire::kMaxFollowed_s);
  static_cast<void>(at(10));
  EXPECT_EQ(host_->session->heard_time_s(), wire::kMaxFollowed_s);
}

TEST_F(PoseOf, AnOwnBodyIsOfNowAtRestAndAgesInMotion) {
  make();
  const BodyId own =
      host_->session->add_body({.name = "own", .model = "aircraft", .own = true}).value();
  const BodyId strict =
      host_->session
          ->add_body({.name = "strict", .model = "aircraft", .own = true, .max_pose_age_s = 1})
          .value();
  ASSERT_TRUE(host_->session->watch(own, strict).is_ok());
  Motion rest = above_ground(800, 100), away = above_ground(800, 300);
  EXPECT_EQ(at(0, {{own, rest}, {strict, away}}).age_a_s, 0);
  EXPECT_EQ(at(100).age_a_s, 0);
  EXPECT_EQ(at(100).age_b_s, 0);
  rest.linear_velocity_mps = away.linear_velocity_mps = {1, 0, 0};
  EXPECT_EQ(at(100, {{own, rest}, {strict, away}}).age_a_s, 0);
  const PairAnswer soon = at(101);
  EXPECT_EQ(soon.age_a_s, 1);
  EXPECT_TRUE(is_certified(soon.answer.status));
  EXPECT_EQ(at(101.5).reason, "the pose of body strict is 1.5 s old, more than 1 s");
}

TEST_F(PoseOf, ASafeHorizonCountsFromThePose) {
  make();
  Motion falling = above_ground(800, 89);
  falling.linear_velocity_mps = {0, 0, -5};
  deliver(10, falling);
  const double at_once_s = at(10).safe_horizon_s;
  ASSERT_GT(at_once_s, 1.6);
  EXPECT_NEAR(at(11.5).safe_horizon_s, at_once_s - 1.5, 1e-9);
  EXPECT_LE(at(11.5).safe_horizon_s, at_once_s - 1.5);
  // A pose of the future: it may have been as far off as that in the meantime.
  EXPECT_LE(at(9.5).safe_horizon_s, at_once_s - 0.5 + 1e-9);
  // And it holds: what falls for so long after the frame touches nothing, a little longer and it
  // does.
  const PairAnswer answer = at(11.5);
  const auto touches = [&](double after_s) {
    return !host_->judge.touching(answer, {}, pose_at(falling, 1.5 + after_s)).empty();
  };
  for (int i = 1; i <= 100; ++i) EXPECT_FALSE(touches(answer.safe_horizon_s * i / 100));
  // Aged beyond all clearance it is 0, not less.
  make(1000);
  deliver(10, falling);
  EXPECT_EQ(at(200).safe_horizon_s, 0);
}

TEST_F(PoseOf, ASweptAnswerCountsFromTheFrame) {
  make({}, {.sweep_s = 8});
  Motion falling = above_ground(800, 89);
  falling.linear_velocity_mps = {0, 0, -20};
  deliver(10, falling);
  const auto settled = [&](double time_s) {
    PairAnswer answer;
    for (int i = 0; i < 50; ++i) answer = at(time_s);
    return answer;
  };
  const PairAnswer fresh = settled(10), aged = settled(11.5);
  ASSERT_TRUE(fresh.swept && aged.swept);
  ASSERT_EQ(fresh.swept->status, AnswerStatus::kContact);
  ASSERT_EQ(aged.swept->status, AnswerStatus::kContact);
  EXPECT_NEAR(aged.swept->hit_s, fresh.swept->hit_s - 1.5, 0.01);
  const auto touches = [&](double after_s) {
    return !host_->judge.touching(aged, {}, pose_at(falling, 1.5 + after_s)).empty();
  };
  EXPECT_TRUE(touches(aged.swept->hit_s));
  for (int i = 0; i < 100; ++i) EXPECT_FALSE(touches(aged.swept->free_until_s * i / 100));
}

TEST_F(PoseOf, WhoWaitsFollowsTheTimeOfOthers) {
  make();
  deliver(100);
  const auto waited = subscriber::wait_ready(*host_->session, kOne, 100);
  ASSERT_TRUE(waited.is_ok());
  EXPECT_EQ(waited.value().readiness.stage, subscriber::ReadyStage::kCertified)
      << waited.value().readiness.reason;
  EXPECT_EQ(waited.value().report.answers[0].age_b_s, 0);
}

TEST_F(PoseOf, TimeThatGoesBackOrCountsNanosecondsIsToldOf) {
  make();
  deliver(10);
  EXPECT_TRUE(is_certified(at(10).answer.status));
  EXPECT_TRUE(complaints_.empty()) << complaints_.front();
  EXPECT_FALSE(is_certified(at(5).answer.status));
  ASSERT_EQ(complaints_.size(), 1U);
  EXPECT_NE(complaints_[0].find("time_s of frame 1 is 5.0"), std::string::npos) << complaints_[0];
  EXPECT_NE(complaints_[0].find("the exercise's clock went back"), std::string::npos);
  EXPECT_FALSE(host_->session->update(2, 1.8e18, {}, 1).is_ok());
}

}  // namespace
}  // namespace nearmesh::test
