// SPDX-License-Identifier: Apache-2.0
#pragma once
// Who needs no poses of the bodies that are moved here. To a participant that has told which bodies
// its host will ever name (told_bodies.hpp), and names none of these, the door sends a pose only
// now and then, since the exercise's clock is the latest that anybody tells. In an exercise of n
// couples each then hears one other, not 2 n - 1. Such a reader misses nothing that it would look
// at, and a pose that does not come never makes an answer certain: what is left out for a name told
// wrongly is "no pose has come". A custom filter of Fast DDS would do the same, but its table is
// changed while a writer may read it (its issue 4878). No Fast DDS, no clock.

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <unordered_map>
#include <vector>

#include "rtps_check.hpp"
#include "told_bodies.hpp"

namespace nearmesh::wire {

/// Threads: one at a time.
class PoseHearers {
 public:
  /// The endpoint `writer` (its entity) tells poses, of these bodies alone, from now on.
  void move(std::uint32_t writer, const std::vector<std::string>& bodies);
  /// Somebody new announces itself: whoever was at its places before is not there any more. May
  /// throw std::bad_alloc: then it hears all.
  void expect(const ParticipantKey& key, const RtpsAnnouncement& announcement);
  void forget(const ParticipantKey& key);
  /// Whether all of a message is by that writer.
  [[nodiscard]] bool is_poses(std::span<const std::uint8_t> message) const;
  /// Whether it goes there now: where poses are of use, and elsewhere once in kClock_s. Whoever
  /// told nothing hears all.
  [[nodiscard]] bool may_go(const RtpsPlace& place, double now_s);
  [[nodiscard]] std::size_t size() const { return hearers_.size(); }

  static constexpr std::size_t kMaxPlaces = 4096;  ///< remembered; who is not hears all
  static constexpr double kClock_s = 5;

 private:
  struct Hearer {
    ParticipantKey key{};
    std::vector<std::uint32_t> named;  ///< hashes, ascending
    std::optional<bool> is_spared;     ///< as far as was looked since bodies changed
    std::optional<double> told_s;      ///< when it was sent one although it is
  };
  std::optional<std::uint32_t> writer_;
  std::vector<std::uint32_t> moved_;  ///< hashes, ascending
  std::unordered_map<RtpsPlace, Hearer, RtpsPlaceHash> hearers_;
};

}  // namespace nearmesh::wire
