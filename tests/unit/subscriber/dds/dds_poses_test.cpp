// SPDX-License-Identifier: Apache-2.0
#include "subscriber/dds/dds_poses.hpp"

#include <gtest/gtest.h>

namespace nearmesh::subscriber {
namespace {

wire::Handle writer(std::uint8_t identity, std::uint8_t participant) {
  wire::Handle handle;
  handle.value[5] = identity;
  handle.value[6] = participant;
  return handle;
}

// Bodies come and go for weeks: each is told of, moved once, and either removed or lost with its program.
TEST(DdsPoses, OnASecuredBusAnIdentityThatHasMovedMoreBodiesThanAreKeptIsHeard) {
  for (const bool is_removed : {true, false}) {
    wire::Mailbox mailbox;
    DdsPoses poses(mailbox, "body_poses", true, 2);
    constexpr std::uint32_t kBodies = 2 * wire::BodyBook::kMaxOfOne;
    for (std::uint32_t i = 0; i < kBodies; ++i) {
      const wire::Handle mover = writer(1, static_cast<std::uint8_t>(is_removed ? 0 : i % 200));
      const std::uint32_t number = is_removed ? i * wire::kBodiesPerPart : 0;
      wire::BodyDirectory directory{.peer = 7, .part = number / wire::kBodiesPerPart};
      const wire::BodyDirectory nobody = directory;
      directory.bodies.push_back({number, "body " + std::to_string(i), "m"});
      wire::BodyPoses said{.peer = 7, .part = directory.part, .sequence = i + 1};
      said.bodies.push_back({.number = number});
      poses.take_directories({}, {{directory, mover}}, false);
      ASSERT_EQ(poses.take({{said, mover}}, false).size(), 1U) << "body " << i;
      if (is_removed) {
        poses.take_directories({}, {{nobody, mover}}, false);
      } else {
        poses.take_directories({{mover, 1, true}}, {}, false);
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

// What is said of bodies comes by other ways than who they are, and of those that are gone nobody tells any more.
TEST(DdsPoses, SamplesOfBodiesThatAreGoneLeaveRoomForThoseThatWait) {
  wire::Mailbox mailbox;
  DdsPoses poses(mailbox, "body_poses", false, 2);
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
    poses.take_directories({{mover, 1, true}}, {}, false);
    EXPECT_TRUE(poses.take({}, false).empty());
  }
}

TEST(DdsPoses, SamplesOfOneThatTellsOfNoBodiesLeaveThoseOfOthers) {
  wire::Mailbox mailbox;
  DdsPoses poses(mailbox, "body_poses", false, 2);
  const wire::Handle waits = writer(1, 1), stranger = writer(1, 2);
  EXPECT_TRUE(poses.take({{poses_of(3, 1), waits}}, false).empty());
  for (std::uint32_t i = 0; i < DdsPoses::kMaxParts + 10; ++i)
    EXPECT_TRUE(poses.take({{poses_of(i * wire::kBodiesPerPart, i + 1), stranger}}, false).empty());
  poses.take_directories({}, {{directory_of(3), waits}}, false);
  EXPECT_EQ(poses.take({}, false).size(), 1U);
}

}  // namespace
}  // namespace nearmesh::subscriber
