// SPDX-License-Identifier: Apache-2.0
// What the door's watch says to whom.

#include <gtest/gtest.h>

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "idl/dds/door_watch.hpp"
#include "idl/security/identity_book.hpp"
#include "idl/security/security.hpp"
#include "tests/support/folder.hpp"
#include "tests/support/rtps_message.hpp"

namespace nearmesh::wire {
namespace {

class SecuredDoor : public testing::Test {
 protected:
  void SetUp() override {
    SecurityPlan plan;
    plan.prefix = "rig";
    plan.identities = {{"one", Role::kSubscriber}};
    ASSERT_TRUE(make_security(folder_.file("set"), plan).is_ok());
    const std::string at = folder_.file("set/one/");
    auto book = IdentityBook::open({at + "identity_ca.cert.pem", at + "cert.pem", ""});
    ASSERT_TRUE(book.is_ok()) << book.status().message();
    watch_.emplace(DoorRules{.is_plain = true, .identity_period_s = 5}, std::move(book).value());
  }
  /// Of a release that is none of ours.
  static nearmesh::test::Rtps announcement_of(const std::string& name) {
    nearmesh::test::Rtps m(nearmesh::test::key_of(1));
    m.begin_announcement().lease(20).secured(name);
    m.product(0x00020107).finish_announcement();
    return m;
  }

 private:
  const nearmesh::test::Folder folder_;

 protected:
  std::optional<DoorWatch> watch_;
};

// A participant hears others before its mailbox is there: while it is being made.
TEST_F(SecuredDoor, SaysAlsoWhatItHeardBeforeAnybodyListened) {
  DoorWatch& watch = *watch_;
  const nearmesh::test::Rtps m = announcement_of("rig/other");
  const auto hear = [&] { EXPECT_FALSE(watch.check(m.bytes, {true, 40'000}).refusal); };

  hear();
  Mailbox mailbox;
  watch.set_mailbox(&mailbox);
  hear();
  hear();
  const std::vector<std::string> said = mailbox.take_complaints();
  ASSERT_EQ(said.size(), 1U) << "once";
  EXPECT_NE(said[0].find("rig/other is secured by a Fast DDS 7"), std::string::npos) << said[0];
  watch.set_mailbox(nullptr);
}

// In weeks more come than names are remembered.
TEST_F(SecuredDoor, SaysOfHowManyOtherReleasesEver) {
  Mailbox mailbox(0);
  watch_->set_mailbox(&mailbox);
  std::size_t said = 0;
  const auto hear = [&](int number) {
    const auto m = announcement_of("rig/" + std::to_string(number));
    static_cast<void>(watch_->check(m.bytes, {true, 40'000}));
    for (const std::string& line : mailbox.take_complaints())
      said += static_cast<std::size_t>(line.starts_with("rig/" + std::to_string(number) + " is "));
  };
  constexpr int kNames = 20'000;
  for (int i = 0; i < kNames; ++i) {
    hear(i);
    hear(0);
  }
  EXPECT_EQ(said, std::size_t{kNames}) << "each once";
  watch_->set_mailbox(nullptr);
}

// Else a reader would be told of the same part with each heartbeat.
TEST(DoorWatch, TellsAnotherPartOfALongGapEachTime) {
  DoorWatch watch({.is_plain = true, .identity_period_s = 5}, nullptr);
  nearmesh::test::Rtps m(nearmesh::test::key_of(1));
  m.gap(1, 1 + 2 * kMaxGap, 0).heartbeat(1, 3 * kMaxGap);
  const auto part = [&] {
    const RtpsVerdict verdict = watch.check(m.bytes, {true, 40'000});
    EXPECT_FALSE(verdict.refusal);
    RtpsCopy copy;
    const auto passed = copy.of(m.bytes, verdict);
    return passed[38] != 0;  // where it starts: 1, or 65,537
  };
  EXPECT_NE(part(), part());
}

TEST(DoorWatch, HoldsBackHeartbeatsThatBeginFar) {
  DoorWatch watch({.is_plain = true, .identity_period_s = 5}, nullptr);
  nearmesh::test::Rtps m(nearmesh::test::key_of(1));
  m.announcement().heartbeat(kMaxSequence, kMaxSequence);
  const RtpsVerdict verdict = watch.check(m.bytes, {true, 40'000});
  EXPECT_FALSE(verdict.refusal);
  EXPECT_TRUE(RtpsCopy::is_needed(verdict));
}

// As Cyclone DDS sends what two participants of one process have to say.
TEST(DoorWatch, BothSpeakersOfAMessageAreBoundToTheirSocket) {
  DoorWatch watch({.is_plain = true, .identity_period_s = 5}, nullptr);
  nearmesh::test::Rtps m(nearmesh::test::key_of(1));
  m.announcement().speaker(nearmesh::test::key_of(2)).announcement();
  const RtpsVerdict first = watch.check(m.bytes, {true, 40'000});
  EXPECT_FALSE(first.refusal);
  ASSERT_NE(first.next_speaker_at, 0U);
  const RtpsVerdict second = watch.check(rtps_of_next_speaker(m.bytes, first), {true, 40'000});
  EXPECT_FALSE(second.refusal);
  ASSERT_TRUE(second.announcement);
  EXPECT_FALSE(second.tells_of_others);
  EXPECT_EQ(watch.is_silent(nearmesh::test::key_of(2), 3), false);
}

TEST(DoorWatch, StrangersStayOutsideWithoutAComplaint) {
  DoorWatch tells({.is_plain = true, .bodies = told_bodies_in(*user_data_of({{"red"}, {"blue"}}))},
                  nullptr),
      any({.is_plain = true}, nullptr);
  const auto comes_in = [&](DoorWatch& door, std::uint8_t number, const BodyNames* bodies) {
    nearmesh::test::Rtps heard({1, 15, number});
    heard.begin_announcement().lease(20);
    if (bodies != nullptr) heard.user_data(user_data_of(*bodies).value());
    heard.finish_announcement();
    const RtpsVerdict verdict = door.check(heard.bytes, {true, 7411});
    EXPECT_FALSE(verdict.refusal);
    return !verdict.is_kept_out;
  };
  const BodyNames red{{}, {"red"}}, looks{{"blue"}, {}}, green{{"red"}, {"green"}};
  EXPECT_TRUE(comes_in(tells, 1, &red));
  EXPECT_TRUE(comes_in(tells, 2, &looks));
  int greens = 0;
  for (std::uint8_t number = 10; number < 60; ++number) greens += comes_in(tells, number, &green);
  EXPECT_LE(greens, 1) << "by lot, one each five seconds";
  EXPECT_TRUE(comes_in(tells, 4, nullptr)) << "it may name any body";
  EXPECT_TRUE(comes_in(any, 3, &green)) << "this one may";
  // Who speaks has let this one in, to tell it the exercise's clock; one that moves nothing cannot.
  const BodyNames looks_elsewhere{{"yellow"}, {}};
  EXPECT_FALSE(comes_in(tells, 5, &looks_elsewhere));
  for (const std::uint8_t number : {std::uint8_t{3}, std::uint8_t{5}}) {
    nearmesh::test::Rtps word({1, 15, number});
    word.heartbeat(1, 1);
    EXPECT_FALSE(tells.check(word.bytes, {true, 7411}).refusal);
  }
  EXPECT_TRUE(comes_in(tells, 3, &green));
  EXPECT_FALSE(comes_in(tells, 5, &looks_elsewhere));
  EXPECT_EQ(tells.refused(), any.refused());
}

}  // namespace
}  // namespace nearmesh::wire
