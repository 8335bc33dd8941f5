// SPDX-License-Identifier: Apache-2.0
// A recorder that comes is told what is held: once, when it is all taken in.
#include "world.hpp"

namespace nearmesh {
namespace {

using namespace test;

const wire::HeldDetail* told_of(const World& world, const ServedModel& model) {
  const wire::HeldDetail* found = nullptr;
  for (const wire::HeldDetail& held : world.bus.held)
    if (held.content_hash == model.open().content_hash()) found = &held;
  return found;
}

TEST(HeldDetail, IsToldOnceToEachRecorderAndToNobodyElse) {
  World world;
  world.start_publisher();
  const auto session = world.make_peer();
  const Flight flight = make_flight(1);
  EXPECT_EQ(world.fly(*session, flight, 0, 8), 8U);
  EXPECT_TRUE(world.bus.held.empty());

  world.bus.bring_recorder();
  world.bus.reports.clear();
  world.round(*session, 8, {{kOne, flight.one[8]}, {kTwo, flight.two[8]}});
  ASSERT_EQ(world.bus.held.size(), 2U);
  const wire::HeldDetail* ground = told_of(world, terrain());
  ASSERT_NE(ground, nullptr);
  EXPECT_EQ(ground->model, "terrain");
  EXPECT_EQ(ground->peer, kPeer);
  EXPECT_GT(ground->applied_batches, 0U);
  EXPECT_GT(ground->last_request, 0U);
  ASSERT_EQ(ground->heard.size(), 1U);
  EXPECT_EQ(ground->heard[0].publisher, kPublisher);
  EXPECT_EQ(ground->heard[0].sequence, session->stats().batches);
  // The same as the report of that moment says.
  const wire::ContactReport& report = world.bus.reports.front();
  ASSERT_EQ(report.a.content_hash, ground->content_hash);
  EXPECT_EQ(report.a.state_digest, ground->state_digest);
  EXPECT_EQ(report.a.applied_batches, ground->applied_batches);

  EXPECT_EQ(world.fly(*session, flight, 9, 12), 3U);
  EXPECT_EQ(world.bus.held.size(), 2U);
  const std::uint32_t before = ground->applied_batches;
  world.bus.bring_recorder();
  EXPECT_EQ(world.fly(*session, flight, 12, 20), 8U);
  EXPECT_EQ(world.bus.held.size(), 4U);
  EXPECT_GE(told_of(world, terrain())->applied_batches, before);
}

TEST(HeldDetail, IsNotToldWhileBatchesWait) {
  World world;
  world.start_publisher();
  const auto session = world.make_peer();
  const Flight flight = make_flight(1);
  EXPECT_EQ(world.fly(*session, flight, 0, 4), 4U);
  // Five batches of the terrain at once, of which an update without a budget takes in one; that
  // they are none is no matter.
  for (std::uint32_t i = 1; i <= 5; ++i)
    world.bus.inject(kPeer, {.publisher = kPublisher,
                             .content_hash = terrain().open().content_hash(),
                             .request = 1,
                             .sequence = 1000 + i,
                             .bytes = {1, 2, 3}});
  world.bus.bring_recorder();
  for (std::uint32_t left = 4; left > 0; --left) {
    EXPECT_EQ(world.round(*session, 4, {}, 0).batches_waiting, left);
    EXPECT_NE(told_of(world, aircraft()), nullptr);
    EXPECT_EQ(told_of(world, terrain()), nullptr);
  }
  EXPECT_EQ(world.round(*session, 4, {}, 0).batches_waiting, 0U);
  ASSERT_NE(told_of(world, terrain()), nullptr);
  EXPECT_EQ(told_of(world, terrain())->heard[0].sequence, 1005U);
}

TEST(HeldDetail, OfAModelThatComesLaterIsToldFromItsBegin) {
  World world;
  const auto session = world.make_peer();
  world.bus.bring_recorder();
  world.round(*session);
  EXPECT_TRUE(world.bus.held.empty());
  world.start_publisher();
  world.round(*session);
  ASSERT_EQ(world.bus.held.size(), 2U);
  for (const wire::HeldDetail& held : world.bus.held) EXPECT_EQ(held.applied_batches, 0U);
}

}  // namespace
}  // namespace nearmesh
