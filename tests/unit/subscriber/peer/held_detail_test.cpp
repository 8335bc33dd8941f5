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
  EXPECT_GT(ground->applied_batches, 2U);
  EXPECT_GT(ground->last_request, 2U);
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
  world.bus.most_splits = 16384;  // answers of many batches
  world.start_publisher();
  const auto session = world.make_peer();
  const Flight flight = make_flight(1);
  std::uint64_t waiting = 0;
  // Without a budget one batch is taken in a frame.
  for (int i = 0; i < 200 && waiting < 3; ++i)
    waiting =
        world.round(*session, 0, {{kOne, flight.one[0]}, {kTwo, flight.two[0]}}, 0).batches_waiting;
  ASSERT_GE(waiting, 3U);
  world.bus.bring_recorder();
  FrameReport report = world.round(*session, 0, {}, 0);
  ASSERT_GT(report.batches_waiting, 0U);
  EXPECT_LT(world.bus.held.size(), 2U);
  for (int i = 0; i < 500 && world.bus.held.size() < 2; ++i) world.round(*session, 0, {}, 0);
  ASSERT_EQ(world.bus.held.size(), 2U);
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
