// SPDX-License-Identifier: Apache-2.0
// How a session has a publisher choose what certifies its answers, and what it does where that publisher cannot.
#include "core/demand/answer.hpp"
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
