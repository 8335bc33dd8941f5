// SPDX-License-Identifier: Apache-2.0
// The real programs on thin and lossy links, in network namespaces of the tests' own.

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>

#include "network_fixture.hpp"

namespace nearmesh::test {
namespace {

class Network : public ServedFixture {};

double mbit_per_s(const PipeResult& pipe) {
  return 8e-6 * static_cast<double>(pipe.bytes) / pipe.seconds;
}

/// Sends datagrams of 1,200 bytes to a host, one a millisecond.
void send_datagrams(const Lan& lan, const char* to, int count) {
  const Lan::Visit visit = lan.visit(0);
  const int socket = ::socket(AF_INET, SOCK_DGRAM, 0);
  sockaddr_in address{.sin_family = AF_INET, .sin_port = htons(9)};
  ASSERT_EQ(::inet_pton(AF_INET, to, &address.sin_addr), 1);
  const std::vector<char> bytes(1200);
  for (int i = 0; i < count; ++i) {
    ::sendto(socket, bytes.data(), bytes.size(), 0, reinterpret_cast<const sockaddr*>(&address),
             sizeof address);
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  ::close(socket);
}

TEST_F(Network, LinksKeepTheirRateAndLoseWhatTheyShould) {
  const Lan links({{}, {.mbit_per_s = 4}, {.loss = 0.5}});
  const Stopwatch watch;
  send_datagrams(links, "10.77.0.2", 600);
  const double most = 125e3 * 4 * watch.seconds() + 60e3;  // and the queue
  EXPECT_LT(static_cast<double>(links.counters(1).received_bytes), most);
  EXPECT_GT(links.counters(1).received_bytes, 100'000U);
  send_datagrams(links, "10.77.0.3", 400);
  EXPECT_NEAR(static_cast<double>(links.counters(2).received_packets) / 400, 0.5, 0.15);
}

TEST_F(Network, ThinLinkIsFilledNotFloodedAndNeededNowOvertakes) {
  serve_over({{}, {.mbit_per_s = 1}});
  const PipeResult pipe = fill_pipe(*lan, 1, models, 5);
  EXPECT_GT(mbit_per_s(pipe), 0.5);
  const auto payload = static_cast<double>(pipe.sample_bytes);
  EXPECT_LT(static_cast<double>(pipe.publisher_sent_bytes), 1.35 * payload);
  ASSERT_GE(pipe.overtakes_s.size(), 3U);
  EXPECT_LT(pipe.overtakes_s[pipe.overtakes_s.size() / 2], 0.3);
}

TEST_F(Network, LossesAreRepairedWithoutAFlood) {
  serve_over({{}, {.mbit_per_s = 1, .loss = 0.05}});
  const PipeResult pipe = fill_pipe(*lan, 1, models, 5);
  EXPECT_GT(mbit_per_s(pipe), 0.25);
  EXPECT_LT(static_cast<double>(pipe.publisher_sent_bytes),
            2.5 * static_cast<double>(pipe.sample_bytes));
}

TEST_F(Network, FlightOverAThinLinkStaysCertified) {
  serve_over({{}, {.mbit_per_s = 0.25}});
  const FlightResult flight = fly(*lan, 1, folder, models, {.frames = 80});
  ASSERT_TRUE(flight.ended) << flight.complaint;
  EXPECT_EQ(flight.answers, 80U);
  EXPECT_EQ(flight.wrong, 0U);
  EXPECT_GT(flight.contacts, 4U);
  EXPECT_GT(flight.certified, 60U);
  EXPECT_LT(flight.longest_lag_s, 2.5);
}

TEST_F(Network, FlightOverALossyLinkIsNeverWrongAndGoesOn) {
  serve_over({{}, {.mbit_per_s = 1, .loss = 0.1}});
  const FlightResult flight = fly(*lan, 1, folder, models, {.frames = 80});
  ASSERT_TRUE(flight.ended) << flight.complaint;
  EXPECT_EQ(flight.answers, 80U);
  EXPECT_EQ(flight.wrong, 0U);
  EXPECT_GT(flight.certified, 40U);
  EXPECT_LT(flight.longest_lag_s, 5);
}

}  // namespace
}  // namespace nearmesh::test
