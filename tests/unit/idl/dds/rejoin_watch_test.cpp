// SPDX-License-Identifier: Apache-2.0
#include "idl/dds/rejoin_watch.hpp"

#include <arpa/inet.h>
#include <gtest/gtest.h>

#include <chrono>

using namespace nearmesh;
using wire::Interface;

namespace {

// That stops and addresses are noticed is tested where there are some (integration/dds_channel_test.cpp, network/rejoin_test.cpp).
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
  EXPECT_FALSE(watch.is_due(true, true, 100));
  EXPECT_FALSE(watch.is_due(true, true, 105.9));
  EXPECT_TRUE(watch.is_due(true, true, 106));
  EXPECT_FALSE(watch.is_due(true, true, 106.1));  // the next wait begins
  EXPECT_FALSE(watch.is_due(true, true, 118));
  EXPECT_TRUE(watch.is_due(true, true, 118.1));
  for (double now_s = 200, waited = 0; now_s < 1000 && waited < 3; now_s += 0.5)
    if (watch.is_due(true, true, now_s)) ++waited;
  EXPECT_FALSE(watch.is_due(true, true, 1000));
  EXPECT_FALSE(watch.is_due(true, true, 1059));
  EXPECT_TRUE(watch.is_due(true, true, 1060));
}

TEST(DeafWatch, BeginsAnewWhereSomebodyWasFoundMeanwhile) {
  wire::DeafWatch watch;
  EXPECT_FALSE(watch.is_due(true, true, 0));
  EXPECT_FALSE(watch.is_due(false, true, 5));
  EXPECT_FALSE(watch.is_due(true, true, 6));
  EXPECT_FALSE(watch.is_due(true, true, 11.9));
  EXPECT_TRUE(watch.is_due(true, true, 12));
}

TEST(DeafWatch, DisturbsThoseWhoAreFoundTwiceAtMost) {
  wire::DeafWatch watch;
  int due = 0;
  for (double now_s = 0; now_s < 1000; now_s += 0.5)
    due += watch.is_due(true, false, now_s) ? 1 : 0;
  EXPECT_EQ(due, wire::DeafWatch::kMostBesideOthers);
  for (double now_s = 1000; now_s < 1100; now_s += 0.5)
    due += watch.is_due(true, true, now_s) ? 1 : 0;
  EXPECT_GT(due, wire::DeafWatch::kMostBesideOthers) << "nobody is disturbed";
}

sockaddr_in place(std::uint16_t port) {
  sockaddr_in out{};
  out.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  out.sin_port = htons(port);
  return out;
}
/// Its port; 0: none.
int deaf_port(const std::vector<sockaddr_in>& connected, const wire::FoundOthers& found) {
  const auto deaf = wire::deaf_place(connected, found);
  return deaf ? ntohs(deaf->sin_port) : 0;
}

TEST(DeafPlace, IsThatBehindWhichNobodyWasFound) {
  EXPECT_EQ(deaf_port({}, {}), 0);
  EXPECT_EQ(deaf_port({place(1)}, {}), 1);
  EXPECT_EQ(deaf_port({place(1), place(2)}, {1, {place(1)}}), 2);
  EXPECT_EQ(deaf_port({place(1), place(2)}, {1, {place(2), place(7)}}), 1);
  EXPECT_EQ(deaf_port({place(1), place(2)}, {2, {place(1), place(2)}}), 0);
}

TEST(DeafPlace, IsNoneOfARelayNorOfOneThatHasTwo) {
  EXPECT_EQ(deaf_port({place(1)}, {1, {place(7)}}), 0) << "it tells another place than the relay's";
  EXPECT_EQ(deaf_port({place(1), place(2)}, {1, {place(1), place(2)}}), 0);
}

const Interface kLoopback{"lo", "127.0.0.1", true, true, true, false};
const Interface kWlan{"wlan0", "10.0.0.5", true, true, false, true};
const Interface kBridge{"docker0", "172.17.0.1", true, true, false, true};

Interface at(Interface interface, const char* address) {
  interface.address = address;
  return interface;
}

/// What is news to who first joined with some interfaces and later with others: "name address", or nothing.
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
