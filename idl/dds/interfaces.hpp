// SPDX-License-Identifier: Apache-2.0
#pragma once
// The network interfaces and connections of this machine, as they are now.

#include <netinet/in.h>

#include <string>
#include <vector>

namespace nearmesh::wire {

struct Interface {
  std::string name, address;  ///< IPv4; an interface with several addresses is there once for each
  bool is_up = false;
  bool is_running = false;  ///< up, and its link too: Fast DDS 2.9 uses no others
  bool is_loopback = false;
  bool has_multicast = false;
};
/// In the kernel's order; empty where it does not tell.
[[nodiscard]] std::vector<Interface> ipv4_interfaces();

/// Whether any process here has a TCP connection to this place; false where the kernel does not
/// tell.
[[nodiscard]] bool is_connected_to(const sockaddr_in& place);

}  // namespace nearmesh::wire
