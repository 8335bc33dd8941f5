// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <chrono>

#include "nearmesh/wire/dds_support.hpp"

using namespace nearmesh;

namespace {

// That a stop is noticed is tested where processes are stopped (integration/dds_channel_test.cpp).
TEST(StopDetector, SaysItOnceMoreWhereJoiningAnewFailed) {
  wire::Mailbox mailbox;
  wire::StopDetector stops(mailbox, 20);  // nothing here stands still for 15 s
  EXPECT_FALSE(stops.take_stop());
  stops.try_again();
  const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(15);
  bool again = false;
  while (!again && std::chrono::steady_clock::now() < end) {
    mailbox.wait(0.1);
    again = stops.take_stop();
  }
  EXPECT_TRUE(again);
  EXPECT_FALSE(stops.take_stop());
}

}  // namespace
