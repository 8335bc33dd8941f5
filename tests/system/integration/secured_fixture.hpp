// SPDX-License-Identifier: Apache-2.0
#pragma once
// Secured channels over real sockets on 127.0.0.1.

#include <gtest/gtest.h>
#include <unistd.h>

#include "core/base/digest.hpp"
#include "idl/security/security.hpp"
#include "inbox.hpp"
#include "nearmesh/subscriber/dds/dds_channel.hpp"
#include "process.hpp"
#include "publisher/dds/dds_channel.hpp"
#include "said.hpp"

namespace nearmesh::test {

namespace fs = std::filesystem;

/// One a process: others of these tests run beside this one, and would try a handshake with each of
/// its participants.
inline const int kDomain = 133 + static_cast<int>(::getpid() % 90);
inline constexpr wire::SessionId kTrue = 0x7, kFalse = 0xbad;
/// How long nothing may have come once somebody else was let in; a handshake takes some 0.3 s.
inline constexpr double kQuiet_s = 1.5;

struct SecuredPeer {
  std::unique_ptr<subscriber::DdsChannel> channel;
  subscriber::Channel::Inbox all;
  std::map<std::string, wire::BodyPoses> said;  ///< of its bodies, the last

  subscriber::Channel::Inbox& collect() {
    take_into(*channel, all);
    return all;
  }
  bool hears(wire::SessionId publisher) {
    return await([&] {
      for (const wire::Hello& hello : collect().hellos)
        if (hello.publisher == publisher) return true;
      return false;
    });
  }
  /// Poses are heard with best effort, so they are said again.
  void say_again() const {
    for (const auto& [body, poses] : said) channel->send(poses);
  }
  /// Of a body that the other moves.
  bool hears(const SecuredPeer& mover, const std::string& body, std::uint64_t frame) {
    SaysAgain again;
    return await([&] {
      if (again.is_due()) mover.say_again();
      return heard_in(collect()).contains({body, frame});
    });
  }
};

class Secured : public ::testing::Test {
 protected:
  [[nodiscard]] wire::SecurityPlan plan_of(
      std::vector<wire::SecurityPlan::Identity> identities) const {
    wire::SecurityPlan plan;
    plan.domain = kDomain;
    plan.prefix = prefix;
    plan.identities = std::move(identities);
    return plan;
  }
  // A set with its own authorities; always the same names.
  std::string make_set(const std::string& name,
                       wire::Role role_of_alice = wire::Role::kSubscriber) {
    const Status made =
        wire::make_security(folder.file(name), plan_of({{"serve", wire::Role::kPublisher},
                                                        {"alice", role_of_alice},
                                                        {"bob", wire::Role::kSubscriber},
                                                        {"carol", wire::Role::kSubscriber},
                                                        {"rec", wire::Role::kRecorder}}));
    EXPECT_TRUE(made.is_ok()) << made.message();
    return folder.file(name);
  }
  [[nodiscard]] wire::TransportOptions transport(const std::string& security) const {
    wire::TransportOptions options;
    options.domain = kDomain;
    options.prefix = prefix;
    options.name = process_name;
    options.interface = "127.0.0.1";
    options.lease_s = 10;  // beyond what a loaded machine stalls
    options.announcement_s = 0.3;
    options.identity_period_s = 0.5;
    options.security = security;
    return options;
  }
  [[nodiscard]] Result<std::unique_ptr<publisher::DdsChannel>> join_as_publisher(
      const std::string& security) const {
    publisher::DdsChannelOptions options;
    options.transport = transport(security);
    return publisher::DdsChannel::create(options);
  }
  static std::vector<std::uint8_t> header_bytes(wire::SessionId session) {
    return std::vector<std::uint8_t>(20'000, static_cast<std::uint8_t>(session));
  }
  static ContentHash content_of(wire::SessionId session) {
    return digest_of(header_bytes(session));
  }
  // With a hello and a header of its own.
  [[nodiscard]] std::unique_ptr<publisher::DdsChannel> serve(const std::string& security,
                                                             wire::SessionId session) const {
    auto made = join_as_publisher(security);
    if (!made.is_ok()) ADD_FAILURE() << made.status().message();
    if (!made.is_ok()) return nullptr;
    wire::Hello hello;
    hello.publisher = session;
    hello.models.push_back({"bunny", content_of(session), 1});
    wire::MeshHeader header;
    header.name = "bunny";
    header.content_hash = content_of(session);
    header.bytes = header_bytes(session);
    made.value()->announce(hello, {header});
    return std::move(made).value();
  }
  [[nodiscard]] SecuredPeer join(const std::string& security) const {
    subscriber::DdsChannelOptions options;
    options.transport = transport(security);
    auto made = subscriber::DdsChannel::create(options);
    if (!made.is_ok()) ADD_FAILURE() << made.status().message();
    return {made.is_ok() ? std::move(made).value() : nullptr, {}, {}};
  }
  static wire::RegionSubscription request_of(const SecuredPeer& peer, wire::SessionId publisher) {
    wire::RegionSubscription message;
    message.peer = peer.channel->own_id();
    message.publisher = publisher;
    message.request = 1;
    message.content_hash = content_of(publisher);
    message.region.attach.push_back({VertexId{0}, 100});
    message.region.region.push_back(GridBox{{{0, 0, 0}}, {{10, 10, 10}}});
    return message;
  }
  static void move(SecuredPeer& peer, const std::string& body, std::uint64_t frame) {
    wire::BodyPose pose;
    pose.peer = peer.channel->own_id();
    pose.body = body;
    pose.frame = frame;
    say(*peer.channel, pose);
    peer.said[body] = said_of(pose).poses;
  }
  // Nothing of a false publisher reaches the peer, while the true one is heard, and nothing of the
  // peer reaches it.
  void expect_unheard(publisher::DdsChannel& false_publisher, SecuredPeer& peer) const {
    ASSERT_TRUE(peer.hears(kTrue));
    peer.channel->send(request_of(peer, kFalse));
    EXPECT_FALSE(await([&] { return !false_publisher.take().subscriptions.empty(); }, kQuiet_s));
    EXPECT_FALSE(false_publisher.send(peer.channel->own_id(), wire::SplitBatchMessage{}));
    for (const wire::Hello& hello : peer.collect().hellos) EXPECT_EQ(hello.publisher, kTrue);
    for (const auto& header : peer.all.headers)
      EXPECT_EQ(header.message.content_hash, content_of(kTrue));
    EXPECT_FALSE(peer.all.headers.empty());
    EXPECT_TRUE(peer.all.batches.empty());
  }

  Folder folder;
  std::string prefix = "security-" + std::to_string(::getpid());
  std::string process_name;  // empty: each has its own
};

}  // namespace nearmesh::test
