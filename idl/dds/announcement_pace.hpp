// SPDX-License-Identifier: Apache-2.0
#pragma once
// When a participant's announcement of itself goes where. No Fast DDS, no clock.

#include <algorithm>
#include <cstdint>
#include <span>
#include <unordered_map>

#include "rtps_check.hpp"

namespace nearmesh::wire {

/// Fast DDS 2.9 announces a participant to everybody, known or not, each time that it hears of somebody new: n that start at once
/// send and read n^3 announcements. Here one place is told the same once, then after kFirst_s, twice that and so on up to a period: each
/// announcement goes to a multicast group, each fourth to a single participant, which hears the group too, or of other things. A place
/// where somebody new is, is told at once. Threads: one at a time.
class AnnouncementPace {
 public:
  static constexpr double kFirst_s = 0.2;
  static constexpr std::size_t kMaxPlaces = 4096;  ///< remembered; beyond that all are forgotten

  /// Of announcements each `period_s`, of a participant with such a lease.
  AnnouncementPace(double period_s, double lease_s)
      : group_wait_s_(kEarly * period_s),
        single_wait_s_(kEarly * std::max(period_s, std::min(4 * period_s, lease_s / 4))) {}

  /// May the announcement with this number go there now? Then it does.
  [[nodiscard]] bool may_go(const RtpsPlace& place, std::int64_t sequence, double now_s);
  /// Somebody new is there, who has not been told.
  void expect(const RtpsPlace& place) { told_.erase(place); }

 private:
  struct Hash {
    std::size_t operator()(const RtpsPlace& place) const;
  };
  struct Told {
    std::int64_t sequence = 0;
    double last_s = 0, wait_s = 0;
  };

  static constexpr double kEarly = 0.8;  ///< timers are not exact
  const double group_wait_s_, single_wait_s_;
  std::unordered_map<RtpsPlace, Told, Hash> told_;
};

/// The number of the announcement that is all of a message; 0: the message is another.
[[nodiscard]] std::int64_t announcement_alone(std::span<const std::uint8_t> message);

}  // namespace nearmesh::wire
