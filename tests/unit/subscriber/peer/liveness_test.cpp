// SPDX-License-Identifier: Apache-2.0
// What is asked is answered in the end, whatever others send: a request counts as answered by who
// was asked, and by nobody else.

#include <cmath>
#include <thread>

#include "core/base/stopwatch.hpp"
#include "core/demand/answer.hpp"
#include "core/world/content_bytes.hpp"
#include "cut_world.hpp"
#include "nearmesh/core/spm/detail/codec.hpp"
#include "world.hpp"

namespace nearmesh::test {
namespace {

constexpr wire::SessionId kOther = kPublisher + 1;

/// Serves something that nobody needs.
ServedModel& elsewhere() {
  static ServedModel model(bake_named("torus"));
  return model;
}

wire::SplitBatchMessage from(wire::SessionId publisher, std::uint32_t request,
                             const ContentHash& content) {
  static std::uint32_t sequence = 0;
  return {
      .publisher = publisher, .content_hash = content, .request = request, .sequence = ++sequence};
}

// A large answer may need longer than the time-out. What both send meanwhile, for others' models
// here, must not have it begun anew at each in turn for ever.
TEST(Liveness, ALongAnswerIsNotBegunAnewForEverAtTwoBusyPublishers) {
  constexpr double kTimeout_s = 0.004;
  World world;
  world.start_publisher();
  world.start_publisher(kOther);
  const auto session = world.make_peer({.request_timeout_s = kTimeout_s});
  world.bus.accept_batches = false;
  const Flight flight = make_flight(1);
  const Stopwatch watch;
  for (int i = 0; i < 100; ++i) {
    for (const wire::SessionId publisher : {kPublisher, kOther}) {
      wire::SplitBatchMessage other = from(publisher, 0, {0, 12345});
      other.bytes = {1, 2, 3};
      world.bus.inject(kPeer, other);
    }
    world.round(*session, 0, {{kOne, flight.one[0]}, {kTwo, flight.two[0]}});
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  // Of two models at most, and the first of each at once.
  const double most = 2 * (2 + std::log2(watch.seconds() / kTimeout_s));
  EXPECT_GT(session->stats().requests, 1U);
  EXPECT_LE(static_cast<double>(session->stats().requests), most);
}

// They serve nothing of it.
TEST(Liveness, ALongAnswerIsNotBegunAnewWithEachPublisherThatComes) {
  constexpr double kTimeout_s = 0.004;
  World world;
  world.start_publisher();
  const auto session = world.make_peer({.request_timeout_s = kTimeout_s});
  world.bus.accept_batches = false;
  const Flight flight = make_flight(1);
  const Stopwatch watch;
  for (wire::SessionId id = 0x1000; id < 0x1064; ++id) {
    world.bus.inject(wire::Hello{.publisher = id, .models = {{"elsewhere", {0, id}, 1, {}}}});
    world.round(*session, 0, {{kOne, flight.one[0]}, {kTwo, flight.two[0]}});
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  const double most = 2 * (2 + std::log2(watch.seconds() / kTimeout_s));
  EXPECT_GT(session->stats().requests, 1U);
  EXPECT_LE(static_cast<double>(session->stats().requests), most);
}

// Faster than they could be taken in, one an update: the peer neither waits for them, nor are they
// before what it asked for.
TEST(Liveness, WhatNobodyAskedForKeepsNoAnswerWaiting) {
  World world;
  world.start_publisher();
  world.start_publisher_of("elsewhere", elsewhere(), kOther);
  const auto session = world.make_peer();
  world.on_report = [&](const FrameReport&) {
    for (const ServedModel* model : {&terrain(), &aircraft()})
      for (int i = 0; i < 10; ++i) {
        wire::SplitBatchMessage other = from(kOther, 1, model->open().content_hash());
        other.bytes = {1, 2, 3};
        world.bus.inject(kPeer, other);
      }
  };
  world.on_report({});
  const Flight flight = make_flight(1);
  EXPECT_EQ(world.fly(*session, flight, 0, 4, 200, 0), 4U);
  EXPECT_TRUE(world.has_complaint("sends detail that it was not asked for"));
  EXPECT_EQ(world.complaints.size(), 1U);
}

// It was asked, of something else.
TEST(Liveness, WhoWasAskedForOneModelDoesNotFloodAnother) {
  World world;
  world.judges = false;  // knows three bodies
  world.start_publisher();
  world.start_publisher_of("elsewhere", other_terrain(), kOther);
  const auto session = world.make_peer();
  const BodyId valley =
      session->add_body({.name = "valley", .model = "elsewhere", .own = true}).value();
  ASSERT_TRUE(session->watch(valley, kGround).is_ok());
  const Flight flight = make_flight(1);
  Motion touching;
  const BakedModel &here = terrain().model, &there = other_terrain().model;
  for (std::size_t k = 0; k < 3; ++k)
    touching.pose.translation_m[k] = position_m(here.header, here.store, VertexId{0})[k] -
                                     position_m(there.header, there.store, VertexId{0})[k];
  bool is_asked = false;
  for (int i = 0; i < 20 && !is_asked; ++i) {
    world.round(*session, 0, {{kOne, flight.one[0]}, {valley, touching}});
    for (const wire::RegionSubscription& request : world.bus.subscriptions)
      is_asked |= request.publisher == kOther;
  }
  ASSERT_TRUE(is_asked);
  ASSERT_TRUE(session->remove_body(valley).is_ok());
  world.judges = true;
  world.on_report = [&](const FrameReport&) {
    for (int i = 0; i < 10; ++i) {
      wire::SplitBatchMessage other = from(kOther, 1, terrain().open().content_hash());
      other.bytes = {1, 2, 3};
      world.bus.inject(kPeer, other);
    }
  };
  EXPECT_EQ(world.fly(*session, flight, 0, 4, 200, 0), 4U);
}

/// Holds a request open, and has another publisher write what it likes in its place.
class OpenRequest : public testing::Test {
 protected:
  void SetUp() override {
    world.start_publisher();
    world.start_publisher_of("elsewhere", elsewhere(), kOther);
    session = world.make_peer({.request_timeout_s = 3600});
    world.bus.accept_batches = false;
    rounds(3);
    asked = session->stats().requests;
    ASSERT_GT(asked, 0U);
  }
  void rounds(int count) {
    for (int i = 0; i < count; ++i)
      world.round(*session, 0, {{kOne, flight.one[0]}, {kTwo, flight.two[0]}});
  }
  /// As if it were the last of the answer to each request that was sent.
  void answer_all(const std::function<void(wire::SplitBatchMessage&)>& change) {
    for (const wire::RegionSubscription& request : world.bus.subscriptions) {
      if (request.request == 0) continue;
      const ContentHash content =
          request.certificate ? request.certificate->models.front().content : request.content_hash;
      wire::SplitBatchMessage message = from(kOther, request.request, content);
      message.last = true;
      change(message);
      world.bus.inject(kPeer, message);
    }
    rounds(3);
  }

  World world;
  const Flight flight = make_flight(1);
  std::unique_ptr<Session> session;
  std::uint64_t asked = 0;
};

TEST_F(OpenRequest, IsEndedByWhoWasAskedAlone) {
  answer_all([](auto&) {});
  EXPECT_EQ(session->stats().requests, asked);
  world.bus.accept_batches = true;
  EXPECT_TRUE(world.fly_frame(*session, 0, {{kOne, flight.one[0]}, {kTwo, flight.two[0]}}));
}

TEST_F(OpenRequest, IsRedirectedByWhoWasAskedAlone) {
  answer_all([](auto& message) { message.refused = message.wants_regions = true; });
  answer_all([](auto& message) { message.refused = message.wants_held = true; });
  EXPECT_EQ(session->stats().requests, asked);
}

TEST_F(OpenRequest, IsRefusedByWhoWasAskedAlone) {
  answer_all([](auto& message) {
    message.refused = true;
    message.bytes = {'n', 'o'};
  });
  EXPECT_FALSE(world.has_complaint("refused")) << world.complaints.front();
  EXPECT_EQ(session->stats().requests, asked);
}

// Else who writes that an audit is answered, before its proof is here, has an honest publisher
// taken for a liar.
TEST(Liveness, AnAuditIsAnsweredByWhoWasAskedAlone) {
  World world;
  world.start_publisher();
  world.start_publisher_of("elsewhere", elsewhere(), kOther);
  SessionOptions options = quick_options();
  options.audit_s = 1e-9;
  const auto session = world.make_peer(options);
  std::set<std::uint32_t> audits;
  const Flight flight = make_flight(1);
  world.bus.batch_filter = [&](wire::SessionId, wire::SplitBatchMessage& message) {
    return message.bytes.empty() || !is_audit_piece(message.bytes);  // proofs take long
  };
  for (std::size_t i = 0; i < flight.frames(); ++i) {
    world.fly_frame(*session, i, {{kOne, flight.one[i]}, {kTwo, flight.two[i]}}, 5);
    for (const wire::RegionSubscription& request : world.bus.subscriptions) {
      if (!request.region.is_audit() || !audits.insert(request.request).second) continue;
      wire::SplitBatchMessage message = from(kOther, request.request, request.content_hash);
      message.last = true;
      world.bus.inject(kPeer, message);
    }
  }
  EXPECT_GT(audits.size(), 0U);
  EXPECT_FALSE(world.has_complaint("does not prove")) << world.complaints.front();
}

// ---- worlds -------------------------------------------------------------------------------------

/// A publisher of a world on a bus, another of nothing of it, and a peer with a ball over it.
struct Valley {
  explicit Valley(double audit_s = 0, double request_timeout_s = 3600) {
    EXPECT_EQ(service.add_world("valley", terrain.folder).message(), "");
    EXPECT_TRUE(service.add_model("ball", ModelFile::open(file->path()).value()).is_ok());
    service.announce();
    EXPECT_TRUE(other.add_model("elsewhere", elsewhere().open()).is_ok());
    other.announce();
    session.emplace(bus.make_peer(kPeer),
                    SessionOptions{.request_timeout_s = request_timeout_s, .audit_s = audit_s});
    world = session->add_body({.name = "ground", .model = "valley"}).value();
    ball = session->add_body({.name = "ball", .model = "ball", .own = true}).value();
    EXPECT_TRUE(session->place_body(world, {}).is_ok());
    EXPECT_TRUE(session->watch(ball, world).is_ok());
    near.pose.translation_m = terrain.posts()[2 * (kCutSide * kCutCells + 1) + 2];
    far = near;
    far.pose.translation_m[2] += 1000;
  }
  FrameReport round(const Motion& motion) {
    bus.tick();
    static_cast<void>(service.step(seconds += 0.05));
    static_cast<void>(other.step(seconds));
    Result<FrameReport> report = session->update(frame++, time_s, {{ball, motion}}, 10);
    EXPECT_TRUE(report.is_ok()) << report.status().message();
    said.insert(said.end(), report.value().complaints.begin(), report.value().complaints.end());
    return std::move(report).value();
  }
  [[nodiscard]] bool has_complaint(const std::string& part) const {
    return std::any_of(said.begin(), said.end(), [&](const std::string& line) {
      return line.find(part) != std::string::npos;
    });
  }

  const CutTerrain terrain;
  std::unique_ptr<TempFile> file = write_model(cut_ball());
  MemoryBus bus{3};
  std::unique_ptr<publisher::Channel> end = bus.make_publisher(kPublisher),
                                      other_end = bus.make_publisher(kOther);
  publisher::Service service{*end, kPublisher}, other{*other_end, kOther};
  std::optional<Session> session;
  BodyId world, ball;
  Motion near, far;
  std::uint64_t frame = 0;
  double seconds = 0, time_s = 0;
  std::vector<std::string> said;
};

TEST(Liveness, PiecesCountFromWhoWasAskedAlone) {
  const auto fly = [](Valley& valley, bool is_disturbed) {
    int rounds = 0;
    while (rounds < 200 && !valley.round(valley.near).all_certified()) {
      ++rounds;
      if (!is_disturbed) continue;
      for (const wire::RegionSubscription& request : valley.bus.subscriptions) {
        if (request.request == 0 || request.certificate) continue;
        if (!asks_for_content_bytes(request.region)) continue;
        // The first piece of more than there is, and what is no piece at all.
        const std::vector<std::uint8_t> more(2 * kMaxBatchBytes, 1);
        for (std::vector<std::uint8_t> bytes : {content_pieces(more).front(), {1, 2, 3}}) {
          wire::SplitBatchMessage message = from(kOther, request.request, request.content_hash);
          message.last = message.is_piece = true;
          seal_batch(request.content_hash, bytes);
          message.bytes = std::move(bytes);
          valley.bus.inject(kPeer, message);
        }
      }
    }
    return rounds;
  };
  Valley quiet, disturbed;
  const int rounds = fly(quiet, false);
  EXPECT_LT(rounds, 200);
  EXPECT_EQ(fly(disturbed, true), rounds);
  EXPECT_EQ(disturbed.session->stats().requests, quiet.session->stats().requests);
  EXPECT_TRUE(disturbed.said.empty()) << disturbed.said.front();
}

// As many are asked for at a time as do not come: the others would never have their turn.
TEST(Liveness, TilesThatDoNotComeLeaveRoomForTheOthers) {
  constexpr std::size_t kMissing = 32;
  Valley valley(0, 0.002);
  std::set<ContentHash> tiles;
  for (const auto& [content, bytes] : valley.terrain.pages.pages)
    if (const auto page = decode_page(bytes); page.is_ok() && page.value().level == 0)
      for (const WorldEntry& entry : page.value().entries) tiles.insert(entry.content);
  ASSERT_GT(tiles.size(), kMissing);
  const std::set<ContentHash> missing(tiles.begin(), std::next(tiles.begin(), kMissing));
  valley.bus.batch_filter = [&](wire::SessionId, wire::SplitBatchMessage& message) {
    return !missing.contains(message.content_hash);
  };
  Motion fast = valley.near;
  fast.linear_velocity_mps = {1e6, 1e6, 0};  // all tiles may be near
  std::size_t here = 0;
  for (int i = 0; i < 400 && here < tiles.size() - kMissing; ++i) {
    const PairAnswer answer = std::move(valley.round(fast).answers.at(0));
    here = 0;
    if (answer.world)
      for (const auto& tile : answer.world->tiles) here += tile.is_here ? 1 : 0;
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  EXPECT_EQ(here, tiles.size() - kMissing);
}

// Tiles are given up after some seconds: who proves nothing would have got away with it each time.
TEST(Liveness, AuditsThatATileDidNotProveCountWhenItComesBack) {
  Valley valley(1e-9);
  const ContentHash ball = ModelFile::open(valley.file->path()).value().content_hash();
  bool is_answered = false;
  valley.bus.batch_filter = [&](wire::SessionId, wire::SplitBatchMessage& message) {
    if (message.content_hash == ball || message.is_piece || message.bytes.empty() ||
        !is_audit_piece(message.bytes))
      return true;
    message.bytes.clear();  // answered, and nothing is proved
    is_answered |= message.last;
    return true;
  };
  const auto is_found = [&] { return valley.has_complaint("does not prove what it sent"); };
  // A visit has one audit or two, and three in a row are found.
  int visits = 0;
  while (visits < 8 && !is_found()) {
    ++visits;
    is_answered = false;
    // Each split is as likely as any other, and roots are drawn with them: of few that are held one
    // comes late.
    for (int i = 0; i < 4000 && !is_answered && !is_found(); ++i) valley.round(valley.near);
    if (is_found()) break;
    ASSERT_TRUE(is_answered);
    valley.round(valley.near);  // takes that in
    valley.time_s += 20;
    for (int i = 0; i < 3; ++i) valley.round(valley.far);
    ASSERT_EQ(valley.session->stats().held_splits, 0U);
  }
  EXPECT_TRUE(is_found());
  EXPECT_GE(visits, 2);
  EXPECT_LT(visits, 8);
}

}  // namespace
}  // namespace nearmesh::test
