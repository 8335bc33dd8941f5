// SPDX-License-Identifier: Apache-2.0
// Joins a bus on the loopback interface, finds nobody there, and leaves.

#include <cstdio>

#include "nearmesh/subscriber/dds/dds_channel.hpp"

int main() {
  nearmesh::subscriber::DdsChannelOptions options;
  options.transport.prefix = "nearmesh_consumer_test";
  options.transport.interface = "127.0.0.1";
  const auto channel = nearmesh::subscriber::DdsChannel::create(options);
  if (!channel.is_ok()) {
    std::fprintf(stderr, "%s\n", channel.status().message().c_str());
    return 1;
  }
  const auto inbox = channel.value()->take();
  std::printf("peer %016llx hears %zu publishers\n",
              static_cast<unsigned long long>(channel.value()->own_id()), inbox.hellos.size());
  return inbox.hellos.empty() ? 0 : 1;
}
