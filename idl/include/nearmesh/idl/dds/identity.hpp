// SPDX-License-Identifier: Apache-2.0
#pragma once
// API (docs/api.md).
// A participant of a host's own on a secured bus. Participants of nearmesh's own take
// TransportOptions::security.

#include <cstdint>
#include <string>

#include "nearmesh/core/base/status.hpp"

namespace eprosima::fastdds::dds {
class DomainParticipantQos;
}  // namespace eprosima::fastdds::dds

namespace nearmesh::wire {

/// Gives the participants that are made from `qos` an identity: `folder` is one that make-security
/// made (docs/security.md) for this domain and prefix. Goes after the transports and before
/// add_door. The host's own topics are those that the identity was made with (make-security
/// --topic); Fast DDS makes no endpoint of others.
/// Errors, with `qos` as it was: kInvalidArgument for the first thing that is wrong with the
/// folder, as check-security says it, or a transport whose max_message_size is below
/// kSecuredDatagramBytes, in which no handshake has room; kConflict where the QoS has an identity
/// or a door already. Cost: reads seven files.
[[nodiscard]] Status add_identity(eprosima::fastdds::dds::DomainParticipantQos& qos,
                                  const std::string& folder, std::uint32_t domain,
                                  const std::string& prefix = "nearmesh");

/// A step of the handshake goes in one message: some 6 KB of certificates and permissions, 8 with
/// the longest names or many topics.
inline constexpr std::uint32_t kSecuredDatagramBytes = 10240;

}  // namespace nearmesh::wire
