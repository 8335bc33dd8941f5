// SPDX-License-Identifier: Apache-2.0
#include "idl/dds/discovery_pace.hpp"

#include <gtest/gtest.h>

#include "tests/support/rtps_message.hpp"

namespace nearmesh::wire {
namespace {

using Kind = DiscoveryWord::Kind;

constexpr std::uint32_t kParticipants = 0x000100c2, kWriters = 0x000003c2, kReaders = 0x000004c2;
constexpr std::uint32_t kWritersReader = 0x000003c7, kPoses = 0x00000903, kPosesReader = 0x00000904;
const ParticipantKey kOwn{1, 15, 1}, kNeighbour{1, 15, 7}, kStranger{1, 15, 8};

RtpsPlace place(std::uint8_t last) {
  RtpsPlace made{.kind = 1, .port = 7410, .address = {}};
  made.address[12] = 10;
  made.address[15] = last;
  return made;
}

DiscoveryWord announcement(std::int64_t sequence) {
  return {Kind::kAnnouncement, kOwn, 0, kParticipants, sequence};
}
DiscoveryWord reminder(std::uint32_t writer, std::int64_t sequence) {
  return {Kind::kReminder, kOwn, kWritersReader, writer, sequence};
}
DiscoveryWord greeting(std::uint32_t reader, std::uint32_t writer) {
  return {Kind::kGreeting, kOwn, reader, writer, 0};
}

class DiscoveryPaceTest : public testing::Test {
 protected:
  /// Somebody is there.
  void meet(const ParticipantKey& key, const RtpsPlace& where) {
    RtpsAnnouncement told;
    told.places[told.place_count++] = where;
    pace.expect(key, told);
  }
  /// How many of the same word, each 10 ms, go there. Out: the longest time without one in
  /// `longest_s`.
  int count_of(const DiscoveryWord& word, const RtpsPlace& where, double from_s, double to_s) {
    int count = 0;
    double last_s = from_s;
    longest_s = 0;
    for (double now_s = from_s; now_s < to_s; now_s += 0.01) {
      longest_s = std::max(longest_s, now_s - last_s);
      if (!pace.may_go(word, where, now_s)) continue;
      last_s = now_s;
      ++count;
    }
    return count;
  }

  DiscoveryPace pace{1};
  double longest_s = 0;
};

TEST_F(DiscoveryPaceTest, AnnouncementsGoAtOnceAndThenEachPeriod) {
  EXPECT_LE(count_of(announcement(1), place(1), 0, 10), 15);
  EXPECT_LE(longest_s, 1);
  EXPECT_TRUE(pace.may_go(announcement(1), place(2), 10));  // who is somewhere else is told
  EXPECT_TRUE(pace.may_go(announcement(2), place(1), 10));  // and what is new
  // As Fast DDS's own timer asks, a little early at times.
  for (double now_s = 20; now_s < 30; now_s += 0.95)
    EXPECT_TRUE(pace.may_go(announcement(2), place(1), now_s)) << now_s;
}

TEST_F(DiscoveryPaceTest, NewcomerIsToldAtOnceWhereAnotherWas) {
  ASSERT_TRUE(pace.may_go(announcement(1), place(1), 0));
  ASSERT_FALSE(pace.may_go(announcement(1), place(1), 0.05));
  meet(kNeighbour, place(1));
  EXPECT_TRUE(pace.may_go(announcement(1), place(1), 0.06));
  EXPECT_TRUE(pace.may_go(reminder(kWriters, 5), place(1), 0.06));
  pace.confirm(kNeighbour, {kOwn, kWriters, 6});
  ASSERT_FALSE(pace.may_go(reminder(kWriters, 5), place(1), 2));
  meet(kStranger, place(1));
  EXPECT_TRUE(pace.may_go(reminder(kWriters, 5), place(1), 2));
}

TEST_F(DiscoveryPaceTest, WhatIsAskedForGoesSoonerOrLater) {
  meet(kNeighbour, place(1));
  for (const DiscoveryWord& word : {reminder(kWriters, 5), greeting(kWritersReader, kWriters),
                                    greeting(kPosesReader, kPoses)}) {
    EXPECT_LE(count_of(word, place(1), 0, 10), 11);
    EXPECT_LE(longest_s, DiscoveryPace::kLast_s + 0.02);
  }
}

TEST_F(DiscoveryPaceTest, ConfirmedIsSaidSeldom) {
  meet(kNeighbour, place(1));
  EXPECT_TRUE(pace.may_go(reminder(kWriters, 5), place(1), 0));
  pace.confirm(kNeighbour, {kOwn, kWriters, 6});
  EXPECT_LE(count_of(reminder(kWriters, 5), place(1), 0, 20), 3);
  EXPECT_GE(count_of(reminder(kWriters, 5), place(1), 20, 40), 3);
  EXPECT_TRUE(pace.may_go(reminder(kReaders, 5), place(1), 40));  // of other endpoints
  EXPECT_TRUE(pace.may_go(reminder(kWriters, 6), place(1), 40));  // more
}

// A busy machine answers each reminder that it still lacks what is on its way: that must not bring
// the next one.
TEST_F(DiscoveryPaceTest, WhoStillLacksSomethingIsNotRemindedSooner) {
  meet(kNeighbour, place(1));
  int reminders = 0;
  for (double now_s = 0; now_s < 10; now_s += 0.01) {
    if (!pace.may_go(reminder(kWriters, 5), place(1), now_s)) continue;
    pace.confirm(kNeighbour, {kOwn, kWriters, reminders < 3 ? reminders : 3});
    ++reminders;
  }
  EXPECT_LE(reminders, 8);
  EXPECT_GE(reminders, 6);
}

TEST_F(DiscoveryPaceTest, WhoHasForgottenIsRemindedAtOnce) {
  meet(kNeighbour, place(1));
  ASSERT_TRUE(pace.may_go(reminder(kWriters, 5), place(1), 0));
  pace.confirm(kNeighbour, {kOwn, kWriters, 6});
  ASSERT_FALSE(pace.may_go(reminder(kWriters, 5), place(1), 0.07));
  pace.confirm(kNeighbour, {kOwn, kWriters, 0});
  EXPECT_TRUE(pace.may_go(reminder(kWriters, 5), place(1), 0.08));
}

// By unicast everybody who was heard of has each of them anyway.
TEST_F(DiscoveryPaceTest, CallsToEverybodyGoSeldom) {
  RtpsPlace everybody = place(1);
  everybody.address[12] = 239;
  EXPECT_LE(count_of(announcement(1), everybody, 0, 60), 20);
  EXPECT_GE(longest_s, 3);
  EXPECT_LE(longest_s, DiscoveryPace::kCalled_s + 0.02);
  EXPECT_TRUE(pace.may_go(announcement(2), everybody, 60));
}

TEST_F(DiscoveryPaceTest, WhatAnotherWasToldIsNotConfirmed) {
  meet(kNeighbour, place(1));
  ASSERT_TRUE(pace.may_go(reminder(kWriters, 5), place(1), 0));
  pace.confirm(kNeighbour, {kStranger, kWriters, 100});  // who had this address before
  EXPECT_TRUE(pace.may_go(reminder(kWriters, 5), place(1), 0.2));
  pace.confirm(kStranger, {kOwn, kWriters, 100});  // nobody has heard of it
  EXPECT_TRUE(pace.may_go(reminder(kWriters, 5), place(1), 0.5));
}

/// It may be anybody's.
TEST_F(DiscoveryPaceTest, PlaceOfNobodyIsNotPacedButForAnnouncements) {
  for (int i = 0; i < 10; ++i) {
    EXPECT_TRUE(pace.may_go(reminder(kWriters, 5), place(1), 0));
    EXPECT_TRUE(pace.may_go(greeting(kWritersReader, kWriters), place(1), 0));
  }
  meet(kNeighbour, place(1));
  ASSERT_TRUE(pace.may_go(reminder(kWriters, 5), place(1), 0));
  ASSERT_FALSE(pace.may_go(reminder(kWriters, 5), place(1), 0));
  pace.forget(kNeighbour);
  EXPECT_TRUE(pace.may_go(reminder(kWriters, 5), place(1), 0));
  EXPECT_EQ(pace.size(), 0);
}

TEST_F(DiscoveryPaceTest, FloodIsForgotten) {
  for (std::uint32_t i = 0; i < 3 * DiscoveryPace::kMaxPlaces; ++i) {
    RtpsPlace where = place(1);
    where.port = i;
    ParticipantKey key = kNeighbour;
    key[10] = static_cast<std::uint8_t>(i);
    key[11] = static_cast<std::uint8_t>(i >> 8);
    meet(key, where);
    EXPECT_TRUE(pace.may_go(announcement(1), where, 0));
    EXPECT_LE(pace.size(), DiscoveryPace::kMaxPlaces);
  }
}

TEST(DiscoveryWordTest, IsReadOnlyWhereItIsAll) {
  using nearmesh::test::Rtps;
  Rtps announced(kOwn);
  announced.timestamp().announcement(3, 20);
  const auto said = discovery_word(announced.bytes);
  ASSERT_TRUE(said);
  EXPECT_EQ(said->kind, Kind::kAnnouncement);
  EXPECT_EQ(said->own, kOwn);
  EXPECT_EQ(said->sequence, 3);

  Rtps reminded(kOwn);
  reminded.to(kNeighbour).heartbeat(1, 5, 1, kWritersReader, kWriters);
  const auto told = discovery_word(reminded.bytes);
  ASSERT_TRUE(told);
  EXPECT_EQ(told->kind, Kind::kReminder);
  EXPECT_EQ(told->reader, kWritersReader);
  EXPECT_EQ(told->writer, kWriters);
  EXPECT_EQ(told->sequence, 5);

  Rtps greeted(kOwn), confirmed(kOwn), lacking(kOwn);
  greeted.to(kNeighbour).ack_nack(0, 0, 1, kPosesReader, kPoses);
  const auto asked = discovery_word(greeted.bytes);
  ASSERT_TRUE(asked);
  EXPECT_EQ(asked->kind, Kind::kGreeting);
  EXPECT_EQ(asked->writer, kPoses);
  confirmed.to(kNeighbour).ack_nack(6, 0, 1, kWritersReader, kWriters);
  EXPECT_FALSE(discovery_word(confirmed.bytes));
  lacking.to(kNeighbour).ack_nack(1, 5, 1, kWritersReader, kWriters);
  EXPECT_FALSE(discovery_word(lacking.bytes));

  Rtps both(kOwn);
  both.heartbeat(1, 5, 1, kWritersReader, kWriters).heartbeat(1, 5, 1, 0x000004c7, kReaders);
  EXPECT_FALSE(discovery_word(both.bytes));
  Rtps other(kOwn);
  other.heartbeat(1, 5, 1, kPosesReader, kPoses);  // of no discovery
  EXPECT_FALSE(discovery_word(other.bytes));
  Rtps left(kOwn);
  left.farewell(4);
  EXPECT_FALSE(discovery_word(left.bytes));
  for (std::size_t size = 0; size < reminded.bytes.size(); ++size)
    static_cast<void>(discovery_word(std::span(reminded.bytes).first(size)));
}

TEST(DiscoveryWordTest, DoorReadsPlacesAndConfirmations) {
  using nearmesh::test::Rtps;
  Rtps announced(kNeighbour);
  announced.announcement(1, 20);
  const auto told = check_rtps(announced.bytes).announcement;
  ASSERT_TRUE(told);
  ASSERT_EQ(told->place_count, 2);
  EXPECT_EQ(told->places[0].kind, 1);
  EXPECT_EQ(told->places[0].port, 7410);
  EXPECT_EQ(told->places[0].address[12], 127);
  EXPECT_EQ(told->places[1].port, 7411);

  Rtps confirmed(kNeighbour);
  confirmed.to(kOwn).ack_nack(6, 0, 1, kWritersReader, kWriters);
  const auto verdict = check_rtps(confirmed.bytes);
  ASSERT_TRUE(verdict.confirmations[0]);
  EXPECT_FALSE(verdict.confirmations[1]);
  EXPECT_EQ(verdict.confirmations[0]->to, kOwn);
  EXPECT_EQ(verdict.confirmations[0]->next, 6);
}

}  // namespace
}  // namespace nearmesh::wire
