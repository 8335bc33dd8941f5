// SPDX-License-Identifier: Apache-2.0
#pragma once
// API (docs/api.md).
// How a session reaches publishers and other peers. DdsChannel (subscriber/dds/dds_channel.hpp)
// does it over DDS: its own thread makes every DDS call, so that the host's never does.
// LocalChannel (local_channel.hpp) needs no network. A host may write one of its own.

#include <map>
#include <string>
#include <vector>

#include "nearmesh/idl/messages/messages.hpp"

namespace nearmesh::subscriber {

/// What a session says goes out through these functions, what it hears comes out of take().
/// Messages that a channel hands over must pass wire::check(); times in them are seconds on the
/// exercise's clock.
/// Threads: a session calls one at a time, from the thread of its own caller. No function may block
/// or throw anything but std::bad_alloc: what it throws comes out of the session's call, and is
/// that session's end (Session::update).
class Channel {
 public:
  virtual ~Channel() = default;

  /// This peer's number: never 0, and the same as long as the channel lives.
  [[nodiscard]] virtual wire::SessionId own_id() const = 0;
  /// Batches that answer it are acknowledged by the channel, as they come and with the window named
  /// here: the publisher learns the pace of the link that way, not of the host's frames.
  virtual void send(const wire::RegionSubscription& subscription) = 0;
  /// After the directory that names these bodies.
  virtual void send(const wire::BodyPoses& poses) = 0;
  /// Holds from now on, also for who joins later.
  virtual void send(const wire::BodyDirectory& directory) = 0;
  /// The same. After the directory that names these bodies.
  virtual void promise(const wire::BodyPromises&) {}
  /// For those peers alone that want some of these bodies, and for recorders.
  virtual void send_near(const wire::NearPoses&) {}
  /// For the mover that it names.
  virtual void want(const wire::WantedPoses&) {}
  /// An answer about a pair, for whoever listens.
  virtual void send(const wire::ContactReport& report) = 0;

  /// How long a channel may work that answers requests itself, until this is called again, seconds.
  /// One that has waited long takes what needs_s() says in any case.
  virtual void allow(double) {}
  /// What it will take of the caller's time however little the next allow() gives, seconds: so that
  /// it can be set aside.
  [[nodiscard]] virtual double needs_s() const { return 0; }
  /// What this process knows of itself, for operators. The channel adds what it knows of the
  /// network.
  virtual void tell(wire::ProcessStatus&) {}
  /// Whether somebody records: then all that answers rest on is to go out, wanted by peers or not.
  [[nodiscard]] virtual bool has_recorder() const { return false; }
  /// What this peer holds of a model, for a recorder that came (Inbox::recorder_came).
  virtual void tell_held(const wire::HeldDetail&) {}

  /// Which bodies this peer watches all pairs of, for whoever records. Holds from now on, also for
  /// who joins later.
  virtual void tell_watched(const wire::WatchedBodies&) {}
  /// What bounds prove free of these, for whoever records. After the poses that it is about.
  virtual void tell_bounds(const wire::BoundsReport&) {}

  /// A header, and the publisher that sent it: the channel knows that it did, whatever the header
  /// says.
  struct Header {
    wire::SessionId publisher = 0;
    wire::MeshHeader message;
  };

  /// Everything valid that arrived since the last call, in order of arrival within each kind.
  struct Inbox {
    /// Take these first: no hello of one lost after it is in here.
    std::vector<wire::SessionId> lost_publishers;
    std::vector<wire::Hello> hellos;
    std::vector<Header> headers;        ///< of publishers whose hello came before
    std::uint64_t refused_headers = 0;  ///< that no publisher is known to have sent, by now
    /// Samples of poses, promises and directories in the name of a peer that another participant is
    std::uint64_t refused_poses = 0;
    std::vector<wire::SplitBatchMessage> batches;
    /// A body that another moves, told when its poses begin to count and when it is another one.
    struct Told {
      wire::BodyDirectory::Body body;
      bool is_gone = false;  ///< its mover has removed it
    };
    std::vector<Told> bodies;  ///< take these before the poses
    /// Too many would have waited: what was told before is void, and whoever is not among `bodies`
    /// is gone.
    bool are_all_bodies = false;
    /// Of bodies that others move. Of one whose mover has left or removed it since, nothing of
    /// before: another of its name may be there.
    std::vector<wire::BodyPose> poses;
    std::vector<wire::BodyPromise> promises;
    std::vector<wire::WantedPoses> wanted;  ///< of bodies that this peer moves
    /// Bodies whose movers left, fell silent or came back since the last call: what holds now. Take
    /// these after poses and promises.
    std::map<std::string, wire::Mover> movers;
    bool are_all_movers = false;  ///< the same: who is not among them has left
    bool recorder_came = false;   ///< one that may have missed what came before
    /// One line each: malformed samples, other wire versions, incompatible QoS.
    std::vector<std::string> complaints;
  };
  [[nodiscard]] virtual Inbox take() = 0;
};

}  // namespace nearmesh::subscriber
