// SPDX-License-Identifier: Apache-2.0
#include "subscriber/dds/dds_poses.hpp"

#include <gtest/gtest.h>

#include "nearmesh/idl/messages/topics.hpp"

namespace nearmesh::subscriber {
namespace {

wire::Handle writer(std::uint8_t identity, std::uint8_t participant) {
  wire::Handle handle;
  handle.value[5] = identity;
  handle.value[6] = participant;
  return handle;
}

// Bodies come and go for weeks: each is told of, moved once, and either removed or lost with its
// program.
TEST(DdsPoses, OnASecuredBusAnIdentityThatHasMovedMoreBodiesThanAreKeptIsHeard) {
  for (const bool is_removed : {true, false}) {
    wire::Mailbox mailbox;
    DdsPoses poses(mailbox, "body_poses", true);
    constexpr std::uint32_t kBodies = 2 * wire::BodyBook::kMaxOfOne;
    for (std::uint32_t i = 0; i < kBodies; ++i) {
      const wire::Handle mover = writer(1, static_cast<std::uint8_t>(is_removed ? 0 : i % 200));
      const std::uint32_t number = is_removed ? i * wire::kBodiesPerPart : 0;
      wire::BodyDirectory directory{.peer = 7, .part = number / wire::kBodiesPerPart};
      const wire::BodyDirectory nobody = directory;
      directory.bodies.push_back({number, "body " + std::to_string(i), "m"});
      wire::BodyPoses said{.peer = 7, .part = directory.part, .sequence = i + 1};
      said.bodies.push_back({.number = number});
      poses.take_directories({{mover, 1, wire::Mover::kThere}}, {{directory, mover}}, false);
      ASSERT_EQ(poses.take({{said, mover}}, false).size(), 1U) << "body " << i;
      if (is_removed) {
        poses.take_directories({}, {{nobody, mover}}, false);
      } else {
        poses.take_directories({{mover, 1, wire::Mover::kLeft}}, {}, false);
      }
      EXPECT_TRUE(poses.take({}, false).empty());
    }
    EXPECT_TRUE(mailbox.take_complaints().empty());
  }
}

wire::BodyPoses poses_of(std::uint32_t number, std::uint32_t sequence) {
  wire::BodyPoses said{.peer = 7, .part = number / wire::kBodiesPerPart, .sequence = sequence};
  said.bodies.push_back({.number = number});
  return said;
}
wire::BodyPromises promises_of(std::uint32_t number) {
  wire::BodyPromises said{.peer = 7, .part = number / wire::kBodiesPerPromise};
  said.bodies.push_back({.number = number});
  return said;
}
wire::BodyDirectory directory_of(std::uint32_t number, double max_speed_mps = 0) {
  wire::BodyDirectory directory{.peer = 7, .part = number / wire::kBodiesPerPart};
  directory.bodies.push_back({number, "body " + std::to_string(number), "m"});
  directory.bodies.back().max_speed_mps = max_speed_mps;
  return directory;
}

// What is said of bodies comes by other ways than who they are, and of those that are gone nobody
// tells any more.
TEST(DdsPoses, SamplesOfBodiesThatAreGoneLeaveRoomForThoseThatWait) {
  wire::Mailbox mailbox;
  DdsPoses poses(mailbox, "body_poses", false);
  std::uint32_t sequence = 0;
  for (const std::uint8_t participant : {std::uint8_t{1}, std::uint8_t{2}}) {
    const wire::Handle mover = writer(1, participant);
    const auto gone = static_cast<std::uint32_t>(DdsPoses::kMaxParts + 10);
    for (std::uint32_t part = 0; part < gone; ++part) {
      poses.hear_promises({{promises_of(part * wire::kBodiesPerPromise), mover}});
      EXPECT_TRUE(
          poses.take({{poses_of(part * wire::kBodiesPerPart, ++sequence), mover}}, false).empty());
    }
    const std::uint32_t number = gone * wire::kBodiesPerPromise;
    poses.hear_promises({{promises_of(number), mover}});
    EXPECT_TRUE(poses.take({{poses_of(number, ++sequence), mover}}, false).empty());
    poses.take_directories({}, {{directory_of(number, 10), mover}}, false);
    poses.hear_promises({});
    EXPECT_EQ(poses.take({}, false).size(), 1U);
    EXPECT_EQ(poses.take_promises().size(), 1U);
    poses.take_directories({{mover, 1, wire::Mover::kLeft}}, {}, false);
    EXPECT_TRUE(poses.take({}, false).empty());
  }
}

TEST(DdsPoses, SamplesOfOneThatTellsOfNoBodiesLeaveThoseOfOthers) {
  wire::Mailbox mailbox;
  DdsPoses poses(mailbox, "body_poses", false);
  const wire::Handle waits = writer(1, 1), stranger = writer(1, 2);
  EXPECT_TRUE(poses.take({{poses_of(3, 1), waits}}, false).empty());
  for (std::uint32_t i = 0; i < DdsPoses::kMaxParts + 10; ++i)
    EXPECT_TRUE(poses.take({{poses_of(i * wire::kBodiesPerPart, i + 1), stranger}}, false).empty());
  poses.take_directories({}, {{directory_of(3), waits}}, false);
  EXPECT_EQ(poses.take({}, false).size(), 1U);
}

// Robots, numbers of samples and promises are told apart by the session: what is said in its name
// would stand among its own.
TEST(DdsPoses, WhatAStrangerSaysInTheNameOfAPeerThatIsThereDoesNotCount) {
  wire::Mailbox mailbox;
  DdsPoses poses(mailbox, "body_poses", false);
  const wire::Handle mover = writer(1, 1), stranger = writer(1, 2);
  // A directory alone takes nothing from anybody, though it comes first.
  poses.take_directories({}, {{directory_of(1, 10), stranger}}, false);
  poses.take_directories({}, {{directory_of(0), mover}}, false);
  EXPECT_EQ(poses.take({{poses_of(0, 1), mover}}, false).size(), 1U);
  EXPECT_TRUE(poses.take({{poses_of(1, 1), stranger}}, false).empty());
  poses.hear_promises({{promises_of(1), stranger}});
  EXPECT_TRUE(poses.take_promises().empty());
  EXPECT_EQ(poses.take({{poses_of(0, 3), mover}}, false).size(), 1U);
  EXPECT_TRUE(poses.take({{poses_of(1, 2), stranger}}, false).empty());
  EXPECT_EQ(poses.take_refused(), 3U);
  EXPECT_TRUE(poses.may_speak_for(7, mover));
  EXPECT_FALSE(poses.may_speak_for(7, stranger));
  const std::vector<std::string> lines = mailbox.take_complaints();
  ASSERT_EQ(lines.size(), 1U);
  EXPECT_NE(lines[0].find("in the name of peer " + wire::partition_of(7)), std::string::npos)
      << lines[0];
  // It may be the peer itself, which joined anew: heard once its old self is missed, and not
  // before.
  poses.take_directories({{mover, 1, wire::Mover::kLeft}}, {}, false);
  const std::vector<wire::BodyPose> after = poses.take({}, false);
  ASSERT_EQ(after.size(), 1U);
  EXPECT_EQ(after[0].body, "body 1");
  EXPECT_EQ(after[0].sequence, 2U);
  EXPECT_EQ(poses.take_promises().size(), 1U);
}

TEST(DdsPoses, OnASecuredBusAnIdentityKeepsItsSessionsThroughWhicheverOfItsPrograms) {
  wire::Mailbox mailbox;
  DdsPoses poses(mailbox, "body_poses", true);
  const wire::Handle mover = writer(1, 1), anew = writer(1, 2), stranger = writer(2, 3);
  poses.take_directories({}, {{directory_of(0), mover}, {directory_of(0), anew}}, false);
  EXPECT_EQ(poses.take({{poses_of(0, 1), mover}, {poses_of(0, 2), anew}}, false).size(), 2U);
  poses.take_directories({{mover, 1, wire::Mover::kLeft}, {anew, 1, wire::Mover::kLeft}}, {},
                         false);
  EXPECT_TRUE(poses.take({}, false).empty());
  poses.take_directories({}, {{directory_of(1), stranger}}, false);
  EXPECT_TRUE(poses.take({{poses_of(1, 3), stranger}}, false).empty());
}

std::map<std::string, wire::Mover> changes_of(DdsPoses& poses) {
  Channel::Inbox inbox;
  poses.tell_movers(inbox);
  return inbox.movers;
}

// Fast DDS does not send again what a reader has had of a writer, whether that only fell silent or
// its lease had ended.
TEST(DdsPoses, WhoSpeaksAgainNeedNotTellAnewOfItsBodies) {
  wire::Mailbox mailbox;
  DdsPoses poses(mailbox, "body_poses", false);
  const wire::Handle mover = writer(1, 1);
  poses.take_directories({}, {{directory_of(0), mover}}, false);
  EXPECT_EQ(poses.take({{poses_of(0, 1), mover}}, false).size(), 1U);
  static_cast<void>(changes_of(poses));
  poses.take_directories({{mover, 1, wire::Mover::kLeft}}, {}, false);
  EXPECT_TRUE(poses.take({}, false).empty());
  EXPECT_EQ(changes_of(poses).at("body 0"), wire::Mover::kLeft);
  // What was on its way does not bring it back.
  EXPECT_TRUE(poses.take({{poses_of(0, 2), mover}}, false).empty());
  EXPECT_TRUE(changes_of(poses).empty());
  poses.take_directories({{mover, 2, wire::Mover::kThere}}, {}, false);
  EXPECT_EQ(poses.take({}, false).size(), 1U);
  EXPECT_EQ(poses.take({{poses_of(0, 3), mover}}, false).size(), 1U);
  EXPECT_EQ(changes_of(poses).at("body 0"), wire::Mover::kThere);
  // One that is barred is forgotten.
  poses.take_directories({{mover, 3, wire::Mover::kBarred}}, {}, false);
  EXPECT_TRUE(poses.take({}, false).empty());
  poses.take_directories({{mover, 4, wire::Mover::kThere}}, {}, false);
  EXPECT_TRUE(poses.take({{poses_of(0, 4), mover}}, false).empty());
}

TEST(DdsPoses, BodiesOfThoseThatWentLeaveRoomForThoseThatCome) {
  wire::Mailbox mailbox;
  DdsPoses poses(mailbox, "body_poses", false);
  std::uint8_t participant = 0;
  for (std::size_t told = 0; told < DdsPoses::kMaxParts; told += DdsPoses::kMaxPartsOfOne) {
    const wire::Handle mover = writer(1, ++participant);
    std::vector<DdsPoses::HeardDirectory> all;
    for (std::uint32_t part = 0; part < DdsPoses::kMaxPartsOfOne; ++part)
      all.push_back({directory_of(part * wire::kBodiesPerPart), mover});
    poses.take_directories({}, std::move(all), false);
    poses.take_directories({{mover, 1, wire::Mover::kLeft}}, {}, false);
    EXPECT_TRUE(poses.take({}, false).empty());
  }
  const wire::Handle comes = writer(2, 1);
  poses.take_directories({}, {{directory_of(0), comes}}, false);
  EXPECT_EQ(poses.take({{poses_of(0, 1), comes}}, false).size(), 1U);
  EXPECT_TRUE(mailbox.take_complaints().empty());
}

// As peers of another site do through a router: each of them removes bodies of its own.
TEST(DdsPoses, SessionsThatSpeakThroughOneParticipantAreToldApart) {
  wire::Mailbox mailbox;
  DdsPoses poses(mailbox, "body_poses", false);
  const wire::Handle router = writer(1, 1);
  const auto as_other = [](auto said) {
    said.peer = 8;
    return said;
  };
  const std::uint32_t others = wire::kBodiesPerPart;
  poses.take_directories({}, {{directory_of(0), router}, {as_other(directory_of(others)), router}},
                         false);
  EXPECT_EQ(
      poses.take({{poses_of(0, 1), router}, {as_other(poses_of(others, 1)), router}}, false).size(),
      2U);
  EXPECT_EQ(poses.take_movers().size(), 2U);
  EXPECT_EQ(changes_of(poses).size(), 2U);
  wire::BodyDirectory removed = directory_of(0);
  removed.bodies.clear();
  poses.take_directories({}, {{removed, router}}, false);
  EXPECT_EQ(changes_of(poses),
            (std::map<std::string, wire::Mover>{{"body 0", wire::Mover::kLeft}}));
  EXPECT_EQ(poses.take_ended(), std::set<std::string>{"body 0"});
  // A known session is not told of again, whichever spoke last.
  EXPECT_EQ(poses.take({{as_other(poses_of(others, 2)), router}}, false).size(), 1U);
  EXPECT_TRUE(poses.take_movers().empty());
}

// Bodies come and go while a host takes nothing: what is told of them stays bounded, and nobody who
// left is taken to be there.
TEST(DdsPoses, AHostThatTakesNothingForLongIsToldOfAllThatAreThere) {
  wire::Mailbox mailbox;
  DdsPoses poses(mailbox, "body_poses", false);
  constexpr std::size_t kMost = 10;
  Channel::Inbox inbox;
  const wire::Handle stays = writer(1, 1);
  poses.take_directories({}, {{directory_of(0), stays}}, false);
  for (std::uint8_t i = 2; i < 60; ++i) {
    const wire::Handle mover = writer(1, i);
    wire::BodyDirectory directory = directory_of(i * wire::kBodiesPerPart);
    wire::BodyPoses said = poses_of(i * wire::kBodiesPerPart, 1);
    directory.peer = said.peer = 100U + i;
    poses.take_directories({}, {{directory, mover}}, false);
    EXPECT_EQ(poses.take({{poses_of(0, i), stays}, {said, mover}}, false).size(), 2U);
    poses.tell_bodies(inbox, kMost);
    poses.tell_movers(inbox, kMost);
    poses.take_directories({{mover, 1, wire::Mover::kLeft}}, {}, false);
    EXPECT_TRUE(poses.take({}, false).empty());
    poses.tell_bodies(inbox, kMost);
    poses.tell_movers(inbox, kMost);
    EXPECT_LE(inbox.bodies.size(), kMost);
    EXPECT_LE(inbox.movers.size(), kMost);
  }
  EXPECT_TRUE(inbox.are_all_bodies);
  EXPECT_TRUE(inbox.are_all_movers);
  EXPECT_TRUE(inbox.movers.contains("body 0"));
  for (const auto& [body, mover] : inbox.movers)
    EXPECT_EQ(mover, body == "body 0" ? wire::Mover::kThere : wire::Mover::kLeft) << body;
  EXPECT_EQ(inbox.bodies.front().body.name, "body 0");
}

}  // namespace
}  // namespace nearmesh::subscriber
