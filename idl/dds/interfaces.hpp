// SPDX-License-Identifier: Apache-2.0
#pragma once
// The network interfaces of this machine, as they are now.

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

}  // namespace nearmesh::wire
