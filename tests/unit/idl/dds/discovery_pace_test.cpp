// SPDX-License-Identifier: Apache-2.0
#include "idl/dds/discovery_pace.hpp"

#include <gtest/gtest.h>

#include "tests/support/rtps_message.hpp"

namespace nearmesh::wire {
namespace {

using Kind = DiscoveryWord::Kind;

constexpr std::uint32_t kParticipants = 0x000100c2, kWriters = 0x000003c2, kReaders = 0x000004c2;
const ParticipantKey kKey{1, 15, 7};

RtpsPlace place(std::uint8_t last, std::uint8_t first = 10) {
  RtpsPlace made{.kind = 1, .port = 7410, .address = {}};
  made.address[12] = first;
  made.address[15] = last;
  return made;
}

/// How many of the same word, each tenth of a second, go there.
int count_of(DiscoveryPace& pace, const RtpsPlace& where, const DiscoveryWord& word, double from_s,
             double to_s) {
  int count = 0;
  for (double now_s = from_s; now_s < to_s; now_s += 0.1)
    count += pace.may_go(where, word, now_s) ? 1 : 0;
  return count;
}

TEST(DiscoveryPace, AnnouncementsGoOnceAndThenSeldom) {
  DiscoveryPace pace(1, 20);
  const DiscoveryWord word{Kind::kAnnouncement, kParticipants, 1};
  EXPECT_LE(count_of(pace, place(1, 239), word, 0, 10), 14);  // a group: each second
  EXPECT_GE(count_of(pace, place(1, 239), word, 10, 20), 10);
  EXPECT_LE(count_of(pace, place(1), word, 0, 30), 11);
  EXPECT_GE(count_of(pace, place(1), word, 30, 60), 8);  // far below the lease
  EXPECT_TRUE(pace.may_go(place(2), word, 60));          // who is somewhere else is told
  EXPECT_TRUE(
      pace.may_go(place(1), {Kind::kAnnouncement, kParticipants, 2}, 60));  // and what is new
}

TEST(DiscoveryPace, ShortLeasesAreKept) {
  DiscoveryPace pace(0.3, 1);
  const DiscoveryWord word{Kind::kAnnouncement, kParticipants, 1};
  double last_s = 0;
  for (double now_s = 0; now_s < 20; now_s += 0.3) {
    if (!pace.may_go(place(1), word, now_s)) continue;
    EXPECT_LT(now_s - last_s, 0.7);
    last_s = now_s;
  }
}

TEST(DiscoveryPace, NewcomerIsToldAtOnceWhereAnotherWas) {
  DiscoveryPace pace(1, 20);
  const DiscoveryWord word{Kind::kAnnouncement, kParticipants, 1};
  ASSERT_TRUE(pace.may_go(place(1), word, 0));
  ASSERT_FALSE(pace.may_go(place(1), word, 0.05));
  RtpsAnnouncement announcement;
  announcement.places[announcement.place_count++] = place(1);
  pace.expect(kKey, announcement);
  EXPECT_TRUE(pace.may_go(place(1), word, 0.06));
}

TEST(DiscoveryPace, NobodyIsRemindedOfWhatHeConfirmed) {
  DiscoveryPace pace(1, 20);
  RtpsAnnouncement announcement;
  announcement.places[announcement.place_count++] = place(1);
  pace.expect(kKey, announcement);
  const DiscoveryWord five{Kind::kReminder, kWriters, 5};
  EXPECT_TRUE(pace.may_go(place(1), five, 0));
  pace.confirm(kKey, {kWriters, 5});
  EXPECT_TRUE(pace.may_go(place(1), five, 10));  // the fifth is not
  pace.confirm(kKey, {kWriters, 6});
  EXPECT_FALSE(pace.may_go(place(1), five, 20));
  EXPECT_TRUE(pace.may_go(place(1), {Kind::kReminder, kReaders, 5}, 20));
  EXPECT_TRUE(pace.may_go(place(1), {Kind::kReminder, kWriters, 6}, 20));
  EXPECT_TRUE(pace.may_go(place(2), five, 20));
  pace.confirm(kKey, {kWriters, 0});  // it has forgotten all
  EXPECT_TRUE(pace.may_go(place(1), five, 30));
}

TEST(DiscoveryPace, GreetingsAndRemindersBackOff) {
  DiscoveryPace pace(1, 20);
  ASSERT_TRUE(pace.may_go(place(1), {Kind::kAnnouncement, kParticipants, 1}, 0));
  for (const Kind kind : {Kind::kGreeting, Kind::kReminder}) {
    const int count = count_of(pace, place(1), {kind, kWriters, 5}, 0, 10);
    EXPECT_GE(count, 5);
    EXPECT_LE(count, 9);
  }
}

TEST(DiscoveryWordTest, IsReadOnlyWhereItIsAll) {
  using nearmesh::test::Rtps;
  Rtps announcement(kKey);
  announcement.announcement(3, 20);
  const auto said = discovery_word(announcement.bytes);
  ASSERT_TRUE(said);
  EXPECT_EQ(said->kind, Kind::kAnnouncement);
  EXPECT_EQ(said->sequence, 3);

  Rtps reminder(kKey);
  reminder.heartbeat(1, 5, 1, 0x000003c7, kWriters);
  const auto reminded = discovery_word(reminder.bytes);
  ASSERT_TRUE(reminded);
  EXPECT_EQ(reminded->kind, Kind::kReminder);
  EXPECT_EQ(reminded->writer, kWriters);
  EXPECT_EQ(reminded->sequence, 5);

  Rtps greeting(kKey), confirmation(kKey);
  greeting.ack_nack(0, 0, 1, 0x000003c7, kWriters);
  confirmation.ack_nack(6, 0, 1, 0x000003c7, kWriters);
  ASSERT_TRUE(discovery_word(greeting.bytes));
  EXPECT_EQ(discovery_word(greeting.bytes)->kind, Kind::kGreeting);
  EXPECT_FALSE(discovery_word(confirmation.bytes));
  ASSERT_TRUE(check_rtps(confirmation.bytes).confirmation);
  EXPECT_EQ(check_rtps(confirmation.bytes).confirmation->next, 6);

  Rtps both(kKey);
  both.heartbeat(1, 5, 1, 0x000003c7, kWriters).heartbeat(1, 5, 1, 0x000004c7, kReaders);
  EXPECT_FALSE(discovery_word(both.bytes));
  Rtps other(kKey);
  other.heartbeat(1, 5, 1, 0x104, 0x103);  // of no discovery
  EXPECT_FALSE(discovery_word(other.bytes));
  Rtps farewell(kKey);
  farewell.farewell(4);
  EXPECT_FALSE(discovery_word(farewell.bytes));
}

}  // namespace
}  // namespace nearmesh::wire
