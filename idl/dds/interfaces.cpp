// SPDX-License-Identifier: Apache-2.0
#include "interfaces.hpp"

#include <arpa/inet.h>
#include <ifaddrs.h>
#include <net/if.h>

#include <cstdio>
#include <fstream>
#include <memory>

namespace nearmesh::wire {

std::vector<Interface> ipv4_interfaces() {
  std::vector<Interface> found;
  ifaddrs* list = nullptr;
  if (::getifaddrs(&list) != 0) return found;
  const std::unique_ptr<ifaddrs, void (*)(ifaddrs*)> owner(list, ::freeifaddrs);
  for (const ifaddrs* entry = list; entry != nullptr; entry = entry->ifa_next) {
    if (entry->ifa_addr == nullptr || entry->ifa_addr->sa_family != AF_INET) continue;
    char address[INET_ADDRSTRLEN] = {};
    ::inet_ntop(AF_INET, &reinterpret_cast<const sockaddr_in*>(entry->ifa_addr)->sin_addr, address,
                sizeof address);
    const auto is = [&](unsigned flag) { return (entry->ifa_flags & flag) != 0; };
    found.push_back({entry->ifa_name, address, is(IFF_UP), is(IFF_RUNNING), is(IFF_LOOPBACK),
                     is(IFF_MULTICAST)});
  }
  return found;
}

bool is_connected_to(const sockaddr_in& place) {
  constexpr unsigned kEstablished = 1;
  std::ifstream connections("/proc/self/net/tcp");
  for (std::string line; std::getline(connections, line);) {
    unsigned address = 0, port = 0, state = 0;
    if (std::sscanf(line.c_str(), "%*u: %*x:%*x %x:%x %x", &address, &port, &state) == 3 &&
        address == place.sin_addr.s_addr && port == ntohs(place.sin_port) && state == kEstablished)
      return true;
  }
  return false;
}

}  // namespace nearmesh::wire
