// SPDX-License-Identifier: Apache-2.0
#pragma once
// Cyclone DDS beside programs on 127.0.0.1.

#include <cstdlib>
#include <string>

namespace nearmesh::test {

/// Loopback offers no multicast to Cyclone: found by unicast, as the Fast DDS programs find each
/// other there. In: more of its settings of the kind General. For programs that are started from
/// now on.
inline void set_cyclone_on_loopback(const std::string& general = "") {
  const std::string settings =
      "<General><Interfaces><NetworkInterface name='lo'/></Interfaces>"
      "<AllowMulticast>false</AllowMulticast>" +
      general +
      "</General><Discovery><ParticipantIndex>auto</ParticipantIndex>"
      "<Peers><Peer address='127.0.0.1'/></Peers></Discovery>";
  ::setenv("CYCLONEDDS_URI", settings.c_str(), 1);
}

/// Ours are datagrams of at most 1,400 bytes, and Fast DDS reads no larger ones than it sends.
inline constexpr const char* kDatagramsOfOurs =
    "<MaxMessageSize>1400B</MaxMessageSize><FragmentSize>1200B</FragmentSize>";

}  // namespace nearmesh::test
