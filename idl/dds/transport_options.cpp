// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/idl/dds/transport_options.hpp"

namespace nearmesh::wire {

const char* to_string(Transport transport) {
  switch (transport) {
    case Transport::kLan:
      return "lan";
    case Transport::kThin:
      return "thin";
    case Transport::kTcp:
      return "tcp";
    case Transport::kUdpOnly:
      return "udp-only";
    case Transport::kSameHost:
      return "same-host";
  }
  return "unknown";
}

std::optional<Transport> transport_of(std::string_view name) {
  for (const Transport transport : kTransports)
    if (name == to_string(transport)) return transport;
  return std::nullopt;
}

TransportOptions preset_of(Transport transport) {
  TransportOptions options;
  options.transport = transport;
  if (transport == Transport::kThin) {
    // A life sign of one participant is some 500 bytes to each other one; a heartbeat some 100 for
    // each stream that is behind. Ten participants on 0.25 Mbit/s would spend a tenth of it at the
    // built-in pace.
    options.announcement_s = 3;
    options.silence_s = 10;
    options.heartbeat_s = 0.3;
  }
  // The kernel tells of a connection that broke, but a busy one delays life signs behind data.
  if (transport == Transport::kTcp) options.silence_s = 10;
  return options;
}

}  // namespace nearmesh::wire
