// SPDX-License-Identifier: Apache-2.0
// Browsers that look on hold up nobody.
#include "subscriber/program/live_server.hpp"

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <string>
#include <thread>

#include "core/base/stopwatch.hpp"

namespace nearmesh::subscriber::program {
namespace {

sockaddr_in local(std::uint16_t port) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(port);
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  return address;
}

std::uint16_t free_port() {
  const int socket = ::socket(AF_INET, SOCK_STREAM, 0);
  sockaddr_in address = local(0);
  socklen_t size = sizeof address;
  EXPECT_EQ(::bind(socket, reinterpret_cast<sockaddr*>(&address), size), 0);
  EXPECT_EQ(::getsockname(socket, reinterpret_cast<sockaddr*>(&address), &size), 0);
  ::close(socket);
  return ntohs(address.sin_port);
}

/// A browser whose machine sleeps: it opens the page's socket, and reads nothing that comes.
int sleeping_browser(std::uint16_t port) {
  const int socket = ::socket(AF_INET, SOCK_STREAM, 0);
  const sockaddr_in address = local(port);
  EXPECT_EQ(::connect(socket, reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
  const std::string host = "127.0.0.1:" + std::to_string(port);
  const std::string asked = "GET /film HTTP/1.1\r\nHost: " + host + "\r\nOrigin: http://" + host +
                            "\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
                            "Sec-WebSocket-Version: 13\r\n"
                            "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n";
  EXPECT_EQ(::send(socket, asked.data(), asked.size(), 0), static_cast<ssize_t>(asked.size()));
  return socket;
}

/// Sends until one has waited for a browser that sleeps. Out: how long the next one takes.
double seconds_after_a_sleeper() {
  const std::uint16_t port = free_port();
  const auto server = LiveServer::start("127.0.0.1:" + std::to_string(port), "page");
  EXPECT_TRUE(server.is_ok()) << server.status().message();
  if (!server.is_ok()) return 0;
  const int browser = sleeping_browser(port);
  const std::string film(std::size_t{32} << 20, 'x');  // more than any socket keeps
  const auto seconds_of_sending = [&] {
    const Stopwatch clock;
    server.value()->send([&](const auto& visit) { visit("world", film); }, "{}",
                         [] { return false; });
    return clock.seconds();
  };
  const Stopwatch waiting;
  bool has_come = false;
  while (!has_come && waiting.seconds() < 100) {
    has_come = seconds_of_sending() >= 1;
    if (!has_come) std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  EXPECT_TRUE(has_come) << "no browser came";
  const double next_s = seconds_of_sending();
  ::close(browser);
  return next_s;
}

// Else each later message waits for it again, and so does all that `watch` shows.
TEST(LiveServer, WhoDoesNotReadIsLeft) {
  // A machine that is held up may take as long as a browser that sleeps: not each time.
  double least_s = 1;
  for (int i = 0; i < 5 && least_s >= 1 && !HasFailure(); ++i)
    least_s = std::min(least_s, seconds_after_a_sleeper());
  EXPECT_LT(least_s, 1);
}

// A stream that is shorter than before would be read as the rest of what came until then.
TEST(LiveServer, WhoLooksIsToldThatTheStreamsBeginAnew) {
  const std::uint16_t port = free_port();
  const auto server = LiveServer::start("127.0.0.1:" + std::to_string(port), "page");
  ASSERT_TRUE(server.is_ok()) << server.status().message();
  const int browser = sleeping_browser(port);
  std::string came;
  const auto read_until = [&](const std::string& text) {
    const Stopwatch waiting;
    while (came.find(text) == std::string::npos && waiting.seconds() < 100) {
      char bytes[4096];
      const ssize_t count = ::recv(browser, bytes, sizeof bytes, MSG_DONTWAIT);
      if (count > 0) came.append(bytes, static_cast<std::size_t>(count));
      const auto send = [&](const std::string& film) {
        server.value()->send([&](const auto& visit) { visit("world", film); }, "{}",
                             [] { return false; });
      };
      send("a long film");
      if (text != "a long film") {
        server.value()->begin_anew();
        send("short");
      }
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
    return came.find(text) != std::string::npos;
  };
  EXPECT_TRUE(read_until("a long film"));
  EXPECT_TRUE(read_until(R"({"anew":true})")) << came;
  EXPECT_EQ(came.find("short"), std::string::npos)
      << "it is shown on a page that has the film before";
  ::close(browser);
}

TEST(LiveServer, WhoIsToEndWaitsForNobody) {
  const std::uint16_t port = free_port();
  const auto server = LiveServer::start("127.0.0.1:" + std::to_string(port), "page");
  ASSERT_TRUE(server.is_ok()) << server.status().message();
  std::array<int, 8> browsers{};  // as many as are served; for each a second and a half is waited
  for (int& browser : browsers) browser = sleeping_browser(port);
  std::this_thread::sleep_for(
      std::chrono::seconds(1));  // all have come by then; if not, none is waited for
  const std::string film(std::size_t{32} << 20, 'x');
  const Stopwatch clock;
  server.value()->send([&](const auto& visit) { visit("world", film); }, "{}",
                       [&] { return clock.seconds() > 0.5; });
  EXPECT_LT(clock.seconds(), 8);
  for (const int browser : browsers) ::close(browser);
}

}  // namespace
}  // namespace nearmesh::subscriber::program
