// SPDX-License-Identifier: Apache-2.0
#pragma once
// What a participant need not say again of itself and its endpoints. No Fast DDS, no clock.
//
// Fast DDS 2.9 announces a participant to everybody, known or not, twice each time that it hears of
// somebody new: n that start at once send some n^3 announcements. A reader that has just met a
// writer asks fourteen times a second whether that is there, and while one participant has yet to
// confirm what it was told of endpoints all are reminded. On a busy machine answers are late, so
// that alone keeps it busy. Nor does a busy machine hear sooner for being reminded: what it lacks
// is on its way, and each reminder has it ask again.

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <unordered_map>
#include <vector>

#include "rtps_check.hpp"

namespace nearmesh::wire {

/// A message that is all of its datagram, and that Fast DDS says again by itself until it is
/// answered.
struct DiscoveryWord {
  enum class Kind : std::uint8_t {
    kAnnouncement,  ///< of the participant
    kReminder,      ///< a heartbeat of a writer that tells of endpoints
    kGreeting       ///< of a reader that has heard nothing of a writer yet
  } kind = Kind::kAnnouncement;
  ParticipantKey own{};                  ///< who says it
  std::uint32_t reader = 0, writer = 0;  ///< entities
  std::int64_t sequence = 0;  ///< of the announcement; of the last that a reminder tells of
};
/// Nothing: the message is another, or more than that.
[[nodiscard]] std::optional<DiscoveryWord> discovery_word(std::span<const std::uint8_t> message);

/// * **What was said goes again** after kFirst_s, twice that and so on up to kLast_s, an
///   announcement up to its period: what is asked for meanwhile is left out, so that nothing is
///   held back but what was said a moment ago.
/// * **Calls to everybody**, by multicast, are for who is new and was not heard himself: they go
///   again up to kCalled_s later. Whoever was heard of has the announcement in each period by
///   unicast anyway.
/// * **Reminders of what was confirmed** go once in kConfirmed_s: what was confirmed in another's
///   name is made good then.
/// * **Who is new**, or has forgotten what it had, is told at once. Who asks is told what it asks
///   for; the reminders that follow keep their pace.
/// Only words to the places of participants that were heard of are paced, and announcements.
/// Threads: one at a time.
class DiscoveryPace {
 public:
  static constexpr double kFirst_s = 0.1, kLast_s = 4, kConfirmed_s = 5, kCalled_s = 5;
  static constexpr std::size_t kMaxPlaces = 4096;  ///< remembered; beyond that all are forgotten

  /// Of a participant that announces itself each `period_s`.
  explicit DiscoveryPace(double period_s);

  /// May this go there now? Then it does.
  [[nodiscard]] bool may_go(const DiscoveryWord& word, const RtpsPlace& place, double now_s);
  /// Somebody new announces itself: where it is, nothing was said yet.
  void expect(const ParticipantKey& key, const RtpsAnnouncement& announcement);
  void forget(const ParticipantKey& key);
  /// What somebody says it has of what was told of endpoints.
  void confirm(const ParticipantKey& key, const RtpsConfirmation& confirmation);
  [[nodiscard]] std::size_t size() const { return told_.size(); }

 private:
  struct Said {
    DiscoveryWord word;
    double last_s = 0, wait_s = 0;
  };
  struct Told {
    bool is_home = false;  ///< somebody who was heard of is there
    std::vector<Said> said;
    std::array<std::int64_t, 2> next{};  ///< below it all was confirmed, of either writer
  };
  struct Home {
    std::array<RtpsPlace, kMaxRtpsPlaces> places{};
    std::size_t count = 0;
  };

  const double longest_s_;  ///< between two announcements to one place
  ParticipantKey own_{};
  std::unordered_map<RtpsPlace, Told, RtpsPlaceHash> told_;
  std::unordered_map<ParticipantKey, Home, ParticipantKeyHash> homes_;
};

}  // namespace nearmesh::wire
