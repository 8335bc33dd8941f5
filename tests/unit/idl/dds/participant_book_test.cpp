// SPDX-License-Identifier: Apache-2.0
#include "idl/dds/participant_book.hpp"

#include <gtest/gtest.h>

#include <cstring>
#include <set>

#include "tests/support/rtps_message.hpp"

namespace nearmesh::wire {
namespace {

constexpr MessageSource kHome{true, 40'000}, kElsewhere{true, 50'000}, kThird{true, 50'001};

ParticipantKey participant_key(std::uint32_t number) {
  ParticipantKey key{1, 15};
  std::memcpy(key.data() + 8, &number, sizeof number);
  return key;
}

RtpsVerdict word_of(std::uint32_t number) {
  RtpsVerdict verdict;
  verdict.source = participant_key(number);
  return verdict;
}

RtpsVerdict announcement_of(std::uint32_t number, double lease_s = 20, std::int64_t sequence = 1) {
  RtpsVerdict verdict = word_of(number);
  verdict.announcement =
      RtpsAnnouncement{.sequence = sequence, .leaves = false, .lease_s = lease_s};
  return verdict;
}

class ParticipantBookTest : public testing::Test {
 protected:
  bool hears(const RtpsVerdict& word, const MessageSource& from = kHome) {
    refusal = book.hear(word, from);
    return !refusal;
  }
  /// Announcements of these, each second; time passes in ticks. Out: who has gone.
  std::vector<ParticipantBook::Gone> pass(double seconds,
                                          const std::vector<std::uint32_t>& living = {}) {
    std::vector<ParticipantBook::Gone> gone;
    for (int i = 0; i < static_cast<int>(seconds * 4); ++i) {
      for (const std::uint32_t number : living)
        EXPECT_TRUE(i % 4 != 0 || hears(announcement_of(number)));
      book.tick(0.25);
      const auto more = book.take_gone();
      gone.insert(gone.end(), more.begin(), more.end());
    }
    return gone;
  }

  ParticipantBook book;
  std::optional<DoorRefusal> refusal;
};

TEST_F(ParticipantBookTest, SpeakerKeepsToItsSockets) {
  ASSERT_TRUE(hears(announcement_of(1)));
  EXPECT_TRUE(hears(word_of(1), kElsewhere));  // another socket of it
  static_cast<void>(pass(ParticipantBook::kLearning_s + 1, {1}));
  EXPECT_TRUE(hears(word_of(1)));
  EXPECT_TRUE(hears(word_of(1), kElsewhere));
  EXPECT_FALSE(hears(word_of(1), kThird));
  EXPECT_EQ(refusal, DoorRefusal::kSource);
}

TEST_F(ParticipantBookTest, ForgedFarewellIsRefused) {
  ASSERT_TRUE(hears(announcement_of(1)));
  static_cast<void>(pass(ParticipantBook::kLearning_s + 1, {1}));
  RtpsVerdict farewell = announcement_of(1);
  farewell.announcement->leaves = true;
  EXPECT_FALSE(hears(farewell, kThird));
  EXPECT_EQ(book.size(), 1U);
  EXPECT_TRUE(hears(farewell));
  EXPECT_EQ(book.size(), 0U);
}

TEST_F(ParticipantBookTest, WhoMovedIsHeardWhenItsOldSocketIsSilent) {
  ASSERT_TRUE(hears(announcement_of(1)));
  static_cast<void>(pass(ParticipantBook::kLearning_s + 1, {1}));
  EXPECT_FALSE(hears(word_of(1), kElsewhere));
  static_cast<void>(pass(ParticipantBook::kMoved_s + 1));
  EXPECT_TRUE(hears(word_of(1), kElsewhere));
  // From now on it is learnt anew: it has more than one.
  EXPECT_TRUE(hears(word_of(1), kThird));
  for (int i = 0; i < 12; ++i) {
    static_cast<void>(pass(1));
    EXPECT_TRUE(hears(word_of(1), kElsewhere));
    EXPECT_TRUE(hears(word_of(1), kThird));
  }
  EXPECT_FALSE(hears(word_of(1)));  // that is now the stranger
}

// Until then it had nothing to say by its other sockets.
TEST_F(ParticipantBookTest, SocketsAreLearntFromTheFirstWordOn) {
  ASSERT_TRUE(hears(announcement_of(1)));
  static_cast<void>(pass(3 * ParticipantBook::kLearning_s, {1}));
  EXPECT_FALSE(hears(word_of(1), kElsewhere));
  EXPECT_TRUE(hears(word_of(1)));
  EXPECT_TRUE(hears(word_of(1), kElsewhere));
  static_cast<void>(pass(ParticipantBook::kLearning_s + 1, {1}));
  EXPECT_TRUE(hears(word_of(1), kElsewhere));
  EXPECT_FALSE(hears(word_of(1), kThird));
}

TEST_F(ParticipantBookTest, LongLeaseOfWhoNeverSpeaksIsShort) {
  ASSERT_TRUE(hears(announcement_of(1, 0x7fffffff)));
  ASSERT_TRUE(hears(announcement_of(2, 0x7fffffff)));
  ASSERT_TRUE(hears(word_of(2)));
  EXPECT_TRUE(pass(ParticipantBook::kOnlyAnnounced_s - 1).empty());
  const auto gone = pass(2);
  ASSERT_EQ(gone.size(), 1U);
  EXPECT_EQ(gone[0].key, participant_key(1));
  EXPECT_TRUE(book.is_known(participant_key(2)));
}

TEST_F(ParticipantBookTest, NoMoreAreKnownThanThereIsRoomFor) {
  std::uint32_t number = 0;
  for (int tick = 0; tick < 4 * 200 && book.size() < ParticipantBook::kMaxKnown; ++tick) {
    for (int i = 0; i < 100; ++i, ++number)
      if (hears(announcement_of(number, 0x7fffffff))) static_cast<void>(hears(word_of(number)));
    book.tick(0.25);
  }
  ASSERT_EQ(book.size(), ParticipantBook::kMaxKnown);
  book.tick(5);
  EXPECT_FALSE(hears(announcement_of(number)));
  EXPECT_EQ(refusal, DoorRefusal::kCrowd);
  RtpsVerdict farewell = announcement_of(0);
  farewell.announcement->leaves = true;
  ASSERT_TRUE(hears(farewell));
  EXPECT_TRUE(hears(announcement_of(number)));
}

TEST_F(ParticipantBookTest, OtherTransportsThanUdpAreNotBoundToSockets) {
  ASSERT_TRUE(hears(announcement_of(1), {}));
  static_cast<void>(pass(ParticipantBook::kLearning_s + 1));
  EXPECT_TRUE(hears(word_of(1), {}));
  EXPECT_TRUE(hears(word_of(1), kHome));  // first by UDP
  static_cast<void>(pass(ParticipantBook::kLearning_s + 1, {1}));
  EXPECT_FALSE(hears(word_of(1), kElsewhere));
}

TEST_F(ParticipantBookTest, TheConnectionOfAParticipantIsThatByWhichItWasHeardFirst) {
  const MessageSource first{.connection = RtpsPlace{4, 5100, {}}};
  const MessageSource second{.connection = RtpsPlace{4, 40'000, {}}};
  EXPECT_FALSE(book.connection_of(participant_key(1)));
  EXPECT_TRUE(hears(announcement_of(1), first));
  EXPECT_TRUE(hears(announcement_of(1), second));
  EXPECT_EQ(book.connection_of(participant_key(1)), first.connection);
  RtpsVerdict farewell = announcement_of(1);
  farewell.announcement->leaves = true;
  EXPECT_TRUE(hears(farewell, second));
  EXPECT_TRUE(hears(announcement_of(1), second));
  EXPECT_EQ(book.connection_of(participant_key(1)), second.connection);
}

TEST_F(ParticipantBookTest, TwoHundredMayComeAtOnce) {
  for (std::uint32_t number = 0; number < 200; ++number)
    EXPECT_TRUE(hears(announcement_of(number))) << number;
}

/// A flood of invented participants while a hundred honest ones join, who announce themselves each
/// second.
TEST_F(ParticipantBookTest, FloodDelaysHonestJoinersAndRefusesNone) {
  std::uint32_t invented = 1'000'000;
  std::vector<bool> in(100);
  double all_in_s = 0;
  for (int tick = 0; tick < 4 * 30 && all_in_s == 0; ++tick) {
    for (int i = 0; i < 500; ++i) static_cast<void>(hears(announcement_of(invented++), kThird));
    if (tick % 4 == 2)
      for (std::uint32_t number = 0; number < 100; ++number)
        in[number] = hears(announcement_of(number)) || in[number];
    book.tick(0.25);
    if (std::find(in.begin(), in.end(), false) == in.end()) all_in_s = (tick + 1) * 0.25;
  }
  EXPECT_GT(all_in_s, 0);
  EXPECT_LT(all_in_s, 5);
  EXPECT_LT(book.size(), 2000U);
}

TEST_F(ParticipantBookTest, HeldBackOnesComeInLater) {
  for (std::uint32_t number = 0; number < 256; ++number)
    ASSERT_TRUE(hears(announcement_of(number)));
  EXPECT_FALSE(hears(announcement_of(1000)));
  EXPECT_EQ(refusal, DoorRefusal::kCrowd);
  EXPECT_FALSE(hears(announcement_of(1000)));  // at once again
  book.tick(0.25);
  EXPECT_TRUE(hears(announcement_of(1000)));
}

TEST_F(ParticipantBookTest, WhoseLeaseIsOverHasGone) {
  ASSERT_TRUE(hears(announcement_of(1, 20, 3)));
  ASSERT_TRUE(hears(announcement_of(1, 20, 5)));
  EXPECT_TRUE(pass(19).empty());
  const auto gone = pass(2);
  ASSERT_EQ(gone.size(), 1U);
  EXPECT_EQ(gone[0].key, participant_key(1));
  EXPECT_EQ(gone[0].sequence, 6);
  EXPECT_EQ(book.size(), 0U);
  EXPECT_TRUE(hears(announcement_of(1)));  // and may come again
}

TEST_F(ParticipantBookTest, AnyWordIsALifeSign) {
  ASSERT_TRUE(hears(announcement_of(1, 2)));
  for (int i = 0; i < 30; ++i) {
    book.tick(1);
    EXPECT_TRUE(book.take_gone().empty());
    EXPECT_TRUE(hears(word_of(1)));
  }
}

TEST_F(ParticipantBookTest, SilentLongBeforeItsLease) {
  EXPECT_FALSE(book.is_silent(participant_key(1), 3));
  ASSERT_TRUE(hears(announcement_of(1)));
  static_cast<void>(pass(4, {1}));
  EXPECT_EQ(book.is_silent(participant_key(1), 3), false);
  static_cast<void>(pass(3));
  EXPECT_EQ(book.is_silent(participant_key(1), 3), true);
  EXPECT_TRUE(hears(word_of(1)));
  EXPECT_EQ(book.is_silent(participant_key(1), 3), false);
}

TEST_F(ParticipantBookTest, WhoAnnouncesItselfRarelyMaySayNothingForLonger) {
  for (int i = 0; i < 3; ++i) {
    ASSERT_TRUE(hears(announcement_of(1)));
    static_cast<void>(pass(3));
  }
  ASSERT_TRUE(hears(announcement_of(1)));
  static_cast<void>(pass(8));
  EXPECT_EQ(book.is_silent(participant_key(1), 3), false);
  static_cast<void>(pass(2));
  EXPECT_EQ(book.is_silent(participant_key(1), 3), true);
}

/// Where a heartbeat of a participant's writer that begins there is to begin.
std::int64_t begins(ParticipantBook& book, std::uint32_t number, std::int64_t first,
                    std::uint32_t writer = 0x103, bool tells_of_endpoints = false) {
  nearmesh::test::Rtps m(participant_key(number));
  RtpsVerdict word = check_rtps(m.heartbeat(first, first, 1, 0, writer).bytes);
  EXPECT_EQ(word.far_beginnings.size(), 1U);
  word.tells_of_endpoints = tells_of_endpoints;
  EXPECT_FALSE(book.hear(word, kHome));
  book.hold_back(word);
  RtpsCopy copy;
  const RtpsVerdict passed = check_rtps(copy.of(m.bytes, word));
  return passed.far_beginnings.empty() ? kFarBeginning : passed.far_beginnings[0].first;
}

// One such packet would have a thread of Fast DDS count for months.
TEST_F(ParticipantBookTest, HeartbeatsThatBeginFarAreHeldBack) {
  constexpr auto kBurst = static_cast<std::int64_t>(ParticipantBook::kLeapBurst);
  constexpr auto kPerSecond = static_cast<std::int64_t>(ParticipantBook::kLeapsPerSecond);
  EXPECT_EQ(begins(book, 1, kMaxSequence), kFarBeginning);  // unknown: nobody counts
  ASSERT_TRUE(hears(announcement_of(1)));
  EXPECT_EQ(begins(book, 1, kFarBeginning + 1000), kFarBeginning + 1000);
  EXPECT_EQ(begins(book, 1, kMaxSequence), kFarBeginning + kBurst);
  EXPECT_EQ(begins(book, 1, kMaxSequence), kFarBeginning + kBurst);
  EXPECT_EQ(begins(book, 1, kMaxSequence, 0x203), kFarBeginning);  // from the same budget
  static_cast<void>(pass(1, {1}));
  EXPECT_EQ(begins(book, 1, kMaxSequence), kFarBeginning + kBurst + kPerSecond);
  // What was handed on is free.
  EXPECT_EQ(begins(book, 1, kFarBeginning + kBurst), kFarBeginning + kBurst);
  // Who is told of the endpoint anew counts anew, so it is not.
  EXPECT_EQ(begins(book, 1, kFarBeginning + kBurst, 0x103, true), kFarBeginning);
  EXPECT_EQ(begins(book, 1, kFarBeginning + kBurst), kFarBeginning);
  static_cast<void>(pass(3, {1}));
  EXPECT_EQ(begins(book, 1, kFarBeginning + kBurst), kFarBeginning + kBurst);
}

// What is told with an endpoint may have come before it, and then nobody counted.
TEST_F(ParticipantBookTest, HeartbeatsThatCameWithTheirEndpointDoNotCountAsHandedOn) {
  constexpr auto kBurst = static_cast<std::int64_t>(ParticipantBook::kLeapBurst);
  ASSERT_TRUE(hears(announcement_of(1)));
  EXPECT_EQ(begins(book, 1, kFarBeginning + kBurst, 0x103, true), kFarBeginning + kBurst);
  EXPECT_EQ(begins(book, 1, kFarBeginning + kBurst), kFarBeginning);
}

TEST_F(ParticipantBookTest, OfCountlessWritersNoneBeginsFar) {
  ASSERT_TRUE(hears(announcement_of(1)));
  for (std::uint32_t i = 0; i < ParticipantBook::kMaxBegun; ++i)
    EXPECT_EQ(begins(book, 1, kFarBeginning + 1, 0x100 * (i + 1) + 3), kFarBeginning + 1);
  EXPECT_EQ(begins(book, 1, kFarBeginning + 1, 0xffff03), kFarBeginning);
  EXPECT_EQ(begins(book, 1, kFarBeginning + 2, 0x103), kFarBeginning + 2);
}

TEST_F(ParticipantBookTest, BarredIsNotHeardAgain) {
  ASSERT_TRUE(hears(announcement_of(1, 20, 7)));
  ASSERT_TRUE(hears(announcement_of(2)));
  book.bar(participant_key(1));
  const auto gone = book.take_gone();
  ASSERT_EQ(gone.size(), 1U);
  EXPECT_EQ(gone[0].sequence, 8);
  EXPECT_FALSE(hears(word_of(1)));
  EXPECT_EQ(refusal, DoorRefusal::kIdentity);
  EXPECT_FALSE(hears(announcement_of(1, 20, 9)));
  EXPECT_TRUE(book.is_barred(participant_key(1)));
  EXPECT_EQ(book.is_silent(participant_key(1), 3), true);
  EXPECT_FALSE(book.is_known(participant_key(1)));
  EXPECT_TRUE(hears(word_of(2)));
  EXPECT_FALSE(book.is_barred(participant_key(2)));
}

class Strangers : public ParticipantBookTest {
 protected:
  Strangers() { book = ParticipantBook(true); }
  /// It announces itself. Out: whether it comes in.
  bool calls(std::uint32_t number) {
    const RtpsVerdict call = announcement_of(number);
    if (!book.is_known(call.source) && book.keeps_out(call.source)) return false;
    EXPECT_TRUE(hears(call));
    return true;
  }
  /// These call each five seconds for so long. Out: which have come in.
  std::set<std::uint32_t> call_for(double seconds, std::uint32_t first, std::uint32_t count) {
    std::set<std::uint32_t> in;
    for (double passed_s = 0; passed_s < seconds; passed_s += 5) {
      for (std::uint32_t number = first; number < first + count; ++number)
        if (calls(number)) in.insert(number);
      static_cast<void>(pass(5));
    }
    return in;
  }
};

TEST_F(Strangers, FewComeIn) {
  constexpr std::uint32_t kCrowd = 100;
  EXPECT_EQ(call_for(5, 0, kCrowd).size(), 1U) << "one at a time";
  EXPECT_EQ(call_for(60, 0, kCrowd).size(), ParticipantBook::kChosen);
  EXPECT_EQ(book.size(), ParticipantBook::kChosen);
}

TEST_F(Strangers, NotAllLetTheSameOnesIn) {
  std::set<std::uint32_t> first;
  for (int i = 0; i < 30; ++i) {
    book = ParticipantBook(true);
    first.insert(*call_for(5, 0, 100).begin());
  }
  EXPECT_GT(first.size(), 1U);
}

TEST_F(Strangers, OneThatHasLeftMakesRoomForAnother) {
  ASSERT_EQ(call_for(60, 0, 100).size(), ParticipantBook::kChosen);
  RtpsVerdict farewell;
  for (std::uint32_t i = 0; !farewell.announcement; ++i)
    if (book.is_known(participant_key(i))) farewell = announcement_of(i);
  farewell.announcement->leaves = true;
  ASSERT_TRUE(hears(farewell));
  EXPECT_EQ(book.size(), ParticipantBook::kChosen - 1);
  static_cast<void>(call_for(10, 0, 100));
  EXPECT_EQ(book.size(), ParticipantBook::kChosen);
}

TEST_F(Strangers, WhoHasLetThisOneInComesIn) {
  ASSERT_EQ(call_for(60, 0, 100).size(), ParticipantBook::kChosen);
  std::uint32_t outside = 0;
  while (book.is_known(participant_key(outside))) ++outside;
  EXPECT_FALSE(calls(outside));
  ASSERT_TRUE(hears(word_of(outside)));
  EXPECT_TRUE(calls(outside));
  EXPECT_EQ(book.size(), ParticipantBook::kChosen + 1);
}

}  // namespace
}  // namespace nearmesh::wire
