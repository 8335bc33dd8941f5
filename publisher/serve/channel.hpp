// SPDX-License-Identifier: Apache-2.0
#pragma once
// How the publisher service reaches its peers. Two implementations: DDS (dds_channel.cpp) and one
// in memory, in the tests, that loses and reorders at will. Service logic knows only this.

#include <string>
#include <vector>

#include "nearmesh/idl/messages/messages.hpp"

namespace nearmesh::publisher {

/// What came since it was taken last.
struct Inbox {
  /// Lease over, or left; all of it before the subscriptions: a peer that is among both was lost
  /// and is there again.
  std::vector<wire::SessionId> lost_peers;
  /// Valid ones, in order of arrival.
  std::vector<wire::RegionSubscription> subscriptions;
  /// Other publishers: those that are gone, and what others said since.
  std::vector<wire::SessionId> lost_rivals;
  std::vector<wire::Hello> rivals;
};

class Channel {
 public:
  virtual ~Channel() = default;

  /// Announces what is served; late joiners get it too.
  virtual void announce(const wire::Hello& hello, const std::vector<wire::MeshHeader>& headers) = 0;
  [[nodiscard]] virtual Inbox take() = 0;
  /// Sends to one peer. False when it could not be taken now: the caller keeps the batch and tries
  /// again.
  [[nodiscard]] virtual bool send(wire::SessionId peer, const wire::SplitBatchMessage& batch) = 0;
  /// What a peer that is there calls itself, for people; "" where that is not known.
  [[nodiscard]] virtual std::string name_of(wire::SessionId) const { return {}; }
  /// Blocks until something arrived or the time is over.
  virtual void wait(double seconds) = 0;
  /// What this process knows of itself, for operators. The channel adds its name, and what it knows
  /// of the network.
  virtual void tell(wire::ProcessStatus&) {}
  /// One line each since the last call: malformed samples, other wire versions, incompatible QoS,
  /// limits reached.
  [[nodiscard]] virtual std::vector<std::string> take_complaints() { return {}; }
};

}  // namespace nearmesh::publisher
