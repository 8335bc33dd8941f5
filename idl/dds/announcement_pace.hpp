// SPDX-License-Identifier: Apache-2.0
#pragma once
// When a participant's announcement of itself goes where. No Fast DDS, no clock.

#include <cstdint>
#include <span>
#include <unordered_map>

#include "rtps_check.hpp"

namespace nearmesh::wire {

/// Fast DDS 2.9 announces a participant to everybody, known or not, each time that it hears of somebody new: n that start at once
/// send and read n^3 announcements. Here one place is told the same once, then after kFirst_s, twice that and so on up to the period;
/// a place where somebody new is, at once. Threads: one at a time.
class AnnouncementPace {
 public:
  static constexpr double kFirst_s = 0.2;
  static constexpr std::size_t kMaxPlaces = 4096;  ///< remembered; beyond that all are forgotten

  /// Lets through what comes each `period_s`, if a little early.
  explicit AnnouncementPace(double period_s) : period_s_(0.8 * period_s) {}

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

  const double period_s_;
  std::unordered_map<RtpsPlace, Told, Hash> told_;
};

/// The number of the announcement that is all of a message; 0: the message is another.
[[nodiscard]] std::int64_t announcement_alone(std::span<const std::uint8_t> message);

}  // namespace nearmesh::wire
