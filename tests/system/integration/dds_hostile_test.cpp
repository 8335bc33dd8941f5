// SPDX-License-Identifier: Apache-2.0
// Both channels and hostile or mistaken programs; what an operator is told of them.

#include <limits>

#include "dds_channel_fixture.hpp"
#include "subscriber/dds/dds_monitor.hpp"

namespace nearmesh::test {
namespace {

struct HostileCase {
  const char* name;
  const char* expected;  ///< in the complaint
  std::function<void(RawType::Bytes&)> spoil;
};

// A subscription: 4 bytes of encapsulation, version, priority, -, request, peer, publisher, hash,
// acknowledged, window, max_splits; the count of attach words is at 56.
const std::vector<HostileCase> kHostile{
    {"OtherVersion", "wire version 200", [](RawType::Bytes& b) { b[4] = 200; }},
    {"HugeAttachCount", "contradict", [](RawType::Bytes& b) { b[59] = 0x7f; }},
    {"AttachCountBeyondBytes", "contradict", [](RawType::Bytes& b) { b[56] = 30; }},
    {"UnknownPriority", "priority", [](RawType::Bytes& b) { b[6] = 2; }},
    {"Truncated", "contradict", [](RawType::Bytes& b) { b.resize(b.size() - 5); }},
    {"Tiny", "too short", [](RawType::Bytes& b) { b.resize(4); }},
    {"ExtraBytes", "contradict", [](RawType::Bytes& b) { b.resize(b.size() + 100); }},
    {"OtherEncapsulation", "encapsulation", [](RawType::Bytes& b) { b[1] = 7; }},
    {"NoPeer", "peer", [](RawType::Bytes& b) { std::fill(b.begin() + 12, b.begin() + 20, 0); }},
};

class HostileSubscription : public testing::TestWithParam<HostileCase> {};

TEST_P(HostileSubscription, GivesOneComplaintAndTheNextArrives) {
  const std::string prefix = "test-" + std::to_string(getpid()) + "/hostile/" + GetParam().name;
  Server server(make_publisher(prefix));
  auto stranger = Stranger::of<wire::RegionSubscription>(prefix);
  ASSERT_TRUE(stranger.await_match());
  RawType::Bytes bad = bytes_of(request_of(9));
  GetParam().spoil(bad);
  stranger.write(bad);
  stranger.write(bytes_of(request_of(9, 55)));
  ASSERT_TRUE(server.await([&] { return !server.subscriptions.empty(); }));
  EXPECT_EQ(server.subscriptions.size(), 1U);
  EXPECT_EQ(server.subscriptions[0].region.max_splits, 55U);
  ASSERT_EQ(server.complaints.size(), 1U);
  EXPECT_NE(server.complaints[0].find(GetParam().expected), std::string::npos)
      << server.complaints[0];
}

INSTANTIATE_TEST_SUITE_P(DdsChannel, HostileSubscription, testing::ValuesIn(kHostile),
                         [](const auto& tested) { return std::string(tested.param.name); });

TEST(DdsChannel, StatusTellsWhetherAHostsParticipantHasADoor) {
  auto monitor = subscriber::DdsMonitor::create(transport(own_prefix()));
  ASSERT_TRUE(monitor.is_ok());
  for (const bool with_door : {false, true}) {
    fdds::DomainParticipant* host = make_participant(own_prefix(), with_door);
    ASSERT_NE(host, nullptr);
    {
      Peer peer(make_peer(own_prefix(), host));
      wire::ProcessStatus status;
      status.session = peer.channel->own_id();
      status.host = "rig";
      peer.channel->tell(status);
      EXPECT_EQ(status.has_door, with_door);
      bool told = !with_door;
      EXPECT_TRUE(wait_for([&] {
        monitor.value()->listen(0.01);
        for (const wire::ProcessStatus& one : monitor.value()->view().processes) {
          if (one.session != peer.channel->own_id()) continue;
          told = one.has_door;
          return true;
        }
        return false;
      }));
      EXPECT_EQ(told, with_door);
    }
    fdds::DomainParticipantFactory::get_instance()->delete_participant(host);
  }
}

TEST(DdsChannel, BodyStaysWithItsFirstMoverUntilThatIsGone) {
  Peer watcher(make_peer(own_prefix())), second(make_peer(own_prefix()));
  {
    Peer first(make_peer(own_prefix()));
    const wire::BodyPose own = pose_of(first.channel->own_id(), "arm", 1);
    say(*first.channel, own);
    ASSERT_TRUE(watcher.await_said(*first.channel, {own}));
    const Said other = said_of(pose_of(second.channel->own_id(), "arm", 2));
    second.channel->send(other.directory);
    SaysAgain says;
    ASSERT_TRUE(watcher.await([&](const Inbox& in) {
      if (says.is_due()) second.channel->send(other.poses);
      return !in.complaints.empty();
    }));
    EXPECT_NE(watcher.all.complaints[0].find("body arm"), std::string::npos);
    EXPECT_EQ(heard_in(watcher.all), Heard({{"arm", 1}}));
  }
  // What it said last counts then, though it says no more.
  ASSERT_TRUE(watcher.await([](const Inbox& in) { return heard_in(in).contains({"arm", 2}); }));
  EXPECT_EQ(watcher.all.complaints.size(), 1U);
}

TEST(DdsChannel, PosesCountOnceTheirMoversDirectoryNamesThem) {
  Peer watcher(make_peer(own_prefix())), mover(make_peer(own_prefix()));
  const auto said = said_of(pose_of(mover.channel->own_id(), "arm", 1));
  // Another participant's word does not count for it.
  Peer liar(make_peer(own_prefix()));
  liar.channel->send(said.directory);
  say(*mover.channel, pose_of(mover.channel->own_id(), "leg", 1));
  // Both of one writer, in this order: with the leg the arm has come.
  SaysAgain says;
  ASSERT_TRUE(watcher.await([&](const Inbox& in) {
    if (says.is_due()) {
      mover.channel->send(said.poses);
      mover.channel->send(said_of(pose_of(mover.channel->own_id(), "leg", 1)).poses);
    }
    return in.poses.size() >= 3;
  }));
  EXPECT_EQ(heard_in(watcher.all), Heard({{"leg", 1}}));
  mover.channel->send(said.directory);
  ASSERT_TRUE(watcher.await([](const Inbox& in) { return heard_in(in).contains({"arm", 1}); }));
  ASSERT_EQ(watcher.all.bodies.size(), 2U);
  EXPECT_EQ(watcher.all.bodies[1].body, said.directory.bodies[0]);
}

TEST(DdsChannel, ABodyThatItsMoverRemovesIsGoneAndItsNameIsFree) {
  Peer watcher(make_peer(own_prefix())), first(make_peer(own_prefix())),
      second(make_peer(own_prefix()));
  auto said = said_of(pose_of(first.channel->own_id(), "arm", 1));
  first.channel->send(said.directory);
  ASSERT_TRUE(watcher.await_said(*first.channel, {pose_of(first.channel->own_id(), "arm", 1)}));
  said.directory.bodies.clear();
  first.channel->send(said.directory);
  ASSERT_TRUE(watcher.await(
      [](const Inbox& in) { return !in.bodies.empty() && in.bodies.back().is_gone; }));
  EXPECT_EQ(watcher.all.movers.at("arm"), wire::Mover::kLeft);
  const wire::BodyPose next = pose_of(second.channel->own_id(), "arm", 2);
  say(*second.channel, next);
  ASSERT_TRUE(watcher.await_said(*second.channel, {next}));
  EXPECT_EQ(watcher.all.movers.at("arm"), wire::Mover::kThere);
  EXPECT_EQ(watcher.all.complaints.size(), 0U);
}

TEST(DdsChannel, BatchIsNotTakenBeforeThePeerCanHearIt) {
  Server server(make_publisher(own_prefix()));
  auto deaf = Stranger::of<wire::RegionSubscription>(own_prefix());
  ASSERT_TRUE(deaf.await_match());
  deaf.write(bytes_of(request_of(9)));
  ASSERT_TRUE(server.await([&] { return !server.subscriptions.empty(); }));
  EXPECT_FALSE(server.channel->send(9, batch_of(1, true)));
  EXPECT_FALSE(server.channel->send(10, batch_of(1, true)));  // unknown
}

TEST(DdsChannel, PoseThatIsNotFiniteGivesOneComplaint) {
  Peer peer(make_peer(own_prefix()));
  auto stranger = Stranger::of<wire::BodyPoses>(own_prefix());
  ASSERT_TRUE(stranger.await_match());
  wire::BodyPoses bad = said_of(pose_of(3, "arm", 1)).poses;
  bad.bodies[0].motion.pose.translation_m[1] = std::numeric_limits<double>::quiet_NaN();
  SaysAgain says;
  ASSERT_TRUE(peer.await([&](const Inbox& in) {
    if (says.is_due()) stranger.write(bytes_of(bad));
    return !in.complaints.empty();
  }));
  Peer mover(make_peer(own_prefix()));
  const wire::BodyPose leg = pose_of(mover.channel->own_id(), "leg", 2);
  say(*mover.channel, leg);
  ASSERT_TRUE(peer.await_said(*mover.channel, {leg})) << peer.story();
  EXPECT_EQ(peer.all.poses[0].body, "leg");
  ASSERT_EQ(peer.all.complaints.size(), 1U);
  EXPECT_NE(peer.all.complaints[0].find("pose of body "), std::string::npos)
      << peer.all.complaints[0];
}

TEST(DdsChannel, HelloOfAnotherVersionIsRefusedLoudly) {
  Peer peer(make_peer(own_prefix()));
  auto stranger = Stranger::of<wire::Hello>(own_prefix());
  RawType::Bytes bytes = bytes_of(hello_of(3));
  bytes[4] = wire::kWireVersion + 1;
  bytes.resize(17);
  stranger.write(bytes);
  ASSERT_TRUE(peer.await([](const Inbox& in) { return !in.complaints.empty(); }));
  EXPECT_NE(
      peer.all.complaints[0].find("wire version " + std::to_string(wire::kWireVersion + 1) +
                                  ", this build speaks " + std::to_string(wire::kWireVersion)),
      std::string::npos)
      << peer.all.complaints[0];
}

// Though it is the very header that a publisher announces: who serves nothing is not believed.
TEST(DdsChannel, HeaderOfWhoeverServesNothingDoesNotCount) {
  wire::MeshHeader header{.name = "bunny", .bytes = {1, 2, 3}};
  header.content_hash = digest_of(header.bytes);
  Peer peer(make_peer(own_prefix()));
  fdds::DataWriterQos qos = stranger_qos<wire::MeshHeader>();
  qos.publish_mode() = {};  // its participant has no flow controller
  auto stranger = Stranger::of<wire::MeshHeader>(own_prefix(), qos);
  ASSERT_TRUE(stranger.await_match());
  stranger.write(bytes_of(header));
  ASSERT_TRUE(peer.await([](const Inbox& in) { return in.refused_headers == 1; }));
  EXPECT_TRUE(peer.all.headers.empty());
  ASSERT_EQ(peer.all.complaints.size(), 1U);
  EXPECT_NE(peer.all.complaints[0].find("its participant announces no such content"),
            std::string::npos)
      << peer.all.complaints[0];
  Server server(make_publisher(own_prefix()));
  wire::Hello hello{.publisher = kChildPublisher};
  hello.models.push_back({"bunny", header.content_hash, 3});
  server.channel->announce(hello, {header});
  ASSERT_TRUE(peer.await([](const Inbox& in) { return !in.headers.empty(); })) << peer.story();
  EXPECT_EQ(peer.all.headers[0].publisher, kChildPublisher);
  EXPECT_EQ(peer.all.headers[0].message.bytes, header.bytes);
  EXPECT_EQ(peer.all.headers.size(), 1U);
  EXPECT_EQ(peer.all.refused_headers, 1U);
}

TEST(DdsChannel, HelloIsHeldBackWhileItsPublisherCannotHear) {
  Peer peer(make_peer(own_prefix()));
  auto deaf = Stranger::of<wire::Hello>(own_prefix());
  ASSERT_TRUE(deaf.await_match());
  deaf.write(bytes_of(hello_of(3)));
  // Two malformed samples mark the time: with the second complaint the hello has been taken too.
  deaf.write({0, 1, 0, 0, 9, 0});
  ASSERT_TRUE(peer.await([](const Inbox& in) { return in.complaints.size() == 1; }));
  deaf.write({0, 1, 0, 0, 8, 0});
  ASSERT_TRUE(peer.await([](const Inbox& in) { return in.complaints.size() == 2; }));
  EXPECT_TRUE(peer.all.hellos.empty());
}

TEST(DdsChannel, TopicOfAnotherVersionIsReported) {
  Peer peer(make_peer(own_prefix()));
  const std::string newer = std::to_string(wire::kWireVersion + 1);
  Stranger stranger(own_prefix(), own_prefix() + "/v" + newer + "/split_batch",
                    wire::topic_of<wire::SplitBatchMessage>().type, false,
                    stranger_qos<wire::SplitBatchMessage>());
  ASSERT_TRUE(peer.await([](const Inbox& in) { return !in.complaints.empty(); }));
  EXPECT_NE(peer.all.complaints[0].find("wire version " + newer), std::string::npos)
      << peer.all.complaints[0];
}

TEST(DdsChannel, OtherTypeOnOurTopicIsReported) {
  Server server(make_publisher(own_prefix()));
  Stranger stranger(own_prefix(), wire::TopicNames(own_prefix()).of<wire::RegionSubscription>(),
                    "Foreign", true, stranger_qos<wire::RegionSubscription>());
  ASSERT_TRUE(server.await([&] { return !server.complaints.empty(); }));
  EXPECT_NE(server.complaints[0].find("Foreign"), std::string::npos) << server.complaints[0];
}

TEST(DdsChannel, IncompatibleQosIsReportedByPolicy) {
  Server server(make_publisher(own_prefix()));
  fdds::DataWriterQos qos = stranger_qos<wire::RegionSubscription>();
  qos.reliability().kind = fdds::BEST_EFFORT_RELIABILITY_QOS;
  auto stranger = Stranger::of<wire::RegionSubscription>(own_prefix(), qos);
  ASSERT_TRUE(server.await([&] { return !server.complaints.empty(); }));
  EXPECT_NE(
      server.complaints[0].find("offers reliability best effort, this side requests reliable"),
      std::string::npos)
      << server.complaints[0];
  server.await([] { return false; }, 0.3);
  EXPECT_EQ(server.complaints.size(), 1U);
}

TEST(DdsChannel, IncompatibleDurabilityNamesBothSides) {
  Peer peer(make_peer(own_prefix()));
  fdds::DataWriterQos qos = stranger_qos<wire::Hello>();
  qos.durability().kind = fdds::VOLATILE_DURABILITY_QOS;
  auto stranger = Stranger::of<wire::Hello>(own_prefix(), qos);
  ASSERT_TRUE(peer.await([](const Inbox& in) { return !in.complaints.empty(); }));
  EXPECT_NE(
      peer.all.complaints[0].find("offers durability volatile, this side requests transient local"),
      std::string::npos)
      << peer.all.complaints[0];
}

// --- What an operator sees

TEST(DdsChannel, PublisherThatIsMatchedButSilentIsReported) {
  Peer peer(make_peer(own_prefix()));
  auto silent = Stranger::of<wire::Hello>(own_prefix());
  ASSERT_TRUE(peer.await([](const Inbox& in) { return !in.complaints.empty(); }));
  EXPECT_NE(peer.all.complaints[0].find("found and matched, but nothing comes"), std::string::npos)
      << peer.all.complaints[0];
  EXPECT_NE(peer.all.complaints[0].find("--transport lan"), std::string::npos);
}

TEST(DdsChannel, MonitorHearsStatusOfBothSidesAndForgetsWhoLeft) {
  auto monitor = subscriber::DdsMonitor::create(transport(own_prefix()));
  ASSERT_TRUE(monitor.is_ok()) << monitor.status().message();
  auto publisher = make_publisher(own_prefix());
  auto peer = make_peer(own_prefix());
  wire::ProcessStatus status;
  status.host = "here";
  status.session = 7;
  status.is_publisher = true;
  publisher->tell(status);
  status.session = 8;
  status.is_publisher = false;
  status.requests = 12;
  peer->tell(status);
  const auto sees = [&](std::size_t count) {
    return wait_for([&] {
      monitor.value()->listen(0.05);
      return monitor.value()->view().processes.size() == count;
    });
  };
  ASSERT_TRUE(sees(2));
  const auto processes = monitor.value()->view().processes;
  EXPECT_TRUE(processes[0].is_publisher);
  EXPECT_EQ(processes[1].requests, 12U);
  peer.reset();
  EXPECT_TRUE(sees(1));
  EXPECT_TRUE(monitor.value()->view().refusals.empty());
}

TEST(DdsChannel, MonitorShowsWhoSpokeFirstAsAProcessAndNamesWhoSpeaksAsItToo) {
  auto monitor = subscriber::DdsMonitor::create(transport(own_prefix()));
  ASSERT_TRUE(monitor.is_ok()) << monitor.status().message();
  std::vector<std::unique_ptr<PeerChannel>> peers;
  const auto shows = [&](const std::string& host, std::size_t errors) {
    return wait_for([&] {
      // One after the other: of a process a reader keeps what was said last.
      for (std::size_t i = 0; i < peers.size(); ++i) {
        wire::ProcessStatus status;
        status.session = 8;
        status.host = "rig " + std::to_string(i);
        if (peers[i]) peers[i]->tell(status);
        for (int k = 0; k < 3; ++k) monitor.value()->listen(0.02);
      }
      const subscriber::BusView view = monitor.value()->view();
      return view.processes.size() == 1 && view.processes[0].host == host &&
             view.errors.size() == errors;
    });
  };
  peers.push_back(make_peer(own_prefix()));
  ASSERT_TRUE(shows("rig 0", 0));
  // Of several, some come before the first by their number on the bus.
  for (int i = 0; i < 3; ++i) peers.push_back(make_peer(own_prefix()));
  ASSERT_TRUE(shows("rig 0", 1));
  EXPECT_NE(monitor.value()->view().errors[0].find("both say that they are it"), std::string::npos);
  peers.resize(1);
  EXPECT_TRUE(shows("rig 0", 0));
}

TEST(DdsChannel, MonitorTellsOfTwoContentsUnderOneNameAndOfTheSilent) {
  auto one = make_publisher(own_prefix()), other = make_publisher(own_prefix());
  wire::Hello hello = hello_of(kChildPublisher);
  one->announce(hello, {});
  hello.publisher = kChildPublisher + 1;
  ++hello.models[0].content_hash.low;
  other->announce(hello, {});
  auto silent = Stranger::of<wire::Hello>(own_prefix());
  auto monitor = subscriber::DdsMonitor::create(transport(own_prefix()));
  ASSERT_TRUE(monitor.is_ok()) << monitor.status().message();
  const auto says = [&](auto has) {
    return wait_for([&] {
      monitor.value()->listen(0.05);
      return has(monitor.value()->view());
    });
  };
  const auto is_error = [](const subscriber::BusView& view) { return view.errors.size() == 1; };
  ASSERT_TRUE(says(is_error));
  EXPECT_NE(monitor.value()->view().errors[0].find("model bunny: publisher "), std::string::npos);
  ASSERT_TRUE(says([](const subscriber::BusView& view) { return !view.refusals.empty(); }));
  EXPECT_NE(monitor.value()->view().refusals[0].find("nothing comes from it"), std::string::npos);
  EXPECT_EQ(monitor.value()->view().refusals.size(), 1U);
  // An act ends it: one says that it replaces the other.
  hello.models[0].replaces = kModel;
  other->announce(hello, {});
  EXPECT_TRUE(says([](const subscriber::BusView& view) { return view.errors.empty(); }));
}

}  // namespace
}  // namespace nearmesh::test
