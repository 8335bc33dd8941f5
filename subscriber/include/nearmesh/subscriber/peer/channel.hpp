// SPDX-License-Identifier: Apache-2.0
#pragma once
// API (docs/api.md).
// How a peer reaches publishers and other peers. Two implementations: DDS (dds_channel.cpp), whose own thread makes every
// DDS call so that the host's never does, and one in memory for tests. All functions are non-blocking.

#include <vector>

#include "nearmesh/idl/messages/messages.hpp"

namespace nearmesh::subscriber {

class Channel {
 public:
  virtual ~Channel() = default;

  [[nodiscard]] virtual wire::SessionId own_id() const = 0;
  /// Batches that answer it are acknowledged by the channel, as they come and with the window named here: the publisher learns
  /// the pace of the link that way, not of the host's frames.
  virtual void send(const wire::RegionSubscription& subscription) = 0;
  virtual void send(const wire::BodyPose& pose) = 0;
  virtual void send(const wire::ContactReport& report) = 0;

  /// What this process knows of itself, for operators. The channel adds what it knows of the network.
  virtual void tell(wire::ProcessStatus&) {}

  /// Everything valid that arrived since the last call, in order of arrival within each kind.
  struct Inbox {
    std::vector<wire::SessionId>
        lost_publishers;  ///< take these first: no hello of one lost after it is in here
    std::vector<wire::Hello> hellos;
    std::vector<wire::MeshHeader> headers;
    std::vector<wire::SplitBatchMessage> batches;
    std::vector<wire::BodyPose> poses;  ///< of bodies that others move
    std::vector<std::string>
        complaints;  ///< one line each: malformed samples, other wire versions, incompatible QoS
  };
  [[nodiscard]] virtual Inbox take() = 0;
};

}  // namespace nearmesh::subscriber
