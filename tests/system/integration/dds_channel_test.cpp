// SPDX-License-Identifier: Apache-2.0
// Two processes, and two participants of one. This program is also its own helper: "--child
// publisher|peer|recorder PREFIX LEASE".

#include "dds_channel_fixture.hpp"
#include "nearmesh/core/recording/recording.hpp"
#include "subscriber/dds/dds_recorder.hpp"

namespace nearmesh::test {
namespace {

// --- Two processes

TEST(DdsChannel, BatchesComeBackInOrder) {
  const auto start = std::chrono::steady_clock::now();
  Child publisher("publisher", own_prefix());
  Peer peer(make_peer(own_prefix()));
  ASSERT_TRUE(peer.await([](const Inbox& in) { return !in.hellos.empty(); }));
  RecordProperty("match_ms", static_cast<int>(seconds_since(start) * 1000));
  EXPECT_EQ(peer.all.hellos[0].publisher, kChildPublisher);
  constexpr std::uint32_t kCount = 2000;
  peer.channel->send(request_of(peer.channel->own_id(), kCount));
  ASSERT_TRUE(peer.await([](const Inbox& in) { return in.batches.size() >= kCount; }))
      << peer.all.batches.size();
  for (std::uint32_t i = 0; i < kCount; ++i) {
    ASSERT_EQ(peer.all.batches[i].sequence, i + 1);
    ASSERT_EQ(peer.all.batches[i].bytes, batch_of(i + 1, false).bytes);
    ASSERT_EQ(peer.all.batches[i].last, i + 1 == kCount);
  }
  EXPECT_EQ(peer.all.complaints, std::vector<std::string>{});
}

TEST(DdsChannel, LateJoinerGetsHelloAndLargeHeader) {
  Child publisher("publisher", own_prefix());
  Peer early(make_peer(own_prefix()));
  ASSERT_TRUE(
      early.await([](const Inbox& in) { return !in.hellos.empty() && !in.headers.empty(); }));
  Peer late(make_peer(own_prefix()));
  ASSERT_TRUE(
      late.await([](const Inbox& in) { return !in.hellos.empty() && !in.headers.empty(); }));
  EXPECT_EQ(late.all.hellos[0].models[0].name, "bunny");
  EXPECT_EQ(late.all.headers[0].message.bytes, big_header().bytes);
}

TEST_F(DdsLease, KilledPublisherIsReportedLost) {
  Child publisher("publisher", own_prefix());
  Peer peer(make_peer(own_prefix()));
  ASSERT_TRUE(peer.await([](const Inbox& in) { return !in.hellos.empty(); }));
  publisher.end();
  ASSERT_TRUE(peer.await([](const Inbox& in) { return !in.lost_publishers.empty(); }));
  EXPECT_EQ(peer.all.lost_publishers, std::vector{kChildPublisher});
}

TEST_F(DdsLease, PublisherStoppedBeyondItsLeaseComesBack) {
  Child publisher("publisher", own_prefix());
  Peer peer(make_peer(own_prefix()));
  ASSERT_TRUE(
      peer.await([](const Inbox& in) { return !in.hellos.empty() && !in.headers.empty(); }));
  const auto has_batch = [](std::uint32_t sequence) {
    return [sequence](const Inbox& in) {
      return std::any_of(in.batches.begin(), in.batches.end(),
                         [&](const auto& batch) { return batch.sequence == sequence; });
    };
  };
  // As a host does: again after each hello, since what was asked before a loss is lost.
  const auto is_served = [&](std::uint32_t batches) {
    std::size_t answered_hellos = 0;
    return peer.await([&](const Inbox& in) {
      if (std::exchange(answered_hellos, in.hellos.size()) < in.hellos.size())
        peer.channel->send(request_of(peer.channel->own_id(), batches));
      return has_batch(batches)(in);
    });
  };
  ASSERT_TRUE(is_served(10)) << peer.story();
  publisher.signal(SIGSTOP);
  ASSERT_TRUE(peer.await([](const Inbox& in) { return !in.lost_publishers.empty(); }));
  publisher.signal(SIGCONT);
  ASSERT_TRUE(peer.await([](const Inbox& in) {
    return in.hellos.size() >= 2 && in.headers.size() >= 2;
  })) << peer.story();
  EXPECT_TRUE(is_served(15)) << peer.story();
}

TEST_F(DdsLease, PeerStoppedBeyondItsLeaseIsServedAgain) {
  Server server(make_publisher(own_prefix()));
  Child peer("peer", own_prefix());
  ASSERT_TRUE(server.await([&] { return !server.subscriptions.empty(); }));
  peer.signal(SIGSTOP);
  ASSERT_TRUE(server.await([&] { return !server.lost.empty(); }));
  server.subscriptions.clear();
  peer.signal(SIGCONT);
  ASSERT_TRUE(server.await([&] { return !server.subscriptions.empty(); }));
  EXPECT_TRUE(wait_for([&] { return server.channel->send(kChildPeer, batch_of(1, true)); }));
}

TEST_F(DdsLease, KilledPeerIsReportedLost) {
  Server server(make_publisher(own_prefix()));
  Child peer("peer", own_prefix());
  ASSERT_TRUE(server.await([&] { return !server.subscriptions.empty(); }));
  ASSERT_TRUE(wait_for([&] { return server.channel->send(kChildPeer, batch_of(1, true)); }));
  peer.end();
  ASSERT_TRUE(server.await([&] { return !server.lost.empty(); }));
  EXPECT_EQ(server.lost, std::vector{kChildPeer});
  EXPECT_FALSE(server.channel->send(kChildPeer, batch_of(2, true)));
}

// Fast DDS before 2.13 may wait for its own heartbeat for ever: see wire::drop_samples().
TEST(DdsChannel, PublisherWithUnacknowledgedBatchesEnds) {
  Child frozen("peer", own_prefix());
  publisher::DdsChannelOptions options;
  options.transport = transport(own_prefix());
  options.transport.heartbeat_s = 20e-6;
  for (int round = 0; round < 40; ++round) {
    auto channel = PublisherChannel::create(options);
    ASSERT_TRUE(channel.is_ok()) << channel.status().message();
    Server server(std::move(channel).value());
    ASSERT_TRUE(server.await([&] { return !server.subscriptions.empty(); }));
    ASSERT_TRUE(wait_for([&] { return server.channel->send(kChildPeer, batch_of(1, false)); }));
    frozen.signal(SIGSTOP);
    for (std::uint32_t batch = 2; batch < 100; ++batch)
      static_cast<void>(server.channel->send(kChildPeer, batch_of(batch, false)));
    server.channel.reset();
    frozen.signal(SIGCONT);
  }
}

TEST_F(DdsLease, FrozenPeerStallsNobodyElse) {
  Server server(make_publisher(own_prefix()));
  server.channel->announce(hello_of(kChildPublisher), {});
  Child frozen("peer", own_prefix());
  Peer healthy(make_peer(own_prefix()));
  ASSERT_TRUE(healthy.await([](const Inbox& in) { return !in.hellos.empty(); }));
  healthy.channel->send(request_of(healthy.channel->own_id()));
  const auto heard = [&](wire::SessionId peer) {
    return std::any_of(server.subscriptions.begin(), server.subscriptions.end(),
                       [&](const auto& s) { return s.peer == peer; });
  };
  ASSERT_TRUE(server.await([&] { return heard(kChildPeer) && heard(healthy.channel->own_id()); }));
  ASSERT_TRUE(wait_for([&] { return server.channel->send(kChildPeer, batch_of(1, false)); }));
  frozen.signal(SIGSTOP);
  // Until its lease is over the frozen peer takes what fits its history, and then no more.
  std::uint32_t taken = 1;
  const auto fill = [&] {
    while (taken < 1000 && server.channel->send(kChildPeer, batch_of(taken + 1, false))) ++taken;
  };
  constexpr std::uint32_t kCount = 600;
  for (std::uint32_t i = 1; i <= kCount; ++i) {
    ASSERT_TRUE(wait_for([&] {
      fill();
      return server.channel->send(healthy.channel->own_id(), batch_of(i, i == kCount));
    }));
  }
  ASSERT_TRUE(healthy.await([](const Inbox& in) { return in.batches.size() == kCount; }));
  EXPECT_LT(taken, 1000U);
  ASSERT_TRUE(server.await([&] { return !server.lost.empty(); }));
  EXPECT_EQ(server.lost, std::vector{kChildPeer});
}

TEST(DdsChannel, RecorderHearsEveryPeerAndFrozenStallsNobody) {
  // What is sent to others is taken before it is over, also where all is held up.
  const Lease lease(60);
  const std::string path = recording_of(own_prefix());
  Child recorder("recorder", own_prefix());
  // Its file has all tables before it is on the bus.
  ASSERT_TRUE(wait_for([&] { return RecordingReader::open(path).is_ok(); }));
  Server server(make_publisher(own_prefix()));
  server.channel->announce(hello_of(kChildPublisher), {});
  const auto hears_publisher = [&] {
    return RecordingReader::open(path).value()->message_count() > 0;
  };
  ASSERT_TRUE(wait_for(hears_publisher));
  Peer peer(make_peer(own_prefix()));
  ASSERT_TRUE(peer.await([](const Inbox& in) { return !in.hellos.empty(); }));
  peer.channel->send(request_of(peer.channel->own_id()));
  ASSERT_TRUE(server.await([&] { return !server.subscriptions.empty(); }));
  const auto stream = [&](std::uint32_t first, std::uint32_t count) {
    for (std::uint32_t i = first; i < first + count; ++i)
      ASSERT_TRUE(
          wait_for([&] { return server.channel->send(peer.channel->own_id(), batch_of(i, false)); },
                   0.8 * lease_s))
          << i;
    ASSERT_TRUE(
        peer.await([&](const Inbox& in) { return in.batches.size() == first + count - 1; }));
  };
  stream(1, 20);
  // All of them, from the first on, although the writer was made a moment before.
  const auto recorded = [&](const std::string& partition) {
    const auto reader = RecordingReader::open(path).value();
    std::uint64_t batches = 0;
    EXPECT_TRUE(reader
                    ->read(1, reader->message_count() + 1,
                           [&](std::int64_t, const RecordedMessage& message) {
                             const auto& writer = reader->writers()[message.writer];
                             batches += writer.partition == partition ? 1 : 0;
                             return true;
                           })
                    .is_ok());
    return batches;
  };
  const std::string own = wire::partition_of(peer.channel->own_id());
  EXPECT_TRUE(wait_for([&] { return recorded(own) == 20; })) << recorded(own);
  // For whoever else comes, too.
  for (wire::SessionId other = 1; other <= 8; ++other) {
    Peer guest(make_peer(own_prefix(), nullptr, other));
    ASSERT_TRUE(guest.await([](const Inbox& in) { return !in.hellos.empty(); }));
    guest.channel->send(request_of(other));
    ASSERT_TRUE(wait_for([&] {
      (void)server.channel->take();
      return server.channel->send(other, batch_of(1, true));
    }));
    ASSERT_TRUE(guest.await([](const Inbox& in) { return !in.batches.empty(); }));
    EXPECT_TRUE(wait_for([&] { return recorded(wire::partition_of(other)) == 1; })) << other;
  }
  // Several times what the writer keeps, before anybody misses the recorder.
  recorder.signal(SIGSTOP);
  stream(21, 1500);
  recorder.end();
  for (const char* suffix : {"", "-wal", "-shm"}) std::remove((path + suffix).c_str());
}

// --- Two participants

TEST(DdsChannel, LeavingPeerAndPublisherAreReportedAtOnce) {
  const Lease lease(120);  // at once: in less than half of it, where all is held up too
  Server server(make_publisher(own_prefix()));
  server.channel->announce(hello_of(7), {});
  Peer watcher(make_peer(own_prefix()));
  ASSERT_TRUE(watcher.await([](const Inbox& in) { return !in.hellos.empty(); }));
  {
    Peer leaver(make_peer(own_prefix(), nullptr, 5));
    leaver.channel->send(request_of(5, 1, 7));
    ASSERT_TRUE(server.await([&] { return !server.subscriptions.empty(); }));
    const auto start = std::chrono::steady_clock::now();
    leaver.channel.reset();
    EXPECT_LT(seconds_since(start), lease_s / 2);
  }
  ASSERT_TRUE(server.await([&] { return !server.lost.empty(); }, lease_s / 2));
  EXPECT_EQ(server.lost, std::vector<wire::SessionId>{5});
  server.channel.reset();
  EXPECT_TRUE(
      watcher.await([](const Inbox& in) { return !in.lost_publishers.empty(); }, lease_s / 2));
}

TEST(DdsChannel, SubscriptionSentBeforeAPublisherExistsArrives) {
  Peer peer(make_peer(own_prefix()));
  peer.channel->send(request_of(peer.channel->own_id(), 77));
  Server server(make_publisher(own_prefix()));
  ASSERT_TRUE(server.await([&] { return !server.subscriptions.empty(); }));
  EXPECT_EQ(server.subscriptions[0].region.max_splits, 77U);
  EXPECT_EQ(server.subscriptions[0].region.attach, request_of(1).region.attach);
}

// Whether or not the host takes them.
TEST(DdsChannel, BatchesAreAcknowledgedAsTheyCome) {
  Server server(make_publisher(own_prefix()));
  server.channel->announce(hello_of(kChildPublisher), {});
  Peer peer(make_peer(own_prefix()));
  ASSERT_TRUE(peer.await([](const Inbox& in) { return !in.hellos.empty(); }));
  wire::RegionSubscription request = request_of(peer.channel->own_id());
  request.window_bytes = 12345;
  peer.channel->send(request);
  ASSERT_TRUE(server.await([&] { return !server.subscriptions.empty(); }));
  for (std::uint32_t sequence = 1; sequence <= 3; ++sequence) {
    const wire::SplitBatchMessage batch = batch_of(sequence, false);
    ASSERT_TRUE(wait_for([&] { return server.channel->send(peer.channel->own_id(), batch); }));
  }
  ASSERT_TRUE(server.await([&] { return server.subscriptions.back().acknowledged_sequence == 3; }));
  EXPECT_EQ(server.subscriptions.back().request, 0U);
  EXPECT_EQ(server.subscriptions.back().window_bytes, 12345U);
}

// A host that takes nothing for a while loses nothing of one publisher because another sends much.
TEST(DdsChannel, BatchesOfOnePublisherTakeNoPlaceOfAnothers) {
  constexpr wire::SessionId kMuch = kChildPublisher + 1;
  Server server(make_publisher(own_prefix())), much(make_publisher(own_prefix()));
  server.channel->announce(hello_of(kChildPublisher), {});
  much.channel->announce(hello_of(kMuch), {});
  Peer peer(make_peer(own_prefix()));
  ASSERT_TRUE(peer.await([](const Inbox& in) { return in.hellos.size() == 2; }));
  peer.channel->send(request_of(peer.channel->own_id()));
  peer.channel->send(request_of(peer.channel->own_id(), 1, kMuch));
  ASSERT_TRUE(server.await([&] { return !server.subscriptions.empty(); }));
  ASSERT_TRUE(much.await([&] { return !much.subscriptions.empty(); }));
  const auto send = [&](Server& from, const wire::SplitBatchMessage& batch) {
    return wait_for([&] { return from.channel->send(peer.channel->own_id(), batch); });
  };
  const auto await_acknowledged = [](Server& from, std::uint32_t sequence) {
    return from.await([&] { return from.subscriptions.back().acknowledged_sequence == sequence; });
  };
  wire::SplitBatchMessage batch = batch_of(0, false);
  batch.publisher = kMuch;
  batch.bytes.resize(100);
  constexpr std::uint32_t kCount = PeerChannel::kMaxWaitingBatches + 100;
  while (batch.sequence < kCount) {
    ++batch.sequence;
    ASSERT_TRUE(send(much, batch)) << batch.sequence;
  }
  ASSERT_TRUE(await_acknowledged(much, kCount));
  ASSERT_TRUE(send(server, batch_of(1, true)));
  ASSERT_TRUE(await_acknowledged(server, 1));
  const Inbox& inbox = peer.collect();
  ASSERT_EQ(inbox.batches.size(), PeerChannel::kMaxWaitingBatches + 1);
  EXPECT_EQ(inbox.batches.back().publisher, kChildPublisher);
}

TEST(DdsChannel, LargestSubscriptionArrives) {
  Peer peer(make_peer(own_prefix()));
  Server server(make_publisher(own_prefix()));
  wire::RegionSubscription largest = request_of(peer.channel->own_id());
  largest.region.attach.clear();
  for (std::uint32_t i = 0; i < kMaxAttachNodes; ++i)
    largest.region.attach.push_back({VertexId{2 * i}, 2});
  largest.region.region.assign(kMaxRegionBoxes, largest.region.region[0]);
  peer.channel->send(largest);
  ASSERT_TRUE(server.await([&] { return !server.subscriptions.empty(); }));
  EXPECT_EQ(server.subscriptions[0].region.attach, largest.region.attach);
  EXPECT_EQ(server.subscriptions[0].region.region, largest.region.region);
}

TEST(DdsChannel, RequestAfterHelloReachesASecondPublisherToo) {
  Server first(make_publisher(own_prefix()));
  first.channel->announce(hello_of(7), {});
  Peer peer(make_peer(own_prefix()));
  ASSERT_TRUE(peer.await([](const Inbox& in) { return in.hellos.size() == 1; }));
  Server second(make_publisher(own_prefix()));
  second.channel->announce(hello_of(8), {});
  ASSERT_TRUE(peer.await([](const Inbox& in) { return in.hellos.size() == 2; }));
  peer.channel->send(request_of(peer.channel->own_id(), 1, 8));
  peer.channel->send(request_of(peer.channel->own_id(), 2, 7));
  EXPECT_TRUE(second.await([&] { return !second.subscriptions.empty(); }));
  ASSERT_TRUE(first.await([&] { return !first.subscriptions.empty(); }));
  EXPECT_EQ(first.subscriptions[0].publisher, 7U);  // the other was not for it
}

TEST(DdsChannel, NamedPeersAreLookedForBesideMulticast) {
  subscriber::DdsChannelOptions options;
  options.transport = transport(own_prefix());
  options.transport.initial_peers = {"127.0.0.1"};
  auto channel = PeerChannel::create(options);
  ASSERT_TRUE(channel.is_ok()) << channel.status().message();
  Peer peer(std::move(channel).value());
  Server server(make_publisher(own_prefix()));
  server.channel->announce(hello_of(7), {});
  EXPECT_TRUE(peer.await([](const Inbox& in) { return !in.hellos.empty(); }));
  options.transport.initial_peers = {"nowhere"};
  EXPECT_EQ(PeerChannel::create(options).status().code(), StatusCode::kInvalidArgument);
}

TEST(DdsChannel, PosesReachOthersButNotTheirSender) {
  Peer mover(make_peer(own_prefix()));
  const wire::BodyPose arm = pose_of(mover.channel->own_id(), "arm", 1);
  say(*mover.channel, arm);
  Peer late(make_peer(own_prefix()));
  ASSERT_TRUE(late.await_said(*mover.channel, {arm}));
  const wire::BodyPose leg = pose_of(late.channel->own_id(), "leg", 2);
  say(*late.channel, leg);
  ASSERT_TRUE(mover.await_said(*late.channel, {leg}));
  EXPECT_EQ(heard_in(late.collect()), Heard({{"arm", 1}}));
  EXPECT_EQ(heard_in(mover.collect()), Heard({{"leg", 2}}));
}

// What is kept of it would make ever larger the gap that late readers are told of, until no door
// lets that pass.
TEST(DdsChannel, NothingIsKeptOfAPartThatHasNoPosesAnyMore) {
  Peer mover(make_peer(own_prefix())), watcher(make_peer(own_prefix()));
  const wire::SessionId id = mover.channel->own_id();
  say(*mover.channel, pose_of(id, "arm", 1));
  say(*mover.channel, pose_of(id, "hand", 1));
  ASSERT_TRUE(watcher.await_said(*mover.channel, {pose_of(id, "arm", 1), pose_of(id, "hand", 1)}));
  // One is removed, of the other promises are made from now on.
  Said arm = said_of(pose_of(id, "arm", 2)), hand = said_of(pose_of(id, "hand", 2));
  arm.directory.bodies.clear();
  mover.channel->send(arm.directory);
  hand.directory.bodies[0].number += 1;
  hand.directory.bodies[0].max_speed_mps = 10;
  mover.channel->send(hand.directory);
  ASSERT_TRUE(watcher.await([](const Inbox& in) {
    return in.movers.at("arm") == wire::Mover::kLeft && in.movers.at("hand") == wire::Mover::kLeft;
  })) << watcher.story();
  const Said leg = said_of(pose_of(id, "leg", 3));
  say(*mover.channel, pose_of(id, "leg", 3));
  ASSERT_TRUE(watcher.await_said(*mover.channel, {pose_of(id, "leg", 3)}));
  const auto only_leg_is_kept = [&] {
    const Found found = find_kept<wire::BodyPoses>(own_prefix(), leg.poses.part);
    EXPECT_EQ(found.messages, 1U);
    return found.all == 1;
  };
  // Until all readers have heard of it, what was taken back is told of.
  EXPECT_TRUE(wait_for(only_leg_is_kept));
  // To those who were there that is no news: the mover has not gone, nor its other bodies.
  EXPECT_EQ(watcher.collect().movers.at("leg"), wire::Mover::kThere);
  EXPECT_EQ(watcher.all.complaints, std::vector<std::string>{});
  // The part is used again.
  Said again = said_of(pose_of(id, "arm", 4));
  again.directory.bodies[0].number = ++again.poses.bodies[0].number;
  mover.channel->send(again.directory);
  mover.channel->send(again.poses);
  SaysAgain says;
  ASSERT_TRUE(watcher.await([&](const Inbox& in) {
    if (says.is_due()) mover.channel->send(again.poses);
    return heard_in(in).contains({"arm", 4});
  }));
}

TEST(DdsRecorder, SamplesOfAWriterAreInOrderThoughItsClockWasSetBack) {
  const std::string prefix = own_prefix(), path = recording_of(prefix);
  wire::Mailbox mailbox;
  wire::Writer<wire::BodyPoses> writer(mailbox);
  const auto bus = std::move(wire::Bus::open({.transport = transport(prefix)}, mailbox)).value();
  ASSERT_TRUE(writer.open(*bus).is_ok());
  // All are there when the recorder comes, so they come to it at once. Each stands for its part, so
  // all are kept.
  constexpr std::uint32_t kCount = 40;
  const std::int64_t now_s = wire::now_us() / 1'000'000;
  for (std::uint32_t part = 0; part < kCount; ++part) {
    wire::Writer<wire::BodyPoses>::Data data;
    encode(wire::BodyPoses{.peer = 1, .part = part, .bodies = {{part * wire::kBodiesPerPart}}},
           data);
    ASSERT_TRUE(wire::is_ok(writer.endpoint().write_w_timestamp(
        static_cast<wire::TypeOf<wire::BodyPoses>::Sample*>(&data), rtps::c_InstanceHandle_Unknown,
        wire::Duration(static_cast<std::int32_t>(now_s - part), 0))));
  }
  subscriber::RecorderOptions options;
  options.transport = transport(prefix);
  options.path = path;
  auto recorder = subscriber::DdsRecorder::create(options);
  ASSERT_TRUE(recorder.is_ok()) << recorder.status().message();
  EXPECT_TRUE(wait_for([&] { return recorder.value()->stats().messages == kCount; }));
  EXPECT_TRUE(recorder.value()->finish().is_ok());
  const subscriber::RecorderStats stats = recorder.value()->stats();
  EXPECT_EQ(stats.lost + stats.before, 0U);
  const auto reader = RecordingReader::open(path).value();
  EXPECT_TRUE(reader->gaps().empty());
  std::vector<std::uint64_t> sequences;
  EXPECT_TRUE(reader
                  ->read(1, reader->message_count() + 1,
                         [&](std::int64_t, const RecordedMessage& message) {
                           sequences.push_back(message.sequence);
                           return true;
                         })
                  .is_ok());
  ASSERT_EQ(sequences.size(), kCount);
  for (std::uint32_t i = 0; i < kCount; ++i) EXPECT_EQ(sequences[i], i + 1);
  for (const char* suffix : {"", "-wal", "-shm"}) std::remove((path + suffix).c_str());
}

TEST(DdsRecorder, WritersAreMergedByTheirTimesAndEachKeepsItsOrder) {
  const EndpointGuid a{1}, b{2};
  using Order = std::vector<std::size_t>;
  EXPECT_EQ(subscriber::order_of({}), Order{});
  EXPECT_EQ(subscriber::order_of({{a, 2, 30}, {b, 1, 20}, {a, 1, 10}}), (Order{2, 1, 0}));
  // The second of a is of a clock that was set back: it stays behind the first, and before what b
  // said later.
  EXPECT_EQ(subscriber::order_of({{b, 8, 60}, {a, 2, 10}, {b, 7, 40}, {a, 1, 50}, {a, 3, 20}}),
            (Order{2, 3, 1, 4, 0}));
  // Of one time: by writer, then by number.
  EXPECT_EQ(subscriber::order_of({{b, 1, 5}, {a, 2, 5}, {a, 1, 5}}), (Order{2, 1, 0}));
}

TEST(DdsChannel, WhoFallsSilentIsMissedLongBeforeItsLeaseIsOver) {
  constexpr double kSilence_s = 3;
  const Lease lease(120);  // long before, where all is held up too
  Child mover("mover", own_prefix());
  Peer watcher(make_peer(own_prefix(), nullptr, 0, kSilence_s)), quiet(make_peer(own_prefix()));
  const auto is_there = [](const Inbox& in, const char* body) {
    const auto at = in.movers.find(body);
    return at != in.movers.end() && at->second == wire::Mover::kThere;
  };
  // It says no more of its body than that, but its participant announces itself.
  const wire::BodyPose leg = pose_of(quiet.channel->own_id(), "leg", 1);
  say(*quiet.channel, leg);
  ASSERT_TRUE(watcher.await_said(*quiet.channel, {leg}));
  std::size_t poses = 5;
  ASSERT_TRUE(watcher.await([&](const Inbox& in) {
    return in.poses.size() > std::exchange(poses, std::max<std::size_t>(5, in.poses.size())) &&
           is_there(in, "arm") && is_there(in, "leg");
  })) << watcher.story();
  mover.signal(SIGSTOP);
  const auto stopped = std::chrono::steady_clock::now();
  EXPECT_TRUE(
      watcher.await([](const Inbox& in) { return in.movers.at("arm") == wire::Mover::kSilent; }));
  EXPECT_GT(seconds_since(stopped), kSilence_s / 2);
  EXPECT_LT(seconds_since(stopped), kSilence_s + 30);  // where all is held up too
  mover.signal(SIGCONT);
  EXPECT_TRUE(
      watcher.await([](const Inbox& in) { return in.movers.at("arm") == wire::Mover::kThere; }));
  mover.end();
  // Where this process is held up itself, the leg is silent until it goes on.
  EXPECT_TRUE(watcher.await([&](const Inbox& in) {
    quiet.channel->send(said_of(leg).poses);
    return !is_there(in, "arm") && is_there(in, "leg");
  }));
  quiet.channel.reset();
  EXPECT_TRUE(
      watcher.await([](const Inbox& in) { return in.movers.at("leg") == wire::Mover::kLeft; }));
  EXPECT_TRUE(watcher.await([](const Inbox& in) {
    return in.movers.at("arm") == wire::Mover::kLeft || in.movers.at("arm") == wire::Mover::kSilent;
  }));
}

TEST(DdsChannel, InvalidMessageIsNotSent) {
  Peer peer(make_peer(own_prefix()));
  say(*peer.channel, pose_of(peer.channel->own_id(), "", 1));
  ASSERT_TRUE(peer.await([](const Inbox& in) { return !in.complaints.empty(); }));
  EXPECT_NE(peer.all.complaints[0].find("not sent: body"), std::string::npos)
      << peer.all.complaints[0];
}

TEST(DdsChannel, FullInboxComplainsOnce) {
  subscriber::DdsChannelOptions options;
  options.transport = transport(own_prefix());
  auto channel = PeerChannel::create(options);
  ASSERT_TRUE(channel.is_ok());
  Peer mover(make_peer(own_prefix()));
  constexpr std::uint32_t kParts = 10, kBodies = kParts * wire::kBodiesPerPart;
  const auto send = [&](std::uint64_t frame) {
    for (std::uint32_t part = 0; part < kParts; ++part) {
      wire::BodyDirectory directory{.peer = mover.channel->own_id(), .part = part};
      wire::BodyPoses poses{.peer = mover.channel->own_id(), .part = part, .frame = frame};
      for (std::uint32_t i = 0; i < wire::kBodiesPerPart; ++i) {
        const std::uint32_t number = part * wire::kBodiesPerPart + i;
        directory.bodies.push_back({number, "body" + std::to_string(number), "model"});
        poses.bodies.push_back({.number = number});
      }
      if (frame == 0) mover.channel->send(directory);
      mover.channel->send(poses);
    }
  };
  send(0);
  Peer witness(make_peer(own_prefix()));
  SaysAgain says;
  ASSERT_TRUE(witness.await([&](const Inbox& in) {
    if (says.is_due()) send(1);
    return in.poses.size() >= kBodies;
  }));
  // Nothing tells when it has overflowed without taking, so more is sent until it must have.
  Inbox taken;
  std::uint64_t frame = 1;
  ASSERT_TRUE(wait_for(
      [&] {
        for (std::size_t sent = 0; sent < PeerChannel::kMaxWaitingPoses + 1000; sent += kBodies) {
          // Poses are not repeated by the bus: the next frame stands for one that was lost.
          const auto arrives = [&] {
            send(++frame);
            return witness.await([&](const Inbox& in) { return in.poses.back().frame == frame; },
                                 0.5);
          };
          if (!wait_for(arrives)) return false;
        }
        taken = channel.value()->take();
        return !taken.complaints.empty();
      },
      4 * kDeadline_s));
  EXPECT_EQ(taken.poses.size(), PeerChannel::kMaxWaitingPoses);
  ASSERT_EQ(taken.complaints.size(), 1U);
  EXPECT_NE(taken.complaints[0].find("full"), std::string::npos) << taken.complaints[0];
}

TEST(DdsChannel, WrongOptionsAreNamed) {
  subscriber::DdsChannelOptions options;
  options.transport = transport("x");
  options.transport.interface = "203.0.113.7";
  auto channel = PeerChannel::create(options);
  ASSERT_FALSE(channel.is_ok());
  EXPECT_NE(channel.status().message().find("203.0.113.7"), std::string::npos);
  options.transport = transport("/bad/");
  EXPECT_EQ(PeerChannel::create(options).status().code(), StatusCode::kInvalidArgument);
  using Options = wire::TransportOptions;
  constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
  const std::pair<std::string, std::function<void(Options&)>> wrong[] = {
      {"participants_per_peer: ", [](Options& o) { o.participants_per_peer = 0; }},
      {"participants_per_peer: ", [](Options& o) { o.participants_per_peer = 121; }},
      {"announcement_s: ", [](Options& o) { o.announcement_s = 0; }},
      {"heartbeat_s: ", [](Options& o) { o.heartbeat_s = kNaN; }},
      {"identity_period_s: ", [](Options& o) { o.identity_period_s = -1; }},
      {"lease_s: ", [](Options& o) { o.lease_s = 1.5 * o.announcement_s; }},
      {"silence_s: ", [](Options& o) { o.silence_s = o.announcement_s; }}};
  for (const auto& [begins, spoil] : wrong) {
    options.transport = transport("x");
    spoil(options.transport);
    const Status refused = PeerChannel::create(options).status();
    EXPECT_EQ(refused.code(), StatusCode::kInvalidArgument) << begins;
    EXPECT_TRUE(refused.message().starts_with(begins)) << refused.message();
  }
}

int run_child(const std::string& role, const std::string& prefix) {
  const auto never = [] { return false; };
  if (role == "publisher") {
    publisher::DdsChannelOptions options;
    options.transport = transport(prefix);
    auto channel = PublisherChannel::create(options);
    if (!channel.is_ok()) return 1;
    serve(*channel.value(), never);
  }
  if (role == "recorder") {
    subscriber::RecorderOptions options;
    options.transport = transport(prefix);
    options.path = recording_of(prefix);
    const auto recorder = subscriber::DdsRecorder::create(options);
    if (!recorder.is_ok()) return 1;
    for (;;) std::this_thread::sleep_for(std::chrono::seconds(1));
  }
  subscriber::DdsChannelOptions options;
  options.transport = transport(prefix);
  options.session = kChildPeer;
  auto channel = PeerChannel::create(options);
  if (!channel.is_ok()) return 1;
  for (std::uint64_t frame = 1; role == "mover"; ++frame) {
    say(*channel.value(), pose_of(kChildPeer, "arm", frame));
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
  }
  for (;;) {
    channel.value()->send(request_of(kChildPeer));
    channel.value()->wait(0.1);
    (void)channel.value()->take();
  }
}

}  // namespace
}  // namespace nearmesh::test

int main(int argc, char** argv) {
  using namespace nearmesh::test;
  if (argc == 5 && std::string(argv[1]) == "--child") {
    lease_s = std::atof(argv[4]);
    return run_child(argv[2], argv[3]);
  }
  nearmesh::wire::speak_through_transports();
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
