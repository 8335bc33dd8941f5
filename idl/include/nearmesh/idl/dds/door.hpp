// SPDX-License-Identifier: Apache-2.0
#pragma once
// API (docs/api.md).
// The door before Fast DDS: every message that a participant is sent is checked before Fast DDS
// reads it. Participants of nearmesh's own have one; a host that brings its own participant adds it
// with one line before it makes that (docs/embed.md).

namespace eprosima::fastdds::dds {
class DomainParticipant;
class DomainParticipantQos;
}  // namespace eprosima::fastdds::dds

namespace nearmesh::wire {

/// Puts the door on every transport of the participants that are made from `qos` from now on; the
/// built-in transports become user transports that are the same. A transport that has one keeps it.
/// Cost: below a microsecond a message; one thread. Of a secured participant (properties
/// identity_ca and identity_certificate as files) the list of revoked certificates, named
/// identity_crl or beside the certificate, and the certificates' ends are looked at every
/// `identity_period_s`: who has none that counts is not heard any more (docs/security.md). Seconds,
/// above 0.
/// What changes beside what is refused: Fast DDS's own statistics of the network are not received,
/// and a participant's lease is watched here instead of by Fast DDS, whose timers can end the
/// process (docs/network.md).
void add_door(eprosima::fastdds::dds::DomainParticipantQos& qos, double identity_period_s = 10);
/// Whether each transport of the participant has one.
[[nodiscard]] bool has_door(const eprosima::fastdds::dds::DomainParticipant& participant);

}  // namespace nearmesh::wire
