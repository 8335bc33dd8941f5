// SPDX-License-Identifier: Apache-2.0
#pragma once
// Which of several publishers of one content a peer asks: the one that it prefers most.

#include "core/base/hash.hpp"
#include "nearmesh/idl/messages/messages.hpp"

namespace nearmesh::subscriber {

/// Rendezvous hashing: peers spread evenly over the publishers without a word between them, a
/// publisher that comes or goes moves its own share of them alone, and no number that a publisher
/// may give itself draws all of them. Source: Thaler and Ravishankar, Using name-based mappings to
/// increase hit rates, IEEE/ACM Trans. Networking 6 (1998).
[[nodiscard]] constexpr std::uint64_t preference(wire::SessionId peer, wire::SessionId publisher) {
  return mix(mix(peer) ^ publisher);
}

}  // namespace nearmesh::subscriber
