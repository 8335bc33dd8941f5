// SPDX-License-Identifier: Apache-2.0
#include "subscriber/dds/pose_tally.hpp"

#include <gtest/gtest.h>

namespace nearmesh::subscriber {
namespace {

// Weeks bring more peers than are counted: those that are there now shall be.
TEST(PoseTally, CountsThoseThatWereHeardLast) {
  constexpr std::size_t kMost = 4;
  PoseTally tally(kMost);
  for (wire::SessionId peer = 1; peer <= 100; ++peer) {
    ++tally.of(peer).heard_poses;
    ++tally.of(1).heard_poses;
  }
  const auto counts = tally.counts();
  ASSERT_EQ(counts.size(), kMost);
  EXPECT_EQ(counts.at(1).heard_poses, 101U);
  for (const wire::SessionId peer : {98, 99, 100}) EXPECT_EQ(counts.at(peer).heard_poses, 1U);
}

}  // namespace
}  // namespace nearmesh::subscriber
