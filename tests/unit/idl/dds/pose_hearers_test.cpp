// SPDX-License-Identifier: Apache-2.0
#include "idl/dds/pose_hearers.hpp"

#include <gtest/gtest.h>

#include <array>

#include "idl/dds/door_watch.hpp"
#include "tests/support/rtps_message.hpp"

namespace nearmesh::wire {
namespace {

using nearmesh::test::Rtps;

class PoseHearersTest : public testing::Test {
 protected:
  static constexpr std::uint32_t kPoses = 0x00000802, kReports = 0x00000a02, kReader = 0x00000507;
  static constexpr ParticipantKey kOwn{1, 15, 1}, kHearer{1, 15, 7}, kOther{1, 15, 8};

  static std::vector<std::uint8_t> names(const std::vector<std::string>& bodies) {
    return user_data_of({bodies, {}}).value();
  }
  static RtpsPlace at_port(std::uint32_t port) { return {.kind = 1, .port = port, .address = {}}; }
  /// `data`: as user data; empty for one that tells none.
  void meet(const ParticipantKey& key, std::uint32_t port, const std::vector<std::uint8_t>& data) {
    RtpsAnnouncement told;
    told.user = data;
    told.places[told.place_count++] = at_port(port);
    told.places[told.place_count++] = at_port(port + 1);
    hearers_.expect(key, told);
  }
  /// Whether all go there, not one now and then.
  [[nodiscard]] bool is_of_use(std::uint32_t port) {
    std::array<bool, 2> second{};
    for (std::uint32_t i = 0; i < 2; ++i) {
      EXPECT_TRUE(hearers_.may_go(at_port(port + i), now_s_)) << "the first";
      second[i] = hearers_.may_go(at_port(port + i), now_s_);
    }
    EXPECT_EQ(second[0], second[1]);
    now_s_ += PoseHearers::kClock_s;
    return second[0];
  }

  PoseHearers hearers_;
  double now_s_ = 0;
};

TEST_F(PoseHearersTest, OnlyWhoNamesABodyThatIsMovedHereGetsPoses) {
  meet(kHearer, 10, names({"terrain", "red"}));
  meet(kOther, 20, names({"terrain", "blue"}));
  meet(kOwn, 30, names({}));  // all that it names are its own
  EXPECT_TRUE(is_of_use(40)) << "of whom nothing is known";
  hearers_.move(kPoses, {"green", "red"});
  EXPECT_TRUE(is_of_use(10));
  EXPECT_FALSE(is_of_use(20));
  EXPECT_FALSE(is_of_use(30));
  EXPECT_TRUE(is_of_use(40));
  // Bodies come and go.
  hearers_.move(kPoses, {"blue"});
  EXPECT_FALSE(is_of_use(10));
  EXPECT_TRUE(is_of_use(20));
}

// The exercise's clock is the latest that anybody tells.
TEST_F(PoseHearersTest, WhoNeedsNoneHearsOneNowAndThen) {
  hearers_.move(kPoses, {"red"});
  meet(kHearer, 10, names({"blue"}));
  int heard = 0;
  for (double now_s = 0; now_s < 60; now_s += 0.05)
    heard += hearers_.may_go(at_port(10), now_s) ? 1 : 0;
  EXPECT_LE(heard, 12);
  EXPECT_GE(heard, 11);
}

TEST_F(PoseHearersTest, WhoTellsNothingThatIsUnderstoodHearsAll) {
  hearers_.move(kPoses, {"red"});
  std::vector<std::uint8_t> told = names({"blue", "green"});
  meet(kHearer, 10, told);
  ASSERT_FALSE(is_of_use(10));
  told[0] = 'x';
  meet(kHearer, 10, told);
  EXPECT_TRUE(is_of_use(10)) << "a host's own user data";
}

TEST_F(PoseHearersTest, WhoComesWhereAnotherWasIsNotTakenForIt) {
  hearers_.move(kPoses, {"red"});
  meet(kHearer, 10, names({"blue"}));
  ASSERT_FALSE(is_of_use(10));
  meet(kOther, 10, {});
  EXPECT_TRUE(is_of_use(10));
  meet(kHearer, 20, names({"blue"}));
  ASSERT_FALSE(is_of_use(20));
  hearers_.forget(kHearer);
  EXPECT_TRUE(is_of_use(20));
  EXPECT_EQ(hearers_.size(), 0U);
}

TEST_F(PoseHearersTest, FloodIsNotRemembered) {
  for (std::uint32_t port = 0; port < 3 * PoseHearers::kMaxPlaces; port += 2)
    meet(kHearer, port, names({"blue"}));
  EXPECT_LE(hearers_.size(), PoseHearers::kMaxPlaces);
}

TEST_F(PoseHearersTest, OnlyMessagesThatAreAllPosesAreLeftOut) {
  const auto data = [](Rtps& m, std::uint32_t writer) {
    m.begin_data(kReader, writer, 3, 4).zeros(40).end();
  };
  Rtps poses(kOwn);
  poses.to(kHearer).timestamp();
  data(poses, kPoses);
  EXPECT_FALSE(hearers_.is_poses(poses.bytes)) << "nothing is moved here";
  hearers_.move(kPoses, {"red"});
  EXPECT_TRUE(hearers_.is_poses(poses.bytes));
  for (std::size_t size = 0; size < poses.bytes.size(); ++size)
    EXPECT_FALSE(hearers_.is_poses(std::span(poses.bytes).first(size)) &&
                 size < poses.bytes.size() - 40)
        << size;

  Rtps report(kOwn), both(kOwn), reminded(kOwn), nothing(kOwn);
  data(report, kReports);
  EXPECT_FALSE(hearers_.is_poses(report.bytes));
  data(both, kPoses);
  data(both, kReports);
  EXPECT_FALSE(hearers_.is_poses(both.bytes));
  data(reminded, kPoses);
  reminded.heartbeat(1, 3, 1, kReader, kPoses);
  EXPECT_FALSE(hearers_.is_poses(reminded.bytes));
  nothing.timestamp();
  EXPECT_FALSE(hearers_.is_poses(nothing.bytes));
}

// From the hearer's announcement to the places that a mover's message is sent to.
TEST_F(PoseHearersTest, DoorSendsFewPosesToWhoNamesNoneOfTheBodies) {
  DoorWatch door({.is_plain = true, .by_udp_alone = true}, nullptr);
  Rtps heard(kHearer);
  heard.begin_announcement().lease(20).user_data(names({"blue"})).finish_announcement();
  ASSERT_FALSE(door.check(heard.bytes, {true, 7411}).refusal);
  RtpsPlace where = at_port(7411);
  where.address[12] = 127;
  where.address[15] = 1;
  Rtps poses(kOwn);
  poses.begin_data(kReader, kPoses, 3, 4).zeros(40).end();
  const auto reached = [&] {
    std::vector<RtpsPlace> places{where, at_port(1)};
    door.leave_out(poses.bytes, places, [](const RtpsPlace& its) { return its; });
    return places.size();
  };
  EXPECT_EQ(reached(), 2U);
  door.tell_moved(kPoses, {"red"});
  EXPECT_EQ(reached(), 2U) << "the first, for the clock";
  EXPECT_EQ(reached(), 1U);
  door.tell_moved(kPoses, {"red", "blue"});
  EXPECT_EQ(reached(), 2U);
}

}  // namespace
}  // namespace nearmesh::wire
