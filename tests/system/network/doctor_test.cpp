// SPDX-License-Identifier: Apache-2.0
// What doctor and status say of networks and programs that are not well, in namespaces of the
// tests' own.

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>

#include <array>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <functional>
#include <nlohmann/json.hpp>

#include "idl/dds/fastdds_api.hpp"
#include "nearmesh/subscriber/peer/session.hpp"
#include "network_fixture.hpp"
#include "tests/support/rtps_message.hpp"

namespace nearmesh::test {
namespace {

namespace fdds = wire::fdds;
using nlohmann::json;
using Words = std::vector<std::string>;

constexpr int kDomain = 45;

class DoctorOn : public NetworkFixture {
 protected:
  std::unique_ptr<Process> examine(const Lan& lan, std::size_t host, const Words& more = {}) {
    const Lan::Visit there = lan.visit(host);
    Words words{"doctor", "--json", "--domain", std::to_string(kDomain)};
    words.insert(words.end(), more.begin(), more.end());
    return std::make_unique<Process>(folder, "nearmesh-subscriber", words);
  }
  /// One on each of two hosts, again until `holds` of what the two told: they measure for a time
  /// that is short and fixed, in which a machine may be held up.
  bool examine_both(const Lan& lan, const Words& more,
                    const std::function<bool(const json&, const json&)>& holds) {
    return await([&] {
      const auto one = examine(lan, 0, more), two = examine(lan, 1, more);
      codes = {one->wait(), two->wait()};
      reports = {json::parse(one->out()), json::parse(two->out())};
      return holds(reports[0], reports[1]);
    });
  }
  std::array<int, 2> codes{};
  std::array<json, 2> reports;

  static void run_on(const Lan& lan, std::size_t host, const std::string& command) {
    const Lan::Visit there = lan.visit(host);
    ASSERT_EQ(std::system(command.c_str()), 0) << command;
  }
  /// Drops what comes to UDP ports there.
  static void close_ports(const Lan& lan, std::size_t host, const std::string& ports) {
    run_on(lan, host,
           "nft 'add table ip wall; add chain ip wall in { type filter hook input priority 0; }; "
           "add rule ip wall in udp dport " +
               ports + " drop'");
  }
  /// Of one kind and name; the text, empty where there is none.
  static std::string text_of(const json& report, const std::string& kind, const std::string& name) {
    for (const json& entry : report.at("findings"))
      if (entry.at("kind") == kind && entry.at("name") == name) return entry.at("text");
    return {};
  }
  static void expect_says(const json& report, const std::string& kind, const std::string& name,
                          const std::string& part) {
    EXPECT_NE(text_of(report, kind, name).find(part), std::string::npos) << report.dump(1);
  }
};

TEST_F(DoctorOn, AGoodLinkIsHealthy) {
  const Lan lan({{}, {}});
  EXPECT_TRUE(examine_both(lan, {}, [this](const json&, const json&) {
    return codes == std::array{0, 0};
  }));
  for (const json& report : reports) {
    expect_says(report, "good", "match", "another doctor after");
    expect_says(report, "fact", "interfaces", "e0 10.77.0.");
    // Advice where it asserts.
    EXPECT_NE(text_of(report, "advice", "fast dds") + text_of(report, "good", "fast dds"), "")
        << report.dump(1);
    EXPECT_EQ(text_of(report, "advice", "network"), "");
  }
}

TEST_F(DoctorOn, AMachineWithoutANetworkIsToldSo) {
  const Lan lan(std::vector<Link>(1));
  run_on(lan, 0, "ip link set e0 down");
  const auto doctor = examine(lan, 0, {"--seconds", "2"});
  EXPECT_EQ(doctor->wait(), 1) << doctor->out();
  const json report = json::parse(doctor->out());
  EXPECT_FALSE(report.at("healthy"));
  expect_says(report, "wrong", "discovery", "nobody was found");
  expect_says(report, "advice", "network", "no interface but loopback is up");
}

TEST_F(DoctorOn, AFirewallThatStopsAllIsSuspected) {
  const Lan lan({{}, {}});
  close_ports(lan, 1, "7400-65535");
  const auto one = examine(lan, 0), two = examine(lan, 1);
  EXPECT_EQ(two->wait(), 1) << two->out();
  expect_says(json::parse(two->out()), "wrong", "discovery",
              "a firewall blocks UDP ports from 18650 on");
  EXPECT_EQ(one->wait(), 1) << one->out();
}

// Discovery passes, by multicast and to the even ports; what is sent to the odd ones does not.
TEST_F(DoctorOn, AFirewallThatStopsDataAloneIsNamed) {
  const Lan lan({{}, {}});
  std::string ports;
  for (int i = 0; i < 20; ++i)
    ports += (i == 0 ? "{" : ",") + std::to_string(7400 + 250 * kDomain + 11 + 2 * i);
  close_ports(lan, 1, ports + "}");
  EXPECT_TRUE(examine_both(lan, {}, [](const json&, const json& report) {
    return !text_of(report, "good", "match").empty();
  }));
  EXPECT_EQ(codes[1], 1);
  expect_says(reports[1], "good", "match", "another doctor after");
  expect_says(reports[1], "wrong", "data", "let UDP ports from 18650 on pass the firewall");
}

TEST_F(DoctorOn, LossIsMeasuredAndWhatHelpsIsSaid) {
  const Lan lan({{}, {.loss = 0.15}});
  // One of the two may have been busy with repairs of the other's megabytes, and say that instead.
  EXPECT_TRUE(examine_both(lan, {"--seconds", "15"},
                           [](const json& first, const json& second) {
                             const std::string text =
                                 text_of(first, "wrong", "loss") + text_of(second, "wrong", "loss");
                             return text.find("try --transport thin, or tcp") != std::string::npos;
                           }))
      << reports[0].dump(1) << reports[1].dump(1);
  EXPECT_EQ(codes, (std::array{1, 1}));
}

/// A host's participant without a door, with a peer on it, until it goes.
class HostWithoutDoor {
 public:
  HostWithoutDoor(const Lan& lan, std::size_t host) {
    const Lan::Visit there = lan.visit(host);
    fdds::DomainParticipantQos qos;
    qos.transport().use_builtin_transports = false;
    qos.transport().user_transports.push_back(
        std::make_shared<wire::rtps::UDPv4TransportDescriptor>());
    participant_ = fdds::DomainParticipantFactory::get_instance()->create_participant(kDomain, qos);
    subscriber::DdsChannelOptions options;
    options.participant = participant_;
    options.transport.name = "careless host";
    auto channel = subscriber::DdsChannel::create(options);
    EXPECT_TRUE(channel.is_ok()) << channel.status().message();
    session_ = std::make_unique<subscriber::Session>(std::move(channel).value());
  }
  ~HostWithoutDoor() {
    session_.reset();
    fdds::DomainParticipantFactory::get_instance()->delete_participant(participant_);
  }
  HostWithoutDoor(const HostWithoutDoor&) = delete;
  HostWithoutDoor& operator=(const HostWithoutDoor&) = delete;

  /// A frame: with these it tells its status.
  void update() { EXPECT_TRUE(session_->update(++frame_, clock_.seconds(), {}, 0.01).is_ok()); }

 private:
  fdds::DomainParticipant* participant_ = nullptr;
  std::unique_ptr<subscriber::Session> session_;
  std::uint64_t frame_ = 0;
  const Stopwatch clock_;
};

TEST_F(DoctorOn, AHostWithoutADoorIsNamed) {
  const Lan lan({{}, {}});
  HostWithoutDoor host(lan, 0);
  std::unique_ptr<Process> doctor;
  json report;
  EXPECT_TRUE(await([&] {  // it listens for a time that is short and fixed
    if (doctor == nullptr) doctor = examine(lan, 1, {"--seconds", "6"});
    host.update();
    pause(0.05);
    if (!doctor->is_over()) return false;
    report = json::parse(doctor->out());
    doctor.reset();
    return !text_of(report, "advice", "door").empty();
  }));
  expect_says(report, "advice", "door", "(careless host) has no door before Fast DDS");
  EXPECT_EQ(text_of(report, "good", "door"), "") << report.dump(1);
}

class StatusOn : public ServedFixture {};

TEST_F(StatusOn, WhatADoorRefusedIsTold) {
  serve_over({{}, {}});
  const auto status = [&](const Words& more) {
    const Lan::Visit there = lan->visit(1);
    Words words{"status", "--domain", std::to_string(models.domain), "--seconds", "3"};
    words.insert(words.end(), more.begin(), more.end());
    std::string out, err;
    // Exit code 1: nobody was heard in that time, as on a machine at work.
    EXPECT_TRUE(await([&] { return run(folder, "nearmesh-subscriber", words, &out, &err) == 0; }))
        << err;
    return out;
  };
  const auto refused = [&] {
    const json told = json::parse(status({"--json"}));
    const json publishers = told.at("publishers");
    return publishers.empty() ? -1 : publishers[0].at("door_refused").at("statistics").get<int>();
  };
  ASSERT_TRUE(await([&] { return refused() == 0; }));
  {
    const Lan::Visit there = lan->visit(1);
    const int sender = ::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    sockaddr_in to{};
    to.sin_family = AF_INET;
    to.sin_port = htons(static_cast<std::uint16_t>(7400 + 250 * models.domain));
    to.sin_addr.s_addr = ::inet_addr("239.255.0.1");
    const RtpsBytes packet = deadly_packet();
    for (int i = 0; i < 5; ++i)
      EXPECT_EQ(::sendto(sender, packet.data(), packet.size(), 0,
                         reinterpret_cast<const sockaddr*>(&to), sizeof to),
                static_cast<ssize_t>(packet.size()));
    ::close(sender);
  }
  int last = 0;
  EXPECT_TRUE(await([&] { return (last = refused()) == 5; })) << last;
  std::string told;
  EXPECT_TRUE(await([&] {
    told = status({});
    return told.find("door refused 5 (statistics 5)") != std::string::npos;
  })) << told;
  EXPECT_TRUE(publisher->says("door: refused 5 messages (statistics 5)")) << publisher->err();
  EXPECT_FALSE(publisher->is_over());
}

}  // namespace
}  // namespace nearmesh::test
