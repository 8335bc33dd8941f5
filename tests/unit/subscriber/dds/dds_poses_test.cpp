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

}  // namespace
}  // namespace nearmesh::subscriber
