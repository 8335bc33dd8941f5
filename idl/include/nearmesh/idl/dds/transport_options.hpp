// SPDX-License-Identifier: Apache-2.0
#pragma once
// API (docs/api.md).
// How a process joins the bus. No Fast DDS here.

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace nearmesh::wire {

/// How bytes travel, by name. All of UDP in datagrams of at most 1,400 bytes.
enum class Transport : std::uint8_t {
  kLan,  ///< UDP; others are found by multicast, and at initial_peers
  /// As kLan, with fewer life signs and repairs, for links below some 2 Mbit/s (see preset_of).
  kThin,
  kTcp,       ///< TCP: whoever has a listen_port is reached by those that name it in initial_peers
  kUdpOnly,   ///< UDP, and nothing is sent by multicast: needs initial_peers or a discovery server
  kSameHost,  ///< shared memory, beside UDP over loopback; leaves files in /dev/shm when killed
};
inline constexpr Transport kTransports[] = {Transport::kLan, Transport::kThin, Transport::kTcp,
                                            Transport::kUdpOnly, Transport::kSameHost};
/// "lan", "thin", "tcp", "udp-only", "same-host".
[[nodiscard]] const char* to_string(Transport transport);
[[nodiscard]] std::optional<Transport> transport_of(std::string_view name);

/// Who joins holds them to their ranges, and names the one that is not in its own
/// (DdsChannel::create).
struct TransportOptions {
  /// What this process is called in logs, status and recordings, for people: 1 to 63 bytes of
  /// printable ASCII without blanks at the ends. "" for HOST/PROCESS.
  std::string name;
  std::uint32_t domain = 0;         ///< DDS domain, 0 to 232
  std::string prefix = "nearmesh";  ///< of every topic; see check_prefix
  Transport transport = Transport::kLan;
  /// "" for all; or one IPv4 address or interface name of this machine. A loopback address needs no
  /// network at all: participants then find each other by unicast, up to participants_per_peer on
  /// one machine and domain.
  std::string interface;
  /// Folder of this program's identity (docs/security.md): joins with it, and hears nobody without
  /// one. "" for none.
  std::string security;
  /// IPv4 addresses to look for publishers or peers at, where multicast does not get through; with
  /// kTcp "ADDRESS" or "ADDRESS:PORT" of who listens (kDefaultTcpPort).
  std::vector<std::string> initial_peers;
  /// "ADDRESS" or "ADDRESS:PORT" of a Fast DDS discovery server (id 0; kDefaultServerPort), through
  /// which alone others are then found. "": none.
  std::string discovery_server;
  std::uint16_t listen_port = 0;  ///< of kTcp; 0: does not listen
  /// How many are looked for at each such address, 1 to 120.
  std::uint32_t participants_per_peer = 16;
  /// A process silent for so long is forgotten: it joins anew; seconds, at least 2 announcement_s.
  double lease_s = 20;
  /// A process silent for so long is taken for lost, until it is heard again; above announcement_s.
  /// Needs a door (door.hpp).
  double silence_s = 3;
  double announcement_s = 1;  ///< period of life signs; seconds, above 0
  /// How often all certificates are looked at, where there is security: expired, or revoked?
  /// Seconds, above 0.
  double identity_period_s = 10;
  /// How soon a lost datagram is noticed; seconds, above 0. Fast DDS's own 3 s stall streams.
  double heartbeat_s = 0.1;
};
inline constexpr std::uint16_t kDefaultTcpPort = 5100;
inline constexpr std::uint16_t kDefaultServerPort = 11811;

/// The options of a transport, the rest as built in: what a preset sets is what differs here.
[[nodiscard]] TransportOptions preset_of(Transport transport);

}  // namespace nearmesh::wire
