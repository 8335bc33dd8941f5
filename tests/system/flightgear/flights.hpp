// SPDX-License-Identifier: Apache-2.0
#pragma once
// What both tests of examples/flightgear share: a bus with a publisher and a recorder, and UDP
// ports of one's own.

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <optional>
#include <string>
#include <vector>

#include "geodesy.hpp"
#include "tests/system/integration/process.hpp"

namespace nearmesh {

/// Of this process, beside those that the system gives away by itself.
inline int flightgear_port() { return 12'000 + ::getpid() % 1'000 * 16; }

/// At a port of this machine.
class Ear {
 public:
  explicit Ear(int port) : socket_(::socket(AF_INET, SOCK_DGRAM, 0)) {
    const sockaddr_in address = local(port);
    EXPECT_EQ(::bind(socket_, reinterpret_cast<const sockaddr*>(&address), sizeof address), 0)
        << "port " << port;
  }
  Ear(const Ear&) = delete;
  Ear& operator=(const Ear&) = delete;
  ~Ear() { ::close(socket_); }

  /// What has come.
  [[nodiscard]] std::optional<std::string> take() const {
    std::string line(4096, '\0');
    const ssize_t size = ::recv(socket_, line.data(), line.size(), MSG_DONTWAIT);
    if (size < 0) return std::nullopt;
    line.resize(static_cast<std::size_t>(size));
    return line;
  }
  void send(int port, const std::string& line) const {
    const sockaddr_in address = local(port);
    ::sendto(socket_, line.data(), line.size(), 0, reinterpret_cast<const sockaddr*>(&address),
             sizeof address);
  }

 private:
  static sockaddr_in local(int port) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(static_cast<std::uint16_t>(port));
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    return address;
  }
  int socket_;
};

inline std::vector<std::string> fields_of(const std::string& line) {
  std::vector<std::string> fields{""};
  for (const char c : line)
    if (c == '\t')
      fields.emplace_back();
    else if (c != '\n')
      fields.back() += c;
  return fields;
}

class FlightGearFlight : public ::testing::Test {
 protected:
  static constexpr int kFlightDomain = 94;

  [[nodiscard]] static std::vector<std::string> on_bus(std::vector<std::string> words) {
    words.insert(words.end(), {"--domain", std::to_string(kFlightDomain), "--prefix",
                               "fg-" + std::to_string(::getpid()), "--interface", "127.0.0.1"});
    return words;
  }
  void begin_flight(const std::vector<std::string>& policy) {
    publisher.emplace(
        folder, "nearmesh-publisher",
        on_bus({"serve", test::model_file("terrain", 48), test::model_file("aircraft", 600)}));
    ASSERT_TRUE(publisher->says("ready on domain")) << publisher->err();
    recorder.emplace(folder, "nearmesh-subscriber", on_bus({"record", "-o", recording}));
    ASSERT_TRUE(recorder->says("recording")) << recorder->err();
    std::vector<std::string> words =
        on_bus({"--origin", std::to_string(kLatitude_deg) + "," + std::to_string(kLongitude_deg),
                "--port", std::to_string(flightgear_port()), "--wait-recorder"});
    words.insert(words.end(), policy.begin(), policy.end());
    bridge.emplace(folder, "nearmesh-example-flightgear", words);
    ASSERT_TRUE(test::await([&] {
      return bridge->out().find("states at UDP port") != bridge->out().npos;
    })) << bridge->err();
  }
  /// And what was answered is proved.
  void end_flight() {
    bridge->signal(SIGINT);
    EXPECT_EQ(bridge->wait(), 0) << bridge->err();
    recorder->signal(SIGINT);
    EXPECT_EQ(recorder->wait(), 0) << recorder->err();
    std::string told;
    EXPECT_EQ(test::run(folder, "nearmesh-subscriber", {"verify", recording}, &told), 0) << told;
    // Nothing was answered where the verdict is of nothing.
    EXPECT_NE(told.find("proved"), std::string::npos) << told;
    verdict = told;
  }

  static constexpr double kLatitude_deg = 0.5, kLongitude_deg = 0.5;
  const flightgear::SceneFrame scene{{kLatitude_deg, kLongitude_deg, 0}};
  test::Folder folder;
  const std::string recording = folder.file("flight.db3");
  std::optional<test::Process> publisher, recorder, bridge;
  std::string verdict;
};

}  // namespace nearmesh
