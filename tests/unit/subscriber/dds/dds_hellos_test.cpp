// SPDX-License-Identifier: Apache-2.0
#include "subscriber/dds/dds_hellos.hpp"

#include <gtest/gtest.h>

namespace nearmesh::subscriber {
namespace {

wire::Handle writer(std::uint8_t n) {
  wire::Handle handle;
  handle.value[0] = n;
  handle.value[15] = 1;
  return handle;
}

DdsHellos::Heard hello_of(wire::SessionId publisher, std::uint8_t by) {
  return {{.publisher = publisher}, writer(by), 1};
}

// As where its network comes and goes: by the time that the others miss its first self its second
// one is gone, too.
TEST(DdsHellos, OfAPublisherThatJoinedAnewTwiceTheOneThatIsThereIsHeard) {
  wire::Mailbox mailbox;
  DdsHellos hellos(mailbox, "hello");
  EXPECT_TRUE(hellos.take({{writer(1), 1, wire::Mover::kThere}}, {hello_of(5, 1)}).empty());
  EXPECT_TRUE(hellos.take({{writer(2), 1, wire::Mover::kThere}}, {hello_of(5, 2)}).empty());
  EXPECT_TRUE(hellos.take({{writer(2), 1, wire::Mover::kLeft}}, {}).empty());
  EXPECT_TRUE(hellos.take({{writer(3), 1, wire::Mover::kThere}}, {hello_of(5, 3)}).empty());
  EXPECT_EQ(hellos.writer_of(5), writer(1));
  EXPECT_EQ(hellos.take({{writer(1), 1, wire::Mover::kLeft}}, {}), std::vector<wire::SessionId>{5});
  EXPECT_EQ(hellos.writer_of(5), writer(3));
  const auto can_hear = [](const wire::Handle& by) { return by == writer(3); };
  EXPECT_EQ(hellos.release(can_hear).size(), 1U);
}

// Who says hello again and again takes no more room than once.
TEST(DdsHellos, WhoContestsASessionOftenLeavesRoomForOthers) {
  wire::Mailbox mailbox;
  DdsHellos hellos(mailbox, "hello");
  static_cast<void>(hellos.take({{writer(1), 1, wire::Mover::kThere},
                                 {writer(2), 1, wire::Mover::kThere},
                                 {writer(3), 1, wire::Mover::kThere}},
                                {hello_of(5, 1), hello_of(6, 2)}));
  for (int i = 0; i < 100; ++i) static_cast<void>(hellos.take({}, {hello_of(6, 3)}));
  static_cast<void>(hellos.take({{writer(4), 1, wire::Mover::kThere}}, {hello_of(5, 4)}));
  EXPECT_EQ(hellos.take({{writer(1), 1, wire::Mover::kLeft}}, {}), std::vector<wire::SessionId>{5});
  EXPECT_EQ(hellos.writer_of(5), writer(4));
}

}  // namespace
}  // namespace nearmesh::subscriber
