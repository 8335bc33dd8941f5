// SPDX-License-Identifier: Apache-2.0
#pragma once
// What a participant need not say again of itself and its endpoints. No Fast DDS, no clock.
//
// Fast DDS 2.9 announces a participant to everybody, known or not, each time that it hears of somebody new: n that start at once
// send and read n^3 announcements. And while one participant has yet to confirm what it was told of endpoints, all are reminded each
// second, and confirm anew: on a slow machine that alone keeps all of them busy for good.

#include <algorithm>
#include <cstdint>
#include <optional>
#include <span>
#include <unordered_map>

#include "rtps_check.hpp"

namespace nearmesh::wire {

/// A message of discovery that is all of its datagram.
struct DiscoveryWord {
  enum class Kind : std::uint8_t { kAnnouncement, kReminder, kGreeting } kind = Kind::kAnnouncement;
  std::uint32_t writer =
      0;  ///< of a reminder, and of a greeting: a reader that has heard nothing of it asks whether it is there
  std::int64_t sequence = 0;  ///< of the announcement; of the last that a reminder tells of
};
/// Nothing: the message is another, or more than that.
[[nodiscard]] std::optional<DiscoveryWord> discovery_word(std::span<const std::uint8_t> message);

/// * **Announcements.** One place is told the same once, then after kFirst_s, twice that and so on up to a period: each announcement
///   goes to a multicast group, each fourth to a single participant, which hears the group too, or of other things.
/// * **Reminders** do not go where all was confirmed; elsewhere, as greetings, after kFirstReminder_s, twice that and so on up to
///   kLastReminder_s: where many join, answers take seconds, and what is said anew meanwhile makes them later.
/// A place where somebody new is, is told at once. Threads: one at a time.
class DiscoveryPace {
 public:
  static constexpr double kFirst_s = 0.2, kFirstSingle_s = 1.2;
  static constexpr double kFirstReminder_s = 0.25, kLastReminder_s = 2;
  static constexpr double kCrowd = 32;  ///< of more participants groups are told less often
  static constexpr std::size_t kMaxPlaces = 4096;  ///< remembered; beyond that all are forgotten

  /// Of announcements each `period_s`, of a participant with such a lease.
  DiscoveryPace(double period_s, double lease_s)
      : group_wait_s_(kEarly * period_s),
        single_wait_s_(kEarly * std::max(period_s, std::min(4 * period_s, lease_s / 4))) {}

  /// May this go there now? Then it does.
  [[nodiscard]] bool may_go(const RtpsPlace& place, const DiscoveryWord& word, double now_s);
  /// Somebody new announces itself: where it is, nothing was said yet.
  void expect(const ParticipantKey& key, const RtpsAnnouncement& announcement);
  /// What somebody has confirmed.
  void confirm(const ParticipantKey& key, const RtpsConfirmation& confirmation);

 private:
  struct PlaceHash {
    std::size_t operator()(const RtpsPlace& place) const;
  };
  struct KeyHash {
    std::size_t operator()(const ParticipantKey& key) const;
  };
  struct Told {
    std::int64_t sequence = 0;
    double last_s = 0, wait_s = 0;
    struct Paced {
      std::int64_t sequence = -1;
      double last_s = 0, wait_s = 0;
    };
    std::array<Paced, 2> reminders{}, greetings{};
    std::array<std::int64_t, 2>
        next{};  ///< below it all was confirmed, of either writer of endpoints
  };
  struct Home {
    std::array<RtpsPlace, 4> places{};
    std::size_t count = 0;
  };

  [[nodiscard]] static bool may_remind(Told::Paced& paced, std::int64_t sequence, double now_s);
  [[nodiscard]] bool may_announce(Told& told, bool is_group, std::int64_t sequence,
                                  double now_s) const;

  static constexpr double kEarly = 0.8;  ///< timers are not exact
  const double group_wait_s_, single_wait_s_;
  std::unordered_map<RtpsPlace, Told, PlaceHash> told_;
  std::unordered_map<ParticipantKey, Home, KeyHash> homes_;
};

}  // namespace nearmesh::wire
