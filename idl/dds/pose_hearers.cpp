// SPDX-License-Identifier: Apache-2.0
#include "pose_hearers.hpp"

#include <algorithm>
#include <array>

#include "core/base/hash.hpp"
#include "rtps_cursor.hpp"

namespace nearmesh::wire {
namespace {

using namespace rtps_ids;
using Bytes = std::span<const std::uint8_t>;

/// What user data begins with that is ours.
constexpr std::array<std::uint8_t, 8> kMark{'n', 'm', 'h', 'e', 'a', 'r', 's', '1'};

std::uint32_t hash_of(const std::string& name) {
  const auto* bytes = reinterpret_cast<const std::uint8_t*>(name.data());
  return static_cast<std::uint32_t>(hash_bytes({bytes, name.size()}));
}

std::vector<std::uint32_t> hashes_of(const std::vector<std::string>& names) {
  std::vector<std::uint32_t> hashes;
  hashes.reserve(names.size());
  for (const std::string& name : names) hashes.push_back(hash_of(name));
  std::sort(hashes.begin(), hashes.end());
  return hashes;
}

/// Of user data; none where it is not ours, or malformed.
std::optional<std::vector<std::uint32_t>> hashes_in(Bytes data) {
  if (data.size() < kMark.size() || !std::equal(kMark.begin(), kMark.end(), data.begin()))
    return std::nullopt;
  const Bytes told = data.subspan(kMark.size());
  if (told.size() % 4 != 0 || told.size() / 4 > kMaxHeardBodies) return std::nullopt;
  std::vector<std::uint32_t> hashes;
  Cursor in(told, true);
  for (std::size_t i = 0; i < told.size() / 4; ++i) hashes.push_back(in.u32());
  if (!std::is_sorted(hashes.begin(), hashes.end())) return std::nullopt;
  return hashes;
}

}  // namespace

std::vector<std::uint8_t> heard_bodies_data(const std::vector<std::string>& names) {
  std::vector<std::uint8_t> data(kMark.begin(), kMark.end());
  for (const std::uint32_t hash : hashes_of(names))
    for (int shift = 0; shift < 32; shift += 8)
      data.push_back(static_cast<std::uint8_t>(hash >> shift));
  return data;
}

void PoseHearers::move(std::uint32_t writer, const std::vector<std::string>& bodies) {
  moved_ = hashes_of(bodies);
  writer_ = writer;
  for (auto& [place, hearer] : hearers_) hearer.is_spared.reset();
}

void PoseHearers::expect(const ParticipantKey& key, const RtpsAnnouncement& announcement) {
  for (std::size_t i = 0; i < announcement.place_count; ++i) hearers_.erase(announcement.places[i]);
  const auto names = hashes_in(announcement.user);
  if (!names) return;
  for (std::size_t i = 0; i < announcement.place_count && hearers_.size() < kMaxPlaces; ++i)
    hearers_[announcement.places[i]] = {key, *names, {}, {}};
}

void PoseHearers::forget(const ParticipantKey& key) {
  std::erase_if(hearers_, [&](const auto& hearer) { return hearer.second.key == key; });
}

bool PoseHearers::is_poses(Bytes message) const {
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
  if (!hearer.is_spared) {
    const auto is_moved = [this](std::uint32_t body) {
      return std::binary_search(moved_.begin(), moved_.end(), body);
    };
    hearer.is_spared = std::none_of(hearer.names.begin(), hearer.names.end(), is_moved);
  }
  if (*hearer.is_spared && hearer.told_s && now_s - *hearer.told_s < kClock_s) return false;
  if (*hearer.is_spared) hearer.told_s = now_s;
  return true;
}

}  // namespace nearmesh::wire
