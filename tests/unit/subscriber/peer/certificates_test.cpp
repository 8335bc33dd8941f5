// SPDX-License-Identifier: Apache-2.0
// How a session has a publisher choose what certifies its answers, and what it does where that
// publisher cannot.
#include "core/certificate/mirror.hpp"
#include "core/certificate/spare_splits.hpp"
#include "core/demand/answer.hpp"
#include "nearmesh/core/spm/detail/codec.hpp"
#include "subscriber/peer/detail_cache.hpp"
#include "tests/support/folder.hpp"
#include "world.hpp"

namespace nearmesh {
namespace {

using subscriber::SessionOptions;
using test::Flight;
using test::kPublisher;
using test::make_flight;
using test::World;

/// Counts what is asked and what is answered.
struct Desk {
  World world;
  std::size_t wants_held = 0, wants_regions = 0;

  Desk() {
    world.bus.batch_filter = [this](wire::SessionId, wire::SplitBatchMessage& message) {
      wants_held += message.wants_held ? 1 : 0;
      wants_regions += message.wants_regions ? 1 : 0;
      return true;
    };
  }
  [[nodiscard]] std::size_t asked_regions() const {
    return count([](const wire::RegionSubscription& asked) { return !asked.certificate; });
  }
  [[nodiscard]] std::size_t asked_certificates() const {
    return count(
        [](const wire::RegionSubscription& asked) { return asked.certificate.has_value(); });
  }
  [[nodiscard]] std::size_t told_held() const {
    return count([](const wire::RegionSubscription& asked) {
      return asked.certificate &&
             std::any_of(asked.certificate->models.begin(), asked.certificate->models.end(),
                         [](const auto& model) { return !model.held.empty(); });
    });
  }

 private:
  template <class Is>
  [[nodiscard]] std::size_t count(const Is& is) const {
    return static_cast<std::size_t>(
        std::count_if(world.bus.subscriptions.begin(), world.bus.subscriptions.end(),
                      [&](const auto& asked) { return asked.request > 0 && is(asked); }));
  }
};

TEST(Certificates, OneRequestCertifiesAllPairsOfAFrame) {
  Desk desk;
  desk.world.start_publisher();
  const auto session = desk.world.make_peer();
  const Flight flight = make_flight(3);
  EXPECT_EQ(desk.world.fly(*session, flight, 0, 1), 1U);
  EXPECT_EQ(desk.asked_certificates(), 1U);
  EXPECT_GE(desk.world.bus.subscriptions.front().certificate->pairs.size(), 2U);
  EXPECT_EQ(desk.asked_regions(), 0U);
}

// A request has room for 16 models. Of 30 that lie in a heap, the pairs behind the first that has
// no place may need no other.
TEST(Certificates, PairsWhoseModelsAreAskedForGoAlong) {
  constexpr std::size_t kBodies = 30;
  test::MemoryBus bus;
  const auto channel = bus.make_publisher(kPublisher);
  publisher::Service service(*channel, kPublisher);
  std::vector<std::unique_ptr<test::TempFile>> files;
  subscriber::Session session(bus.make_peer(test::kPeer), {.request_timeout_s = 3600});
  std::vector<subscriber::Session::OwnMotion> motions;
  Random random(5);
  for (std::size_t i = 0; i < kBodies; ++i) {
    const std::string name = "ball" + std::to_string(i);
    IndexedMesh ball = generate_sphere(12, 1);
    for (auto& position_m : ball.positions_m) position_m[2] *= 1 + 0.01 * static_cast<double>(i);
    files.push_back(test::write_model(test::bake_mesh(ball, 16)));
    ASSERT_TRUE(service.add_model(name, ModelFile::open(files.back()->path()).value()).is_ok());
    auto& [body, motion] = motions.emplace_back();
    body = session.add_body({.name = name, .model = name, .own = true}).value();
    for (double& x : motion.pose.translation_m) x = random.between(-3, 3);
  }
  service.announce();
  session.watch_all();
  bool is_certified = false;
  for (std::uint64_t i = 0; i < 400 && !is_certified; ++i) {
    bus.tick();
    service.step(static_cast<double>(i) * 0.05);
    const auto report = session.update(i, 0, motions, 10);
    ASSERT_TRUE(report.is_ok()) << report.status().message();
    is_certified = report.value().all_certified();
  }
  EXPECT_TRUE(is_certified);
  const auto requests = std::count_if(bus.subscriptions.begin(), bus.subscriptions.end(),
                                      [](const auto& asked) { return asked.request > 0; });
  EXPECT_LE(requests, 5) << "with those up to the first that has no place alone it takes 7";
}

TEST(Certificates, NothingIsToldThatThePublisherKnows) {
  Desk desk;
  desk.world.start_publisher();
  const auto session = desk.world.make_peer();
  const Flight flight = make_flight(3);
  EXPECT_EQ(desk.world.fly(*session, flight), flight.frames());
  EXPECT_GT(desk.asked_certificates(), 3U);
  EXPECT_EQ(desk.told_held(), 0U);
  EXPECT_EQ(desk.wants_held, 0U);
  EXPECT_EQ(desk.asked_regions(), 0U);
}

TEST(Certificates, DetailThatWasGivenUpIsToldWithTheNextRequest) {
  Desk desk;
  desk.world.start_publisher();
  SessionOptions options = test::quick_options();
  options.max_held_splits = 100;
  const auto session = desk.world.make_peer(options);
  const Flight flight = make_flight(3);
  EXPECT_EQ(desk.world.fly(*session, flight), flight.frames());
  EXPECT_GT(desk.told_held(), 0U);
  EXPECT_EQ(desk.wants_held, 0U) << "a round trip";
  EXPECT_EQ(desk.asked_regions(), 0U);
}

TEST(Certificates, AnotherPublisherIsToldAtOnce) {
  Desk desk;
  desk.world.start_publisher();
  const auto session = desk.world.make_peer();
  const Flight flight = make_flight(3);
  EXPECT_EQ(desk.world.fly(*session, flight, 0, 20), 20U);
  desk.world.stop_publisher();
  desk.world.start_publisher(0xa2);
  EXPECT_EQ(desk.world.fly(*session, flight, 20, 40), 20U);
  EXPECT_EQ(desk.told_held(), 1U);
  EXPECT_EQ(desk.wants_held, 0U);
}

// A publisher refuses a longer word, so it is not told.
TEST(Certificates, WhoHoldsMoreThanPublishersListenToNamesWhatItLacks) {
  const BakedModel ground = test::bake_mesh(generate_terrain(520, 7), 64);
  const auto file = test::write_model(ground);
  const ContentHash content = ModelFile::open(file->path()).value().content_hash();
  // All but one of the last splits is held, out of a cache, and one body is where that is.
  std::vector<VertexId> held = test::all_splits(ground.store);
  const auto last = std::find_if(held.rbegin(), held.rend(), [&](VertexId split) {
    return ground.store.node_of(split).size == 2;
  });
  ASSERT_NE(last, held.rend());
  Motion there;
  there.pose.translation_m = test::position_m(ground.header, ground.store, *last);
  held.erase(std::next(last).base());
  ASSERT_GT(held.size(), MirrorMaker::kMostHeld);
  std::sort(held.begin(), held.end());
  subscriber::Batches batches = encode_batches(
      ground.header, ground.store, treelet_of(ground.store, held), BoxPolicy::kCutNodes);
  for (std::vector<std::uint8_t>& batch : batches) seal_batch(content, batch);
  const test::Folder folder;
  ASSERT_TRUE(subscriber::write_cached(folder.path(), content, batches).is_ok());

  test::MemoryBus bus;
  const auto channel = bus.make_publisher(kPublisher);
  publisher::Service service(*channel, kPublisher);
  ASSERT_TRUE(service.add_model("ground", ModelFile::open(file->path()).value()).is_ok());
  ASSERT_TRUE(service.add_model("aircraft", test::aircraft().open()).is_ok());
  service.announce();
  subscriber::Session session(bus.make_peer(test::kPeer), {.cache_folder = folder.path()});
  const auto at = session.add_body({.name = "ground", .model = "ground"}).value(),
             own = session.add_body({.name = "own", .model = "aircraft", .own = true}).value();
  ASSERT_TRUE(session.place_body(at, {}).is_ok());
  ASSERT_TRUE(session.watch(at, own).is_ok());
  bool is_certified = false;
  for (std::uint64_t i = 0; i < 100 && !is_certified; ++i) {
    bus.tick();
    service.step(static_cast<double>(i) * 0.05);
    const auto report = session.update(i, 0, {{own, there}}, 10);
    ASSERT_TRUE(report.is_ok()) << report.status().message();
    is_certified = report.value().all_certified();
  }
  EXPECT_TRUE(is_certified);
  std::size_t regions = 0;
  for (const wire::RegionSubscription& asked : bus.subscriptions) {
    EXPECT_FALSE(asked.certificate) << "request " << asked.request;
    regions += asked.request > 0 ? 1 : 0;
  }
  EXPECT_GT(regions, 0U);
}

// Half-spaces are held, too, and a state that is not known costs a round trip.
TEST(Certificates, AnotherPublisherIsToldAtOnceOfHalfSpacesAlone) {
  Random random(5);
  int found = 0;
  for (int i = 0; i < 60; ++i) {
    Desk desk;
    desk.world.start_publisher();
    subscriber::Session session(desk.world.bus.make_peer(test::kPeer), test::quick_options());
    ASSERT_EQ(session.add_body({.name = "ground", .model = "terrain"}).value(), test::kGround);
    ASSERT_TRUE(session.place_body(test::kGround, {}).is_ok());
    const auto one = session.add_body({.name = "one", .model = "aircraft", .own = true}).value();
    ASSERT_TRUE(session.watch(test::kGround, one).is_ok());
    const BakedModel& ground = test::terrain().model;
    Motion motion;
    motion.pose.rotation = test::random_rotation(random);
    motion.pose.translation_m =
        test::position_m(ground.header, ground.store, {random.below(ground.header.vertex_count)});
    const double height_m = random.between(35, 60);
    motion.pose.translation_m[2] += height_m;
    ASSERT_TRUE(desk.world.fly_frame(session, 0, {{one, motion}}));
    if (desk.asked_certificates() == 0 || session.stats().held_splits > 0) continue;
    ++found;
    desk.world.stop_publisher();
    desk.world.start_publisher(0xa2);
    motion.pose.translation_m[2] -= height_m;
    EXPECT_TRUE(desk.world.fly_frame(session, 1, {{one, motion}}));
    EXPECT_EQ(desk.told_held(), 1U);
    EXPECT_EQ(desk.wants_held, 0U);
  }
  EXPECT_GT(found, 0);
}

TEST(Certificates, APublisherThatForgotAsksOnceWhatIsHeld) {
  Desk desk;
  desk.world.start_publisher();
  const auto session = desk.world.make_peer();
  const Flight flight = make_flight(3);
  EXPECT_EQ(desk.world.fly(*session, flight, 0, 20), 20U);
  desk.world.bus.keep_quiet = true;
  desk.world.stop_publisher();
  desk.world.start_publisher();  // as if nothing had been
  EXPECT_EQ(desk.world.fly(*session, flight, 20, 40), 20U);
  EXPECT_EQ(desk.wants_held, 1U);
  EXPECT_EQ(desk.told_held(), 1U);
  EXPECT_EQ(desk.asked_regions(), 0U);
}

TEST(Certificates, APublisherThatNeverRemembersIsAskedForRegions) {
  Desk desk;
  desk.world.start_publisher();
  std::uint32_t last = 0;
  desk.world.bus.batch_filter = [&](wire::SessionId, wire::SplitBatchMessage& message) {
    const auto& asked = desk.world.bus.subscriptions;
    const auto at = std::find_if(asked.rbegin(), asked.rend(),
                                 [&](const auto& each) { return each.request == message.request; });
    if (at == asked.rend() || !at->certificate) return true;
    message.bytes.clear();
    message.refused = message.wants_held = message.last = true;
    message.content_hash = at->certificate->models.front().content;
    return std::exchange(last, message.request) != message.request;
  };
  const auto session = desk.world.make_peer();
  const Flight flight = make_flight(3);
  EXPECT_EQ(desk.world.fly(*session, flight), flight.frames());
  EXPECT_GT(desk.asked_regions(), 0U);
  EXPECT_LE(desk.asked_certificates(), 4U) << "two for each content";
}

// It chooses for all others as before.
TEST(Certificates, RegionsAreAskedForOfTheContentThatThePublisherDoesNotChooseFor) {
  Desk desk;
  desk.world.start_publisher();
  const ModelFile ground = test::terrain().open();
  desk.world.service().add_answerer(
      ground.content_hash(),
      [&ground](const RegionRequest& request) -> Result<publisher::Service::Parts> {
        auto batches = answer_request(test::terrain().model.header, test::terrain().model.store,
                                      request, [](NodeSpan) { return Status::ok(); });
        NEARMESH_RETURN_IF_ERROR(batches);
        return publisher::Service::Parts(
            [whole = std::move(batches).value(),
             content = ground.content_hash()]() mutable -> Result<publisher::Service::Part> {
              return publisher::Service::Part{content, std::move(whole), true};
            });
      });
  const auto session = desk.world.make_peer();
  for (std::uint64_t seed = 1; seed <= 5; ++seed)
    EXPECT_EQ(desk.world.fly(*session, make_flight(seed)), 40U);
  EXPECT_EQ(desk.wants_regions, 1U);
  EXPECT_GT(desk.asked_regions(), 0U);
  EXPECT_GT(desk.asked_certificates(), 1U) << "of the two aircraft";
}

TEST(Certificates, RegionsAreAskedForWhereNobodyServesBothModels) {
  Desk desk;
  desk.world.start_publisher_of("terrain", test::terrain(), kPublisher);
  desk.world.start_publisher_of("aircraft", test::aircraft(), 0xa2);
  const auto session = desk.world.make_peer();
  const Flight flight = make_flight(3);
  EXPECT_EQ(desk.world.fly(*session, flight), flight.frames());
  EXPECT_GT(desk.asked_regions(), 3U);
  EXPECT_EQ(desk.wants_regions, 0U) << "who serves what is known";
  EXPECT_EQ(desk.wants_held, 0U);
}

}  // namespace
}  // namespace nearmesh
