// SPDX-License-Identifier: Apache-2.0
#pragma once
// Who gets which sample of a routed topic (topics.hpp): the writer's custom content filter of Fast
// DDS, over a table of our own. Readers announce one filter, which never changes; what they want is
// said by WantedPoses, and stands in the table of the session that writes. So nothing is announced
// anew when it changes. For the rooms named dds alone.

#include <fastdds/dds/topic/IContentFilter.hpp>
#include <fastdds/dds/topic/IContentFilterFactory.hpp>

#include <array>
#include <chrono>
#include <cstdint>
#include <map>
#include <mutex>
#include <set>
#include <span>
#include <utility>
#include <vector>

#include "fastdds_api.hpp"
#include "nearmesh/idl/messages/messages.hpp"

namespace nearmesh::wire {

/// What the filter is called when it is announced, and its expression, which says nothing.
inline constexpr char kRoutesFilter[] = "nearmesh.routes";
inline constexpr char kRoutesExpression[] = "routed";

/// Of one session: who wants which of its bodies, and where the sessions are whose bodies it wants.
/// A sample of which the table does not say who gets it goes to all. Threads: any.
class Routes {
 public:
  using Participant = std::array<std::uint8_t, 12>;
  [[nodiscard]] static Participant participant_of(const Handle& endpoint);

  /// Samples that this session writes from now on, until the destructor, go by this table.
  explicit Routes(SessionId own);
  ~Routes();
  Routes(const Routes&) = delete;
  Routes& operator=(const Routes&) = delete;

  /// A peer's wish, as it came from a writer of that participant: the last one of both holds, for
  /// kWantedFor_s. Anybody can write a peer's name, so what comes from elsewhere in that name
  /// changes nothing for who is meant.
  void want(const WantedPoses& wanted, const Participant& from);
  /// The session speaks through that participant. Through several, one of which may be a stranger's
  /// or its own of before it joined anew: each gets what is for it.
  void find(SessionId session, const Participant& at);
  /// Whoever spoke through that participant does not any more: in weeks there are more of them than
  /// are kept, and who is not gets all.
  void lose(const Participant& at);
  /// With a bus: nobody is known any more.
  void clear();

  /// Samples of near poses that went to each peer, since the start; of those that want none, as
  /// long as there is room.
  [[nodiscard]] std::map<SessionId, std::uint64_t> sent() const;

  /// Whether a reader there gets a sample: its bytes, as they go to the bus.
  [[nodiscard]] bool gets_near_poses(std::span<const std::uint8_t> cdr, const Participant& reader);
  [[nodiscard]] bool gets_wanted_poses(std::span<const std::uint8_t> cdr,
                                       const Participant& reader) const;

  /// Peers whose wishes are kept.
  static constexpr std::size_t kMaxPeers = 4096;
  /// Participants of one session; of one with more nobody is told from the others.
  static constexpr std::size_t kMaxPlaces = 8;

 private:
  struct Wish {
    WantedPoses wanted;
    std::chrono::steady_clock::time_point heard;
  };
  void forget_who_wants_nothing();

  const SessionId own_;
  mutable std::mutex mutex_;
  std::map<std::pair<Participant, SessionId>, Wish> wishes_;  ///< by whose they are
  std::map<SessionId, std::set<Participant>> places_;
  std::map<SessionId, std::uint64_t> sent_;
};

/// Through which writer each peer says which poses it wants. The first one keeps a peer until it is
/// gone, or has said nothing for so long that its wishes have ended: nobody else's word counts as
/// that peer's meanwhile. Not SessionBook: a router writes for all peers of its site through one
/// writer. Threads: one.
class Wishers {
 public:
  using Time = std::chrono::steady_clock::time_point;
  enum class Claim : std::uint8_t { kOwn, kOthers, kFull };
  [[nodiscard]] Claim claim(SessionId peer, const Handle& writer, Time now);
  void forget(const Handle& writer);
  void clear() { held_.clear(); }

  /// Peers of one writer.
  static constexpr std::size_t kMaxOfOne = 1024;

 private:
  struct Held {
    Handle writer;
    Time heard;
  };
  std::map<SessionId, Held> held_;  ///< at most Routes::kMaxPeers
};

/// Makes the filter of every routed topic, for any participant; lives as long as the process.
[[nodiscard]] fdds::IContentFilterFactory& routes_filters();

}  // namespace nearmesh::wire
