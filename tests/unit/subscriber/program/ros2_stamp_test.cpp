// SPDX-License-Identifier: Apache-2.0
// What is shown in ROS 2 has the time of those who move: it goes on with the newest stamp, and
// begins anew where that does.
#include <gtest/gtest.h>

#include "subscriber/program/ros2_flight.hpp"

namespace nearmesh::subscriber::program {
namespace {

constexpr std::int64_t kSecond_ns = 1'000'000'000;

TEST(Ros2Stamp, GoesOnWithTheNewest) {
  EXPECT_EQ(stamp_after(0, 5 * kSecond_ns), 5 * kSecond_ns);
  EXPECT_EQ(stamp_after(5 * kSecond_ns, 6 * kSecond_ns), 6 * kSecond_ns);
  // Another mover that is a little behind; one that says no time.
  EXPECT_EQ(stamp_after(5 * kSecond_ns, 5 * kSecond_ns - 1), 5 * kSecond_ns);
  EXPECT_EQ(stamp_after(5 * kSecond_ns, 0), 5 * kSecond_ns);
}

TEST(Ros2Stamp, BeginsAnewWithTheClock) {
  EXPECT_EQ(stamp_after(900 * kSecond_ns, kSecond_ns), kSecond_ns);
  constexpr std::int64_t kEnd_ns = 2'147'483'647 * kSecond_ns;  // as late as a stamp can be
  EXPECT_EQ(stamp_after(kEnd_ns, -kEnd_ns), -kEnd_ns);
}

}  // namespace
}  // namespace nearmesh::subscriber::program
