// SPDX-License-Identifier: Apache-2.0
// Browsers that look on hold up nobody.
#include "subscriber/program/live_server.hpp"

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

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

/// What has come to a browser, until nothing comes for a while.
std::string read_all(int browser) {
  std::string came;
  char bytes[65536];
  pollfd waits{.fd = browser, .events = POLLIN, .revents = 0};
  while (::poll(&waits, 1, 300) > 0) {
    const ssize_t count = ::recv(browser, bytes, sizeof bytes, 0);
    if (count <= 0) break;
    came.append(bytes, static_cast<std::size_t>(count));
  }
  return came;
}

void send(LiveServer& server, const std::string& film, const std::string& text) {
  server.send([&](const auto& visit) { visit("world", film); }, text, [] { return false; });
}

// It has a part of a message: the next one it would read as the rest of that, and each would wait
// for it again.
TEST(LiveServer, WhoDoesNotReadIsLeft) {
  const std::uint16_t port = free_port();
  const auto server = LiveServer::start("127.0.0.1:" + std::to_string(port), "page");
  ASSERT_TRUE(server.is_ok()) << server.status().message();
  const int browser = sleeping_browser(port);
  const std::string film(std::size_t{32} << 20, 'x');  // more than any socket keeps
  std::string came;
  const Stopwatch waiting;
  while (came.find("xxxx") == std::string::npos && waiting.seconds() < 100) {
    send(*server.value(), film, "first");  // where it is known already, until time is up
    came += read_all(browser);
  }
  ASSERT_NE(came.find("xxxx"), std::string::npos) << "no browser came";
  ASSERT_LT(came.size(), film.size());
  send(*server.value(), film, "later");
  EXPECT_EQ(read_all(browser).find("later"), std::string::npos);
  ::close(browser);
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
      send(*server.value(), "a long film", "{}");
      if (text != "a long film") {
        server.value()->begin_anew();
        send(*server.value(), "short", "{}");
      }
      came += read_all(browser);
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
