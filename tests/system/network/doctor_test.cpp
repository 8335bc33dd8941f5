// SPDX-License-Identifier: Apache-2.0
// What the doctor says of networks that are not well, in namespaces of the tests' own.

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "network_fixture.hpp"

namespace nearmesh::test {
namespace {

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
  const auto one = examine(lan, 0), two = examine(lan, 1);
  for (Process* doctor : {one.get(), two.get()}) {
    EXPECT_EQ(doctor->wait(), 0) << doctor->out() << doctor->err();
    const json report = json::parse(doctor->out());
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
  const auto one = examine(lan, 0), two = examine(lan, 1);
  EXPECT_EQ(two->wait(), 1) << two->out();
  const json report = json::parse(two->out());
  expect_says(report, "good", "match", "another doctor after");
  expect_says(report, "wrong", "data", "let UDP ports from 18650 on pass the firewall");
  one->wait();
}

TEST_F(DoctorOn, LossIsMeasuredAndWhatHelpsIsSaid) {
  const Lan lan({{}, {.loss = 0.15}});
  const auto one = examine(lan, 0, {"--seconds", "15"}), two = examine(lan, 1, {"--seconds", "15"});
  EXPECT_EQ(one->wait(), 1) << one->out();
  EXPECT_EQ(two->wait(), 1) << two->out();
  // One of the two may have been busy with repairs of the other's megabytes, and say that instead.
  const json first = json::parse(one->out()), second = json::parse(two->out());
  const std::string text = text_of(first, "wrong", "loss") + text_of(second, "wrong", "loss");
  EXPECT_NE(text.find("try --transport thin, or tcp"), std::string::npos)
      << first.dump(1) << second.dump(1);
}

}  // namespace
}  // namespace nearmesh::test
