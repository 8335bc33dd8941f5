// SPDX-License-Identifier: Apache-2.0
// Both channels over real sockets: UDP on 127.0.0.1, two processes where one must die or freeze,
// else two participants with intra-process delivery off. Every test has its own topic prefix, so
// nothing leaks from one into another. This program is also its own helper: "--child
// publisher|peer|recorder PREFIX LEASE".

#include <fastdds/rtps/attributes/ServerAttributes.h>
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>
#include <fastrtps/utils/IPLocator.h>
#include <fastrtps/xmlparser/XMLProfileManager.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdlib>
#include <functional>
#include <limits>
#include <thread>

#include "nearmesh/core/session/recording.hpp"
#include "nearmesh/core/spm/codec.hpp"
#include "nearmesh/publisher/dds_channel.hpp"
#include "nearmesh/subscriber/dds_channel.hpp"
#include "nearmesh/subscriber/dds_monitor.hpp"
#include "nearmesh/subscriber/dds_recorder.hpp"
#include "nearmesh/wire/dds_support.hpp"

namespace {

using namespace nearmesh;
using namespace std::chrono_literals;
namespace fdds = eprosima::fastdds::dds;
using PublisherChannel = publisher::DdsChannel;
using PeerChannel = subscriber::DdsChannel;
using Inbox = subscriber::Channel::Inbox;

constexpr double kDeadline_s = 20;
/// Of every participant here: beyond what a loaded machine stalls, since whoever stalls is lost. Less where a loss is
/// waited for.
double lease_s = 10;
constexpr double kShortLease_s = 3;
constexpr std::uint64_t kModel = 0xabcdef;
constexpr std::size_t kHeaderBytes = 300'000;
constexpr wire::SessionId kChildPublisher = 0x1111;
constexpr wire::SessionId kChildPeer = 0x2222;

wire::TransportOptions transport(const std::string& prefix) {
  wire::TransportOptions options;
  const char* domain = std::getenv("NEARMESH_TEST_DOMAIN");
  options.domain = domain != nullptr ? static_cast<std::uint32_t>(std::atoi(domain)) : 91;
  options.prefix = prefix;
  // NEARMESH_TEST_INTERFACE= (empty) tries all interfaces, with multicast.
  const char* interface = std::getenv("NEARMESH_TEST_INTERFACE");
  options.interface = interface != nullptr ? interface : "127.0.0.1";
  options.lease_s = lease_s;
  options.announcement_s = 0.3;
  return options;
}

std::string own_prefix() {
  const auto* test = testing::UnitTest::GetInstance()->current_test_info();
  return std::string("test-") + std::to_string(getpid()) + "/" + test->name();
}

std::unique_ptr<PublisherChannel> make_publisher(const std::string& prefix,
                                                 std::size_t max_peers = 1000) {
  publisher::DdsChannelOptions options;
  options.transport = transport(prefix);
  options.max_peers = max_peers;
  auto channel = PublisherChannel::create(options);
  if (!channel.is_ok()) ADD_FAILURE() << channel.status().message();
  return channel.is_ok() ? std::move(channel).value() : nullptr;
}

std::unique_ptr<PeerChannel> make_peer(const std::string& prefix,
                                       fdds::DomainParticipant* participant = nullptr,
                                       wire::SessionId session = 0) {
  subscriber::DdsChannelOptions options;
  options.transport = transport(prefix);
  options.participant = participant;
  options.session = session;
  auto channel = PeerChannel::create(options);
  if (!channel.is_ok()) ADD_FAILURE() << channel.status().message();
  return channel.is_ok() ? std::move(channel).value() : nullptr;
}

wire::Hello hello_of(wire::SessionId publisher) {
  wire::Hello hello;
  hello.publisher = publisher;
  hello.models.push_back({"bunny", kModel, 123});
  return hello;
}

wire::MeshHeader big_header() {
  wire::MeshHeader header;
  header.name = "bunny";
  header.content_hash = kModel;
  header.bytes.resize(kHeaderBytes);
  for (std::size_t i = 0; i < kHeaderBytes; ++i)
    header.bytes[i] = static_cast<std::uint8_t>(i * 2654435761U >> 13);
  return header;
}

/// A request; here max_splits says how many batches the helper is to answer with.
wire::RegionSubscription request_of(wire::SessionId peer, std::uint32_t batches = 1,
                                    wire::SessionId publisher = kChildPublisher) {
  wire::RegionSubscription message;
  message.peer = peer;
  message.publisher = publisher;
  message.request = 1;
  message.content_hash = kModel;
  message.region.attach.push_back({VertexId{0}, 100});
  message.region.region.push_back(GridBox{{{0, 0, 0}}, {{10, 10, 10}}});
  message.region.max_splits = batches;
  return message;
}

wire::SplitBatchMessage batch_of(std::uint32_t sequence, bool last) {
  wire::SplitBatchMessage batch;
  batch.publisher = kChildPublisher;
  batch.content_hash = kModel;
  batch.request = 1;
  batch.sequence = sequence;
  batch.last = last;
  batch.bytes.assign(nearmesh::kMaxBatchBytes, static_cast<std::uint8_t>(sequence));
  return batch;
}

wire::BodyPose pose_of(wire::SessionId peer, const std::string& body, std::uint64_t frame) {
  wire::BodyPose pose;
  pose.peer = peer;
  pose.body = body;
  pose.frame = frame;
  return pose;
}

/// Answers requests until killed.
void serve(PublisherChannel& channel, const std::function<bool()>& stop) {
  channel.announce(hello_of(kChildPublisher), {big_header()});
  struct Job {
    wire::SessionId peer;
    std::uint32_t next, count;
  };
  std::vector<Job> jobs;
  while (!stop()) {
    channel.wait(jobs.empty() ? 0.05 : 0.001);
    const publisher::Inbox inbox = channel.take();
    for (const wire::SessionId lost : inbox.lost_peers)
      std::erase_if(jobs, [&](const Job& job) { return job.peer == lost; });
    for (const auto& subscription : inbox.subscriptions)
      if (subscription.request != 0)
        jobs.push_back({subscription.peer, 1, subscription.region.max_splits});
    for (const std::string& line : channel.take_complaints()) fprintf(stderr, "%s\n", line.c_str());
    for (Job& job : jobs)
      while (job.next <= job.count &&
             channel.send(job.peer, batch_of(job.next, job.next == job.count)))
        ++job.next;
    std::erase_if(jobs, [](const Job& job) { return job.next > job.count; });
  }
}

/// Tests in which somebody is lost.
class DdsLease : public testing::Test {
 protected:
  DdsLease() { lease_s = kShortLease_s; }
};

/// This program again, as publisher or peer.
class Child {
 public:
  Child(const char* role, const std::string& prefix) {
    pid_ = fork();
    if (pid_ != 0) return;
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    execl("/proc/self/exe", "dds_channel_test", "--child", role, prefix.c_str(),
          std::to_string(lease_s).c_str(), nullptr);
    _exit(127);
  }
  ~Child() { end(); }
  Child(const Child&) = delete;
  Child& operator=(const Child&) = delete;
  void signal(int number) const { kill(pid_, number); }
  void end() {
    if (pid_ <= 0) return;
    kill(pid_, SIGKILL);
    waitpid(pid_, nullptr, 0);
    pid_ = 0;
  }

 private:
  pid_t pid_ = 0;
};

/// Waits for a condition; false when the deadline passes.
bool wait_for(const std::function<bool()>& condition, double seconds = kDeadline_s) {
  const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(seconds);
  while (!condition()) {
    if (std::chrono::steady_clock::now() > end) return false;
    std::this_thread::sleep_for(1ms);
  }
  return true;
}

/// A peer with everything it ever received.
struct Peer {
  explicit Peer(std::unique_ptr<PeerChannel> made) : channel(std::move(made)) {}
  std::unique_ptr<PeerChannel> channel;
  Inbox all;

  Inbox& collect() {
    Inbox now = channel->take();
    const auto append = [](auto& to, auto& from) {
      to.insert(to.end(), std::make_move_iterator(from.begin()),
                std::make_move_iterator(from.end()));
    };
    append(all.hellos, now.hellos);
    append(all.lost_publishers, now.lost_publishers);
    append(all.headers, now.headers);
    append(all.batches, now.batches);
    append(all.poses, now.poses);
    append(all.complaints, now.complaints);
    return all;
  }
  bool await(const std::function<bool(const Inbox&)>& condition, double seconds = kDeadline_s) {
    return wait_for([&] { return condition(collect()); }, seconds);
  }
  /// For a failed expectation: what came so far.
  [[nodiscard]] std::string story() const {
    std::string text = std::to_string(all.hellos.size()) + " hellos, " +
                       std::to_string(all.lost_publishers.size()) + " losses, " +
                       std::to_string(all.headers.size()) + " headers, " +
                       std::to_string(all.batches.size()) + " batches";
    for (const std::string& line : all.complaints) text += "\n" + line;
    return text;
  }
};

/// A publisher with everything it ever received.
struct Server {
  explicit Server(std::unique_ptr<PublisherChannel> made) : channel(std::move(made)) {}
  std::unique_ptr<PublisherChannel> channel;
  std::vector<wire::RegionSubscription> subscriptions;
  std::vector<wire::SessionId> lost;
  std::vector<std::string> complaints;

  bool await(const std::function<bool()>& condition, double seconds = kDeadline_s) {
    return wait_for(
        [&] {
          publisher::Inbox inbox = channel->take();
          for (auto& s : inbox.subscriptions) subscriptions.push_back(std::move(s));
          for (const auto peer : inbox.lost_peers) lost.push_back(peer);
          for (auto& line : channel->take_complaints()) complaints.push_back(std::move(line));
          return condition();
        },
        seconds);
  }
};

double seconds_since(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

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
  EXPECT_EQ(late.all.headers[0].bytes, big_header().bytes);
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

std::string recording_of(const std::string& prefix) {
  std::string name = prefix;
  std::replace(name.begin(), name.end(), '/', '-');
  return testing::TempDir() + name + ".db3";
}

TEST(DdsChannel, RecorderHearsEveryPeerAndFrozenStallsNobody) {
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
      ASSERT_TRUE(wait_for(
          [&] { return server.channel->send(peer.channel->own_id(), batch_of(i, false)); }, 8))
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
  mover.channel->send(pose_of(mover.channel->own_id(), "arm", 1));
  Peer late(make_peer(own_prefix()));
  ASSERT_TRUE(late.await([](const Inbox& in) { return !in.poses.empty(); }));
  EXPECT_EQ(late.all.poses[0].body, "arm");
  late.channel->send(pose_of(late.channel->own_id(), "leg", 2));
  ASSERT_TRUE(mover.await([](const Inbox& in) { return !in.poses.empty(); }));
  EXPECT_EQ(mover.all.poses.size(), 1U);
  EXPECT_EQ(mover.all.poses[0].body, "leg");
}

TEST(DdsChannel, PeerBeyondTheLimitIsRefusedWithOneComplaint) {
  Server server(make_publisher(own_prefix(), 1));
  Peer first(make_peer(own_prefix(), nullptr, 5));
  first.channel->send(request_of(5));
  ASSERT_TRUE(server.await([&] { return !server.subscriptions.empty(); }));
  Peer second(make_peer(own_prefix(), nullptr, 6));
  second.channel->send(request_of(6));
  second.channel->send(request_of(6));
  ASSERT_TRUE(server.await([&] { return !server.complaints.empty(); }));
  EXPECT_EQ(server.complaints.size(), 1U);
  EXPECT_NE(server.complaints[0].find("limit"), std::string::npos) << server.complaints[0];
  first.channel.reset();
  ASSERT_TRUE(server.await([&] { return !server.lost.empty(); }));
  second.channel->send(request_of(6));
  EXPECT_TRUE(server.await([&] { return server.subscriptions.size() == 2; }));
}

TEST(DdsChannel, NobodyCanSpeakForAnotherPeer) {
  Server server(make_publisher(own_prefix()));
  Peer owner(make_peer(own_prefix(), nullptr, 5));
  owner.channel->send(request_of(5));
  ASSERT_TRUE(server.await([&] { return !server.subscriptions.empty(); }));
  Peer thief(make_peer(own_prefix(), nullptr, 6));
  for (int i = 0; i < 100; ++i) thief.channel->send(request_of(5, 77));
  ASSERT_TRUE(server.await([&] { return !server.complaints.empty(); }));
  thief.channel.reset();
  owner.channel->send(request_of(5));
  ASSERT_TRUE(server.await([&] { return server.subscriptions.size() >= 2; }));
  for (const wire::RegionSubscription& taken : server.subscriptions)
    EXPECT_EQ(taken.region.max_splits, 1U) << "of the thief";
  EXPECT_TRUE(server.lost.empty());
  EXPECT_NE(server.complaints[0].find("speaks through another writer"), std::string::npos)
      << server.complaints[0];
}

TEST(DdsChannel, NobodyCanSendForAPublisher) {
  Server server(make_publisher(own_prefix()));
  server.channel->announce(hello_of(kChildPublisher), {});
  Peer peer(make_peer(own_prefix(), nullptr, 5));
  ASSERT_TRUE(peer.await([](const Inbox& in) { return !in.hellos.empty(); }));
  peer.channel->send(request_of(5));
  ASSERT_TRUE(server.await([&] { return !server.subscriptions.empty(); }));
  wire::Mailbox mailbox;
  wire::WriterListener listener(mailbox, "");
  auto bus = std::move(wire::Bus::open({.transport = transport(own_prefix())}, mailbox)).value();
  fdds::Topic* topic =
      bus->add_topic<wire::SplitBatchType>(wire::TopicNames(own_prefix()).split_batch).value();
  fdds::DataWriter* forger =
      bus->add_writer(topic, wire::writer_qos(wire::kSplitBatchDelivery, 0.1), listener,
                      wire::partition_of(5))
          .value();
  ASSERT_TRUE(wait_for([&] {
    fdds::PublicationMatchedStatus status;
    forger->get_publication_matched_status(status);
    return status.current_count > 0;
  }));
  wire::SplitBatchMessage forged = batch_of(1, true);
  forged.bytes.assign(10, 99);
  for (int i = 0; i < 100; ++i)
    ASSERT_EQ(wire::write_message<wire::SplitBatchType>(*forger, forged, mailbox),
              wire::WriteResult::kTaken);
  ASSERT_TRUE(peer.await([](const Inbox& in) { return !in.complaints.empty(); }));
  EXPECT_NE(peer.all.complaints[0].find("is another participant"), std::string::npos)
      << peer.all.complaints[0];
  ASSERT_TRUE(wait_for([&] { return server.channel->send(5, batch_of(1, true)); }));
  ASSERT_TRUE(peer.await([](const Inbox& in) { return !in.batches.empty(); }));
  for (const wire::SplitBatchMessage& taken : peer.all.batches)
    EXPECT_EQ(taken.bytes, batch_of(1, true).bytes);
  EXPECT_EQ(peer.all.complaints.size(), 1U);
}

TEST(DdsChannel, PublishersTellOfAnotherWithOtherContentUnderTheirName) {
  Server one(make_publisher(own_prefix())), other(make_publisher(own_prefix())),
      same(make_publisher(own_prefix()));
  wire::Hello hello = hello_of(kChildPublisher);
  one.channel->announce(hello, {});
  hello.publisher = kChildPublisher + 1;
  same.channel->announce(hello, {});
  // Same content under the same name is what a second publisher is for: nothing is said of it.
  const auto serves_other = [](const std::string& line, wire::SessionId publisher) {
    return line.find("model bunny: publisher " + wire::partition_of(publisher) +
                     " serves other content") != std::string::npos;
  };
  hello.publisher = kChildPublisher + 2;
  ++hello.models[0].content_hash;
  other.channel->announce(hello, {});
  const auto tells = [&](Server& server, wire::SessionId of) {
    return server.await([&] {
      return std::any_of(server.complaints.begin(), server.complaints.end(),
                         [&](const std::string& line) { return serves_other(line, of); });
    });
  };
  EXPECT_TRUE(tells(one, kChildPublisher + 2));
  EXPECT_TRUE(tells(same, kChildPublisher + 2));
  EXPECT_TRUE(tells(other, kChildPublisher));
  EXPECT_TRUE(tells(other, kChildPublisher + 1));
  for (const std::string& line : one.complaints)
    EXPECT_FALSE(serves_other(line, kChildPublisher + 1)) << line;
}

TEST(DdsChannel, InvalidMessageIsNotSent) {
  Peer peer(make_peer(own_prefix()));
  peer.channel->send(pose_of(peer.channel->own_id(), "", 1));
  ASSERT_TRUE(peer.await([](const Inbox& in) { return !in.complaints.empty(); }));
  EXPECT_NE(peer.all.complaints[0].find("not sent: body"), std::string::npos)
      << peer.all.complaints[0];
}

TEST(DdsChannel, FullInboxComplainsOnce) {
  subscriber::DdsChannelOptions options;
  options.transport = transport(own_prefix());
  options.max_waiting_others = 2;
  auto channel = PeerChannel::create(options);
  ASSERT_TRUE(channel.is_ok());
  Peer mover(make_peer(own_prefix()));
  for (int i = 0; i < 10; ++i)
    mover.channel->send(pose_of(mover.channel->own_id(), "body" + std::to_string(i), 1));
  Peer witness(make_peer(own_prefix()));
  ASSERT_TRUE(witness.await([](const Inbox& in) { return in.poses.size() == 10; }));
  // Nothing tells when it has overflowed without taking, so more is sent until it must have.
  Inbox taken;
  std::uint64_t frame = 1;
  ASSERT_TRUE(wait_for([&] {
    ++frame;
    for (int i = 0; i < 10; ++i)
      mover.channel->send(pose_of(mover.channel->own_id(), "body" + std::to_string(i), frame));
    const auto arrived = [&](const Inbox& in) { return in.poses.back().frame == frame; };
    if (!witness.await(arrived)) return false;
    taken = channel.value()->take();
    return !taken.complaints.empty();
  }));
  EXPECT_EQ(taken.poses.size(), 2U);
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
}

// --- Hostile or mistaken programs

/// Sends bytes as they are, under any name of a type.
class RawType : public fdds::TopicDataType {
 public:
  using Bytes = std::vector<std::uint8_t>;
  RawType(std::string_view name, bool keyed) {
    setName(std::string(name).c_str());
    m_typeSize = 65536;
    m_isGetKeyDefined = keyed;
  }
  bool serialize(void* data, eprosima::fastrtps::rtps::SerializedPayload_t* payload) override {
    const auto& bytes = *static_cast<Bytes*>(data);
    std::copy(bytes.begin(), bytes.end(), payload->data);
    payload->length = static_cast<std::uint32_t>(bytes.size());
    return true;
  }
  bool deserialize(eprosima::fastrtps::rtps::SerializedPayload_t*, void*) override { return true; }
  std::function<std::uint32_t()> getSerializedSizeProvider(void* data) override {
    return [data] { return static_cast<std::uint32_t>(static_cast<Bytes*>(data)->size()); };
  }
  void* createData() override { return new Bytes; }
  void deleteData(void* data) override { delete static_cast<Bytes*>(data); }
  bool getKey(void*, eprosima::fastrtps::rtps::InstanceHandle_t* handle, bool) override {
    handle->value[0] = 1;
    return true;
  }
};

fdds::DomainParticipant* make_participant(const std::string& prefix) {
  fdds::DomainParticipantQos qos;
  qos.transport().use_builtin_transports = false;
  auto udp = std::make_shared<eprosima::fastdds::rtps::UDPv4TransportDescriptor>();
  udp->interfaceWhiteList.push_back("127.0.0.1");
  qos.transport().user_transports.push_back(udp);
  eprosima::fastrtps::rtps::Locator_t locator;
  eprosima::fastrtps::rtps::IPLocator::setIPv4(locator, "239.255.0.1");
  locator.port = qos.wire_protocol().port.getMulticastPort(transport(prefix).domain);
  qos.wire_protocol().builtin.initialPeersList.push_back(locator);
  return fdds::DomainParticipantFactory::get_instance()->create_participant(
      transport(prefix).domain, qos);
}

class Stranger {
 public:
  Stranger(const std::string& prefix, const std::string& topic, std::string_view type, bool keyed,
           const fdds::DataWriterQos& qos)
      : participant_(make_participant(prefix)) {
    fdds::TypeSupport support(new RawType(type, keyed));
    participant_->register_type(support);
    fdds::Topic* made =
        participant_->create_topic(topic, std::string(type), fdds::TOPIC_QOS_DEFAULT);
    writer_ =
        participant_->create_publisher(fdds::PUBLISHER_QOS_DEFAULT)->create_datawriter(made, qos);
  }
  ~Stranger() {
    participant_->delete_contained_entities();
    fdds::DomainParticipantFactory::get_instance()->delete_participant(participant_);
  }
  bool await_match() {
    return wait_for([&] {
      fdds::PublicationMatchedStatus status;
      writer_->get_publication_matched_status(status);
      return status.current_count > 0;
    });
  }
  void write(RawType::Bytes bytes) {
    writer_->write(&bytes, eprosima::fastrtps::rtps::c_InstanceHandle_Unknown);
  }

 private:
  fdds::DomainParticipant* participant_;
  fdds::DataWriter* writer_;
};

template <class Type, class Message>
RawType::Bytes bytes_of(const Message& message) {
  typename Type::Data data;
  wire::encode(message, data);
  Type type;
  void* sample = static_cast<typename Type::Sample*>(&data);
  eprosima::fastrtps::rtps::SerializedPayload_t payload(type.getSerializedSizeProvider(sample)());
  type.serialize(sample, &payload);
  return {payload.data, payload.data + payload.length};
}

fdds::DataWriterQos stranger_qos(const wire::Delivery& delivery) {
  fdds::DataWriterQos qos = wire::writer_qos(delivery, 0.1);
  qos.history().kind = fdds::KEEP_ALL_HISTORY_QOS;
  return qos;
}

struct HostileCase {
  const char* name;
  const char* expected;  ///< in the complaint
  std::function<void(RawType::Bytes&)> spoil;
};

// A subscription: 4 bytes of encapsulation, version, priority, -, request, peer, publisher, hash,
// acknowledged, window, max_splits; the count of attach words is at 48.
const std::vector<HostileCase> kHostile{
    {"OtherVersion", "wire version 9", [](RawType::Bytes& b) { b[4] = 9; }},
    {"HugeAttachCount", "contradict", [](RawType::Bytes& b) { b[51] = 0x7f; }},
    {"AttachCountBeyondBytes", "contradict", [](RawType::Bytes& b) { b[48] = 30; }},
    {"UnknownPriority", "priority", [](RawType::Bytes& b) { b[6] = 3; }},
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
  Stranger stranger(prefix, wire::TopicNames(prefix).region_subscription,
                    wire::kRegionSubscriptionType, true,
                    stranger_qos(wire::kRegionSubscriptionDelivery));
  ASSERT_TRUE(stranger.await_match());
  RawType::Bytes bad = bytes_of<wire::RegionSubscriptionType>(request_of(9));
  GetParam().spoil(bad);
  stranger.write(bad);
  stranger.write(bytes_of<wire::RegionSubscriptionType>(request_of(9, 55)));
  ASSERT_TRUE(server.await([&] { return !server.subscriptions.empty(); }));
  EXPECT_EQ(server.subscriptions.size(), 1U);
  EXPECT_EQ(server.subscriptions[0].region.max_splits, 55U);
  ASSERT_EQ(server.complaints.size(), 1U);
  EXPECT_NE(server.complaints[0].find(GetParam().expected), std::string::npos)
      << server.complaints[0];
}

INSTANTIATE_TEST_SUITE_P(DdsChannel, HostileSubscription, testing::ValuesIn(kHostile),
                         [](const auto& tested) { return std::string(tested.param.name); });

TEST(DdsChannel, BodyStaysWithItsFirstMoverUntilThatIsGone) {
  Peer watcher(make_peer(own_prefix())), second(make_peer(own_prefix()));
  {
    Peer first(make_peer(own_prefix()));
    first.channel->send(pose_of(first.channel->own_id(), "arm", 1));
    ASSERT_TRUE(watcher.await([](const Inbox& in) { return in.poses.size() == 1; }));
    second.channel->send(pose_of(second.channel->own_id(), "arm", 2));
    ASSERT_TRUE(watcher.await([](const Inbox& in) { return !in.complaints.empty(); }));
    EXPECT_NE(watcher.all.complaints[0].find("body arm"), std::string::npos);
    EXPECT_EQ(watcher.all.poses.size(), 1U);
  }
  // What it said last counts then, though it says no more.
  ASSERT_TRUE(watcher.await([](const Inbox& in) { return in.poses.size() == 2; }));
  EXPECT_EQ(watcher.all.poses[1].frame, 2U);
  EXPECT_EQ(watcher.all.complaints.size(), 1U);
}

TEST(DdsChannel, BatchIsNotTakenBeforeThePeerCanHearIt) {
  Server server(make_publisher(own_prefix()));
  Stranger deaf(own_prefix(), wire::TopicNames(own_prefix()).region_subscription,
                wire::kRegionSubscriptionType, true,
                stranger_qos(wire::kRegionSubscriptionDelivery));
  ASSERT_TRUE(deaf.await_match());
  deaf.write(bytes_of<wire::RegionSubscriptionType>(request_of(9)));
  ASSERT_TRUE(server.await([&] { return !server.subscriptions.empty(); }));
  EXPECT_FALSE(server.channel->send(9, batch_of(1, true)));
  EXPECT_FALSE(server.channel->send(10, batch_of(1, true)));  // unknown
}

TEST(DdsChannel, PoseThatIsNotFiniteGivesOneComplaint) {
  Peer peer(make_peer(own_prefix()));
  Stranger stranger(own_prefix(), wire::TopicNames(own_prefix()).body_pose, wire::kBodyPoseType,
                    true, stranger_qos(wire::kBodyPoseDelivery));
  ASSERT_TRUE(stranger.await_match());
  wire::BodyPose bad = pose_of(3, "arm", 1);
  bad.pose.translation_m[1] = std::numeric_limits<double>::quiet_NaN();
  stranger.write(bytes_of<wire::BodyPoseType>(bad));
  stranger.write(bytes_of<wire::BodyPoseType>(pose_of(3, "leg", 2)));
  ASSERT_TRUE(peer.await([](const Inbox& in) { return !in.poses.empty(); }));
  EXPECT_EQ(peer.all.poses[0].body, "leg");
  ASSERT_EQ(peer.all.complaints.size(), 1U);
  EXPECT_NE(peer.all.complaints[0].find("arm"), std::string::npos) << peer.all.complaints[0];
}

TEST(DdsChannel, HelloOfAnotherVersionIsRefusedLoudly) {
  Peer peer(make_peer(own_prefix()));
  Stranger stranger(own_prefix(), wire::TopicNames(own_prefix()).hello, wire::kHelloType, true,
                    stranger_qos(wire::kHelloDelivery));
  RawType::Bytes bytes = bytes_of<wire::HelloType>(hello_of(3));
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

TEST(DdsChannel, HelloIsHeldBackWhileItsPublisherCannotHear) {
  Peer peer(make_peer(own_prefix()));
  Stranger deaf(own_prefix(), wire::TopicNames(own_prefix()).hello, wire::kHelloType, true,
                stranger_qos(wire::kHelloDelivery));
  ASSERT_TRUE(deaf.await_match());
  deaf.write(bytes_of<wire::HelloType>(hello_of(3)));
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
                    wire::kSplitBatchType, false, stranger_qos(wire::kSplitBatchDelivery));
  ASSERT_TRUE(peer.await([](const Inbox& in) { return !in.complaints.empty(); }));
  EXPECT_NE(peer.all.complaints[0].find("wire version " + newer), std::string::npos)
      << peer.all.complaints[0];
}

TEST(DdsChannel, OtherTypeOnOurTopicIsReported) {
  Server server(make_publisher(own_prefix()));
  Stranger stranger(own_prefix(), wire::TopicNames(own_prefix()).region_subscription, "Foreign",
                    true, stranger_qos(wire::kRegionSubscriptionDelivery));
  ASSERT_TRUE(server.await([&] { return !server.complaints.empty(); }));
  EXPECT_NE(server.complaints[0].find("Foreign"), std::string::npos) << server.complaints[0];
}

TEST(DdsChannel, IncompatibleQosIsReportedByPolicy) {
  Server server(make_publisher(own_prefix()));
  fdds::DataWriterQos qos = stranger_qos(wire::kRegionSubscriptionDelivery);
  qos.reliability().kind = fdds::BEST_EFFORT_RELIABILITY_QOS;
  Stranger stranger(own_prefix(), wire::TopicNames(own_prefix()).region_subscription,
                    wire::kRegionSubscriptionType, true, qos);
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
  fdds::DataWriterQos qos = stranger_qos(wire::kHelloDelivery);
  qos.durability().kind = fdds::VOLATILE_DURABILITY_QOS;
  Stranger stranger(own_prefix(), wire::TopicNames(own_prefix()).hello, wire::kHelloType, true,
                    qos);
  ASSERT_TRUE(peer.await([](const Inbox& in) { return !in.complaints.empty(); }));
  EXPECT_NE(
      peer.all.complaints[0].find("offers durability volatile, this side requests transient local"),
      std::string::npos)
      << peer.all.complaints[0];
}

// --- What an operator sees

TEST(DdsChannel, PublisherThatIsMatchedButSilentIsReported) {
  Peer peer(make_peer(own_prefix()));
  Stranger silent(own_prefix(), wire::TopicNames(own_prefix()).hello, wire::kHelloType, true,
                  stranger_qos(wire::kHelloDelivery));
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

TEST(DdsChannel, MonitorTellsOfTwoContentsUnderOneNameAndOfTheSilent) {
  auto one = make_publisher(own_prefix()), other = make_publisher(own_prefix());
  wire::Hello hello = hello_of(kChildPublisher);
  one->announce(hello, {});
  hello.publisher = kChildPublisher + 1;
  ++hello.models[0].content_hash;
  other->announce(hello, {});
  Stranger silent(own_prefix(), wire::TopicNames(own_prefix()).hello, wire::kHelloType, true,
                  stranger_qos(wire::kHelloDelivery));
  auto monitor = subscriber::DdsMonitor::create(transport(own_prefix()));
  ASSERT_TRUE(monitor.is_ok()) << monitor.status().message();
  const auto says = [&](const char* text) {
    return wait_for([&] {
      monitor.value()->listen(0.05);
      const auto refusals = monitor.value()->view().refusals;
      return std::any_of(refusals.begin(), refusals.end(), [&](const std::string& line) {
        return line.find(text) != std::string::npos;
      });
    });
  };
  EXPECT_TRUE(says("rename or replace one file"));
  EXPECT_TRUE(says("nothing comes from it"));
  EXPECT_EQ(monitor.value()->view().refusals.size(), 2U);
}

// --- Other ways to find each other

std::uint16_t own_port() { return static_cast<std::uint16_t>(20000 + getpid() % 20000); }

TEST(DdsChannel, DiscoveryServerAloneBringsThemTogether) {
  wire::TransportOptions options = transport(own_prefix());
  options.discovery_server = "127.0.0.1:" + std::to_string(own_port());
  publisher::DdsChannelOptions publisher_options;
  publisher_options.transport = options;
  auto publisher = PublisherChannel::create(publisher_options);
  ASSERT_TRUE(publisher.is_ok()) << publisher.status().message();
  publisher.value()->announce(hello_of(kChildPublisher), {});
  subscriber::DdsChannelOptions peer_options;
  peer_options.transport = options;
  auto made = PeerChannel::create(peer_options);
  ASSERT_TRUE(made.is_ok()) << made.status().message();
  Peer peer(std::move(made).value());
  const auto found = [](const Inbox& in) { return !in.hellos.empty(); };
  EXPECT_FALSE(peer.await(found, 0.5));

  fdds::DomainParticipantQos qos;
  auto& builtin = qos.wire_protocol().builtin;
  builtin.discovery_config.discoveryProtocol =
      eprosima::fastrtps::rtps::DiscoveryProtocol_t::SERVER;
  ASSERT_TRUE(
      eprosima::fastdds::rtps::get_server_client_default_guidPrefix(0, qos.wire_protocol().prefix));
  eprosima::fastrtps::rtps::Locator_t locator;
  eprosima::fastrtps::rtps::IPLocator::setIPv4(locator, "127.0.0.1");
  locator.port = own_port();
  builtin.metatrafficUnicastLocatorList.push_back(locator);
  auto* factory = fdds::DomainParticipantFactory::get_instance();
  fdds::DomainParticipant* server = factory->create_participant(options.domain, qos);
  ASSERT_NE(server, nullptr);
  EXPECT_TRUE(peer.await(found));
  factory->delete_participant(server);
}

TEST(DdsChannel, WrongTransportOptionsAreNamed) {
  const auto refuses = [&](const char* expected, auto spoil) {
    subscriber::DdsChannelOptions options;
    options.transport = transport(own_prefix());
    spoil(options.transport);
    const auto channel = PeerChannel::create(options);
    ASSERT_FALSE(channel.is_ok()) << expected;
    EXPECT_EQ(channel.status().code(), StatusCode::kInvalidArgument);
    EXPECT_NE(channel.status().message().find(expected), std::string::npos)
        << channel.status().message();
  };
  using Options = wire::TransportOptions;
  refuses("tcp: expected initial peers", [](Options& o) { o.transport = wire::Transport::kTcp; });
  refuses("a port, ADDRESS:PORT", [](Options& o) {
    o.transport = wire::Transport::kTcp;
    o.initial_peers = {"127.0.0.1:70000"};
  });
  refuses("reached by UDP", [](Options& o) {
    o.transport = wire::Transport::kTcp;
    o.listen_port = 5100;
    o.discovery_server = "127.0.0.1";
  });
  refuses("initial peer \"127.0.0.1:7400\": expected an IPv4 address",
          [](Options& o) { o.initial_peers = {"127.0.0.1:7400"}; });
  refuses("nothing is sent by multicast", [](Options& o) {
    o.transport = wire::Transport::kUdpOnly;
    o.interface.clear();
  });
  refuses("discovery server \"here\"", [](Options& o) { o.discovery_server = "here"; });
}

// --- A participant given by the host

TEST(DdsChannel, HostParticipantIsLeftAsItWas) {
  class HostListener : public fdds::DomainParticipantListener {
   public:
    void on_data_available(fdds::DataReader*) override { ++events; }
    void on_data_on_readers(fdds::Subscriber*) override { ++events; }
    void on_subscription_matched(fdds::DataReader*,
                                 const fdds::SubscriptionMatchedStatus&) override {
      ++events;
    }
    std::atomic<int> events = 0;
  } listener;
  fdds::DomainParticipant* host = make_participant(own_prefix());
  ASSERT_NE(host, nullptr);
  host->set_listener(&listener, fdds::StatusMask::all());
  const fdds::DomainParticipantQos before = host->get_qos();
  {
    Child publisher("publisher", own_prefix());
    Peer one(make_peer(own_prefix(), host));
    Peer two(make_peer(own_prefix(), host));
    for (Peer* peer : {&one, &two}) {
      ASSERT_TRUE(peer->await([](const Inbox& in) { return !in.hellos.empty(); }));
      peer->channel->send(request_of(peer->channel->own_id(), 20));
      ASSERT_TRUE(peer->await([](const Inbox& in) { return in.batches.size() == 20; }));
    }
    one.channel.reset();  // the other goes on with what they shared
    two.channel->send(request_of(two.channel->own_id(), 20));
    EXPECT_TRUE(two.await([](const Inbox& in) { return in.batches.size() == 40; }));
  }
  EXPECT_TRUE(host->get_qos() == before);
  EXPECT_EQ(host->get_listener(), &listener);
  EXPECT_EQ(listener.events, 0);
  const wire::TopicNames names(own_prefix());
  for (const auto& topic : {names.hello, names.mesh_header, names.split_batch, names.body_pose,
                            names.region_subscription, names.contact_report})
    EXPECT_EQ(host->lookup_topicdescription(topic), nullptr) << topic;
  EXPECT_TRUE(host->find_type(std::string(wire::kSplitBatchType)).empty());
  EXPECT_TRUE(fdds::DomainParticipantFactory::get_instance()->delete_participant(host) ==
              eprosima::fastrtps::types::ReturnCode_t::RETCODE_OK);
}

TEST(DdsChannel, ForeignTypeOnHostParticipantIsAConflict) {
  fdds::DomainParticipant* host = make_participant(own_prefix());
  fdds::TypeSupport foreign(new RawType(wire::kSplitBatchType, false));
  host->register_type(foreign);
  subscriber::DdsChannelOptions options;
  options.transport = transport(own_prefix());
  options.participant = host;
  auto channel = PeerChannel::create(options);
  ASSERT_FALSE(channel.is_ok());
  EXPECT_EQ(channel.status().code(), StatusCode::kConflict);
  EXPECT_FALSE(host->find_type(std::string(wire::kSplitBatchType)).empty());
  EXPECT_TRUE(fdds::DomainParticipantFactory::get_instance()->delete_participant(host) ==
              eprosima::fastrtps::types::ReturnCode_t::RETCODE_OK);
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
    for (;;) std::this_thread::sleep_for(1s);
  }
  subscriber::DdsChannelOptions options;
  options.transport = transport(prefix);
  options.session = kChildPeer;
  auto channel = PeerChannel::create(options);
  if (!channel.is_ok()) return 1;
  for (;;) {
    channel.value()->send(request_of(kChildPeer));
    channel.value()->wait(0.1);
    (void)channel.value()->take();
  }
}

}  // namespace

int main(int argc, char** argv) {
  if (argc == 5 && std::string(argv[1]) == "--child") {
    lease_s = std::atof(argv[4]);
    return run_child(argv[2], argv[3]);
  }
  eprosima::fastrtps::LibrarySettingsAttributes settings;
  settings.intraprocess_delivery = eprosima::fastrtps::INTRAPROCESS_OFF;
  eprosima::fastrtps::xmlparser::XMLProfileManager::library_settings(settings);
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
