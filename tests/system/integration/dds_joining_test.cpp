// SPDX-License-Identifier: Apache-2.0
// Both channels: other ways to find each other, and participants given by a host.

#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <atomic>

#include "dds_channel_fixture.hpp"

namespace nearmesh::test {
namespace {

// --- Before a peer asks

/// Writers that a reader is matched with.
struct Ear {
  explicit Ear(const std::string& partition) { EXPECT_TRUE(reader.open(*bus, partition).is_ok()); }
  int writers() {
    for (const auto& match : reader.take_matches()) count += match.is_gone() ? -1 : 1;
    return count;
  }
  wire::Mailbox mailbox;
  wire::Reader<wire::SplitBatchMessage> reader{mailbox};
  std::unique_ptr<wire::Bus> bus =
      std::move(wire::Bus::open({.transport = transport(own_prefix())}, mailbox)).value();
  int count = 0;
};

// Else the first batches would come before the word of who writes them.
TEST(DdsChannel, WhoHearsBatchesHasAWriterBeforeItAsks) {
  const auto publisher = make_publisher(own_prefix(), 1);
  const auto writers_at = [&](Ear& ear, int expected) {
    return poll(
        [&] {
          static_cast<void>(publisher->take());
          return ear.writers() == expected;
        },
        kDeadline_s, 0.01);
  };
  Ear all("*");  // as a recorder
  auto peer = std::make_unique<Ear>(wire::partition_of(kChildPeer));
  EXPECT_TRUE(writers_at(*peer, 1));
  EXPECT_TRUE(writers_at(all, 1));
  peer.reset();
  EXPECT_TRUE(writers_at(all, 0)) << "it left without a word";
  Ear another(wire::partition_of(kChildPeer + 1));
  EXPECT_TRUE(writers_at(another, 1)) << "the other's place is free";
}

// --- Other ways to find each other

/// Of domains that no test uses (11 to 29), below those that systems give out.
std::uint16_t own_port() { return static_cast<std::uint16_t>(10150 + getpid() % 4700); }

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
  builtin.discovery_config.discoveryProtocol = wire::DiscoveryProtocol::SERVER;
  ASSERT_TRUE(rtps::get_server_client_default_guidPrefix(0, qos.wire_protocol().prefix));
  rtps::Locator_t locator;
  rtps::IPLocator::setIPv4(locator, "127.0.0.1");
  locator.port = own_port();
  builtin.metatrafficUnicastLocatorList.push_back(locator);
  auto* factory = fdds::DomainParticipantFactory::get_instance();
  fdds::DomainParticipant* server = factory->create_participant(options.domain, qos);
  ASSERT_NE(server, nullptr);
  EXPECT_TRUE(peer.await(found));
  factory->delete_participant(server);
}

TEST(DdsChannel, DomainWhosePlacesAreTakenIsNamed) {
  subscriber::DdsChannelOptions options;
  options.transport = transport(own_prefix());
  options.transport.domain = 97;
  std::vector<int> sockets;
  sockaddr_in at{};
  at.sin_family = AF_INET;
  for (std::uint32_t port = 7410 + 250 * options.transport.domain; sockets.size() < 240; ++port) {
    sockets.push_back(::socket(AF_INET, SOCK_DGRAM, 0));
    at.sin_port = htons(static_cast<std::uint16_t>(port));
    static_cast<void>(::bind(sockets.back(), reinterpret_cast<sockaddr*>(&at), sizeof at));
  }
  const auto refused = PeerChannel::create(options);
  ASSERT_FALSE(refused.is_ok());
  EXPECT_EQ(refused.status().code(), StatusCode::kIo);
  EXPECT_NE(refused.status().message().find("places of domain 97 on this machine are taken"),
            std::string::npos)
      << refused.status().message();
  // The last pair of ports is a place, too.
  for (int i = 0; i < 2; ++i) {
    ::close(sockets.back());
    sockets.pop_back();
  }
  const auto last = PeerChannel::create(options);
  EXPECT_TRUE(last.is_ok()) << last.status().message();
  for (const int socket : sockets) ::close(socket);
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
  refuses("secured programs do not find each other through one", [](Options& o) {
    o.discovery_server = "127.0.0.1";
    o.security = "alice";
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
  for (wire::TopicPlace place = 0; place < wire::kTopicCount; ++place)
    EXPECT_EQ(host->lookup_topicdescription(names.at(place)), nullptr) << names.at(place);
  EXPECT_TRUE(host->find_type(std::string(wire::topic_of<wire::SplitBatchMessage>().type)).empty());
  EXPECT_TRUE(
      wire::is_ok(fdds::DomainParticipantFactory::get_instance()->delete_participant(host)));
}

TEST(DdsChannel, ForeignTypeOnHostParticipantIsAConflict) {
  fdds::DomainParticipant* host = make_participant(own_prefix());
  fdds::TypeSupport foreign(new RawType(wire::topic_of<wire::SplitBatchMessage>().type, false));
  host->register_type(foreign);
  subscriber::DdsChannelOptions options;
  options.transport = transport(own_prefix());
  options.participant = host;
  auto channel = PeerChannel::create(options);
  ASSERT_FALSE(channel.is_ok());
  EXPECT_EQ(channel.status().code(), StatusCode::kConflict);
  EXPECT_FALSE(
      host->find_type(std::string(wire::topic_of<wire::SplitBatchMessage>().type)).empty());
  EXPECT_TRUE(
      wire::is_ok(fdds::DomainParticipantFactory::get_instance()->delete_participant(host)));
}

}  // namespace
}  // namespace nearmesh::test
