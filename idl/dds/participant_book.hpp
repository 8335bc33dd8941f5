// SPDX-License-Identifier: Apache-2.0
#pragma once
// Who speaks on the bus: from where, when last, and whether a newcomer may come in now. No Fast
// DDS, no clock: time is ticked.

#include <cstdint>
#include <deque>
#include <map>
#include <optional>
#include <random>
#include <unordered_map>
#include <unordered_set>
#include <utility>
#include <vector>

#include "rtps_check.hpp"

namespace nearmesh::wire {

/// Where a message came from. Of UDP the port tells one socket from another; other transports need
/// no such check.
struct MessageSource {
  bool is_udp = false;
  std::uint16_t port = 0;
  std::optional<RtpsPlace> connection{};  ///< that it came by, where answers go back by the same
};

/// Six rules:
/// * **Who speaks.** A participant speaks from few sockets. After the first kLearning_s a message
///   in its name from another one is refused, unless it has been silent for kMoved_s: else anybody
///   could forge what it says, and one such message makes a reader deaf for it. The time of
///   learning begins anew when it has moved, and once with its first word that is no announcement:
///   before that its other sockets had nothing to say.
/// * **Who comes in.** Fast DDS takes memory and time for each participant that it hears of. kBurst
///   may come at once, then kNewcomersPerSecond; who is held back is let in when it speaks again,
///   which an honest one does within five seconds, and who invents participants does not. Of who
///   has only announced itself a lease counts kOnlyAnnounced_s at most, and kMaxKnown are known:
///   more than such invented ones as never speak again can be within that.
/// * **Whom one has to do with.** Strangers (told_bodies.hpp) stay outside: to know somebody costs
///   milliseconds at once, and a message a second. A few that move bodies come in all the same,
///   kChosen at most, one each kChoice_s, each by a lot of one in kLots, or all would let in the
///   same ones; and so does whoever has let this one in. So each is linked to each by some others,
///   and the exercise's clock, which is the latest that anybody tells, reaches all.
/// * **Who is barred.** A participant whose identity does not count any more is not heard.
/// * **Who is gone.** A participant that has been silent for its lease has left. Time counts only
///   while this process runs, so one that stood still does not miss everybody.
/// * **Who has long spoken.** Where a heartbeat begins far beyond what was handed on of its writer,
///   Fast DDS counts up to there, and one of its threads hears nothing meanwhile. kLeapBurst
///   numbers may be counted at once, then kLeapsPerSecond; the rest comes with later heartbeats.
/// Threads: one at a time.
class ParticipantBook {
 public:
  static constexpr double kLearning_s = 10;
  static constexpr double kMoved_s = 5;
  static constexpr double kBurst = 256;
  static constexpr double kNewcomersPerSecond = 50;
  static constexpr std::size_t kChosen = 4;
  static constexpr double kChoice_s = 5;
  static constexpr std::uint32_t kLots = 4;
  static constexpr std::size_t kMaxSpoken = 4096;   ///< remembered; beyond that all are forgotten
  static constexpr double kAgain_s = 0.05;          ///< between the two words of who is held back
  static constexpr std::size_t kMaxWaiting = 4096;  ///< held back; the oldest are forgotten
  static constexpr std::size_t kMaxPorts = 16;      ///< of one participant
  static constexpr double kOnlyAnnounced_s = 60;
  static constexpr std::size_t kMaxKnown = 4096;
  static constexpr double kLeapBurst = 1 << 22;  ///< of all participants; 0.9 s of counting
  static constexpr double kLeapsPerSecond = 1 << 22;
  static constexpr std::size_t kMaxBegun = 64;  ///< writers of one participant that begin far

  /// In: whether keeps_out() will be asked.
  explicit ParticipantBook(bool has_strangers = false) : has_strangers_(has_strangers) {}

  /// A well-formed message. Out: why it is refused.
  [[nodiscard]] std::optional<DoorRefusal> hear(const RtpsVerdict& message,
                                                const MessageSource& from);

  /// Whether this stranger, which is not known and announces itself, stays outside for now. To be
  /// asked before hear(). May throw std::bad_alloc.
  [[nodiscard]] bool keeps_out(const ParticipantKey& stranger);

  /// Of a message that hear() took: changes where its heartbeats begin, if that is too far. May
  /// throw std::bad_alloc.
  void hold_back(RtpsVerdict& message);

  struct Gone {
    ParticipantKey key;
    std::int64_t sequence;  ///< above that of all its announcements
  };
  /// Nothing is heard of it from now on, for good. Of one that is not known yet too. May throw
  /// std::bad_alloc: then it is not barred.
  void bar(const ParticipantKey& key);
  [[nodiscard]] bool is_barred(const ParticipantKey& key) const { return barred_.contains(key); }
  [[nodiscard]] bool is_known(const ParticipantKey& key) const { return known_.contains(key); }
  /// By which it was heard first, since it is known; nothing where that is not known.
  [[nodiscard]] std::optional<RtpsPlace> connection_of(const ParticipantKey& key) const;
  /// So much time has passed: who has been silent for its lease is not known any more. May throw
  /// std::bad_alloc: then the time has passed and nobody is forgotten; the next tick does it.
  void tick(double seconds);
  /// Who has left by its lease or was barred, since it was asked last.
  [[nodiscard]] std::vector<Gone> take_gone() { return std::exchange(gone_, {}); }
  /// Nothing came from it for so long, nor for three periods of its own life signs, which may be
  /// slower than ours. Nothing: it is not known. One that is barred is silent.
  [[nodiscard]] std::optional<bool> is_silent(const ParticipantKey& key, double silence_s) const;
  [[nodiscard]] std::size_t size() const { return known_.size(); }

 private:
  struct Known {
    double first_s = 0, last_s = 0;
    double lease_s = 0;
    double announced_s = 0, period_s = 0;  ///< of its announcements
    std::int64_t sequence = 0;
    bool has_spoken = false;  ///< has said more than that it is there
    std::vector<std::uint16_t> ports;
    std::optional<RtpsPlace> connection;
    /// How far its writers begin that begin far, as was handed on. Who is told of them anew counts
    /// anew.
    std::map<std::uint32_t, std::int64_t> begun;
  };
  [[nodiscard]] bool may_come_in(const ParticipantKey& key);
  [[nodiscard]] bool has_left(const Known& known) const;
  [[nodiscard]] bool speaks_from(Known& known, const MessageSource& from) const;

  bool has_strangers_;
  double now_s_ = 0;
  std::unordered_map<ParticipantKey, Known, ParticipantKeyHash> known_;
  /// Some bytes for each that ever had a certificate.
  std::unordered_set<ParticipantKey, ParticipantKeyHash> barred_;
  double tokens_ = kBurst;
  double again_tokens_ = kBurst;
  double leap_tokens_ = kLeapBurst;
  std::unordered_map<ParticipantKey, double, ParticipantKeyHash> waiting_;  ///< since when
  /// All of these, and such as are not waiting any more.
  std::deque<ParticipantKey> waiting_order_;
  /// Who is not known and has said more than that it is there.
  std::unordered_set<ParticipantKey, ParticipantKeyHash> spoken_;
  std::vector<ParticipantKey> chosen_;  ///< strangers
  double next_choice_s_ = 0;
  std::minstd_rand dice_{std::random_device{}()};
  std::vector<Gone> gone_;
};

}  // namespace nearmesh::wire
