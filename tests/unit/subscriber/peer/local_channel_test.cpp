// SPDX-License-Identifier: Apache-2.0
// A session fed from files, as hosts' unit tests have it.

#include "local_host.hpp"

namespace nearmesh::test {
namespace {

TEST(LocalChannel, CertifiesAFlightWithoutNetworkOrClock) {
  const Flight flight = make_flight(3, 2);
  LocalHost host;
  host.spawn("one");
  host.spawn("two");
  ASSERT_TRUE(host.session->watch(kOne, kTwo).is_ok());
  for (std::size_t i = 0; i < flight.frames(); ++i)
    ASSERT_GT(host.settle({{kOne, flight.one[i]}, {kTwo, flight.two[i]}}), 0) << "frame " << i;
  EXPECT_GT(host.judge.contact, 0U);
  EXPECT_GT(host.judge.free, 0U);
  EXPECT_EQ(host.session->stats().sequence_gaps, 0U);
  EXPECT_LT(host.session->stats().batch_bytes, host.session->stats().mesh_bytes);
}

TEST(LocalChannel, TheSameCallsGiveTheSameAnswersInTheSameUpdates) {
  std::vector<std::uint64_t> digests[2];
  for (auto& seen : digests) {
    const Flight flight = make_flight(4, 1);
    LocalHost host;
    host.spawn("one");
    for (std::size_t i = 0; i < flight.frames(); ++i) {
      const FrameReport report = host.update({{kOne, flight.one[i]}});
      seen.push_back(report.state_digest);
      seen.push_back(report.answers_digest);
    }
  }
  EXPECT_EQ(digests[0], digests[1]);
}

TEST(LocalChannel, FirstAnswerIsUncertainForWantOfDetail) {
  LocalHost host;
  host.spawn("one");
  const FrameReport first = host.update({{kOne, above_ground(800, 0)}});
  EXPECT_TRUE(first.answers[0].asked);
  EXPECT_FALSE(first.all_certified());
  EXPECT_GT(host.settle(), 0);
}

TEST(LocalChannel, WithoutTimeItWorksInEachEighthCallAndSaysSoBefore) {
  LocalHost host;
  host.spawn("one");
  ASSERT_GT(host.settle({{kOne, above_ground(800, 0)}}), 0);
  // Elsewhere, and no time: what is lacking there is asked for, and waits.
  ASSERT_TRUE(host.session->update(1000, 0, {{kOne, above_ground(20, 0)}}, 0).is_ok());
  std::vector<int> steps;  // the calls that it announced
  bool came = false;
  for (int call = 1; !came && call <= 400; ++call) {
    const double needs_s = host.channel->needs_s();
    EXPECT_LE(needs_s, 3e-3);  // one step, however slow the machine
    if (needs_s > 0) steps.push_back(call);
    host.channel->allow(0);
    came = !host.channel->take().batches.empty();
    EXPECT_TRUE(!came || needs_s > 0) << "call " << call;
  }
  EXPECT_TRUE(came);
  for (std::size_t i = 0; i < steps.size(); ++i) EXPECT_EQ(steps[i], 8 * static_cast<int>(i + 1));
}

TEST(LocalChannel, DisconnectedBringsNothingAndSaysSo) {
  LocalHost host;
  host.spawn("one");
  host.channel->set_connected(false);
  const FrameReport alone = host.update({{kOne, above_ground(800, 0)}});
  EXPECT_NE(alone.answers[0].reason.find("no publisher found"), std::string::npos)
      << alone.answers[0].reason;
  host.channel->set_connected(true);
  ASSERT_GT(host.settle(), 0);

  host.channel->set_connected(false);
  for (int i = 0; i < 5; ++i)
    EXPECT_FALSE(host.update({{kOne, above_ground(20, 0)}}).all_certified());
  EXPECT_TRUE(host.update({{kOne, above_ground(800, 0)}}).all_certified());  // it knows that place
  EXPECT_FALSE(host.update({{kOne, above_ground(20, 0)}}).all_certified());
  host.channel->set_connected(true);
  EXPECT_GT(host.settle(), 0);
  EXPECT_EQ(host.session->stats().sequence_gaps, 0U);
}

TEST(LocalChannel, DeliversPosesOfOthersWhileConnected) {
  LocalHost host;
  const auto other = host.session->add_body({.name = "other", .model = "aircraft"});
  ASSERT_TRUE(other.is_ok());
  ASSERT_TRUE(host.session->watch(kGround, other.value()).is_ok());
  EXPECT_NE(host.update().answers[0].reason.find("no pose of body other"), std::string::npos);
  wire::BodyPose pose;
  pose.peer = 77;
  pose.body = "other";
  pose.pose = above_ground(800, 0).pose;
  host.channel->set_connected(false);
  ASSERT_TRUE(host.channel->deliver(pose).is_ok());
  host.channel->set_connected(true);
  EXPECT_FALSE(host.update().answers[0].asked);
  ASSERT_TRUE(host.channel->deliver(pose).is_ok());
  EXPECT_GT(host.settle(), 0);
  // Who moves it is out of reach with the publisher, and back with its next pose.
  host.channel->set_connected(false);
  EXPECT_EQ(host.update().answers[0].reason, "the peer that moves body other has left");
  host.channel->set_connected(true);
  EXPECT_FALSE(host.update().answers[0].asked);
  ASSERT_TRUE(host.channel->deliver(pose).is_ok());
  EXPECT_GT(host.settle(), 0);
  pose.pose.rotation[0] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(host.channel->deliver(pose).is_ok());
}

TEST(LocalChannel, RefusesNamesAndContentsThatAreTaken) {
  LocalChannel channel;
  ASSERT_TRUE(channel.add_model("terrain", terrain().open()).is_ok());
  EXPECT_EQ(channel.add_model("terrain", aircraft().open()).code(), StatusCode::kConflict);
  EXPECT_EQ(channel.add_model("ground", terrain().open()).code(), StatusCode::kConflict);
  EXPECT_EQ(channel.add_model("", aircraft().open()).code(), StatusCode::kInvalidArgument);
  EXPECT_EQ(channel.add_model(std::string(64, 'x'), aircraft().open()).code(),
            StatusCode::kInvalidArgument);
  EXPECT_TRUE(channel.add_model("aircraft", aircraft().open()).is_ok());
}

TEST(LocalChannel, RefusesARequestThatContradictsTheModel) {
  LocalChannel channel;
  ASSERT_TRUE(channel.add_model("terrain", terrain().open()).is_ok());
  static_cast<void>(channel.take());
  wire::RegionSubscription request;
  request.request = 1;
  request.content_hash = {0, 12345};
  channel.send(request);
  request.content_hash = terrain().open().content_hash();
  request.region.attach = {{VertexId{0}, 0xffffffff}};
  channel.send(request);
  const auto inbox = channel.take();
  ASSERT_EQ(inbox.batches.size(), 2U);
  for (const wire::SplitBatchMessage& batch : inbox.batches) {
    EXPECT_TRUE(batch.refused && batch.last);
    EXPECT_FALSE(batch.bytes.empty());
    EXPECT_TRUE(wire::check(batch).is_ok());
  }
}

}  // namespace
}  // namespace nearmesh::test
