// SPDX-License-Identifier: Apache-2.0
#pragma once
// API (docs/api.md).
// A peer's channel over Fast DDS. One thread inside makes every DDS call; the host's only puts into
// and takes from queues, so no call here waits for the network.

#include <cstddef>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "nearmesh/core/base/status.hpp"
#include "nearmesh/idl/dds/transport_options.hpp"
#include "nearmesh/subscriber/peer/channel.hpp"

namespace eprosima::fastdds::dds {
class DomainParticipant;
}

namespace nearmesh::subscriber {

struct DdsChannelOptions {
  wire::TransportOptions transport;
  /// This peer's number on the bus, unlike all others'; 0: one drawn at random.
  wire::SessionId session = 0;
  /// All bodies that the host will ever name in its session, others' and its own, where it knows
  /// them beforehand. Peers are told: of other bodies it hears a pose each five seconds alone, for
  /// the exercise's clock. Of a body that is not among them "no pose has come", or an old one.
  /// None: it may name any. By UDP without identities, on an own participant; more than 64 names
  /// count as none.
  std::optional<std::vector<std::string>> bodies;
  /// Beside `bodies`: all that the host will ever move itself. Two peers that tell both, and of
  /// which neither names a body that the other moves, are strangers: most never hear of each other
  /// (docs/network.md). A body that is moved and not told is complained of: peers that name it may
  /// wait for it in vain.
  std::vector<std::string> moves;
  /// Given by the host: used as it is (its domain, transports, lease; only prefix and heartbeat_s
  /// apply here); its QoS and listeners stay, types and topics that exist are used, and only what
  /// was made here is removed. Must outlive the channel.
  eprosima::fastdds::dds::DomainParticipant* participant = nullptr;
};

/// Samples about where bodies are, between this peer and another, since the start.
struct PoseCounts {
  std::uint64_t heard_poses = 0, heard_promises = 0, heard_near = 0;
  /// That the other wrote between two that were heard, and that never came or were displaced by
  /// later ones before they were taken. Also those that it did not send here, since none of its
  /// bodies is named here (DdsChannelOptions::bodies).
  std::uint64_t lost_poses = 0, lost_promises = 0;
  std::uint64_t sent_near = 0;  ///< to it alone; beside its heard_near, this tells what was lost
};

/// A peer's way to the bus. Make it, hand it to a Session, and forget it; take() and the rest are
/// the session's.
/// Threads: all functions, any thread.
class DdsChannel final : public Channel {
 public:
  /// What may wait for take(), each kind; the newest beyond are dropped with a complaint.
  /// Of each publisher that was asked for something, and of all others together; about 20 MB.
  static constexpr std::size_t kMaxWaitingBatches = 16384;
  static constexpr std::size_t kMaxWaitingOthers = 4096;
  static constexpr std::size_t kMaxWaitingPoses = 4 * kMaxWaitingOthers;
  static constexpr std::size_t kMaxWaitingHeaderBytes = 64U << 20;
  /// What may wait to be sent, each kind; the oldest beyond are dropped with a complaint.
  static constexpr std::size_t kMaxOutgoing = 4096;

  /// Waits until the thread has made its entities, some ten milliseconds.
  /// Errors: kInvalidArgument naming the option; kConflict when the host's participant has other
  /// types under our names; kIo when Fast DDS refuses.
  [[nodiscard]] static Result<std::unique_ptr<DdsChannel>> create(const DdsChannelOptions& options);
  /// Leaves the bus; below a second.
  ~DdsChannel() override;

  [[nodiscard]] wire::SessionId own_id() const override;
  /// Kept until a publisher can hear it. A message that check() refuses leaves a complaint.
  void send(const wire::RegionSubscription& subscription) override;
  void send(const wire::BodyPoses& poses) override;
  void send(const wire::BodyDirectory& directory) override;
  void promise(const wire::BodyPromises& promises) override;
  void send_near(const wire::NearPoses& poses) override;
  void want(const wire::WantedPoses& wanted) override;
  void send(const wire::ContactReport& report) override;
  void tell(wire::ProcessStatus& status) override;
  void tell_held(const wire::HeldDetail& held) override;
  void tell_watched(const wire::WatchedBodies& watched) override;
  void tell_bounds(const wire::BoundsReport& bounds) override;
  /// Whether somebody records what this peer says from now on. Recorders of some topics count where
  /// held_detail is one.
  [[nodiscard]] bool has_recorder() const override;
  /// Not ok once this program's identity was revoked or has expired: then it hears nobody, and
  /// nobody hears it.
  [[nodiscard]] Status identity() const;
  /// By the other's session, of the kMaxWaitingOthers that were heard last. Threads: any.
  [[nodiscard]] std::map<wire::SessionId, PoseCounts> pose_counts() const;
  /// A Hello comes out only when its publisher can hear subscriptions, so no request that follows
  /// it is lost.
  [[nodiscard]] Inbox take() override;
  /// For programs without a frame loop: blocks until take() has something, or so many seconds (at
  /// least 0) are over.
  void wait(double seconds);

 private:
  class Impl;
  explicit DdsChannel(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace nearmesh::subscriber
