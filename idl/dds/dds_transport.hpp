// SPDX-License-Identifier: Apache-2.0
#pragma once
// Turns TransportOptions into what Fast DDS wants to know of transports and discovery.

#include <netinet/in.h>

#include <string>
#include <vector>

#include "fastdds_api.hpp"
#include "nearmesh/core/base/status.hpp"
#include "nearmesh/idl/dds/identity.hpp"
#include "nearmesh/idl/dds/transport_options.hpp"

namespace nearmesh::wire {

/// Below the usual MTU with room for IP, UDP and a tunnel: nothing fragments at IP level, where one
/// lost fragment costs the whole datagram.
inline constexpr std::uint32_t kMaxDatagramBytes = 1400;
/// With security the kernel cuts a handshake, and also a full batch (1,535 bytes with its
/// protection).
[[nodiscard]] inline std::uint32_t datagram_bytes(const TransportOptions& options) {
  return options.security.empty() ? kMaxDatagramBytes : kSecuredDatagramBytes;
}

/// The initial peers of transport tcp.
/// Errors: kInvalidArgument naming the one that is no address.
[[nodiscard]] Result<std::vector<sockaddr_in>> tcp_peers(const TransportOptions& options);

/// Sets transports, initial peers, discovery, lease and life signs.
/// Errors: kInvalidArgument naming the option and what was expected.
[[nodiscard]] Status set_transport(const TransportOptions& options,
                                   fdds::DomainParticipantQos& qos);

/// The same of a discovery server that is found at `listen`, "ADDRESS" or "ADDRESS:PORT".
[[nodiscard]] Status set_server_transport(const TransportOptions& options,
                                          const std::string& listen,
                                          fdds::DomainParticipantQos& qos);

}  // namespace nearmesh::wire
