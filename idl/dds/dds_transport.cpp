// SPDX-License-Identifier: Apache-2.0
#include "dds_transport.hpp"

#include <arpa/inet.h>
#include <sys/socket.h>

#include <charconv>
#include <cstring>
#include <memory>

#include "interfaces.hpp"
#include "room.hpp"

namespace nearmesh::wire {
namespace {

using rtps::IPLocator;
using rtps::Locator_t;
using rtps::octet;
using rtps::SharedMemTransportDescriptor;
using rtps::TCPv4TransportDescriptor;
using rtps::UDPv4TransportDescriptor;

/// A header of a megabyte arrives as one burst. The kernel may grant less.
constexpr std::uint32_t kSocketBufferBytes = 4U << 20;
constexpr const char* kDiscoveryMulticast = "239.255.0.1";
constexpr const char* kLoopback = "127.0.0.1";

/// The address of an interface given by name or address. Fast DDS uses none without a link, and
/// says only that it has no ports.
Result<std::string> resolve_interface(const std::string& wanted) {
  std::string known;
  for (const Interface& interface : ipv4_interfaces()) {
    if (wanted == interface.address || wanted == interface.name) {
      if (interface.is_running) return interface.address;
      return Status{StatusCode::kIo,
                    "interface \"" + wanted + "\" has no link: it is " +
                        (interface.is_up ? "up, but nothing is at its other end" : "down")};
    }
    known += (known.empty() ? "" : ", ") + interface.name + " " + interface.address;
  }
  return Status{StatusCode::kInvalidArgument,
                "interface \"" + wanted + "\": expected one of " + known};
}

/// "ADDRESS" or, where a default port is given, "ADDRESS:PORT" too.
Result<Locator_t> parse_locator(const std::string& text, std::uint16_t default_port,
                                const char* option) {
  const std::size_t colon = default_port != 0 ? text.find(':') : std::string::npos;
  const std::string address = text.substr(0, colon);
  std::uint32_t port = default_port;
  bool right = true;
  if (colon != std::string::npos) {
    const char* end = text.data() + text.size();
    const auto parsed = std::from_chars(text.data() + colon + 1, end, port);
    right = parsed.ec == std::errc{} && parsed.ptr == end && port >= 1 && port <= 65535;
  }
  in_addr unused{};
  if (!right || inet_pton(AF_INET, address.c_str(), &unused) != 1)
    return Status{StatusCode::kInvalidArgument,
                  std::string(option) + " \"" + text + "\": expected an IPv4 address" +
                      (default_port != 0 ? ", or one with a port, ADDRESS:PORT" : "")};
  Locator_t locator;
  IPLocator::setIPv4(locator, address);
  locator.port = port;
  return locator;
}

/// Port 0: Fast DDS asks the ports of the first participants there.
void add_udp_peer(const std::string& address, std::uint32_t port, fdds::DomainParticipantQos& qos) {
  Locator_t locator;
  IPLocator::setIPv4(locator, address);
  locator.port = port;
  qos.wire_protocol().builtin.initialPeersList.push_back(locator);
}

void set_udp(const TransportOptions& options, const std::string& interface,
             fdds::DomainParticipantQos& qos) {
  auto udp = std::make_shared<UDPv4TransportDescriptor>();
  udp->maxMessageSize = datagram_bytes(options);
  udp->sendBufferSize = kSocketBufferBytes;
  udp->receiveBufferSize = kSocketBufferBytes;
  udp->maxInitialPeersRange = options.participants_per_peer;
  if (!interface.empty()) udp->interfaceWhiteList.push_back(interface);
  qos.transport().user_transports.push_back(udp);
}

Status set_udp_peers(const TransportOptions& options, const std::string& interface,
                     fdds::DomainParticipantQos& qos) {
  auto& peers = qos.wire_protocol().builtin.initialPeersList;
  for (const std::string& peer : options.initial_peers) {
    Result<Locator_t> locator = parse_locator(peer, 0, "initial peer");
    NEARMESH_RETURN_IF_ERROR(locator);
    peers.push_back(locator.value());
  }
  // Multicast works on loopback too when the socket is bound to it, even without any route. The
  // unicast search beside it is for machines that forbid multicast; alone it would miss
  // processes that have made many participants, whose ports lie ever higher.
  if (interface.starts_with("127.")) add_udp_peer(interface, 0, qos);
  if (options.transport == Transport::kUdpOnly) {
    if (peers.empty() && options.discovery_server.empty())
      return {StatusCode::kInvalidArgument,
              "transport udp-only: expected initial peers or a discovery server (--peer, "
              "--discovery-server), since nothing is sent by multicast"};
    return Status::ok();
  }
  // Naming peers replaces the multicast search, so that must then be named too.
  if (!peers.empty())
    add_udp_peer(kDiscoveryMulticast, qos.wire_protocol().port.getMulticastPort(options.domain),
                 qos);
  return Status::ok();
}

Status set_tcp(const TransportOptions& options, const std::string& interface,
               fdds::DomainParticipantQos& qos) {
  if (options.listen_port == 0 && options.initial_peers.empty())
    return {
        StatusCode::kInvalidArgument,
        "transport tcp: expected initial peers (--peer), or a port to listen at (--listen-port)"};
  if (!options.discovery_server.empty())
    return {StatusCode::kInvalidArgument,
            "transport tcp: a discovery server is reached by UDP; expected initial peers"};
  auto tcp = std::make_shared<TCPv4TransportDescriptor>();
  tcp->sendBufferSize = kSocketBufferBytes;
  tcp->receiveBufferSize = kSocketBufferBytes;
  tcp->maxInitialPeersRange = options.participants_per_peer;
  if (options.listen_port != 0) tcp->add_listener_port(options.listen_port);
  if (!interface.empty()) tcp->interfaceWhiteList.push_back(interface);
  qos.transport().user_transports.push_back(tcp);
  const Result<std::vector<sockaddr_in>> peers = tcp_peers(options);
  NEARMESH_RETURN_IF_ERROR(peers);
  for (const sockaddr_in& peer : peers.value()) {
    Locator_t locator;
    locator.kind = LOCATOR_KIND_TCPv4;
    IPLocator::setIPv4(locator, reinterpret_cast<const octet*>(&peer.sin_addr));
    IPLocator::setPhysicalPort(locator, ntohs(peer.sin_port));
    qos.wire_protocol().builtin.initialPeersList.push_back(locator);
  }
  return Status::ok();
}

Status set_discovery_server(const TransportOptions& options, fdds::DomainParticipantQos& qos) {
  // A server of Fast DDS 2.9 does not hand on what secured programs tell of their endpoints; its
  // 2.10 does.
  if (!options.security.empty())
    return {StatusCode::kInvalidArgument,
            "discovery server: secured programs do not find each other through one; expected "
            "multicast, or initial peers (--peer)"};
  Result<Locator_t> locator =
      parse_locator(options.discovery_server, kDefaultServerPort, "discovery server");
  NEARMESH_RETURN_IF_ERROR(locator);
  add_discovery_server(qos, locator.value());
  return Status::ok();
}

}  // namespace

Result<std::vector<sockaddr_in>> tcp_peers(const TransportOptions& options) {
  std::vector<sockaddr_in> peers;
  for (const std::string& peer : options.initial_peers) {
    const Result<Locator_t> parsed = parse_locator(peer, kDefaultTcpPort, "initial peer");
    NEARMESH_RETURN_IF_ERROR(parsed);
    sockaddr_in& place = peers.emplace_back();
    place.sin_family = AF_INET;
    place.sin_port = htons(static_cast<std::uint16_t>(parsed.value().port));
    std::memcpy(&place.sin_addr, IPLocator::getIPv4(parsed.value()), sizeof place.sin_addr);
  }
  return peers;
}

Status set_transport(const TransportOptions& options, fdds::DomainParticipantQos& qos) {
  // Not the built-in ones: shared memory leaves files in /dev/shm when a process is killed, fails
  // between users, takes 10 MB a participant, and is not faster for samples of our size. Who wants
  // it says same-host.
  qos.transport().use_builtin_transports = false;
  auto& discovery = qos.wire_protocol().builtin.discovery_config;
  discovery.leaseDuration = Duration(options.lease_s);
  discovery.leaseDuration_announcementperiod = Duration(options.announcement_s);
  qos.wire_protocol().builtin.mutation_tries = kPlacesPerDomain - 1;
  // Liveliness is by participant, at the door; this would only be two more endpoints for everybody
  // to match.
  qos.wire_protocol().builtin.use_WriterLivelinessProtocol = false;
  std::string interface = options.interface.empty() && options.transport == Transport::kSameHost
                              ? kLoopback
                              : options.interface;
  if (!interface.empty()) {
    Result<std::string> address = resolve_interface(interface);
    NEARMESH_RETURN_IF_ERROR(address);
    interface = std::move(address).value();
  }
  if (options.transport == Transport::kTcp) return set_tcp(options, interface, qos);
  if (options.transport == Transport::kSameHost) {
    auto shared = std::make_shared<SharedMemTransportDescriptor>();
    shared->segment_size(static_cast<std::uint32_t>(kSharedSegmentBytes));
    qos.transport().user_transports.push_back(shared);
  }
  set_udp(options, interface, qos);
  if (!options.discovery_server.empty()) return set_discovery_server(options, qos);
  return set_udp_peers(options, interface, qos);
}

Status set_server_transport(const TransportOptions& options, const std::string& listen,
                            fdds::DomainParticipantQos& qos) {
  Result<Locator_t> locator = parse_locator(listen, kDefaultServerPort, "listen");
  NEARMESH_RETURN_IF_ERROR(locator);
  qos.transport().use_builtin_transports = false;
  set_udp(options, {}, qos);
  auto& builtin = qos.wire_protocol().builtin;
  builtin.use_WriterLivelinessProtocol = false;
  builtin.metatrafficUnicastLocatorList.push_back(locator.value());
  builtin.discovery_config.discoveryProtocol = DiscoveryProtocol::SERVER;
  builtin.discovery_config.leaseDuration = Duration(options.lease_s);
  builtin.discovery_config.leaseDuration_announcementperiod = Duration(options.announcement_s);
  // As those name it that are of 2.9.
  rtps::get_server_client_default_guidPrefix(0, qos.wire_protocol().prefix);
  return Status::ok();
}

}  // namespace nearmesh::wire
