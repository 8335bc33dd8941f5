// SPDX-License-Identifier: Apache-2.0
// Bodies that lie where they lay, on the same detail: what was answered of them holds, and is not
// asked again.

#include "local_host.hpp"

namespace nearmesh::test {
namespace {

using subscriber::ContactChange;

constexpr double kNoTime = 0;

/// Whether a pair was answered, and what that took.
bool is_asked_anew(const PairAnswer& answer) {
  EXPECT_TRUE(answer.asked) << answer.reason;
  return answer.answer.stats.box_tests > 0;
}

class Rest : public ::testing::Test {
 protected:
  /// One aircraft in the ground, certified.
  void lay(SessionOptions options) {
    options.contacts = true;
    options.depth = true;
    options.sweep_s = 0.1;
    host = std::make_unique<LocalHost>(options);
    one = host->spawn("one");
    ASSERT_GT(host->settle({{one, lying}}), 0);
    host->update();  // what was there for the time ahead came after the answer
  }
  /// The update after it, without a moment of time.
  PairAnswer next(const std::vector<Session::OwnMotion>& motions = {}) {
    host->time_s += 0.01;
    Result<FrameReport> report =
        host->session->update(100 + frame++, host->time_s, motions, kNoTime);
    EXPECT_TRUE(report.is_ok()) << report.status().message();
    host->judge.check(report.value());
    events = report.value().contact_events;
    return *report.value().find(kGround, one);
  }

  Motion lying = above_ground(300, 1);
  std::unique_ptr<LocalHost> host;
  BodyId one;
  std::vector<subscriber::ContactEvent> events;
  std::uint64_t frame = 0;
};

TEST_F(Rest, WhatTouchedIsAnsweredAgainToTheLastContactWithoutATurn) {
  lay({});
  const FrameReport report = host->update();
  const PairAnswer& then = *report.find(kGround, one);
  ASSERT_GT(then.answer.pair_total, 0U);
  ASSERT_TRUE(then.contacts && then.depth && then.swept);
  for (int i = 0; i < 5; ++i) {
    const PairAnswer now = next();
    EXPECT_FALSE(is_asked_anew(now));
    EXPECT_FALSE(now.put_off);
    EXPECT_EQ(digest(now.answer), digest(then.answer));
    EXPECT_EQ(now.answer.pairs, then.answer.pairs);
    ASSERT_TRUE(now.contacts && now.depth && now.swept);
    EXPECT_EQ(now.contacts->segments.size(), then.contacts->segments.size());
    EXPECT_EQ(now.contact_ids, then.contact_ids);
    EXPECT_EQ(now.depth->at_least_m, then.depth->at_least_m);
    EXPECT_EQ(now.swept->status, then.swept->status);
    for (const auto& event : events) EXPECT_EQ(event.change, ContactChange::kPersist);
  }
}

TEST_F(Rest, NobodyLooksAheadOfWhatLies) {
  lay({});
  next();
  const std::uint64_t looks = host->session->stats().looks_ahead;
  for (int i = 0; i < 200; ++i) next();
  EXPECT_EQ(host->session->stats().looks_ahead, looks);
  Motion moved = lying;
  moved.linear_velocity_mps[2] = 1;
  for (int i = 0; i < 200; ++i) next({{one, moved}});
  EXPECT_GT(host->session->stats().looks_ahead, looks);
}

TEST_F(Rest, WhoMovesIsAskedAgain) {
  lay({});
  EXPECT_FALSE(is_asked_anew(next()));
  Motion moved = lying;
  moved.pose.translation_m[0] += 1e-9;
  EXPECT_TRUE(is_asked_anew(next({{one, moved}})));  // it is the first, so it is asked to its end
  EXPECT_FALSE(is_asked_anew(next()));
  moved.linear_velocity_mps[2] = 1;
  EXPECT_TRUE(is_asked_anew(next({{one, moved}})));
  EXPECT_TRUE(is_asked_anew(next()));  // its pose is older, so the time ahead is another
}

TEST_F(Rest, WhatIsHeldNowAndWasNotThenIsAskedAgain) {
  lay({});
  EXPECT_FALSE(is_asked_anew(next()));
  const BodyId two = host->spawn("two");
  std::size_t asked = 0;
  for (int i = 0; i < 20; ++i) {
    const FrameReport report = host->update({{two, above_ground(900, 1)}});
    asked += is_asked_anew(*report.find(kGround, one)) ? 1 : 0;
  }
  EXPECT_GT(asked, 0U);
  EXPECT_LT(asked, 20U);
  EXPECT_FALSE(is_asked_anew(next()));
}

}  // namespace
}  // namespace nearmesh::test
