// SPDX-License-Identifier: Apache-2.0
// The real programs on thin and lossy links, in network namespaces of the tests' own.

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>

#include <algorithm>
#include <cstdio>

#include "network_fixture.hpp"

namespace nearmesh::test {
namespace {

class Network : public ServedFixture {};

/// Rates and pauses are those of the machine too: where it was held up they are measured again.
/// What is flooded or wrong is so each time.
constexpr int kTries = 5;

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
  bool is_filled = false, overtakes = false;
  for (int i = 0; i < kTries && !(is_filled && overtakes); ++i) {
    const PipeResult pipe = fill_pipe(*lan, 1, models, 5);
    EXPECT_LT(static_cast<double>(pipe.publisher_sent_bytes),
              1.35 * static_cast<double>(pipe.sample_bytes));
    is_filled = mbit_per_s(pipe) > 0.5;
    const std::size_t asked = pipe.overtakes_s.size();
    overtakes = asked >= 3 && pipe.overtakes_s[asked / 2] < 0.3;
    std::printf("%.2f Mbit/s, %zu overtakes, %.3f s (median)\n", mbit_per_s(pipe), asked,
                asked == 0 ? 0 : pipe.overtakes_s[asked / 2]);
  }
  EXPECT_TRUE(is_filled);
  EXPECT_TRUE(overtakes);
}

TEST_F(Network, LossesAreRepairedWithoutAFlood) {
  serve_over({{}, {.mbit_per_s = 1, .loss = 0.05}});
  double most = 0;
  for (int i = 0; i < kTries && most <= 0.25; ++i) {
    const PipeResult pipe = fill_pipe(*lan, 1, models, 5);
    most = std::max(most, mbit_per_s(pipe));
    EXPECT_LT(static_cast<double>(pipe.publisher_sent_bytes),
              2.5 * static_cast<double>(pipe.sample_bytes));
  }
  EXPECT_GT(most, 0.25);
}

/// Flies until it stays certified as it should, and each time every answer is right.
FlightResult fly_well(const Lan& lan, const Folder& folder, const Exercise& models,
                      std::uint64_t certified, double lag_s) {
  FlightResult flight;
  for (int i = 0; i < kTries && !::testing::Test::HasFailure(); ++i) {
    flight = fly(lan, 1, folder, models, {.frames = 80});
    EXPECT_TRUE(flight.ended) << flight.complaint;
    EXPECT_EQ(flight.answers, 80U);
    EXPECT_EQ(flight.wrong, 0U);
    if (flight.certified > certified && flight.longest_lag_s < lag_s) break;
  }
  EXPECT_GT(flight.certified, certified);
  EXPECT_LT(flight.longest_lag_s, lag_s);
  return flight;
}

TEST_F(Network, FlightOverAThinLinkStaysCertified) {
  serve_over({{}, {.mbit_per_s = 0.25}});
  EXPECT_GT(fly_well(*lan, folder, models, 60, 2.5).contacts, 4U);
}

TEST_F(Network, FlightOverALossyLinkIsNeverWrongAndGoesOn) {
  serve_over({{}, {.mbit_per_s = 1, .loss = 0.1}});
  static_cast<void>(fly_well(*lan, folder, models, 40, 5));
}

}  // namespace
}  // namespace nearmesh::test
