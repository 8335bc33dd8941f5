// SPDX-License-Identifier: Apache-2.0
// How a session has a publisher choose what certifies its answers, and what it does where that publisher cannot.
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
  EXPECT_LE(desk.asked_certificates(), 2U);
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
