// SPDX-License-Identifier: Apache-2.0
#pragma once
// Both channels over real sockets: UDP on 127.0.0.1, two processes where one must die or freeze,
// else two participants with intra-process delivery off. Every test has its own topic prefix, so
// nothing leaks from one into another.

#include <gtest/gtest.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <functional>
#include <memory>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "core/base/digest.hpp"
#include "idl/dds/bus.hpp"
#include "idl/dds/dds_time.hpp"
#include "idl/dds/endpoints.hpp"
#include "idl/dds/fastdds.hpp"
#include "inbox.hpp"
#include "nearmesh/core/spm/detail/codec.hpp"
#include "nearmesh/idl/dds/door.hpp"
#include "nearmesh/subscriber/dds/dds_channel.hpp"
#include "poll.hpp"
#include "publisher/dds/dds_channel.hpp"
#include "said.hpp"

namespace nearmesh::test {

namespace fdds = wire::fdds;
namespace rtps = wire::rtps;
using PublisherChannel = publisher::DdsChannel;
using PeerChannel = subscriber::DdsChannel;
using Inbox = subscriber::Channel::Inbox;

constexpr double kDeadline_s = 100;  ///< for anything that ought to happen soon
/// Of every participant here: beyond what a loaded machine stalls, since whoever stalls is lost.
/// Less where a loss is waited for.
inline double lease_s = 20;
constexpr double kShortLease_s = 6;
constexpr std::size_t kHeaderBytes = 300'000;
inline std::vector<std::uint8_t> header_bytes() {
  std::vector<std::uint8_t> bytes(kHeaderBytes);
  for (std::size_t i = 0; i < kHeaderBytes; ++i)
    bytes[i] = static_cast<std::uint8_t>(i * 2654435761U >> 13);
  return bytes;
}
inline const ContentHash kModel = digest_of(header_bytes());
constexpr wire::SessionId kChildPublisher = 0x1111;
constexpr wire::SessionId kChildPeer = 0x2222;

inline wire::TransportOptions transport(const std::string& prefix) {
  wire::TransportOptions options;
  const char* domain = std::getenv("NEARMESH_TEST_DOMAIN");
  options.domain = domain != nullptr ? static_cast<std::uint32_t>(std::atoi(domain)) : 91;
  options.prefix = prefix;
  // NEARMESH_TEST_INTERFACE= (empty) tries all interfaces, with multicast.
  const char* interface = std::getenv("NEARMESH_TEST_INTERFACE");
  options.interface = interface != nullptr ? interface : "127.0.0.1";
  options.lease_s = lease_s;
  options.silence_s = lease_s;
  options.announcement_s = 0.3;
  return options;
}

inline std::string own_prefix() {
  const auto* test = testing::UnitTest::GetInstance()->current_test_info();
  return std::string("test-") + std::to_string(getpid()) + "/" + test->name();
}

inline std::unique_ptr<PublisherChannel> make_publisher(const std::string& prefix,
                                                        std::size_t max_peers = 1000) {
  publisher::DdsChannelOptions options;
  options.transport = transport(prefix);
  options.max_peers = max_peers;
  auto channel = PublisherChannel::create(options);
  if (!channel.is_ok()) ADD_FAILURE() << channel.status().message();
  return channel.is_ok() ? std::move(channel).value() : nullptr;
}

inline std::unique_ptr<PeerChannel> make_peer(const std::string& prefix,
                                              fdds::DomainParticipant* participant = nullptr,
                                              wire::SessionId session = 0,
                                              double silence_s = lease_s) {
  subscriber::DdsChannelOptions options;
  options.transport = transport(prefix);
  options.transport.silence_s = silence_s;
  options.participant = participant;
  options.session = session;
  auto channel = PeerChannel::create(options);
  if (!channel.is_ok()) ADD_FAILURE() << channel.status().message();
  return channel.is_ok() ? std::move(channel).value() : nullptr;
}

inline wire::Hello hello_of(wire::SessionId publisher) {
  wire::Hello hello;
  hello.publisher = publisher;
  hello.models.push_back({"bunny", kModel, 123});
  return hello;
}

inline wire::MeshHeader big_header() {
  wire::MeshHeader header;
  header.name = "bunny";
  header.content_hash = kModel;
  header.bytes = header_bytes();
  return header;
}

/// A request; here max_splits says how many batches the helper is to answer with.
inline wire::RegionSubscription request_of(wire::SessionId peer, std::uint32_t batches = 1,
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

inline wire::SplitBatchMessage batch_of(std::uint32_t sequence, bool last) {
  wire::SplitBatchMessage batch;
  batch.publisher = kChildPublisher;
  batch.content_hash = kModel;
  batch.request = 1;
  batch.sequence = sequence;
  batch.last = last;
  batch.bytes.assign(nearmesh::kMaxSealedBytes, static_cast<std::uint8_t>(sequence));
  return batch;
}

inline wire::BodyPose pose_of(wire::SessionId peer, const std::string& body, std::uint64_t frame) {
  wire::BodyPose pose;
  pose.peer = peer;
  pose.body = body;
  pose.frame = frame;
  return pose;
}

/// Answers requests until killed.
inline void serve(PublisherChannel& channel, const std::function<bool()>& stop) {
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

/// Of who joins in this scope.
class Lease {
 public:
  explicit Lease(double seconds) : before_s_(std::exchange(lease_s, seconds)) {}
  ~Lease() { lease_s = before_s_; }
  Lease(const Lease&) = delete;
  Lease& operator=(const Lease&) = delete;

 private:
  const double before_s_;
};

/// Tests in which somebody is lost.
class DdsLease : public testing::Test {
  const Lease lease_{kShortLease_s};
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
inline bool wait_for(const std::function<bool()>& condition, double seconds = kDeadline_s) {
  return poll(condition, seconds, 0.001);
}

/// A peer with everything it ever received.
struct Peer {
  explicit Peer(std::unique_ptr<PeerChannel> made) : channel(std::move(made)) {}
  std::unique_ptr<PeerChannel> channel;
  Inbox all;

  Inbox& collect() {
    take_into(*channel, all);
    return all;
  }
  bool await(const std::function<bool(const Inbox&)>& condition, double seconds = kDeadline_s) {
    return wait_for([&] { return condition(collect()); }, seconds);
  }
  /// Until all of these poses were heard, whose bodies were told: they are heard with best effort,
  /// so they are said again meanwhile.
  bool await_said(PeerChannel& mover, const std::vector<wire::BodyPose>& poses) {
    SaysAgain again;
    return await([&](const Inbox& in) {
      const Heard heard = heard_in(in);
      const bool has_all = std::all_of(poses.begin(), poses.end(), [&](const wire::BodyPose& pose) {
        return heard.contains({pose.body, pose.frame});
      });
      if (!has_all && again.is_due())
        for (const wire::BodyPose& pose : poses) mover.send(said_of(pose).poses);
      return has_all;
    });
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
  std::vector<wire::SessionId> lost, lost_rivals;
  std::vector<wire::Hello> rivals;
  std::vector<std::string> complaints;

  bool await(const std::function<bool()>& condition, double seconds = kDeadline_s) {
    return wait_for(
        [&] {
          publisher::Inbox inbox = channel->take();
          for (auto& s : inbox.subscriptions) subscriptions.push_back(std::move(s));
          for (const auto peer : inbox.lost_peers) lost.push_back(peer);
          for (const auto rival : inbox.lost_rivals) lost_rivals.push_back(rival);
          for (auto& hello : inbox.rivals) rivals.push_back(std::move(hello));
          for (auto& line : channel->take_complaints()) complaints.push_back(std::move(line));
          return condition();
        },
        seconds);
  }
};

inline double seconds_since(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

inline std::string recording_of(const std::string& prefix) {
  std::string name = prefix;
  std::replace(name.begin(), name.end(), '/', '-');
  return testing::TempDir() + name + ".db3";
}

/// Sends bytes as they are, under any name of a type.
class RawType : public wire::OfEitherVersion<fdds::TopicDataType> {
 public:
  using Bytes = std::vector<std::uint8_t>;
  RawType(std::string_view name, bool keyed) { describe(std::string(name), 65536, keyed); }
  bool write(const void* data, wire::Payload& payload) override {
    const auto& bytes = *static_cast<const Bytes*>(data);
    std::copy(bytes.begin(), bytes.end(), payload.data);
    payload.length = static_cast<std::uint32_t>(bytes.size());
    return true;
  }
  bool read(wire::Payload&, void*) override { return true; }
  std::uint32_t size_of(const void* data) override {
    return static_cast<std::uint32_t>(static_cast<const Bytes*>(data)->size());
  }
  void* make_data() override { return new Bytes; }
  void delete_made(void* data) override { delete static_cast<Bytes*>(data); }
  bool key_of(const void*, wire::Handle& handle, bool) override {
    handle.value[0] = 1;
    return true;
  }
};

inline fdds::DomainParticipant* make_participant(const std::string& prefix,
                                                 bool with_door = false) {
  fdds::DomainParticipantQos qos;
  qos.transport().use_builtin_transports = false;
  auto udp = std::make_shared<rtps::UDPv4TransportDescriptor>();
  udp->interfaceWhiteList.push_back("127.0.0.1");
  qos.transport().user_transports.push_back(udp);
  rtps::Locator_t locator;
  rtps::IPLocator::setIPv4(locator, "239.255.0.1");
  locator.port = qos.wire_protocol().port.getMulticastPort(transport(prefix).domain);
  qos.wire_protocol().builtin.initialPeersList.push_back(locator);
  if (with_door) wire::add_door(qos);
  return fdds::DomainParticipantFactory::get_instance()->create_participant(
      transport(prefix).domain, qos);
}

template <class Message>
fdds::DataWriterQos stranger_qos() {
  fdds::DataWriterQos qos = wire::writer_qos(wire::topic_of<Message>().delivery, 0.1);
  qos.history().kind = fdds::KEEP_ALL_HISTORY_QOS;
  return qos;
}

class Stranger {
 public:
  /// Of a topic with a key, under its name and type.
  template <class Message>
  static Stranger of(const std::string& prefix,
                     const fdds::DataWriterQos& qos = stranger_qos<Message>()) {
    return {prefix, wire::TopicNames(prefix).of<Message>(), wire::topic_of<Message>().type, true,
            qos};
  }
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
  void write(RawType::Bytes bytes) { writer_->write(&bytes, rtps::c_InstanceHandle_Unknown); }

 private:
  fdds::DomainParticipant* participant_;
  fdds::DataWriter* writer_;
};

/// What a reader of a topic that comes now finds: how many samples with a message, and all, also
/// those that say that a key is taken back.
struct Found {
  std::size_t messages = 0, all = 0;
};
/// Until that part's has come.
template <class Message>
Found find_kept(const std::string& prefix, std::uint32_t awaited_part) {
  wire::Mailbox mailbox;
  wire::Reader<Message> late(mailbox);
  const auto bus = std::move(wire::Bus::open({.transport = transport(prefix)}, mailbox)).value();
  EXPECT_TRUE(late.open(*bus).is_ok());
  Found found;
  bool is_there = false;
  EXPECT_TRUE(wait_for([&] {
    while (late.drain(
        100,
        [&](Message&& message, const wire::Handle&, wire::Microseconds) {
          ++found.messages;
          is_there |= message.part == awaited_part;
        },
        [&](const wire::Handle&) { ++found.all; })) {
    }
    return is_there;
  }));
  return found;
}

template <class Message>
RawType::Bytes bytes_of(const Message& message) {
  using Type = wire::TypeOf<Message>;
  typename Type::Data data;
  wire::encode(message, data);
  Type type;
  return wire::to_cdr(type, data);
}

}  // namespace nearmesh::test
