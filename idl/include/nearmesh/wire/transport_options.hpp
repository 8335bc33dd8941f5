// SPDX-License-Identifier: Apache-2.0
#pragma once
// How a process joins the bus. No Fast DDS here.

#include <cstdint>
#include <string>
#include <vector>

namespace nearmesh::wire {

struct TransportOptions {
  std::uint32_t domain = 0;         ///< DDS domain, 0 to 232
  std::string prefix = "nearmesh";  ///< of every topic; see check_prefix
  /// "" for all; or one IPv4 address or interface name of this machine. A loopback address needs no
  /// network at all: participants then find each other by unicast, up to loopback_peers of them on
  /// one machine and domain.
  std::string interface;
  /// Folder of this program's identity (docs/security.md): joins with it, and hears nobody without one. "" for none.
  std::string security;
  /// IPv4 addresses to look for publishers or peers at, where multicast does not get through.
  std::vector<std::string> initial_peers;
  std::uint32_t participants_per_peer = 16;  ///< how many are looked for at each such address
  double lease_s = 3;                        ///< a process silent for so long is lost
  double announcement_s = 1;                 ///< period of life signs; below lease_s / 2
  double heartbeat_s =
      0.1;  ///< how soon a lost datagram is noticed; Fast DDS' own 3 s stall streams
};

}  // namespace nearmesh::wire
