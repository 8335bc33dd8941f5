// SPDX-License-Identifier: Apache-2.0
#include "pose_hearers.hpp"

#include "rtps_cursor.hpp"

namespace nearmesh::wire {

using namespace rtps_ids;

void PoseHearers::move(std::uint32_t writer, const std::vector<std::string>& bodies) {
  moved_ = body_hashes(bodies);
  writer_ = writer;
  for (auto& [place, hearer] : hearers_) hearer.is_spared.reset();
}

void PoseHearers::expect(const ParticipantKey& key, const RtpsAnnouncement& announcement) {
  for (std::size_t i = 0; i < announcement.place_count; ++i) hearers_.erase(announcement.places[i]);
  const std::optional<ToldBodies> told = told_bodies_in(announcement.user);
  if (!told) return;
  for (std::size_t i = 0; i < announcement.place_count && hearers_.size() < kMaxPlaces; ++i)
    hearers_[announcement.places[i]] = {key, told->named, {}, {}};
}

void PoseHearers::forget(const ParticipantKey& key) {
  std::erase_if(hearers_, [&](const auto& hearer) { return hearer.second.key == key; });
}

bool PoseHearers::is_poses(std::span<const std::uint8_t> message) const {
  if (!writer_) return false;
  bool is_any = false;
  const auto is_by_writer = [&](std::uint8_t id, std::uint8_t, Cursor body) {
    is_any = true;
    body.skip(8);
    return id == kData && body.big_u32() == *writer_ && body.is_whole();
  };
  return for_each_word(message, is_by_writer) && is_any;
}

bool PoseHearers::may_go(const RtpsPlace& place, double now_s) {
  const auto at = hearers_.find(place);
  if (at == hearers_.end()) return true;
  Hearer& hearer = at->second;
  if (!hearer.is_spared) hearer.is_spared = !have_one_in_common(hearer.named, moved_);
  if (*hearer.is_spared && hearer.told_s && now_s - *hearer.told_s < kClock_s) return false;
  if (*hearer.is_spared) hearer.told_s = now_s;
  return true;
}

}  // namespace nearmesh::wire
