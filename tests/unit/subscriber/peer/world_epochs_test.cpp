// SPDX-License-Identifier: Apache-2.0
// A crater at a time of the exercise: the world of the next epoch takes the place of the one before
// in the same frame of all peers.
#include "cut_world.hpp"
#include "memory_channel.hpp"
#include "nearmesh/subscriber/peer/session.hpp"
#include "publisher/serve/service.hpp"

namespace nearmesh {
namespace {

using subscriber::BodyId;
using subscriber::FrameReport;
using subscriber::PairAnswer;
using subscriber::Session;
using test::cut_ball;
using test::CutTerrain;

class WorldEpochs : public ::testing::Test {
 protected:
  static constexpr double kStep_s = 0.05;
  static constexpr std::uint64_t kFrames = 90, kSwitch = 30;
  struct Peer {
    std::unique_ptr<Session> session;
    BodyId ball;
    std::vector<ContentHash> worlds;  ///< by frame: that the answer is about
    std::vector<AnswerStatus> status;
    std::vector<std::uint64_t> touching;  ///< pairs of faces
  };
  WorldEpochs() {
    serve(0xa1, before_, {}, {});
    add_ball(0xa3);
  }
  void serve(wire::SessionId id, const CutTerrain& terrain, const ContentHash& replaces,
             const wire::Epoch& epoch) {
    serve(id, terrain.folder, replaces, epoch);
  }
  void serve(wire::SessionId id, const std::string& folder, const ContentHash& replaces,
             const wire::Epoch& epoch) {
    Server& server = make_server(id);
    EXPECT_EQ(server.service->add_world("valley", folder, replaces, epoch).message(), "");
    server.service->announce();
  }
  void serve_crater() {
    after_.emplace(0.6, true);  // its record takes the other's place in the folder
    serve(0xa2, *after_, before_.pages.name, {1, static_cast<double>(kSwitch) * kStep_s});
  }
  void stop(wire::SessionId id) { servers_.erase(id); }
  Peer join(wire::SessionId id, double margin_m = 0) {
    Peer peer;
    peer.session = std::make_unique<Session>(
        bus_.make_peer(id),
        subscriber::SessionOptions{.margin_m = margin_m, .request_timeout_s = 0.002});
    const BodyId ground = peer.session->add_body({.name = "ground", .model = "valley"}).value();
    EXPECT_TRUE(peer.session->place_body(ground, {}).is_ok());
    peer.ball =
        peer.session->add_body({.name = "ball" + std::to_string(id), .model = "ball", .own = true})
            .value();
    EXPECT_TRUE(peer.session->watch(peer.ball, ground).is_ok());
    return peer;
  }
  /// The ball rests above the post that the crater is at.
  [[nodiscard]] Motion over_the_crater() const {
    Motion motion;
    motion.pose.translation_m = before_.posts()[2 * (test::kCutSide * test::kCutCells + 1) + 2];
    motion.pose.translation_m[2] += 0.3;
    return motion;
  }
  PairAnswer update(Peer& peer, std::uint64_t frame, const Motion& ball) {
    bus_.tick();
    for (auto& [id, server] : servers_) static_cast<void>(server.service->step(seconds_ += 0.01));
    const auto report =
        peer.session->update(frame, static_cast<double>(frame) * kStep_s, {{peer.ball, ball}}, 10);
    EXPECT_TRUE(report.is_ok()) << report.status().message();
    return report.value().answers.at(0);
  }
  /// `rounds`: updates in the same frame, of which the first one's answer counts.
  void frame(Peer& peer, std::uint64_t frame, int rounds) {
    for (int round = 0; round < rounds; ++round) {
      const PairAnswer answer = update(peer, frame, over_the_crater());
      const ContentHash world = answer.a == peer.ball ? answer.content_b : answer.content_a;
      if (answer.world) {
        EXPECT_EQ(answer.world->world, world);
      }
      if (round == 0) {
        peer.worlds.push_back(world);
        peer.status.push_back(answer.answer.status);
        peer.touching.push_back(answer.answer.pair_total);
      } else {
        EXPECT_EQ(world, peer.worlds.back()) << "frame " << frame;
      }
    }
  }
  [[nodiscard]] const ContentHash& name_at(std::uint64_t frame) const {
    return frame < kSwitch ? before_.pages.name : after_->pages.name;
  }

  const CutTerrain before_;
  std::optional<CutTerrain> after_;
  test::MemoryBus bus_{5};

 private:
  struct Server {
    std::unique_ptr<publisher::Channel> channel;
    std::unique_ptr<publisher::Service> service;
  };
  Server& make_server(wire::SessionId id) {
    Server& server = servers_[id];
    server.channel = bus_.make_publisher(id);
    server.service = std::make_unique<publisher::Service>(*server.channel, id);
    return server;
  }
  void add_ball(wire::SessionId id) {
    Server& server = make_server(id);
    EXPECT_TRUE(server.service->add_model("ball", ModelFile::open(ball_->path()).value()).is_ok());
    server.service->announce();
  }
  std::unique_ptr<test::TempFile> ball_ = test::write_model(cut_ball());
  std::map<wire::SessionId, Server> servers_;
  double seconds_ = 0;
};

TEST_F(WorldEpochs, AllPeersChangeInTheFrameOfTheTimeAndHaveFetchedAhead) {
  bus_.on_batches = bus_.on_subscriptions = {.lose = 0.05, .repeat = 0.05, .max_delay = 2};
  Peer one = join(0xb1), two = join(0xb2);
  for (std::uint64_t at = 0; at < kFrames; ++at) {
    if (at == 10) serve_crater();
    frame(one, at, 4);
    frame(two, at, at % 3 == 0 ? 6 : 1);  // slower, and not evenly
    if (at < 5) continue;
    EXPECT_EQ(one.worlds.back(), name_at(at)) << "frame " << at;
    EXPECT_EQ(two.worlds.back(), name_at(at)) << "frame " << at;
  }
  // Where detail is here answers are of the whole mesh that then holds.
  const auto touching = [&](const CutTerrain& terrain) {
    return test::touching_of_whole(terrain, {}, over_the_crater().pose).size();
  };
  EXPECT_GT(touching(before_), touching(*after_));
  EXPECT_EQ(one.status[kSwitch - 1], AnswerStatus::kContact);
  EXPECT_EQ(one.touching[kSwitch - 1], touching(before_));
  // What is lost is asked for again by the clock, which frames here run ahead of.
  for (std::uint64_t at = kSwitch + 40; at < kFrames; ++at) {
    EXPECT_TRUE(is_certified(one.status[at])) << at;
    EXPECT_EQ(one.touching[at], touching(*after_)) << at;
  }
}

// Pages and tiles are here from before: nothing but the record tells that all of them stand higher.
// The margin makes tiles near while the ball is free of them, so there are answers to be kept:
// bodies rest, contents and detail are the same.
TEST_F(WorldEpochs, TilesThatStandElsewhereAreAskedAnew) {
  constexpr double kHigher_m = 1, kMargin_m = 2;
  const std::string folder = before_.folder + "_raised";
  std::filesystem::copy(before_.folder, folder, std::filesystem::copy_options::recursive);
  WorldPages raised = before_.pages;
  raised.world.lattice.origin_m[2] += kHigher_m;
  ASSERT_TRUE(write_world(raised, folder).is_ok());
  Peer one = join(0xb1, kMargin_m);
  Motion above = over_the_crater();
  above.pose.translation_m[2] += kHigher_m;
  PairAnswer answer;
  for (std::uint64_t at = 0; at < kSwitch; ++at) {
    if (at == 10)
      serve(0xa2, folder, before_.pages.name, {1, static_cast<double>(kSwitch) * kStep_s});
    for (int i = 0; i < 4; ++i) answer = update(one, at, above);
  }
  EXPECT_EQ(answer.answer.status, AnswerStatus::kFree);
  ASSERT_TRUE(answer.world);
  EXPECT_FALSE(answer.world->tiles.empty());
  for (std::uint64_t at = kSwitch; at < kFrames; ++at) {
    answer = update(one, at, above);
    EXPECT_NE(answer.answer.status, AnswerStatus::kFree) << "frame " << at;
  }
  EXPECT_EQ(answer.answer.status, AnswerStatus::kContact);
  std::filesystem::remove_all(folder);
}

// Before the time pages are asked for, so that the first frame after knows which tiles are near.
TEST_F(WorldEpochs, InTheFirstFramePagesAreHere) {
  Peer one = join(0xb1);
  for (std::uint64_t at = 0; at <= kSwitch; ++at) {
    if (at == 10) serve_crater();
    if (at < kSwitch) {
      frame(one, at, 4);
      continue;
    }
    const auto report = one.session->update(at, static_cast<double>(at) * kStep_s,
                                            {{one.ball, over_the_crater()}}, 10);
    ASSERT_TRUE(report.is_ok());
    const PairAnswer& answer = report.value().answers.at(0);
    ASSERT_TRUE(answer.world) << answer.reason;
    EXPECT_EQ(answer.world->world, after_->pages.name);
    EXPECT_TRUE(answer.world->missing_pages.empty()) << answer.world->missing_pages.size();
    EXPECT_FALSE(answer.world->tiles.empty());
  }
}

TEST_F(WorldEpochs, WhoJoinsLateGetsThePresentOne) {
  serve_crater();
  Peer early = join(0xb1);
  for (std::uint64_t at = 20; at < 40; ++at) frame(early, at, 4);
  Peer late = join(0xb2);
  for (std::uint64_t at = 40; at < 50; ++at) {
    frame(late, at, 4);
    frame(early, at, 4);
  }
  EXPECT_EQ(late.worlds.back(), after_->pages.name);
  EXPECT_EQ(early.worlds.back(), after_->pages.name);
  EXPECT_EQ(early.worlds[5], before_.pages.name);
  // Once nobody serves what was before, or what is now.
  stop(0xa1);
  frame(early, 50, 4);
  EXPECT_EQ(early.worlds.back(), after_->pages.name);
  Peer later = join(0xb3);
  for (std::uint64_t at = 51; at < 56; ++at) frame(later, at, 4);
  EXPECT_EQ(later.worlds.back(), after_->pages.name);
}

TEST_F(WorldEpochs, WhereNobodyServesTheNextAnyMoreTheOneBeforeDoesNotComeBack) {
  serve_crater();
  Peer one = join(0xb1);
  for (std::uint64_t at = 25; at < 40; ++at) frame(one, at, 4);
  stop(0xa2);
  for (std::uint64_t at = 40; at < 45; ++at) frame(one, at, 4);
  EXPECT_EQ(one.worlds.back(), after_->pages.name);
  // A clock that is set back before the time is before it.
  for (std::uint64_t at = 20; at < 25; ++at) frame(one, at, 4);
  EXPECT_EQ(one.worlds.back(), before_.pages.name);
}

}  // namespace
}  // namespace nearmesh
