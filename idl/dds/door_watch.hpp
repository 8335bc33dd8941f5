// SPDX-License-Identifier: Apache-2.0
#pragma once
// What the doors of one participant share: who is known, what was refused, and the thread that lets
// leases end.

#include <array>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <memory>
#include <mutex>
#include <new>
#include <optional>
#include <string>
#include <thread>
#include <unordered_map>
#include <variant>
#include <vector>

#include "core/base/lru_map.hpp"
#include "discovery_pace.hpp"
#include "idl/security/identity_book.hpp"
#include "mailbox.hpp"
#include "participant_book.hpp"
#include "pose_hearers.hpp"
#include "told_bodies.hpp"

namespace nearmesh::wire {

/// Where the watch tells Fast DDS that a participant has left.
class LeaseEnd {
 public:
  /// Throws std::bad_alloc: then it may be told again, as a later word of the same participant.
  virtual void end(std::span<const std::uint8_t> farewell) = 0;

 protected:
  ~LeaseEnd() = default;
};

/// What holds of the participant.
struct DoorRules {
  /// Discovery without a server, where each participant speaks for itself alone. Then leases end
  /// here.
  bool is_plain = false;
  bool by_udp_alone = false, by_tcp_alone = false;
  double announcement_s = 1;         ///< period of its announcements
  double identity_period_s = 10;     ///< between two looks at identities
  std::optional<ToldBodies> bodies;  ///< that it tells of, if it does; where it is_plain
};

/// Of a secured participant it also looks whose certificate still counts. Fast DDS 2.9 asks that
/// once, in the handshake, and reads the revocation list when the participant is made. Here each
/// handshake's certificate is noted, one for each participant, and looked at again every period:
/// whose is revoked or has expired is barred. Where it is the own one, nobody is heard any more.
/// Where there is no memory for what its thread does, that is said, and done a moment later.
/// Threads: all functions, any thread.
class DoorWatch {
 public:
  /// `identities`: nullptr for a participant without one.
  DoorWatch(const DoorRules& rules, std::unique_ptr<IdentityBook> identities);
  ~DoorWatch();
  DoorWatch(const DoorWatch&) = delete;
  DoorWatch& operator=(const DoorWatch&) = delete;

  [[nodiscard]] bool ends_leases() const { return rules_.is_plain; }
  /// Whether repeats of discovery are left out: by UDP, where each comes by two ways. Beside
  /// identities Fast DDS itself waits for announcements, to begin handshakes anew; in shared memory
  /// one place may be several participants'.
  [[nodiscard]] bool paces() const {
    return rules_.is_plain && rules_.by_udp_alone && identities_ == nullptr;
  }
  /// Whether others are answered by the connection of TCP by which they were heard first, wherever
  /// they say that they are, and each transport has a name of its own (Door). Beside identities
  /// Fast DDS 3.1 also announces itself enciphered.
  [[nodiscard]] bool answers_by_connection() const {
    return rules_.is_plain && rules_.by_tcp_alone && identities_ == nullptr;
  }
  /// Poses that this writer (its entity) tells are of these bodies alone: whoever names none of
  /// them needs few (PoseHearers).
  void tell_moved(std::uint32_t writer, const std::vector<std::string>& bodies);
  /// Takes away places that need not be told now (DiscoveryPace), or of poses (PoseHearers).
  /// place_of(place): as RTPS writes it. Where there is no memory to remember what was told, all
  /// are told.
  template <class Places, class PlaceOf>
  void leave_out(std::span<const std::uint8_t> message, Places& places, PlaceOf place_of) {
    const std::optional<DiscoveryWord> word = discovery_word(message);
    const std::chrono::duration<double> now = std::chrono::steady_clock::now().time_since_epoch();
    const std::lock_guard lock(pace_mutex_);
    if (!word) {
      if (hearers_.is_poses(message))
        std::erase_if(places, [&](const auto& place) {
          return !hearers_.may_go(place_of(place), now.count());
        });
      return;
    }
    std::erase_if(places, [&](const auto& place) {
      try {
        return !pace_.may_go(*word, place_of(place), now.count());
      } catch (const std::bad_alloc&) {
        return false;
      }
    });
  }
  /// It listens at one more UDP port of its own.
  void note_own_port() { ++own_ports_; }
  [[nodiscard]] int own_ports() const { return own_ports_; }
  /// Checks a message, and counts it where it is refused. May throw std::bad_alloc: then the
  /// message is lost, and may come again.
  [[nodiscard]] RtpsVerdict check(std::span<const std::uint8_t> message, const MessageSource& from);
  void count(DoorRefusal refusal);
  /// To be held while a message that introduces is handed on. Fast DDS 2.9 fills in one set of
  /// proxies, shared by all its threads and without a lock, when it matches the endpoints of
  /// handshakes and of keys (mended later: eProsima/Fast-DDS pull request 3362). Where two
  /// participants are heard of in one moment, by multicast and by unicast, one of them is matched
  /// twice, the other never.
  [[nodiscard]] std::mutex& introductions() { return introductions_; }
  [[nodiscard]] std::array<std::uint64_t, kDoorRefusals> refused() const;
  /// As ParticipantBook::is_silent.
  [[nodiscard]] std::optional<bool> is_silent(const ParticipantKey& participant,
                                              double silence_s) const;

  /// Its identity does not count any more.
  [[nodiscard]] bool is_barred(const ParticipantKey& participant) const;
  /// Why this program's own identity does not count any more, a line; "": it does.
  [[nodiscard]] std::string own_end() const;

  void add(LeaseEnd* end);
  void remove(LeaseEnd* end);
  /// Where it is said what was refused, one line a second at most, whose identity has ended, and
  /// want of memory; nullptr: nowhere.
  void set_mailbox(Mailbox* mailbox);
  void complain_of_memory() noexcept;

 private:
  static constexpr std::size_t kMaxCertificates = 16384;
  /// What was said already; who tries on is remembered.
  using Said = LruMap<std::string, std::monostate>;
  static constexpr std::size_t kMaxSaid = 16384;
  void run();
  void tick(double passed_s);
  void tell_ends();
  [[nodiscard]] bool keeps_out(const RtpsVerdict& newcomer);
  void note_for_pace(const RtpsVerdict& message, bool was_known);
  void say_what_was_refused();
  void say(std::string line);
  void say_once(Said& said, const std::string& what, std::string line);
  [[nodiscard]] std::optional<DoorRefusal> judge_handshake(const RtpsVerdict& message);
  [[nodiscard]] bool has_room_for_certificate();
  void judge_release(const RtpsVerdict& message);
  void refuse_identity(const IdentityFacts& facts, const std::string& fault);
  void look_at_identities();

  const DoorRules rules_;
  const std::unique_ptr<IdentityBook> identities_;
  double looked_s_ = 0;                      ///< since identities were looked at; the thread's own
  std::vector<ParticipantBook::Gone> gone_;  ///< whose end is not told yet; the thread's own
  mutable std::mutex mutex_;                 ///< of the book and the thread
  /// That counted when they came.
  std::unordered_map<ParticipantKey, IdentityFacts, ParticipantKeyHash> certificates_;
  std::string own_end_;
  std::atomic<bool> has_ended_ = false;  ///< own_end_ is set
  ParticipantBook book_;
  std::mutex pace_mutex_;  ///< of both below; taken with mutex_ held, not the other way round
  DiscoveryPace pace_;
  PoseHearers hearers_;
  std::array<std::atomic<std::uint64_t>, kDoorRefusals> refused_{};
  std::atomic<int> own_ports_ = 0;
  std::atomic<std::uint32_t> gap_turn_ = 0;  ///< gaps that were cut
  std::mutex introductions_;
  std::mutex ends_mutex_;
  std::vector<LeaseEnd*> ends_;
  std::mutex complain_mutex_;
  Mailbox* mailbox_ = nullptr;
  Said refused_serials_{kMaxSaid}, of_other_releases_{kMaxSaid};
  std::array<std::uint64_t, kDoorRefusals> said_{};
  std::condition_variable condition_;
  bool ending_ = false;
  std::thread thread_;
};

/// The watch of a participant's doors; nullptr where a transport of it has none.
[[nodiscard]] std::shared_ptr<DoorWatch> door_watch_of(
    const eprosima::fastdds::dds::DomainParticipantQos& qos);

}  // namespace nearmesh::wire
