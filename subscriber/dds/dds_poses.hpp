// SPDX-License-Identifier: Apache-2.0
#pragma once
// Whose poses of a body count: those of the peer that moved it first, until that is gone. What a
// pose's number stands for, the directory of the same peer and participant says. The same holds for
// promises. A peer is known by the writer of its directory, whichever of its writers speaks. A
// session is who spoke for it first, until that is gone: numbers of bodies, of links and of samples
// are the session's, so what a stranger says in its name would stand among them.
// Fast DDS: for the rooms named dds alone.

#include <algorithm>
#include <cstdint>
#include <deque>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <tuple>
#include <utility>
#include <variant>
#include <vector>

#include "core/base/lru_map.hpp"
#include "idl/dds/body_book.hpp"
#include "idl/dds/listeners.hpp"
#include "idl/dds/routes.hpp"
#include "nearmesh/subscriber/peer/channel.hpp"

namespace nearmesh::subscriber {

using Participant = wire::Routes::Participant;
/// A part of a peer's bodies, as one participant tells of it.
using PartKey = std::tuple<Participant, wire::SessionId, std::uint32_t>;

/// Threads: one. The mailbox must outlive it.
class DdsPoses {
 public:
  struct Heard {
    wire::BodyPoses poses;
    wire::Handle writer;
    bool is_near = false;  ///< of the topic of near poses
  };
  struct HeardPromises {
    wire::BodyPromises promises;
    wire::Handle writer;
  };
  struct HeardDirectory {
    wire::BodyDirectory directory;
    wire::Handle writer;
  };
  /// Parts known of one writer of directories, and of all; as many may wait for theirs.
  static constexpr std::size_t kMaxPartsOfOne = 1024, kMaxParts = 16384;
  static constexpr std::size_t kMaxStrangers = 256;
  static constexpr std::size_t kMaxAbsent = 256;  ///< writers of directories that went

  DdsPoses(wire::Mailbox& mailbox, std::string topic, bool is_secured)
      : mailbox_(mailbox), topic_(std::move(topic)), is_secured_(is_secured), bodies_(is_secured) {}

  /// Directories that came since the last call; before the poses.
  void take_directories(const std::vector<wire::ReaderListener::Match>& matches,
                        std::vector<HeardDirectory> heard, bool more);
  /// What came since the last call; `more`: some of it was not read yet. Out: the poses that count,
  /// in order. One line for each body that another claims.
  [[nodiscard]] std::vector<wire::BodyPose> take(std::vector<Heard> heard, bool more);
  /// Promises that came since the last call; before the poses. Out: as of poses, of
  /// take_promises().
  void hear_promises(std::vector<HeardPromises> heard);
  /// Those that count, in order, since the last call; after take().
  [[nodiscard]] std::vector<wire::BodyPromise> take_promises() {
    return std::exchange(promises_, {});
  }
  /// Through which participant each session moves bodies.
  [[nodiscard]] std::vector<std::pair<wire::SessionId, wire::Handle>> take_movers() {
    return std::exchange(new_movers_, {});
  }
  /// Whether nobody else than this writer's participant speaks for the session. On a secured bus
  /// all programs of an identity may.
  [[nodiscard]] bool may_speak_for(wire::SessionId session, const wire::Handle& writer) const;
  /// Samples in the name of a session that another speaks for, since the last call.
  [[nodiscard]] std::uint64_t take_refused() { return std::exchange(refused_, 0); }
  /// With a bus: nobody is known any more.
  void clear();
  /// Adds what became of the bodies' movers since the last call: of each what holds now. Where more
  /// than `most` would wait, all that are there take their place: nothing is lost however long the
  /// host takes nothing.
  void tell_movers(Channel::Inbox& inbox, std::size_t most = wire::BodyBook::kMaxOfAll);
  /// The same of bodies whose poses count that came, went or became other ones.
  void tell_bodies(Channel::Inbox& inbox, std::size_t most = wire::BodyBook::kMaxOfAll);
  /// Bodies that somebody moved and moves no more, since the last call: what was said of them
  /// before take() counts no more.
  [[nodiscard]] std::set<std::string> take_ended() { return std::exchange(ended_, {}); }

 private:
  struct Moved {
    wire::Handle writer;
    wire::SessionId session = 0;
    wire::BodyDirectory::Body body;
    wire::Mover mover = wire::Mover::kNone;  ///< as was told
  };
  struct Part {
    wire::Handle writer;
    std::vector<wire::BodyDirectory::Body> bodies;
    bool is_absent = false;  ///< its writer is: nothing is named by it until that is found again
  };
  /// One body's pose, and who the body is.
  struct Named {
    wire::BodyPose pose;
    wire::Handle writer;
    wire::BodyDirectory::Body body;
  };
  struct NamedPromise {
    wire::BodyPromise promise;
    wire::Handle writer;
    wire::BodyDirectory::Body body;
  };
  /// What was said last of parts whose directory has not come. Of parts that are gone none comes
  /// any more, and in weeks there are many: those that wait for longest make room.
  template <class Message>
  using UnnamedParts = LruMap<PartKey, Message, Participant>;  ///< by participant
  [[nodiscard]] Participant speaker_of(const wire::Handle& writer) const;
  /// As may_speak_for(); from now on if not before. Where not, that is counted, and said once of
  /// each.
  [[nodiscard]] bool claim_session(wire::SessionId session, const wire::Handle& writer);
  /// What is known of a body, and who tells it; nullptrs where nothing is.
  [[nodiscard]] std::pair<const wire::BodyDirectory::Body*, const Part*> find(
      const wire::Handle& writer, wire::SessionId peer, std::uint32_t number) const;
  /// Whether this writer moves the body, from now on if not before.
  [[nodiscard]] bool is_of_mover(const wire::BodyDirectory::Body& body, wire::SessionId peer,
                                 const wire::Handle& writer);
  void name(HeardPromises&& heard);
  void accept(NamedPromise&& heard);
  [[nodiscard]] static PartKey key_of(const wire::Handle& writer, wire::SessionId peer,
                                      std::uint32_t part);
  void know(HeardDirectory&& heard);
  void lose_teller(const wire::Handle& writer, bool is_barred);
  void find_teller(const wire::Handle& writer);
  void forget_teller(wire::Handle writer);
  [[nodiscard]] bool is_absent(const wire::Handle& writer) const;
  void name(Heard&& heard, std::vector<wire::BodyPose>& accepted);
  void change_bodies(wire::SessionId peer, const Part& before,
                     const std::vector<wire::BodyDirectory::Body>& now);
  void accept(Named&& heard, std::vector<wire::BodyPose>& accepted);
  void accept_contested(std::vector<wire::BodyPose>& accepted);
  void tell(const std::string& body, Moved& moved, wire::Mover now);
  [[nodiscard]] std::set<std::string> lose(const wire::Handle& writer, wire::Mover how);

  wire::Mailbox& mailbox_;
  const std::string topic_;
  const bool is_secured_;
  wire::BodyBook bodies_;
  LruMap<wire::SessionId, std::monostate, Participant> sessions_{kMaxPartsOfOne,
                                                                 kMaxParts};  ///< by speaker
  LruMap<std::pair<wire::SessionId, Participant>, std::monostate> strangers_{
      kMaxStrangers};  ///< of whom that was said
  std::uint64_t refused_ = 0;
  /// Not yet forgotten, and how they went.
  std::vector<std::pair<wire::Handle, wire::Mover>> gone_movers_;
  std::map<std::string, Named> contested_;  ///< of bodies that another owns, the latest
  std::map<std::string, NamedPromise> contested_promises_;
  UnnamedParts<HeardPromises> unnamed_promises_{kMaxPartsOfOne, kMaxParts};  ///< the part is theirs
  std::vector<wire::BodyPromise> promises_;                                  ///< that count
  std::vector<std::pair<wire::SessionId, wire::Handle>> new_movers_;
  std::map<PartKey, Part> parts_;
  std::map<wire::Handle, std::size_t> part_counts_;  ///< by writer of directories
  UnnamedParts<Heard> unnamed_{kMaxPartsOfOne, kMaxParts};
  std::vector<PartKey> told_parts_;  ///< whose directory came since poses were named
  std::vector<std::pair<wire::Handle, bool>> gone_tellers_;  ///< and whether each was barred
  /// Writers of directories that fell silent or left, the first to go first. What they told is
  /// kept: Fast DDS says it once, and they may be found again.
  std::deque<wire::Handle> absent_;
  std::set<wire::Handle> over_full_;  ///< of whom that was said
  std::vector<Channel::Inbox::Told> told_;
  bool has_released_ = false;  ///< a body, since poses were taken
  /// Sessions that move bodies, by participant. Several may speak through one, as those of another
  /// site do through a router.
  LruMap<std::pair<wire::SessionId, Participant>, std::monostate, Participant> sources_{
      kMaxPartsOfOne, kMaxParts};
  std::map<std::string, Moved> moved_;  ///< bodies whose poses count
  std::map<std::string, wire::Mover> changes_;
  std::set<std::string> ended_;
};

}  // namespace nearmesh::subscriber
