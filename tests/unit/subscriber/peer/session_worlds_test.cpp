// SPDX-License-Identifier: Apache-2.0
// Sessions with a body that is a world, held against the one mesh that was cut into its tiles.
#include <sys/resource.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <functional>
#include <iterator>
#include <optional>
#include <set>
#include <thread>

#include "core/base/digest.hpp"
#include "core/spm/file_layout.hpp"
#include "core/world/content_bytes.hpp"
#include "core/world/world_folder.hpp"
#include "cut_world.hpp"
#include "memory_channel.hpp"
#include "nearmesh/core/spm/detail/codec.hpp"
#include "nearmesh/subscriber/peer/local_channel.hpp"
#include "nearmesh/subscriber/peer/session.hpp"
#include "publisher/serve/service.hpp"
#include "subscriber/peer/peer_world.hpp"
#include "test_models.hpp"

namespace nearmesh {
namespace {

using subscriber::BodyId;
using subscriber::Channel;
using subscriber::FrameReport;
using subscriber::LocalChannel;
using subscriber::PairAnswer;
using subscriber::Session;
using subscriber::SessionOptions;
using test::cut_ball;
using test::CutScene;
using test::CutTerrain;
using test::random_scene;

/// Lets a test change or lose what comes.
class SpoiledChannel final : public Channel {
 public:
  explicit SpoiledChannel(LocalChannel& inner) : inner_(inner) {}
  std::function<bool(wire::SplitBatchMessage&)> passes = [](auto&) { return true; };

  [[nodiscard]] wire::SessionId own_id() const override { return inner_.own_id(); }
  void send(const wire::RegionSubscription& subscription) override {
    if (subscription.certificate) {
      certificates.insert(subscription.request);
    } else if (asks_for_content_bytes(subscription.region)) {
      requests.insert(subscription.request);
    } else {
      ++regions;
      regions_of.insert(subscription.content_hash);
    }
    inner_.send(subscription);
  }
  void send(const wire::BodyPoses&) override {}
  void send(const wire::BodyDirectory&) override {}
  void send(const wire::ContactReport&) override {}
  [[nodiscard]] Inbox take() override {
    Inbox inbox = inner_.take();
    std::erase_if(inbox.batches, [this](wire::SplitBatchMessage& batch) { return !passes(batch); });
    return inbox;
  }
  std::set<std::uint32_t> requests, certificates;  ///< of pages and headers; for certificates
  int regions = 0;                                 ///< that were asked for
  std::set<ContentHash> regions_of;

 private:
  LocalChannel& inner_;
};

struct CutHost {
  explicit CutHost(const CutTerrain& terrain, SessionOptions options = {}) {
    EXPECT_TRUE(local.add_world("valley", terrain.folder).is_ok());
    EXPECT_TRUE(local.add_model("ball", ModelFile::open(file->path()).value()).is_ok());
    auto made = std::make_unique<SpoiledChannel>(local);
    channel = made.get();
    options.request_timeout_s = 0.0005;
    session = std::make_unique<Session>(std::move(made), options);
    world = session->add_body({.name = "ground", .model = "valley"}).value();
    ball = session->add_body({.name = "ball", .model = "ball", .own = true}).value();
    EXPECT_TRUE(session->watch(ball, world).is_ok());
  }
  FrameReport update(const Pose& world_pose, const Motion& motion) {
    EXPECT_TRUE(session->place_body(world, world_pose).is_ok());
    return update(motion);
  }
  FrameReport update(const Motion& motion) {
    Result<FrameReport> report = session->update(frame++, time_s, {{ball, motion}}, 10);
    EXPECT_TRUE(report.is_ok()) << report.status().message();
    said.insert(said.end(), report.value().complaints.begin(), report.value().complaints.end());
    return std::move(report).value();
  }
  PairAnswer settle(const Pose& world_pose, const Motion& motion, int most = 40) {
    FrameReport report = update(world_pose, motion);
    for (int i = 0; i < most && !report.all_certified(); ++i) report = update(motion);
    EXPECT_EQ(report.answers.size(), 1U);
    return report.answers.at(0);
  }

  std::unique_ptr<test::TempFile> file = test::write_model(cut_ball());
  LocalChannel local;
  SpoiledChannel* channel = nullptr;
  std::unique_ptr<Session> session;
  BodyId world, ball;
  std::uint64_t frame = 0;
  double time_s = 0;
  std::vector<std::string> said;  ///< complaints
};

std::vector<FaceKey> touching_of(const PairAnswer& answer) {
  std::vector<FaceKey> keys;
  for (const FacePair& pair : answer.answer.pairs) keys.push_back(pair.a);
  std::sort(keys.begin(), keys.end());
  return keys;
}

void expect_true(const CutTerrain& terrain, const CutScene& scene, const PairAnswer& answer) {
  const std::vector<FaceKey> truth = test::touching_of_whole(terrain, scene.world, scene.ball.pose);
  const std::vector<FaceKey> told = touching_of(answer);
  EXPECT_EQ(answer.answer.pair_total, told.size());
  if (is_certified(answer.answer.status)) {
    EXPECT_EQ(told, truth);
    EXPECT_EQ(answer.answer.status, truth.empty() ? AnswerStatus::kFree : AnswerStatus::kContact);
    return;
  }
  EXPECT_TRUE(std::includes(truth.begin(), truth.end(), told.begin(), told.end()));
  EXPECT_FALSE(answer.reason.empty() && answer.awaited.empty());
}

TEST(SessionWorlds, AnswersAreThoseOfTheMeshThatWasCut) {
  const CutTerrain terrain;
  CutHost host(terrain);
  Random random(11);
  std::size_t contacts = 0, over_seams = 0, free = 0;
  for (int round = 0; round < 120; ++round) {
    const CutScene scene = random_scene(terrain, random, round % 3);
    FrameReport report = host.update(scene.world, scene.ball);
    for (int i = 0; i < 40; ++i) {
      ASSERT_EQ(report.answers.size(), 1U);
      expect_true(terrain, scene, report.answers[0]);
      if (report.all_certified()) break;
      report = host.update(scene.ball);
    }
    const PairAnswer& answer = report.answers[0];
    ASSERT_TRUE(is_certified(answer.answer.status))
        << "round " << round << ": " << answer.reason << answer.awaited << ' '
        << (host.said.empty() ? "" : host.said.back());
    ASSERT_TRUE(answer.world.has_value());
    EXPECT_EQ(answer.world->world, terrain.pages.name);
    std::size_t tiles = 0, listed = 0;
    for (const subscriber::NearTile& tile : answer.world->tiles) {
      tiles += tile.pairs > 0 ? 1 : 0;
      listed += tile.pairs;
    }
    EXPECT_EQ(listed, answer.answer.pairs.size());
    contacts += answer.answer.pair_total > 0 ? 1 : 0;
    over_seams += tiles > 1 ? 1 : 0;
    free += answer.answer.pair_total == 0 ? 1 : 0;
  }
  EXPECT_GT(contacts, 40U);
  EXPECT_GT(over_seams, 20U);
  EXPECT_GT(free, 10U);
}

// A tile's model begins at zero, and the poses of the world place the world's origin: the publisher
// is told where the tile is.
TEST(SessionWorlds, ThePublisherChoosesDetailOfTiles) {
  const CutTerrain terrain;
  Random random(21);
  int certified = 0, touching = 0;
  for (int round = 0; round < 24; ++round) {
    SCOPED_TRACE(round);
    CutScene scene = random_scene(terrain, random, round % 3);
    for (double& w : scene.ball.angular_velocity_radps) w = random.between(-1, 1);
    CutHost host(terrain);
    const PairAnswer answer = host.settle(scene.world, scene.ball);
    expect_true(terrain, scene, answer);
    certified += is_certified(answer.answer.status) ? 1 : 0;
    touching += answer.answer.pair_total > 0 ? 1 : 0;
    EXPECT_EQ(host.channel->regions, 0) << "each request for detail is one for a certificate";
    EXPECT_LE(host.channel->certificates.size(), 3U);
  }
  EXPECT_EQ(certified, 24);
  EXPECT_GT(touching, 6);
}

/// Its middle on the ground at that cell's corner of the terrain.
Motion on_the_ground(const CutTerrain& terrain, int column, int row) {
  const auto post = static_cast<std::size_t>(row * (test::kCutSide * test::kCutCells + 1) + column);
  Motion ball;
  ball.pose.translation_m = terrain.posts().at(post);
  return ball;
}

// As other pairs do: it would ask for the same for ever.
TEST(SessionWorlds, WherePublishersChooseNothingPairsWithTilesNameWhatTheyLack) {
  const CutTerrain terrain;
  CutHost host(terrain);
  host.channel->passes = [&](wire::SplitBatchMessage& batch) {
    if (host.channel->certificates.contains(batch.request)) batch.bytes.clear();
    return true;
  };
  CutScene scene;
  scene.ball = on_the_ground(terrain, 10, 10);
  const PairAnswer answer = host.settle(scene.world, scene.ball, 400);
  EXPECT_EQ(answer.answer.status, AnswerStatus::kContact) << answer.awaited;
  expect_true(terrain, scene, answer);
  EXPECT_GT(host.channel->regions, 0);
  EXPECT_GT(host.channel->certificates.size(), 2U);
}

// One request is about all tiles near. Of the others the publisher goes on to choose.
TEST(SessionWorlds, ATileThatCannotBeReadKeepsNoDetailOfOthersBack) {
  const CutTerrain terrain;
  CutScene scene;
  scene.ball = on_the_ground(terrain, 10, 10);  // where four tiles meet
  CutHost honest(terrain);
  const PairAnswer truth = honest.settle(scene.world, scene.ball);
  ASSERT_EQ(truth.answer.status, AnswerStatus::kContact);
  ASSERT_GE(truth.world->tiles.size(), 4U);
  const auto spoiled = std::ranges::max(truth.world->tiles, {}, &subscriber::NearTile::pairs).tile;
  {  // in each of its blocks
    const WorldFolder folder = WorldFolder::open(terrain.folder).value();
    std::fstream file(folder.tile_path(spoiled.content),
                      std::ios::in | std::ios::out | std::ios::binary);
    file_layout::Preamble preamble;
    file.read(reinterpret_cast<char*>(&preamble), sizeof(preamble));
    const std::uint64_t first = sizeof(preamble) + preamble.header_bytes;
    file.seekp(static_cast<std::streamoff>(first));
    for (std::uint64_t at = first;
         at < preamble.directory_offset - sizeof(file_layout::OriginEntry); ++at)
      file.put('\x5a');
    ASSERT_TRUE(file.good());
  }
  CutHost host(terrain);
  const auto are_others_certified = [&](const PairAnswer& answer) {
    return answer.world && answer.world->tiles.size() == truth.world->tiles.size() &&
           std::ranges::all_of(answer.world->tiles, [&](const subscriber::NearTile& near) {
             return near.tile.content == spoiled.content || is_certified(near.status);
           });
  };
  PairAnswer answer = host.settle(scene.world, scene.ball, 0);
  for (int i = 0; i < 2000 && !are_others_certified(answer); ++i) {
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
    answer = host.update(scene.ball).answers.at(0);
    expect_true(terrain, scene, answer);
  }
  EXPECT_TRUE(are_others_certified(answer)) << answer.awaited;
  EXPECT_FALSE(is_certified(answer.answer.status));
  ASSERT_FALSE(host.said.empty());
  EXPECT_NE(host.said.back().find(to_hex(spoiled.content)), std::string::npos) << host.said.back();
  for (const subscriber::NearTile& near : truth.world->tiles)
    EXPECT_EQ(host.channel->regions_of.contains(near.tile.content),
              near.tile.content == spoiled.content);
}

/// No more files than are open, and so many.
class FewFiles {
 public:
  explicit FewFiles(std::size_t more) {
    const std::filesystem::directory_iterator open("/proc/self/fd");
    EXPECT_EQ(::getrlimit(RLIMIT_NOFILE, &before_), 0);
    rlimit few = before_;
    few.rlim_cur = more + static_cast<std::size_t>(std::distance(begin(open), end(open)));
    EXPECT_EQ(::setrlimit(RLIMIT_NOFILE, &few), 0);
  }
  FewFiles(const FewFiles&) = delete;
  FewFiles& operator=(const FewFiles&) = delete;
  ~FewFiles() { EXPECT_EQ(::setrlimit(RLIMIT_NOFILE, &before_), 0); }

 private:
  rlimit before_{};
};

// A mirror that is awake holds the file of its tile.
TEST(SessionWorlds, PublishersCloseTilesThatTheirMirrorsRemember) {
  const CutTerrain terrain;
  const auto ball_file = test::write_model(cut_ball());
  const FewFiles few(24);
  const auto over_all = [&](auto&& settle) {
    for (int row = 2; row < test::kCutSide * test::kCutCells; row += test::kCutCells)
      for (int column = 2; column < test::kCutSide * test::kCutCells; column += test::kCutCells)
        settle(on_the_ground(terrain, column, row));
  };
  {
    CutHost host(terrain);
    over_all([&](const Motion& ball) {
      const PairAnswer answer = host.settle({}, ball);
      EXPECT_EQ(answer.answer.status, AnswerStatus::kContact) << answer.awaited;
    });
    EXPECT_EQ(host.channel->regions, 0);
    EXPECT_EQ(host.said, std::vector<std::string>{});
  }

  test::MemoryBus bus(3);
  const auto end = bus.make_publisher(0xa1);
  publisher::Service service(*end, 0xa1);
  ASSERT_EQ(service.add_world("valley", terrain.folder).message(), "");
  ASSERT_TRUE(service.add_model("ball", ModelFile::open(ball_file->path()).value()).is_ok());
  service.announce();
  Session session(bus.make_peer(0xb1));
  const BodyId world = session.add_body({.name = "ground", .model = "valley"}).value();
  const BodyId ball = session.add_body({.name = "ball", .model = "ball", .own = true}).value();
  ASSERT_TRUE(session.watch(ball, world).is_ok());
  ASSERT_TRUE(session.place_body(world, {}).is_ok());
  std::uint64_t frame = 0;
  over_all([&](const Motion& motion) {
    bool is_certified = false;
    for (int round = 0; round < 40 && !is_certified; ++round) {
      const auto report = session.update(frame++, 0, {{ball, motion}}, 10);
      is_certified = report.value().all_certified();
      EXPECT_TRUE(service.step(0.01 * static_cast<double>(frame)).empty());
      bus.tick();
    }
    EXPECT_TRUE(is_certified);
  });
  EXPECT_EQ(service.stats().refused, 0U);
}

TEST(SessionWorlds, SweptAnswersAreThoseOfTheMeshThatWasCut) {
  constexpr double kSweep_s = 0.7;
  const CutTerrain terrain;
  CutHost host(terrain, {.lookahead_s = 0.1, .sweep_s = kSweep_s});
  const auto whole = build_full_tree(terrain.model->header, terrain.model->store);
  const auto ball = build_full_tree(cut_ball().header, cut_ball().store);
  ASSERT_TRUE(whole && ball);
  Random random(17);
  int hits = 0, free = 0;
  for (int i = 0; i < 60; ++i) {
    CutScene scene = random_scene(terrain, random, i % 3);
    if (i % 6 == 0) scene.ball.pose.translation_m[2] += 0.9;
    const auto truth = sweep(ball->view(), scene.ball, "ball", whole->view(), {.pose = scene.world},
                             "whole", {.duration_s = kSweep_s});
    ASSERT_TRUE(truth.is_ok()) << truth.status().message();
    ASSERT_TRUE(host.session->place_body(host.world, scene.world).is_ok());
    for (int round = 0; round < 60; ++round) {
      const FrameReport report = host.update(scene.ball);
      const PairAnswer& answer = report.answers.at(0);
      if (!answer.swept) {
        EXPECT_FALSE(answer.asked);
        continue;
      }
      // As long as tiles and detail come it says less, and nothing else.
      EXPECT_LE(answer.swept->free_until_s, truth.value().hit_s);
      EXPECT_GE(answer.swept->hit_s, truth.value().hit_s);
      if (!is_certified(answer.swept->status)) continue;
      EXPECT_EQ(answer.swept->status, truth.value().status);
      EXPECT_EQ(answer.swept->hit_s, truth.value().hit_s);
      hits += answer.swept->status == AnswerStatus::kContact ? 1 : 0;
      free += answer.swept->status == AnswerStatus::kFree ? 1 : 0;
      break;
    }
  }
  EXPECT_GT(hits, 20);
  EXPECT_GT(free, 5);
}

/// From a publisher's service, over a bus that loses and reorders.
TEST(SessionWorlds, APublisherServesThemOverALossyBus) {
  const CutTerrain terrain;
  const auto ball_file = test::write_model(cut_ball());
  Random random(11);
  test::MemoryBus bus(3);
  bus.on_batches = bus.on_subscriptions = {.lose = 0.1, .repeat = 0.1, .max_delay = 3};
  const auto end = bus.make_publisher(0xa1);
  publisher::Service service(*end, 0xa1);
  ASSERT_EQ(service.add_world("valley", terrain.folder + "/").message(), "");
  ASSERT_TRUE(service.add_model("ball", ModelFile::open(ball_file->path()).value()).is_ok());
  EXPECT_EQ(service.add_world("valley", terrain.folder).code(), StatusCode::kConflict);
  EXPECT_EQ(service.add_world("other", terrain.folder).code(), StatusCode::kConflict);
  EXPECT_EQ(service.add_world("none", ball_file->path()).code(), StatusCode::kIo);
  service.announce();
  Session session(bus.make_peer(0xb1), {.request_timeout_s = 0.002});
  const BodyId world = session.add_body({.name = "ground", .model = "valley"}).value();
  const BodyId ball = session.add_body({.name = "ball", .model = "ball", .own = true}).value();
  ASSERT_TRUE(session.watch(ball, world).is_ok());
  std::uint64_t frame = 0;
  double seconds = 0;
  int certified = 0, contacts = 0;
  const auto settle = [&](const CutTerrain& truth, const CutScene& scene, auto&& step) {
    ASSERT_TRUE(session.place_body(world, scene.world).is_ok());
    for (int round = 0; round < 400; ++round) {
      const auto report = session.update(frame++, 0, {{ball, scene.ball}}, 10);
      ASSERT_TRUE(report.is_ok()) << report.status().message();
      step();
      bus.tick();
      const PairAnswer& answer = report.value().answers.at(0);
      if (answer.world && answer.world->world != truth.pages.name) continue;
      expect_true(truth, scene, answer);
      if (!report.value().all_certified()) continue;
      ++certified;
      contacts += answer.answer.pair_total > 0 ? 1 : 0;
      return;
    }
  };
  for (int i = 0; i < 40; ++i)
    settle(terrain, random_scene(terrain, random, i % 3),
           [&] { static_cast<void>(service.step(seconds += 0.05)); });
  EXPECT_EQ(certified, 40);
  EXPECT_GT(contacts, 10);

  // A crater: another world in its place. It shares all tiles but one, and the folder.
  const CutTerrain crater(0.6, true);
  const auto other_end = bus.make_publisher(0xa2);
  publisher::Service other(*other_end, 0xa2);
  ASSERT_EQ(other.add_world("valley", crater.folder, terrain.pages.name).message(), "");
  other.announce();
  for (int i = 0; i < 20; ++i)
    settle(crater, random_scene(crater, random, i % 3), [&] {
      static_cast<void>(service.step(seconds += 0.05));
      static_cast<void>(other.step(seconds));
    });
  EXPECT_EQ(certified, 60);
  EXPECT_EQ(service.stats().refused, 0U);
}

/// What a tree of pages names: the contents of pages and of tiles.
std::set<ContentHash> contents_of(const WorldPages& pages) {
  std::set<ContentHash> contents;
  for (const auto& [content, bytes] : pages.pages) {
    contents.insert(content);
    const Result<WorldPage> page = decode_page(bytes);
    EXPECT_TRUE(page.is_ok());
    for (const WorldEntry& entry : page.value().entries) contents.insert(entry.content);
  }
  return contents;
}

/// Where the crater is deepest.
CutScene over_the_crater(const CutTerrain& terrain) {
  CutScene scene;
  scene.ball.pose.translation_m = terrain.posts()[2 * (test::kCutSide * test::kCutCells + 1) + 2];
  return scene;
}

// All that a lower page or a tile of another world says is true, but not of this one.
TEST(SessionWorlds, WhatIsOfAnotherRootIsRefusedUnderTheSealThatWasAskedFor) {
  const CutTerrain terrain;
  const CutScene scene = over_the_crater(terrain);
  CutHost honest(terrain);
  ASSERT_EQ(honest.settle(scene.world, scene.ball).answer.status, AnswerStatus::kContact);
  LocalChannel other;
  const CutTerrain crater(0.6, true);
  ASSERT_TRUE(other.add_world("valley", crater.folder).is_ok());
  static_cast<void>(other.take());
  const std::set<ContentHash> its = contents_of(terrain.pages), others = contents_of(crater.pages);
  std::vector<ContentHash> only_its, only_others;
  std::set_difference(its.begin(), its.end(), others.begin(), others.end(),
                      std::back_inserter(only_its));
  std::set_difference(others.begin(), others.end(), its.begin(), its.end(),
                      std::back_inserter(only_others));
  ASSERT_EQ(only_its.size(), 3U) << "the tile, and the pages above it";
  ASSERT_EQ(only_others.size(), 3U);
  // Written anew: the crater's record stands in the folder by now.
  ASSERT_TRUE(write_world(terrain.pages, terrain.folder).is_ok());
  for (const ContentHash& asked : only_its)
    for (const ContentHash& given : only_others) {
      CutHost host(terrain);
      int lies = 0;
      host.channel->passes = [&](wire::SplitBatchMessage& batch) {
        if (batch.content_hash != asked || !host.channel->requests.contains(batch.request) ||
            lies == 3)
          return true;
        wire::RegionSubscription request;
        request.request = 1;
        request.content_hash = given;
        request.region = content_bytes_request();
        other.send(request);
        for (wire::SplitBatchMessage& piece : other.take().batches) {
          if (piece.bytes.empty()) continue;
          batch.bytes = piece.bytes;
          batch.bytes.resize(batch.bytes.size() - kSealBytes);
          seal_batch(asked, batch.bytes);
          break;  // each of these fits one
        }
        lies += batch.last ? 1 : 0;
        return true;
      };
      FrameReport report = host.update(scene.world, scene.ball);
      for (int i = 0; i < 500 && !report.all_certified(); ++i) {
        expect_true(terrain, scene, report.answers.at(0));
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
        report = host.update(scene.ball);
      }
      EXPECT_EQ(lies, 3);
      EXPECT_TRUE(report.all_certified());
      expect_true(terrain, scene, report.answers.at(0));
      EXPECT_TRUE(std::any_of(host.said.begin(), host.said.end(), [&](const std::string& line) {
        return line.find(to_hex(asked) + ": have the digest " + to_hex(given)) != std::string::npos;
      })) << (host.said.empty() ? "" : host.said.front());
    }
}

/// A publisher on a bus, and a peer with a ball over its world.
struct BusHost {
  explicit BusHost(const CutTerrain& terrain) {
    service = serve(end, 0xa1, terrain, {});
    EXPECT_TRUE(service->add_model("ball", ModelFile::open(file->path()).value()).is_ok());
    service->announce();
    session.emplace(bus.make_peer(0xb1), SessionOptions{.request_timeout_s = 0.002});
    world = session->add_body({.name = "ground", .model = "valley"}).value();
    ball = session->add_body({.name = "ball", .model = "ball", .own = true}).value();
    EXPECT_TRUE(session->place_body(world, {}).is_ok());
    EXPECT_TRUE(session->watch(ball, world).is_ok());
  }
  std::unique_ptr<publisher::Service> serve(std::unique_ptr<publisher::Channel>& its_end,
                                            wire::SessionId id, const CutTerrain& terrain,
                                            const ContentHash& replaces) {
    its_end = bus.make_publisher(id);
    auto made = std::make_unique<publisher::Service>(*its_end, id);
    EXPECT_EQ(made->add_world("valley", terrain.folder, replaces).message(), "");
    return made;
  }
  PairAnswer round(const Motion& motion) {
    Result<FrameReport> report = session->update(frame++, 0, {{ball, motion}}, 10);
    EXPECT_TRUE(report.is_ok()) << report.status().message();
    seconds += 0.05;
    for (publisher::Service* each : {service.get(), other.get()})
      if (each != nullptr) static_cast<void>(each->step(seconds));
    bus.tick();
    return std::move(report.value().answers.at(0));
  }
  PairAnswer settle(const Motion& motion, const ContentHash& of_world) {
    PairAnswer answer = round(motion);
    for (int i = 0; i < 400 && !(is_certified(answer.answer.status) && answer.world &&
                                 answer.world->world == of_world);
         ++i)
      answer = round(motion);
    return answer;
  }

  std::unique_ptr<test::TempFile> file = test::write_model(cut_ball());
  test::MemoryBus bus{3};
  std::unique_ptr<publisher::Channel> end, other_end;
  std::unique_ptr<publisher::Service> service, other;
  std::optional<Session> session;
  BodyId world, ball;
  std::uint64_t frame = 0;
  double seconds = 0;
};

TEST(SessionWorlds, APublisherThatGoesInTheMiddleOfATileLeavesItUncertainAndNamesIt) {
  const CutTerrain terrain;
  CutScene scene;
  scene.ball = on_the_ground(terrain, 10, 10);  // where four tiles meet
  std::set<ContentHash> pages;
  for (const auto& [content, bytes] : terrain.pages.pages) pages.insert(content);
  int in_header = 0, in_detail = 0, in_page = 0, whole = 0;
  for (int most = 1; whole == 0 && most < 200; ++most) {
    BusHost host(terrain);
    int came = 0;
    bool is_page = false, is_piece = false;
    host.bus.batch_filter = [&](wire::SessionId, wire::SplitBatchMessage& batch) {
      if (came == most) return false;
      // A datagram of which only a part was made, too.
      const auto room = static_cast<std::size_t>(most - came - 1);
      if (batch.joined.size() > room) {
        batch.joined.resize(room);
        batch.last = false;
      }
      came += 1 + static_cast<int>(batch.joined.size());
      is_page = pages.contains(batch.content_hash);
      is_piece = batch.is_piece;
      return true;
    };
    PairAnswer answer = host.round(scene.ball);
    for (int i = 0; i < 60 && came < most && !is_certified(answer.answer.status); ++i)
      answer = host.round(scene.ball);
    host.service.reset();
    host.end.reset();
    for (int i = 0; i < 5; ++i) {
      answer = host.round(scene.ball);
      expect_true(terrain, scene, answer);
    }
    if (is_certified(answer.answer.status)) {
      ++whole;
      continue;
    }
    EXPECT_NE((answer.reason + answer.awaited).find("no publisher"), std::string::npos)
        << answer.reason << answer.awaited;
    if (!answer.world || answer.world->tiles.empty()) {
      ++in_page;
      continue;
    }
    EXPECT_NE(answer.awaited.find("tile "), std::string::npos) << answer.awaited;
    ++(is_page ? in_page : is_piece ? in_header : in_detail);
  }
  EXPECT_EQ(whole, 1);
  EXPECT_GT(in_page, 0);
  EXPECT_GT(in_header, 0);
  EXPECT_GT(in_detail, 2);
}

TEST(SessionWorlds, AcrossACraterOnlyItsTileAndThePagesAboveItComeAnew) {
  const CutTerrain terrain;
  const CutScene scene = over_the_crater(terrain);
  BusHost host(terrain);
  // First over other places, so that both lower pages and several tiles are held.
  constexpr std::size_t kPosts = test::kCutSide * test::kCutCells + 1;
  for (const std::size_t post : {5 * kPosts + 5, 20 * kPosts + 20, 35 * kPosts + 35}) {
    CutScene there;
    there.ball.pose.translation_m = terrain.posts()[post];
    const PairAnswer answer = host.settle(there.ball, terrain.pages.name);
    expect_true(terrain, there, answer);
    EXPECT_EQ(answer.answer.status, AnswerStatus::kContact);
  }
  const PairAnswer before = host.settle(scene.ball, terrain.pages.name);
  EXPECT_EQ(before.answer.status, AnswerStatus::kContact);
  const std::uint64_t held = host.session->stats().held_splits;

  const CutTerrain crater(0.6, true);
  host.other = host.serve(host.other_end, 0xa2, crater, terrain.pages.name);
  host.other->announce();
  host.bus.subscriptions.clear();
  const PairAnswer after = host.settle(scene.ball, crater.pages.name);
  expect_true(crater, scene, after);
  EXPECT_NE(touching_of(after), touching_of(before));
  for (const std::size_t post : {5 * kPosts + 5, 20 * kPosts + 20, 35 * kPosts + 35}) {
    CutScene there;
    there.ball.pose.translation_m = terrain.posts()[post];
    expect_true(crater, there, host.settle(there.ball, crater.pages.name));
  }
  const std::set<ContentHash> known = contents_of(terrain.pages);
  std::set<ContentHash> came;
  for (const wire::RegionSubscription& request : host.bus.subscriptions) {
    if (request.request == 0 || request.certificate) continue;
    EXPECT_FALSE(known.contains(request.content_hash))
        << to_hex(request.content_hash) << " was here already";
    if (asks_for_content_bytes(request.region)) came.insert(request.content_hash);
  }
  EXPECT_EQ(came.size(), 3U) << "the tile, and the two pages above it";
  EXPECT_GT(host.session->stats().held_splits, held * 3 / 4);
}

TEST(SessionWorlds, WhatIsFarIsFreeByAPageAndCostsNoTile) {
  const CutTerrain terrain;
  CutHost host(terrain);
  Motion high;
  high.pose.translation_m = terrain.posts()[500];
  high.pose.translation_m[2] += 50;
  high.linear_velocity_mps = {0, 0, -20};  // 10 m within the look-ahead
  const PairAnswer answer = host.settle({}, high);
  EXPECT_EQ(answer.answer.status, AnswerStatus::kFree);
  EXPECT_GT(answer.answer.clearance_m, 10);
  EXPECT_LE(answer.answer.clearance_m, 50);
  EXPECT_TRUE(answer.world->tiles.empty());
  EXPECT_EQ(host.channel->requests.size(), 1U) << "the first page";
  EXPECT_EQ(host.session->stats().batch_bytes, terrain.pages.pages.front().second.size() + 12);
}

TEST(SessionWorlds, ClearanceIsBelowTheDistance) {
  const CutTerrain terrain;
  CutHost host(terrain);
  Random random(5);
  std::size_t checked = 0;
  for (int round = 0; round < 60; ++round) {
    CutScene scene = random_scene(terrain, random, round % 2);
    const PairAnswer answer = host.settle(scene.world, scene.ball);
    if (answer.answer.status != AnswerStatus::kFree) continue;
    // Moved by less than the clearance, wherever to, it still touches nothing.
    for (int way = 0; way < 4; ++way) {
      std::array<double, 3> to{random.between(-1, 1), random.between(-1, 1), random.between(-1, 1)};
      const double length = std::sqrt(to[0] * to[0] + to[1] * to[1] + to[2] * to[2]);
      Pose moved = scene.ball.pose;
      for (std::size_t k = 0; k < 3; ++k)
        moved.translation_m[k] += to[k] / length * (answer.answer.clearance_m - 0.002);
      if (answer.answer.clearance_m > 0.002) {
        EXPECT_TRUE(test::touching_of_whole(terrain, scene.world, moved).empty());
      }
    }
    EXPECT_LE(answer.answer.clearance_m, answer.answer.distance_at_most_m);
    ++checked;
  }
  EXPECT_GT(checked, 5U);
}

TEST(SessionWorlds, LostAndWrongPiecesLeaveItUncertainAndNameTheTile) {
  const CutTerrain terrain;
  Random random(17);
  for (int kind = 0; kind < 6; ++kind) {
    CutHost host(terrain);
    Random fate(static_cast<std::uint64_t>(kind) + 1);
    const auto& other_page = terrain.pages.pages.back().second;
    // A page that hides its tiles.
    const auto forge = [](std::vector<std::uint8_t>& bytes, const ContentHash& content) {
      bytes.resize(bytes.size() - kSealBytes);
      Result<WorldPage> page = decode_page(std::span(bytes).subspan(8));
      if (page.is_ok() && page.value().level == 0) {
        for (WorldEntry& entry : page.value().entries) entry.extent = {};
        bytes = content_pieces(encode_page(page.value())).front();
      }
      seal_batch(content, bytes);
    };
    host.channel->passes = [&](wire::SplitBatchMessage& batch) {
      if (batch.bytes.size() < 12 || fate.below(2) == 0) return true;
      if (kind > 0 && !host.channel->requests.contains(batch.request)) return true;
      switch (kind) {
        case 0:
          return false;
        case 1:
          batch.bytes[8 + fate.below(static_cast<std::uint32_t>(batch.bytes.size() - 8))] ^= 1U;
          return true;
        case 2:
          batch.bytes.resize(batch.bytes.size() / 2);
          return true;
        case 3:  // whole, under the seal of what was asked for
          batch.bytes = content_pieces(other_page).front();
          seal_batch(batch.content_hash, batch.bytes);
          return true;
        case 4:
          forge(batch.bytes, batch.content_hash);
          return true;
        default:
          batch.bytes.resize(batch.bytes.size() - kSealBytes);
          batch.bytes[fate.below(static_cast<std::uint32_t>(batch.bytes.size()))] ^= 3U;
          seal_batch(batch.content_hash, batch.bytes);
          return true;
      }
    };
    std::size_t named = 0, certified = 0;
    for (int round = 0; round < 12; ++round) {
      const CutScene scene = random_scene(terrain, random, round % 3);
      FrameReport report = host.update(scene.world, scene.ball);
      for (int i = 0; i < 60; ++i) {
        expect_true(terrain, scene, report.answers.at(0));
        if (report.answers[0].awaited.find("tile ") != std::string::npos) ++named;
        if (report.all_certified()) break;
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
        report = host.update(scene.ball);
      }
      certified += report.all_certified() ? 1 : 0;
    }
    EXPECT_GT(named, 0U) << kind;
    EXPECT_GT(certified, 0U) << kind;
  }
}

TEST(SessionWorlds, WithoutItsPublisherAllThatIsNotHereIsUncertain) {
  const CutTerrain terrain;
  CutHost host(terrain);
  Random random(23);
  const CutScene first = random_scene(terrain, random, 0);
  ASSERT_TRUE(is_certified(host.settle(first.world, first.ball).answer.status));
  host.local.set_connected(false);
  std::size_t uncertain = 0;
  for (int round = 0; round < 30; ++round) {
    CutScene scene = random_scene(terrain, random, 0);
    for (std::size_t k = 0; k < 3; ++k)
      scene.ball.pose.translation_m[k] +=
          first.world.translation_m[k] - scene.world.translation_m[k];
    scene.world = first.world;
    const PairAnswer answer = host.settle(scene.world, scene.ball, 3);
    expect_true(terrain, scene, answer);
    if (is_certified(answer.answer.status)) continue;
    ++uncertain;
    EXPECT_NE(answer.awaited.find("no publisher"), std::string::npos) << answer.awaited;
  }
  EXPECT_GT(uncertain, 5U);
  host.local.set_connected(true);
  EXPECT_TRUE(is_certified(host.settle(first.world, first.ball).answer.status));
}

TEST(SessionWorlds, TilesAndPagesThatNothingNeedsAreGivenUp) {
  const CutTerrain terrain;
  CutHost host(terrain);
  Random random(29);
  const CutScene scene = random_scene(terrain, random, 0);
  const PairAnswer near = host.settle(scene.world, scene.ball);
  ASSERT_TRUE(is_certified(near.answer.status));
  EXPECT_GT(host.session->stats().tree_bytes, 0U);
  const std::uint64_t with_tiles = host.session->stats().slots;
  Motion away;
  away.pose = scene.ball.pose;
  away.pose.translation_m[2] += 1000;
  host.time_s = 9;
  host.update(away);
  EXPECT_EQ(host.session->stats().slots, with_tiles);
  host.time_s = 21;
  host.update(away);
  EXPECT_LT(host.session->stats().slots, with_tiles);
  EXPECT_EQ(host.settle(scene.world, scene.ball).answer.pair_total, near.answer.pair_total);
}

/// Until nothing is uncertain; what is said before that is so, too. Out: how many updates it took.
template <class Probe, class Answer, class Check>
int probe_until_certain(CutHost& host, const Motion& away, const std::vector<Probe>& probes,
                        std::vector<Answer>& answers, const Check& check) {
  for (int round = 0; round < 200; ++round) {
    const auto report =
        host.session->probe(host.world, std::span<const Probe>(probes), std::span<Answer>(answers));
    EXPECT_TRUE(report.is_ok()) << report.status().message();
    check();
    const bool is_certain = std::all_of(answers.begin(), answers.end(), [](const Answer& answer) {
      return answer.status != ProbeStatus::kUncertain;
    });
    EXPECT_EQ(report.value().awaited.empty() && report.value().reason.empty(), is_certain)
        << report.value().awaited << report.value().reason;
    if (is_certain) return round;
    host.update(away);
  }
  ADD_FAILURE() << "still uncertain";
  return 200;
}

TEST(SessionWorlds, ProbesAreThoseOfTheWorldOnDisk) {
  const CutTerrain terrain;
  WorldProbe truth = WorldProbe::open(terrain.folder).value();
  Random random(41);
  std::size_t hits = 0, misses = 0, balls_hit = 0, boxes_hit = 0, told_before = 0;
  for (int round = 0; round < 12; ++round) {
    CutHost host(terrain, {.max_held_splits = round % 2 == 0 ? 0U : 40U});
    const CutScene scene = random_scene(terrain, random, round % 3);
    Motion away;
    away.pose.translation_m = test::place(scene.world, {0, 0, 5000});
    ASSERT_TRUE(host.session->place_body(host.world, scene.world).is_ok());
    std::vector<RayProbe> rays;
    std::vector<BallProbe> balls;
    std::vector<BoxProbe> boxes;
    for (int i = 0; i < 12; ++i) {
      std::array<double, 3> post =
          terrain.posts()[random.below(static_cast<std::uint32_t>(terrain.posts().size()))];
      std::array<double, 3> near = post, above = post;
      for (double& x : near) x += random.between(-0.4, 0.4);
      above[2] += random.between(0.1, 20);
      above[0] += random.between(-30, 30) * (i % 3 == 0 ? 1 : 0);
      std::array<double, 3> from = test::place(scene.world, above),
                            to = test::place(scene.world, near);
      RayProbe ray{.origin_m = from, .direction = {}, .range_m = 60};
      for (std::size_t k = 0; k < 3; ++k) ray.direction[k] = to[k] - from[k];
      rays.push_back(ray);
      balls.push_back({to, random.between(0, 0.4)});
      boxes.push_back({{test::random_rotation(random), to}, {0.1, 0.2, random.between(0.1, 3)}});
    }
    std::vector<RayAnswer> found(rays.size());
    std::vector<WorldRayAnswer> on_disk(rays.size());
    ASSERT_TRUE(truth.probe(scene.world, rays, on_disk).is_ok());
    host.update(away);  // its first page is asked for
    const int took = probe_until_certain(host, away, rays, found, [&] {
      for (std::size_t i = 0; i < rays.size(); ++i) {
        const RayAnswer &told = found[i], &is = on_disk[i].ray;
        if (told.status != ProbeStatus::kUncertain) {
          EXPECT_EQ(told.status, is.status);
          EXPECT_EQ(told.missing, 0U);
        } else if (told.at_least_m > 0 || told.has_face) {
          ++told_before;
        }
        if (told.status == ProbeStatus::kHit) {
          EXPECT_EQ(told.face, is.face);
          EXPECT_EQ(told.point_m, is.point_m);
          EXPECT_EQ(told.normal, is.normal);
        }
        if (is.status == ProbeStatus::kMiss) {
          EXPECT_FALSE(told.has_face);
          continue;
        }
        EXPECT_LE(told.at_least_m, is.at_most_m);
        EXPECT_GE(told.at_most_m, is.at_least_m);
      }
    });
    EXPECT_GT(took, 1) << "pages, headers and detail were not here";
    for (const WorldRayAnswer& is : on_disk) ++(is.ray.status == ProbeStatus::kHit ? hits : misses);

    std::vector<ShapeAnswer> shapes(balls.size());
    std::vector<WorldShapeAnswer> shapes_on_disk(balls.size());
    const auto expect_same = [&](std::size_t& count) {
      for (std::size_t i = 0; i < shapes.size(); ++i) {
        if (shapes[i].status == ProbeStatus::kUncertain) continue;
        EXPECT_EQ(shapes[i].status, shapes_on_disk[i].shape.status);
        count += shapes[i].status == ProbeStatus::kHit ? 1 : 0;
      }
    };
    ASSERT_TRUE(truth.probe(scene.world, balls, shapes_on_disk).is_ok());
    probe_until_certain(host, away, balls, shapes, [&] { expect_same(balls_hit); });
    ASSERT_TRUE(truth.probe(scene.world, boxes, shapes_on_disk).is_ok());
    probe_until_certain(host, away, boxes, shapes, [&] { expect_same(boxes_hit); });

    std::vector<PointAnswer> points(1);
    const std::array<double, 3> point{};
    const auto inside = host.session->probe(host.world, std::span(&point, 1), points);
    ASSERT_TRUE(inside.is_ok());
    EXPECT_NE(inside.value().reason.find("is a world"), std::string::npos);
    EXPECT_EQ(points[0].status, ProbeStatus::kUncertain);
    rays[3].direction = {};
    const auto refused = host.session->probe(host.world, rays, std::span(found));
    EXPECT_EQ(refused.status().code(), StatusCode::kInvalidArgument);
    EXPECT_NE(refused.status().message().find("ground: ray 3"), std::string::npos)
        << refused.status().message();
  }
  EXPECT_GT(hits, 60U);
  EXPECT_GT(misses, 10U);
  EXPECT_GT(balls_hit, 20U);
  EXPECT_GT(boxes_hit, 20U);
  EXPECT_GT(told_before, 10U) << "uncertain answers have bounds";
}

// As long as somebody probes them.
TEST(SessionWorlds, WhatIsProbedIsNotGivenUp) {
  const CutTerrain terrain;
  CutHost host(terrain);
  Motion away;
  away.pose.translation_m = {0, 0, 5000};
  ASSERT_TRUE(host.session->place_body(host.world, {}).is_ok());
  const std::vector<RayProbe> rays{
      {.origin_m = {terrain.posts()[300][0] + 0.1, terrain.posts()[300][1] + 0.1, 100}}};
  std::vector<RayAnswer> found(1);
  host.update(away);
  probe_until_certain(host, away, rays, found, [] {});
  EXPECT_EQ(found[0].status, ProbeStatus::kHit);
  for (int i = 0; i < 5; ++i) {
    host.time_s += 6;
    host.update(away);
    ASSERT_TRUE(host.session->probe(host.world, rays, std::span(found)).is_ok());
    EXPECT_EQ(found[0].status, ProbeStatus::kHit) << i;
  }
  for (int i = 0; i < 2; ++i) {
    host.time_s += 11;
    host.update(away);
  }
  ASSERT_TRUE(host.session->probe(host.world, rays, std::span(found)).is_ok());
  EXPECT_EQ(found[0].status, ProbeStatus::kUncertain);
  EXPECT_EQ(found[0].missing, 1U);
  EXPECT_GT(found[0].at_least_m, 90);
}

/// A ray upward from within the box of a lower page that meets no tile's box.
RayProbe ray_between(const CutTerrain& terrain) {
  std::vector<WorldPage> lower;
  for (const auto& [content, bytes] : terrain.pages.pages)
    if (const Result<WorldPage> page = decode_page(bytes); page.is_ok() && page.value().level == 0)
      lower.push_back(page.value());
  std::array<std::int64_t, 3> best{};
  std::int64_t best_room = 0;  // in cells, above the highest tile there
  for (const WorldPage& page : lower)
    for (const WorldEntry& entry : page.entries) {
      const CellBox box = entry.box();
      const std::int64_t x = (box.lo[0] + box.hi[0]) / 2, y = (box.lo[1] + box.hi[1]) / 2;
      std::int64_t top = box.hi[2];
      for (const WorldPage& other : lower)
        for (const WorldEntry& tile : other.entries)
          if (const CellBox its = tile.box();
              its.lo[0] <= x && x <= its.hi[0] && its.lo[1] <= y && y <= its.hi[1])
            top = std::max(top, its.hi[2]);
      const std::int64_t room = page.box().hi[2] - top;
      if (room <= best_room) continue;
      best_room = room;
      best = {x, y, top + room / 2};
    }
  EXPECT_GT(best_room, 4);
  RayProbe ray{.direction = {0, 0, 1}};
  for (std::size_t k = 0; k < 3; ++k)
    ray.origin_m[k] = test::kCutLattice.origin_m[k] +
                      std::ldexp(static_cast<double>(best[k]), test::kCutLattice.exponent);
  return ray;
}

// Where bodies and probes come near pages and near no tile.
TEST(SessionWorlds, PagesWithoutTilesAreGivenUp) {
  const CutTerrain terrain;
  CutHost host(terrain);
  Motion away;
  away.pose.translation_m = {0, 0, 5000};
  ASSERT_TRUE(host.session->place_body(host.world, {}).is_ok());
  const std::vector<RayProbe> rays{ray_between(terrain)};
  std::vector<RayAnswer> found(1);
  host.update(away);
  probe_until_certain(host, away, rays, found, [] {});
  EXPECT_EQ(found[0].status, ProbeStatus::kMiss);
  EXPECT_GE(host.channel->requests.size(), 2U) << "the first page, and what the ray meets below it";
  host.time_s = 9;
  host.update(away);
  ASSERT_TRUE(host.session->probe(host.world, rays, std::span(found)).is_ok());
  EXPECT_EQ(found[0].status, ProbeStatus::kMiss);
  host.time_s = 21;
  host.update(away);
  ASSERT_TRUE(host.session->probe(host.world, rays, std::span(found)).is_ok());
  EXPECT_EQ(found[0].status, ProbeStatus::kUncertain);
}

TEST(SessionWorlds, TheSameTilesInAnotherLatticeStandElsewhere) {
  const CutTerrain terrain;
  const std::string folder = terrain.folder + "_moved";
  std::filesystem::copy(terrain.folder, folder, std::filesystem::copy_options::recursive);
  WorldPages moved = terrain.pages;
  moved.world.lattice.origin_m[0] += 16;
  ASSERT_TRUE(write_world(moved, folder).is_ok());
  CutHost host(terrain);
  ASSERT_TRUE(host.local.add_world("moved", folder).is_ok());
  Random random(37);
  for (int round = 0; round < 8; ++round) {
    CutScene scene = random_scene(terrain, random, 0);
    scene.world = {};
    scene.ball.pose.translation_m = terrain.posts()[100 + 7 * static_cast<std::size_t>(round)];
    scene.ball.linear_velocity_mps = {};
    ASSERT_TRUE(host.session->replace_model(host.world, "valley").is_ok());
    PairAnswer answer = host.settle(scene.world, scene.ball);
    expect_true(terrain, scene, answer);
    EXPECT_EQ(answer.answer.status, AnswerStatus::kContact);
    ASSERT_TRUE(host.session->replace_model(host.world, "moved").is_ok());
    answer = host.settle(scene.world, scene.ball);
    EXPECT_EQ(answer.answer.status, AnswerStatus::kFree);
    EXPECT_NE(answer.content_b, terrain.pages.name);
    scene.ball.pose.translation_m[0] += 16;
    answer = host.settle(scene.world, scene.ball);
    EXPECT_EQ(answer.answer.status, AnswerStatus::kContact);
    scene.world.translation_m[0] = 16;
    expect_true(terrain, scene, answer);
  }
  std::filesystem::remove_all(folder);
}

// Else it would be asked for again with each answer, for ever.
TEST(SessionWorlds, APageThatIsNoRootOfItsWorldIsNotWantedAgain) {
  const CutTerrain terrain;
  const WorldFolder folder = WorldFolder::open(terrain.folder).value();
  WorldRecord record = folder.world();
  const std::vector<std::uint8_t> root = folder.page_bytes(record.root).value();
  ++record.root_level;
  const std::vector<std::uint8_t> bytes = encode_world(record);
  subscriber::PeerWorld world = subscriber::PeerWorld::from_record(digest_of(bytes), bytes).value();
  EXPECT_TRUE(world.wants_root());
  EXPECT_FALSE(world.take_page(record.root, root));
  EXPECT_EQ(world.root(), nullptr);
  EXPECT_FALSE(world.wants_root());
}

// Names from outside are for models that publishers serve.
TEST(SessionWorlds, NoBodyHasTheModelOfATile) {
  const CutTerrain terrain;
  CutHost host(terrain);
  Random random(41);
  const CutScene scene = random_scene(terrain, random, 0);
  const PairAnswer answer = host.settle(scene.world, scene.ball);
  ASSERT_TRUE(answer.world && !answer.world->tiles.empty());
  for (const auto& tile : answer.world->tiles) {
    const std::string name = "valley tile " + to_hex(tile.tile.content);
    const Result<BodyId> posing = host.session->add_body({.name = name, .model = name});
    ASSERT_TRUE(posing.is_ok()) << posing.status().message();
    host.update(scene.ball);
    EXPECT_EQ(host.session->held_mesh(posing.value()).status().code(), StatusCode::kNotFound);
  }
}

TEST(SessionWorlds, TwoRunsGiveTheSameDigests) {
  const CutTerrain terrain;
  std::vector<std::uint64_t> digests[2];
  for (auto& seen : digests) {
    CutHost host(terrain);
    Random random(31);
    for (int round = 0; round < 10; ++round) {
      const CutScene scene = random_scene(terrain, random, round % 3);
      for (int i = 0; i < 6; ++i) {
        const FrameReport report = host.update(scene.world, scene.ball);
        seen.push_back(report.answers_digest);
        seen.push_back(report.state_digest);
      }
    }
  }
  EXPECT_EQ(digests[0], digests[1]);
}

}  // namespace
}  // namespace nearmesh
