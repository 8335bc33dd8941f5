// SPDX-License-Identifier: Apache-2.0
#include "idl/dds/rejoin_watch.hpp"

#include <gtest/gtest.h>

#include <chrono>

using namespace nearmesh;
using wire::Interface;

namespace {

// That stops and addresses are noticed is tested where there are some
// (integration/dds_channel_test.cpp, network/rejoin_test.cpp).
TEST(RejoinWatch, SaysItOnceMoreWhereJoiningAnewFailed) {
  wire::Mailbox mailbox;
  wire::TransportOptions options;
  options.lease_s = 200;  // nothing here stands still for most of it
  options.interface = "127.0.0.1";
  wire::RejoinWatch watch(mailbox, options);
  EXPECT_FALSE(watch.take_due());
  watch.try_again();
  const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(100);
  bool again = false;
  while (!again && std::chrono::steady_clock::now() < end) {
    mailbox.wait(0.1);
    again = watch.take_due();
  }
  EXPECT_TRUE(again);
  EXPECT_FALSE(watch.take_due());
}

TEST(DeafWatch, IsDueOnceAfterEachWaitThatGrows) {
  wire::DeafWatch watch;
  EXPECT_FALSE(watch.is_due(true, 100));
  EXPECT_FALSE(watch.is_due(true, 105.9));
  EXPECT_TRUE(watch.is_due(true, 106));
  EXPECT_FALSE(watch.is_due(true, 106.1));  // the next wait begins
  EXPECT_FALSE(watch.is_due(true, 118));
  EXPECT_TRUE(watch.is_due(true, 118.1));
  for (double now_s = 200, waited = 0; now_s < 1000 && waited < 3; now_s += 0.5)
    if (watch.is_due(true, now_s)) ++waited;
  EXPECT_FALSE(watch.is_due(true, 1000));
  EXPECT_FALSE(watch.is_due(true, 1059));
  EXPECT_TRUE(watch.is_due(true, 1060));
}

TEST(DeafWatch, BeginsAnewWhereSomebodyWasFoundMeanwhile) {
  wire::DeafWatch watch;
  EXPECT_FALSE(watch.is_due(true, 0));
  EXPECT_FALSE(watch.is_due(false, 5));
  EXPECT_FALSE(watch.is_due(true, 6));
  EXPECT_FALSE(watch.is_due(true, 11.9));
  EXPECT_TRUE(watch.is_due(true, 12));
}

const Interface kLoopback{"lo", "127.0.0.1", true, true, true, false};
const Interface kWlan{"wlan0", "10.0.0.5", true, true, false, true};
const Interface kBridge{"docker0", "172.17.0.1", true, true, false, true};

Interface at(Interface interface, const char* address) {
  interface.address = address;
  return interface;
}

/// What is news to who first joined with some interfaces and later with others: "name address", or
/// nothing.
std::string news(const std::string& wanted, const std::vector<std::vector<Interface>>& joined,
                 const std::vector<Interface>& now) {
  wire::NetworkMemory memory(wanted);
  for (const auto& interfaces : joined) memory.joined(interfaces);
  const Interface* found = memory.news(now);
  return found == nullptr ? "" : found->name + " " + found->address;
}

TEST(NetworkMemory, WhatWasJoinedWithIsNoNews) {
  EXPECT_EQ(news("", {{kLoopback, kWlan}}, {kLoopback, kWlan}), "");
  EXPECT_EQ(news("", {{kLoopback, kWlan}}, {kLoopback}), "");
}

TEST(NetworkMemory, AnInterfaceThatWasUsedAndComesBackIsNews) {
  EXPECT_EQ(
      news("", {{kLoopback, kWlan, kBridge}, {kLoopback, kBridge}}, {kLoopback, kBridge, kWlan}),
      "wlan0 10.0.0.5");
}

TEST(NetworkMemory, AnotherAddressOfAnInterfaceIsNews) {
  EXPECT_EQ(news("", {{kLoopback, kWlan}}, {kLoopback, at(kWlan, "10.0.0.9")}), "wlan0 10.0.0.9");
}

TEST(NetworkMemory, AnInterfaceNeverUsedIsNewsToWhoHasLoopbackAlone) {
  EXPECT_EQ(news("", {{kLoopback}}, {kLoopback, kWlan}), "wlan0 10.0.0.5");
  EXPECT_EQ(news("", {{kLoopback, kWlan}}, {kLoopback, kWlan, kBridge}), "");
}

TEST(NetworkMemory, OneWithoutALinkIsNotThere) {
  Interface unplugged = kWlan;
  unplugged.is_running = false;
  EXPECT_EQ(news("", {{kLoopback}}, {kLoopback, unplugged}), "");
  EXPECT_EQ(news("", {{kLoopback, unplugged}}, {kLoopback, kWlan}), "wlan0 10.0.0.5");
}

TEST(NetworkMemory, WhoUsesOneInterfaceCaresForNoOther) {
  EXPECT_EQ(news("127.0.0.1", {{kLoopback}}, {kLoopback, kWlan}), "");
  EXPECT_EQ(news("wlan0", {{kLoopback, kWlan}}, {kLoopback, at(kWlan, "10.0.0.9")}),
            "wlan0 10.0.0.9");
}

}  // namespace
