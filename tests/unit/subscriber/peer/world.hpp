// SPDX-License-Identifier: Apache-2.0
#pragma once
// Publishers and peers on a memory bus, whose answers are judged.

#include <chrono>
#include <deque>
#include <set>

#include "judge.hpp"
#include "memory_channel.hpp"
#include "publisher/serve/service.hpp"

namespace nearmesh::test {

// ---- world --------------------------------------------------------------------------------------

constexpr wire::SessionId kPublisher = 0xa1, kPeer = 0xb1;

/// Repeats soon, since the bus is fast.
inline SessionOptions quick_options() { return {.request_timeout_s = 0.0005}; }

class World {
 public:
  explicit World(std::uint64_t seed = 1) : bus(seed) { bus.most_splits = 256; }

  MemoryBus bus;
  Judge judge;
  std::vector<std::string> complaints;
  double seconds_per_round = 0.05;  ///< by the services' clock
  std::function<void(const FrameReport&)> on_report;
  bool judges = true;  ///< else a test does: of answers that the session's options cut

  /// `replaces`: the content whose place its ground takes.
  void start_publisher(wire::SessionId id = kPublisher, const ServedModel& ground = terrain(),
                       ContentHash replaces = {}) {
    publisher::Service& service = make_service(id);
    EXPECT_TRUE(service.add_model("terrain", ground.open(), replaces).is_ok());
    EXPECT_TRUE(service.add_model("aircraft", aircraft().open()).is_ok());
    service.announce();
  }
  /// One that serves nothing else.
  void start_publisher_of(const std::string& name, const ServedModel& model, wire::SessionId id) {
    publisher::Service& service = make_service(id);
    EXPECT_TRUE(service.add_model(name, model.open()).is_ok());
    service.announce();
  }
  void stop_publisher(wire::SessionId id = kPublisher) { servers_.erase(id); }
  publisher::Service& service(wire::SessionId id = kPublisher) { return *servers_.at(id).service; }

  /// A peer that moves both aircraft over the ground and asks about all three pairs.
  std::unique_ptr<Session> make_peer(SessionOptions options = quick_options(),
                                     wire::SessionId id = kPeer) {
    return make_peer(options, id, true, true);
  }
  std::unique_ptr<Session> make_peer(SessionOptions options, wire::SessionId id, bool moves_one,
                                     bool moves_two) {
    auto session = std::make_unique<Session>(bus.make_peer(id), options);
    EXPECT_EQ(session->add_body({.name = "ground", .model = "terrain"}).value(), kGround);
    EXPECT_TRUE(session->place_body(kGround, {}).is_ok());
    EXPECT_EQ(session->add_body({.name = "one", .model = "aircraft", .own = moves_one}).value(),
              kOne);
    EXPECT_EQ(session->add_body({.name = "two", .model = "aircraft", .own = moves_two}).value(),
              kTwo);
    EXPECT_TRUE(session->watch(kGround, kOne).is_ok());
    EXPECT_TRUE(session->watch(kGround, kTwo).is_ok());
    EXPECT_TRUE(session->watch(kOne, kTwo).is_ok());
    return session;
  }

  /// Everybody does one step; the answers are judged.
  FrameReport round(Session& session, std::uint64_t frame = 0,
                    const std::vector<Session::OwnMotion>& motions = {}, double budget_s = 1) {
    bus.tick();
    for (auto& [id, server] : servers_)
      for (std::string& line :
           server.service->step(static_cast<double>(++steps_) * seconds_per_round))
        complaints.push_back(std::move(line));
    Result<FrameReport> report =
        session.update(frame, begin_s_ + static_cast<double>(frame) * 0.05, motions, budget_s);
    EXPECT_TRUE(report.is_ok()) << report.status().message();
    complaints.insert(complaints.end(), report.value().complaints.begin(),
                      report.value().complaints.end());
    if (judges) judge.check(report.value());
    if (on_report) on_report(report.value());
    return std::move(report).value();
  }

  /// One frame: rounds until all is certified, or the limit is reached. True when all was.
  bool fly_frame(Session& session, std::uint64_t frame,
                 const std::vector<Session::OwnMotion>& motions, int max_rounds = 0,
                 double budget_s = 1) {
    const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(100);
    for (int i = 0; max_rounds == 0 || i < max_rounds; ++i) {
      if (round(session, frame, i == 0 ? motions : std::vector<Session::OwnMotion>{}, budget_s)
              .all_certified())
        return true;
      if (std::chrono::steady_clock::now() > deadline) break;
    }
    return false;
  }

  /// Frames [first, last). Gives the number of frames that ended with all certified.
  std::size_t fly(Session& session, const Flight& flight, std::size_t first, std::size_t last,
                  int max_rounds = 0, double budget_s = 1) {
    std::size_t certified = 0;
    for (std::size_t i = first; i < last && !::testing::Test::HasFailure(); ++i)
      certified += fly_frame(session, i, {{kOne, flight.one[i]}, {kTwo, flight.two[i]}}, max_rounds,
                             budget_s)
                       ? 1
                       : 0;
    return certified;
  }
  /// All of it; the next follows it in time.
  std::size_t fly(Session& session, const Flight& flight) {
    const std::size_t certified = fly(session, flight, 0, flight.frames());
    begin_s_ += static_cast<double>(flight.frames()) * 0.05;
    return certified;
  }

  [[nodiscard]] bool has_complaint(const std::string& part) const {
    return std::any_of(complaints.begin(), complaints.end(), [&](const std::string& line) {
      return line.find(part) != std::string::npos;
    });
  }

 private:
  struct Server {
    std::unique_ptr<publisher::Channel> channel;
    std::unique_ptr<publisher::Service> service;
  };
  publisher::Service& make_service(wire::SessionId id) {
    Server& server = servers_[id];
    server.channel = bus.make_publisher(id);
    server.service = std::make_unique<publisher::Service>(*server.channel, id);
    return *server.service;
  }

  std::map<wire::SessionId, Server> servers_;
  std::uint64_t steps_ = 0;
  double begin_s_ = 0;  ///< of frame 0, by the exercise's clock
};

}  // namespace nearmesh::test
