// SPDX-License-Identifier: Apache-2.0
// Programs that were stopped for longer than their lease, as a machine that was suspended, and
// resumed before their network is there again.

#include <gtest/gtest.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "idl/dds/fastdds_api.hpp"
#include "network_fixture.hpp"
#include "probe_peer.hpp"
#include "publisher/dds/dds_channel.hpp"

namespace nearmesh::test {
namespace {

constexpr double kStopped_s = 3.5;  // more than the lease of three seconds
constexpr double kAway_s = 3;       // of the network, after the program goes on

/// The interface that programs are told to use: none, which is all there are, or the one that loses
/// its address.
class Rejoin : public ServedFixture, public ::testing::WithParamInterface<std::string> {
 protected:
  void serve_two() { serve_over({{}, {}}, GetParam()); }
  /// Stops it, takes its address, and lets it go on without.
  void resume_without_network(pid_t process, std::size_t host) const {
    ::kill(process, SIGSTOP);
    lan->take_address(host);
    pause(kStopped_s);
    ::kill(process, SIGCONT);
    pause(kAway_s);
  }
};

TEST_P(Rejoin, PublisherThatResumesBeforeItsNetworkServesOnceThatIsBack) {
  serve_two();
  ProbePeer peer(*lan, 1, models);
  ASSERT_GE(peer.certify_at(0, kDeadline_s), 0) << peer.reason();
  resume_without_network(publisher->id(), 0);
  lan->give_address(0, 1);
  EXPECT_GE(peer.certify_at(1, kDeadline_s), 0) << peer.reason() << "\n" << publisher->err();
  EXPECT_EQ(peer.wrong(), 0U);
}

TEST_P(Rejoin, PublisherThatGetsAnotherAddressServesFromThere) {
  serve_two();
  ProbePeer peer(*lan, 1, models);
  ASSERT_GE(peer.certify_at(0, kDeadline_s), 0) << peer.reason();
  lan->take_address(0);
  lan->give_address(0, 77);
  EXPECT_GE(peer.certify_at(1, kDeadline_s), 0) << peer.reason() << "\n" << publisher->err();
  EXPECT_NE(publisher->err().find("10.77.0.77 now: joining again"), std::string::npos)
      << publisher->err();
}

class Announced : public NetworkFixture {};

/// What a publisher announces while it has no network is told once it has one again.
TEST_F(Announced, WithoutANetworkIsHeardOnceThatIsThere) {
  const Lan lan({{}, {}});
  std::unique_ptr<publisher::DdsChannel> channel;
  std::unique_ptr<subscriber::DdsChannel> peer;
  {
    const Lan::Visit visit = lan.visit(0);
    publisher::DdsChannelOptions options;
    options.transport.interface = "e0";
    channel = std::move(publisher::DdsChannel::create(options)).value();
  }
  {
    const Lan::Visit visit = lan.visit(1);
    wire::list_addresses_again();  // both hosts are one process here, which remembers one's alone
    peer = std::move(subscriber::DdsChannel::create({})).value();
  }
  std::vector<std::string> said;
  const auto says = [&](const std::string& part) {
    return await([&] {
      const Lan::Visit visit = lan.visit(0);
      static_cast<void>(channel->take());
      for (std::string& line : channel->take_complaints()) said.push_back(std::move(line));
      return std::any_of(said.begin(), said.end(), [&](const std::string& line) {
        return line.find(part) != std::string::npos;
      });
    });
  };
  // Another address makes it join again, which cannot be done when that is gone too.
  lan.take_address(0);
  lan.give_address(0, 77);
  pause(1);
  lan.take_address(0);
  ASSERT_TRUE(says("could not join again"));
  wire::Hello hello;
  hello.publisher = 5;
  channel->announce(hello, {});
  lan.give_address(0, 78);
  EXPECT_TRUE(await([&] {
    const Lan::Visit visit = lan.visit(0);
    static_cast<void>(channel->take());
    for (std::string& line : channel->take_complaints()) said.push_back(std::move(line));
    return !peer->take().hellos.empty();
  })) << ::testing::PrintToString(said);
}

/// The demo's flight from where it comes down into the ground until it leaves it, a few metres a
/// row: nothing down there is certified without the detail of each place.
void write_low_flight(const Folder& folder, const Exercise& exercise) {
  constexpr std::ptrdiff_t kRows = 800, kFrom = 640, kTo = 752;
  write_flights(folder, exercise, kRows, 20);
  const std::vector<std::string> lines = lines_of(read_text(folder.file("flight1.csv")));
  std::string low = lines.front() + "\n";
  for (std::ptrdiff_t row = kFrom; row < kTo; ++row)
    low += lines[static_cast<std::size_t>(row) + 1] + "\n";
  folder.write("flight1.csv", low);
}

TEST_P(Rejoin, PeerThatResumesBeforeItsNetworkIsServedOnceThatIsBack) {
  constexpr double kRows_hz = 4;
  serve_two();
  write_low_flight(folder, models);
  const auto flight = start_flight(*lan, 1, folder, models, kRows_hz);
  std::size_t seen = 0;  // answers
  const auto says_status = [&](const std::string& status) {
    return await([&] {
      std::vector<std::string> lines = lines_of(read_text(folder.file("answers.jsonl")));
      if (!lines.empty()) lines.pop_back();  // it may be half of one
      while (seen < lines.size())
        if (nlohmann::json::parse(lines[seen++]).value("status", "") == status) return true;
      return false;
    });
  };
  ASSERT_TRUE(says_status("free")) << flight->err();
  resume_without_network(flight->id(), 1);
  ASSERT_TRUE(says_status("uncertain")) << flight->err();
  lan->give_address(1, 2);
  EXPECT_TRUE(says_status("contact")) << flight->err();
  flight->signal(SIGINT);
  ASSERT_EQ(flight->wait(), 0) << flight->err();
  const std::size_t lines = lines_of(read_text(folder.file("answers.jsonl"))).size();
  EXPECT_EQ(count_wrong_answers(folder, models, lines - 1), 0U);  // the last is the summary
}

INSTANTIATE_TEST_SUITE_P(Interface, Rejoin, ::testing::Values("", "e0"), [](const auto& tested) {
  return tested.param.empty() ? std::string("All") : tested.param;
});

}  // namespace
}  // namespace nearmesh::test
