// SPDX-License-Identifier: Apache-2.0
// Whom an update asks within its budget, and what is said of the others. No test but one depends on
// how long anything takes: a budget of 0 asks one pair, an infinite one all.
#include <algorithm>
#include <cmath>
#include <map>
#include <thread>

#include "core/query/answer.hpp"
#include "local_host.hpp"
#include "random_rotation.hpp"

namespace nearmesh::test {
namespace {

using subscriber::LastCertified;
using subscriber::Readiness;
using subscriber::ReadyStage;

/// No bound of these is kept: each pair is asked, or put off, unless both bodies lie still.
const SessionOptions kAsksAll{.lookahead_s = 0, .clearance = Clearance::kExact};
constexpr double kNoBudget = 0, kAllTime = std::numeric_limits<double>::infinity();

/// Aircraft of a local session, all pairs watched by name.
class Squadron {
 public:
  explicit Squadron(std::uint32_t count, SessionOptions options = {.lookahead_s = 0}) {
    auto channel = std::make_unique<LocalChannel>();
    EXPECT_TRUE(channel->add_model("aircraft", aircraft().open()).is_ok());
    session = std::make_unique<Session>(std::move(channel), options);
    for (std::uint32_t i = 0; i < count; ++i) {
      const std::string name = "a" + std::to_string(i);
      motions.push_back(
          {session->add_body({.name = name, .model = "aircraft", .own = true}).value(), {}});
      for (std::uint32_t j = 0; j < i; ++j)
        EXPECT_TRUE(session->watch(motions[j].body, motions[i].body).is_ok());
    }
  }
  FrameReport update(double budget_s) {
    const double time_s = 0.05 * static_cast<double>(frame_);
    Result<FrameReport> report = session->update(frame_++, time_s, motions, budget_s);
    EXPECT_TRUE(report.is_ok()) << report.status().message();
    return std::move(report).value();
  }
  void move() {
    for (auto& [body, motion] : motions) motion.pose = pose_at(motion, 0.05);
  }
  /// Where they are, but not for good.
  void stir() {
    for (auto& [body, motion] : motions) motion.linear_velocity_mps[2] = 1e-3;
  }
  void settle() {
    for (int i = 0; i < 50; ++i)
      if (update(kAllTime).all_certified()) return;
    ADD_FAILURE() << "not certified";
  }

  std::unique_ptr<Session> session;
  std::vector<Session::OwnMotion> motions;

 private:
  std::uint64_t frame_ = 0;
};

/// In a heap, some touching, each on a way of its own.
void scatter(Squadron& squadron, std::uint64_t seed, double side_m) {
  Random random(seed);
  for (auto& [body, motion] : squadron.motions) {
    motion.pose.rotation = random_rotation(random);
    for (std::size_t k = 0; k < 3; ++k) {
      motion.pose.translation_m[k] = random.between(0, side_m);
      motion.linear_velocity_mps[k] = random.between(-20, 20);
      motion.angular_velocity_radps[k] = random.between(-1, 1);
    }
  }
}

std::vector<const PairAnswer*> asked_of(const FrameReport& report) {
  std::vector<const PairAnswer*> asked;
  for (const PairAnswer& answer : report.answers)
    if (answer.asked) asked.push_back(&answer);
  return asked;
}

TEST(Budget, WhatIsNotAskedSaysSoAndIsNeverCertified) {
  Squadron squadron(5);
  scatter(squadron, 1, 60);
  for (int frame = 0; frame < 30; ++frame) {
    squadron.move();
    const FrameReport report = squadron.update(kNoBudget);
    EXPECT_EQ(asked_of(report).size(), 1U);
    EXPECT_EQ(report.pairs_put_off, report.answers.size() - 1);
    EXPECT_FALSE(report.all_certified());
    for (const PairAnswer& answer : report.answers) {
      EXPECT_NE(answer.asked, answer.put_off);
      if (answer.asked) {
        EXPECT_FALSE(answer.last_certified);
        continue;
      }
      EXPECT_EQ(answer.reason, "out of budget");
      EXPECT_EQ(digest(answer.answer), digest(nothing_known()));
      EXPECT_EQ(answer.safe_horizon_s, 0);
      EXPECT_FALSE(answer.contacts || answer.swept);
      const Readiness readiness = squadron.session->readiness(answer.a).value();
      EXPECT_EQ(readiness.stage, ReadyStage::kAnswering);
    }
  }
}

TEST(Budget, NoPairStarves) {
  Squadron squadron(8);
  scatter(squadron, 2, 60);
  std::map<std::pair<BodyId, BodyId>, int> waited;
  int longest = 0;
  for (int frame = 0; frame < 400; ++frame) {
    squadron.move();
    for (const PairAnswer& answer : squadron.update(kNoBudget).answers) {
      int& wait = waited[{answer.a, answer.b}];
      wait = answer.asked ? 0 : wait + 1;
      longest = std::max(longest, wait);
    }
  }
  EXPECT_EQ(waited.size(), 28U);
  EXPECT_LE(longest, 28 + 16 + 2);
}

// A pair that was cheap and takes many budgets now. Its time is the machine's, so in some rounds it
// may be asked at once.
TEST(Budget, WhatTakesLongerThanExpectedIsCutShortOnceAndThenAskedToItsEnd) {
  SessionOptions options = kAsksAll;
  options.contacts = options.depth = true;
  Squadron squadron(2, options);
  squadron.stir();
  const auto update_at = [&](double way_m, double budget_s) {
    squadron.motions[1].motion.pose.translation_m = {way_m, 0.3, 0.1};
    return squadron.update(budget_s);
  };
  const auto pair_of = [&](const FrameReport& report) -> const PairAnswer& {
    return *report.find(squadron.motions[0].body, squadron.motions[1].body);
  };
  FrameReport deep = update_at(1, kAllTime);
  for (int i = 0; i < 50 && !deep.all_certified(); ++i) deep = update_at(1, kAllTime);
  ASSERT_EQ(pair_of(deep).answer.status, AnswerStatus::kContact);
  deep = update_at(1, kAllTime);
  int cut_short = 0;
  for (int round = 0; round < 30; ++round) {
    for (int i = 0; i < 10; ++i) update_at(60, kAllTime);
    const FrameReport first = update_at(1, deep.query_s / 4);
    EXPECT_NE(pair_of(first).asked, pair_of(first).put_off);
    if (pair_of(first).asked) continue;
    ++cut_short;
    EXPECT_EQ(pair_of(first).reason, "out of budget");
    EXPECT_EQ(digest(pair_of(first).answer), digest(nothing_known()));
    EXPECT_FALSE(pair_of(first).contacts || pair_of(first).depth);
    const FrameReport second = update_at(1, deep.query_s / 4);
    ASSERT_TRUE(pair_of(second).asked);
    EXPECT_EQ(digest(pair_of(second).answer), digest(pair_of(deep).answer));
    EXPECT_EQ(pair_of(second).depth->at_least_m, pair_of(deep).depth->at_least_m);
  }
  EXPECT_GT(cut_short, 0);
}

TEST(Budget, WhoMayTouchSoonestIsAskedFirst) {
  // One in the middle, the others around it; the nearer, the sooner, and at last another one comes
  // fast.
  Squadron squadron(5, kAsksAll);
  for (std::size_t i = 1; i < 5; ++i) {
    squadron.motions[i].motion.pose.translation_m[0] =
        (i % 2 == 0 ? 200.0 : -200.0) * static_cast<double>(i);
    squadron.motions[i].motion.linear_velocity_mps[0] = i % 2 == 0 ? -0.5 : 0.5;
  }
  const auto is_of_middle = [&](const PairAnswer& answer) {
    return answer.a == squadron.motions[0].body;
  };
  squadron.settle();
  squadron.update(kAllTime);
  // Nobody is due: the one that is 200 m away may touch soonest.
  const FrameReport calm = squadron.update(kNoBudget);
  ASSERT_EQ(asked_of(calm).size(), 1U);
  EXPECT_TRUE(is_of_middle(*asked_of(calm)[0]));
  EXPECT_EQ(asked_of(calm)[0]->b, squadron.motions[1].body);
  squadron.motions[3].motion.linear_velocity_mps[0] = 5000;
  const FrameReport alarm = squadron.update(kNoBudget);
  ASSERT_EQ(asked_of(alarm).size(), 1U);
  EXPECT_TRUE(is_of_middle(*asked_of(alarm)[0]) ||
              asked_of(alarm)[0]->b == squadron.motions[3].body);
  EXPECT_TRUE(asked_of(alarm)[0]->b == squadron.motions[3].body ||
              asked_of(alarm)[0]->a == squadron.motions[3].body);
}

// What boxes and bounds of then prove costs no turn.
TEST(Budget, WhatStaysFreeByItsBoundIsAnsweredWithoutATurn) {
  Squadron squadron(4);
  for (std::size_t i = 0; i < 4; ++i) {
    squadron.motions[i].motion.pose.translation_m[0] = 300.0 * static_cast<double>(i);
    squadron.motions[i].motion.linear_velocity_mps[1] = static_cast<double>(i);
  }
  squadron.settle();
  for (int frame = 0; frame < 20; ++frame) {
    squadron.move();
    const FrameReport report = squadron.update(kNoBudget);
    EXPECT_TRUE(report.all_certified());
    EXPECT_EQ(report.pairs_put_off, 0U);
    for (const PairAnswer& answer : report.answers) {
      EXPECT_TRUE(answer.asked);
      EXPECT_EQ(answer.answer.stats.box_tests, 0U);
      EXPECT_GT(answer.answer.clearance_m, 50);
    }
  }
  for (auto& [body, motion] : squadron.motions) motion.pose.translation_m[0] *= 0.5;
  EXPECT_EQ(squadron.update(kNoBudget).pairs_put_off, 5U);
}

TEST(Budget, WhatIsNewIsAskedBeforeWhatIsFree) {
  Squadron squadron(4, kAsksAll);
  squadron.stir();
  for (std::size_t i = 0; i < 4; ++i)
    squadron.motions[i].motion.pose.translation_m[0] = 300.0 * static_cast<double>(i);
  squadron.settle();
  const BodyId late =
      squadron.session->add_body({.name = "late", .model = "aircraft", .own = true}).value();
  ASSERT_TRUE(squadron.session->watch(squadron.motions[0].body, late).is_ok());
  squadron.motions.push_back({late, {}});
  squadron.motions.back().motion.pose.translation_m[1] = 500;
  const FrameReport report = squadron.update(kNoBudget);
  ASSERT_EQ(asked_of(report).size(), 1U);
  EXPECT_EQ(asked_of(report)[0]->b, late);
}

TEST(Budget, AnswersThatWereAskedAreThoseOfASessionWithoutOne) {
  const SessionOptions options{.lookahead_s = 0, .sweep_s = 0.2, .contacts = true};
  Squadron hurried(5, options), patient(5, options);
  int compared = 0;
  for (const std::uint64_t seed : {3U, 4U}) {
    for (Squadron* squadron : {&hurried, &patient}) scatter(*squadron, seed, 60);
    // The same detail on both sides: they fly it all once with time.
    for (const bool is_hurried : {false, true}) {
      const auto begin = hurried.motions;
      for (int frame = 0; frame < 20; ++frame) {
        for (Squadron* squadron : {&hurried, &patient}) squadron->move();
        if (!is_hurried)
          for (int i = 0; i < 6; ++i) {
            hurried.update(kAllTime);
            patient.update(kAllTime);
          }
        const FrameReport some = hurried.update(is_hurried ? kNoBudget : kAllTime),
                          all = patient.update(kAllTime);
        ASSERT_EQ(some.state_digest, all.state_digest);
        for (std::size_t i = 0; i < some.answers.size(); ++i) {
          const PairAnswer &one = some.answers[i], &two = all.answers[i];
          if (!one.asked) continue;
          ++compared;
          EXPECT_EQ(digest(one.answer), digest(two.answer));
          EXPECT_EQ(one.answer.clearance_m, two.answer.clearance_m);
          EXPECT_EQ(one.safe_horizon_s, two.safe_horizon_s);
          ASSERT_EQ(one.contacts.has_value(), two.contacts.has_value());
          if (one.contacts) {
            EXPECT_EQ(one.contacts->patches.size(), two.contacts->patches.size());
          }
          ASSERT_TRUE(one.swept && two.swept);
          EXPECT_EQ(one.swept->free_until_s, two.swept->free_until_s);
          EXPECT_EQ(one.swept->hit_s, two.swept->hit_s);
          EXPECT_EQ(one.swept->status, two.swept->status);
        }
      }
      hurried.motions = patient.motions = begin;
    }
  }
  EXPECT_GT(compared, 400);
}

// What is left of an answer is true of the poses of now, wherever the bodies went meanwhile: also
// of one that is carried off.
TEST(Budget, WhatIsLeftOfTheLastAnswerHolds) {
  Squadron hurried(5), patient(5, {.lookahead_s = 0, .clearance = Clearance::kExact});
  Random random(9);
  int left = 0, safe = 0, carried = 0;
  for (const std::uint64_t seed : {5U, 6U, 7U}) {
    for (Squadron* squadron : {&hurried, &patient}) {
      scatter(*squadron, seed, 150);
      squadron->settle();
    }
    for (int frame = 0; frame < 60; ++frame) {
      for (Squadron* squadron : {&hurried, &patient}) squadron->move();
      if (random.below(20) == 0) {
        const std::uint32_t which = random.below(5);
        const double way_m = random.between(-40, 40);
        for (Squadron* squadron : {&hurried, &patient})
          squadron->motions[which].motion.pose.translation_m[0] += way_m;
        ++carried;
      }
      const FrameReport some = hurried.update(kNoBudget);
      for (int i = 0; i < 8 && !patient.update(kAllTime).all_certified(); ++i) {
      }
      const FrameReport all = patient.update(kAllTime);
      for (std::size_t i = 0; i < some.answers.size(); ++i) {
        if (!some.answers[i].last_certified) continue;
        const LastCertified& last = *some.answers[i].last_certified;
        const Answer& truth = all.answers[i].answer;
        EXPECT_GT(last.age_s, 0);
        if (last.clearance_m > 0 && is_certified(truth.status)) {
          EXPECT_EQ(truth.pair_total, 0U);
          EXPECT_LE(last.clearance_m, truth.clearance_m);
          ++left;
        }
        if (last.safe_s > 0 && is_certified(truth.status)) {
          EXPECT_LE(last.safe_s, all.answers[i].safe_horizon_s);
          ++safe;
        }
        if (last.pair_total > 0) {
          EXPECT_EQ(last.safe_s, 0);
        }
      }
    }
  }
  EXPECT_GT(left, 100);
  EXPECT_GT(safe, 100);
  EXPECT_GT(carried, 3);
}

TEST(Budget, AnotherModelTakesTheLastAnswerAway) {
  Squadron squadron(3, kAsksAll);
  squadron.stir();
  for (std::size_t i = 0; i < 3; ++i)
    squadron.motions[i].motion.pose.translation_m[0] = 300.0 * static_cast<double>(i);
  squadron.settle();
  bool had_one = false;
  for (const PairAnswer& answer : squadron.update(kNoBudget).answers)
    had_one |= answer.last_certified.has_value();
  EXPECT_TRUE(had_one);
  ASSERT_TRUE(squadron.session->replace_model(squadron.motions[0].body, "aircraft").is_ok());
  for (const PairAnswer& answer : squadron.update(kNoBudget).answers)
    if (answer.a == squadron.motions[0].body) {
      EXPECT_FALSE(answer.last_certified);
    }
}

// A host's own order and threads: the most urgent pair is the one that is asked all the same.
TEST(Budget, HoldsWithJobsInAnyOrder) {
  std::vector<std::pair<BodyId, BodyId>> asked[3];
  for (const int how : {0, 1, 2}) {
    SessionOptions options{.lookahead_s = 0};
    if (how == 1)
      options.run_jobs = [](std::size_t count, const std::function<void(std::size_t)>& job) {
        for (std::size_t i = count; i-- > 0;) job(i);
      };
    if (how == 2)
      options.run_jobs = [](std::size_t count, const std::function<void(std::size_t)>& job) {
        for (std::size_t i = 0; i < count; ++i) std::thread(job, i).join();
      };
    Squadron squadron(6, options);
    scatter(squadron, 11, 60);
    for (int frame = 0; frame < 60; ++frame) {
      squadron.move();
      const FrameReport report = squadron.update(kNoBudget);
      for (const PairAnswer* answer : asked_of(report))
        asked[how].emplace_back(answer->a, answer->b);
    }
  }
  EXPECT_EQ(asked[0].size(), 60U);
  EXPECT_EQ(asked[1], asked[0]);
  EXPECT_EQ(asked[2], asked[0]);
}

TEST(Budget, LimitsOfAnAnswerComeFromTheOptions) {
  Squadron whole(2);
  whole.settle();
  const Answer all = whole.update(kAllTime).answers[0].answer;
  ASSERT_GT(all.pair_total, 10U);  // in the same place
  Squadron few(2, {.lookahead_s = 0, .max_pairs = 3});
  few.settle();
  const Answer first = few.update(kAllTime).answers[0].answer;
  EXPECT_EQ(first.pairs, std::vector<FacePair>(all.pairs.begin(), all.pairs.begin() + 3));
  EXPECT_EQ(first.pair_total, all.pair_total);
  Squadron any(2, {.lookahead_s = 0, .any = true});
  any.settle();
  EXPECT_EQ(any.update(kAllTime).answers[0].answer.pair_total, 1U);
  Squadron ended(2, {.lookahead_s = 0, .max_tests = 10});
  for (int i = 0; i < 10; ++i) {
    const FrameReport report = ended.update(kAllTime);
    ASSERT_EQ(report.answers.size(), 1U);
    EXPECT_FALSE(is_certified(report.answers[0].answer.status));
    if (i == 0) continue;
    EXPECT_TRUE(report.answers[0].answer.exhausted);
    EXPECT_TRUE(report.answers[0].reason.empty());
    EXPECT_NE(report.answers[0].awaited.find("ended after 10 tests"), std::string::npos);
    EXPECT_EQ(ended.session->readiness(report.answers[0].a).value().stage, ReadyStage::kAnswering);
  }
}

}  // namespace
}  // namespace nearmesh::test
