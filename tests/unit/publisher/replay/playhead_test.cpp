// SPDX-License-Identifier: Apache-2.0
// Which message is due when: rate, pause, step, seek, ends; on recordings whose bytes mean nothing.
#include "publisher/replay/playhead.hpp"

#include <limits>

#include "session_file.hpp"
#include "test_models.hpp"

namespace nearmesh {
namespace {

using publisher::Playhead;
using publisher::PlayheadOptions;
using test::SessionFile;

/// Ten messages, one a second, whose one byte is their number; or as `times_s` says.
std::unique_ptr<RecordingReader> make_recording(const test::TempFile& file,
                                                std::vector<double> times_s = {0, 1, 2, 3, 4, 5, 6,
                                                                               7, 8, 9}) {
  SessionFile session(file.path());
  for (std::size_t i = 0; i < times_s.size(); ++i)
    session.add_bytes(times_s[i], {static_cast<std::uint8_t>(i)});
  session.close();
  return RecordingReader::open(file.path()).value();
}

class PlayheadTest : public ::testing::Test {
 protected:
  test::TempFile file{".db3"};
  std::unique_ptr<RecordingReader> recording = make_recording(file);

  Playhead make(PlayheadOptions options = {}, double now_s = 100) {
    return Playhead::create(*recording, options, now_s).value();
  }
  /// Ids of all that is due.
  static std::vector<std::int64_t> take(Playhead& playhead, double now_s) {
    std::vector<std::int64_t> ids;
    for (auto due = playhead.take(now_s).value(); due; due = playhead.take(now_s).value()) {
      EXPECT_EQ(due->message.cdr.at(0), due->id - 1);
      ids.push_back(due->id);
    }
    return ids;
  }
  using Ids = std::vector<std::int64_t>;
};

TEST_F(PlayheadTest, GivesEachMessageWhenItIsDue) {
  Playhead playhead = make();
  EXPECT_EQ(take(playhead, 100), Ids{1});
  EXPECT_EQ(take(playhead, 100.9), Ids{});
  EXPECT_NEAR(playhead.wait_s(100.9), 0.1, 1e-9);
  const auto due = playhead.take(101.25).value();
  ASSERT_TRUE(due);
  EXPECT_EQ(due->id, 2);
  EXPECT_NEAR(due->late_s, 0.25, 1e-9);
  EXPECT_EQ(playhead.next_id(), 3);
  EXPECT_NEAR(playhead.time_s(101.25), 1.25, 1e-9);
}

TEST_F(PlayheadTest, RateScalesTime) {
  Playhead fast = make({.rate = 4}), slow = make({.rate = 0.5});
  EXPECT_EQ(take(fast, 101 - 1e-6), (Ids{1, 2, 3, 4}));
  EXPECT_EQ(take(slow, 101), Ids{1});
  EXPECT_NEAR(slow.wait_s(101), 1, 1e-9);
  EXPECT_NEAR(fast.time_s(100.5), 2, 1e-9);
}

TEST_F(PlayheadTest, EndsAfterTheLastMessage) {
  Playhead playhead = make({.rate = 1000});
  EXPECT_FALSE(playhead.at_end());
  EXPECT_EQ(take(playhead, 100.5).size(), 10U);
  EXPECT_TRUE(playhead.at_end());
  EXPECT_EQ(playhead.wait_s(100.5), std::numeric_limits<double>::infinity());
  EXPECT_NEAR(playhead.time_s(100.5), 9, 1e-9);
}

TEST_F(PlayheadTest, PlaysOnlyFromStartToEnd) {
  Playhead playhead = make({.rate = 1000, .start_s = 2.5, .end_s = 6});
  EXPECT_EQ(playhead.next_id(), 4);
  EXPECT_EQ(take(playhead, 100.5), (Ids{4, 5, 6}));  // at 6 s sharp: not any more
  EXPECT_TRUE(playhead.at_end());
}

TEST_F(PlayheadTest, PauseStopsTime) {
  Playhead playhead = make();
  EXPECT_EQ(take(playhead, 100.5), Ids{1});
  playhead.pause(100.5);
  EXPECT_EQ(take(playhead, 101.2), Ids{});
  EXPECT_NEAR(playhead.time_s(101.2), 0.5, 1e-9);
  playhead.resume(101.2);
  EXPECT_EQ(take(playhead, 101.6), Ids{});
  EXPECT_EQ(take(playhead, 101.8), Ids{2});
}

TEST_F(PlayheadTest, StepTakesTheNextAndItsTime) {
  Playhead playhead = make();
  playhead.pause(100);
  EXPECT_EQ(playhead.take_early(100).value()->id, 1);
  EXPECT_EQ(playhead.take_early(100).value()->id, 2);
  EXPECT_NEAR(playhead.time_s(100), 1, 1e-9);
  playhead.resume(100);
  EXPECT_EQ(take(playhead, 100.9), Ids{});
  EXPECT_EQ(take(playhead, 101), Ids{3});
}

TEST_F(PlayheadTest, SeeksBothWaysAndIsClamped) {
  Playhead playhead = make({.start_s = 1, .end_s = 8});
  ASSERT_TRUE(playhead.seek(5.5, 100).is_ok());
  EXPECT_EQ(playhead.next_id(), 7);
  EXPECT_EQ(take(playhead, 100.5), Ids{7});
  ASSERT_TRUE(playhead.seek(3, 100.5).is_ok());
  EXPECT_EQ(take(playhead, 100.5), Ids{4});
  ASSERT_TRUE(playhead.seek(-10, 101).is_ok());
  EXPECT_EQ(playhead.next_id(), 2);
  ASSERT_TRUE(playhead.seek(100, 101).is_ok());
  EXPECT_TRUE(playhead.at_end());
  ASSERT_TRUE(playhead.seek(4, 101).is_ok());
  EXPECT_EQ(take(playhead, 101), Ids{5});
}

TEST_F(PlayheadTest, SeekWhilePausedStaysPaused) {
  Playhead playhead = make();
  playhead.pause(100);
  ASSERT_TRUE(playhead.seek(4, 100).is_ok());
  EXPECT_EQ(take(playhead, 100.5), Ids{});
  EXPECT_EQ(playhead.next_id(), 5);
}

TEST_F(PlayheadTest, AStoppedProcessGoesOnWhereItWas) {
  Playhead playhead = make();
  EXPECT_EQ(take(playhead, 100), Ids{1});
  EXPECT_EQ(take(playhead, 100.75), Ids{});
  EXPECT_EQ(take(playhead, 700.75), Ids{});  // away for ten minutes
  EXPECT_EQ(take(playhead, 701), Ids{2});
}

TEST(Playhead, ReceiveTimesThatGoBackAreDueInOrder) {
  const test::TempFile file(".db3");
  const auto recording = make_recording(file, {0, 2, 1, 3});
  Playhead playhead = Playhead::create(*recording, {}, 0).value();
  std::vector<std::int64_t> ids;
  const auto take = [&](double now_s) {
    for (auto due = playhead.take(now_s).value(); due; due = playhead.take(now_s).value()) {
      ids.push_back(due->id);
      EXPECT_LT(due->late_s, 0.95);  // the one that goes back is not late for it
    }
  };
  take(0.9);
  take(1.8);
  EXPECT_EQ(ids, (std::vector<std::int64_t>{1}));
  take(2.0);
  EXPECT_EQ(ids, (std::vector<std::int64_t>{1, 2, 3}));
}

TEST(Playhead, ReadsPartsAsOne) {
  const test::TempFile file(".db3");
  SessionFile first(file.path()), second(part_path(file.path(), 1), 1);
  for (std::uint8_t i = 0; i < 5; ++i) first.add_bytes(i, {i});
  for (std::uint8_t i = 5; i < 10; ++i) second.add_bytes(i, {i});
  first.close();
  second.close();
  const auto recording = RecordingReader::open(file.path()).value();
  Playhead playhead = Playhead::create(*recording, {.rate = 1000, .start_s = 2}, 0).value();
  std::vector<int> bytes;
  for (auto due = playhead.take(0.5).value(); due; due = playhead.take(0.5).value())
    bytes.push_back(due->message.cdr.at(0));
  EXPECT_EQ(bytes, (std::vector<int>{2, 3, 4, 5, 6, 7, 8, 9}));
  std::remove(part_path(file.path(), 1).c_str());
}

TEST_F(PlayheadTest, RefusesWhatCannotBePlayed) {
  const auto refusal = [&](PlayheadOptions options) {
    const auto created = Playhead::create(*recording, options, 0);
    return created.is_ok() ? std::string() : created.status().message();
  };
  EXPECT_NE(refusal({.rate = 0}).find("rate"), std::string::npos);
  EXPECT_NE(refusal({.rate = -1}).find("rate"), std::string::npos);
  EXPECT_NE(refusal({.rate = std::numeric_limits<double>::quiet_NaN()}).find("rate"),
            std::string::npos);
  EXPECT_NE(refusal({.start_s = 9.5}).find("0 to 9.000 s, found 9.500"), std::string::npos)
      << refusal({.start_s = 9.5});
  EXPECT_NE(refusal({.start_s = -1}).find("start"), std::string::npos);
  EXPECT_NE(refusal({.end_s = 20}).find("end: expected a time in the recording's 0 to 9.000 s"),
            std::string::npos);
  EXPECT_NE(refusal({.start_s = 5, .end_s = 4}).find("after the start at 5.000 s"),
            std::string::npos);
  EXPECT_EQ(refusal({.start_s = 9}), "");
}

}  // namespace
}  // namespace nearmesh
