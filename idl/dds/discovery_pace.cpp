// SPDX-License-Identifier: Apache-2.0
#include "discovery_pace.hpp"

#include <algorithm>

#include "rtps_cursor.hpp"

namespace nearmesh::wire {
namespace {

using namespace rtps_ids;
using Bytes = std::span<const std::uint8_t>;
using Kind = DiscoveryWord::Kind;

constexpr std::uint8_t kWithInlineQos = 2, kWithPayload = 4;
/// Of a period: Fast DDS's own timer comes a little early at times.
constexpr double kEarly = 0.9;

/// Everybody's, not one participant's.
bool is_multicast(const RtpsPlace& place) { return (place.address[12] & 0xf0) == 0xe0; }

std::optional<DiscoveryWord> announcement_in(Cursor in, std::uint8_t flags) {
  in.skip(4);
  const std::uint32_t reader = in.big_u32(), writer = in.big_u32();
  const std::int64_t sequence = in.sequence();
  // What it takes back is told with inline QoS.
  if (!in.is_whole() || (flags & kWithInlineQos) != 0 || (flags & kWithPayload) == 0 ||
      writer != kParticipants)
    return std::nullopt;
  return DiscoveryWord{Kind::kAnnouncement, {}, reader, writer, sequence};
}

std::optional<DiscoveryWord> reminder_in(Cursor in) {
  const std::uint32_t reader = in.big_u32(), writer = in.big_u32();
  in.skip(8);  // the first
  const std::int64_t last = in.sequence();
  in.skip(4);
  if (!in.is_whole() || !place_of_endpoint_writer(writer)) return std::nullopt;
  return DiscoveryWord{Kind::kReminder, {}, reader, writer, last};
}

/// It names no number that it has or lacks.
std::optional<DiscoveryWord> greeting_in(Cursor in) {
  const std::uint32_t reader = in.big_u32(), writer = in.big_u32();
  const std::int64_t base = in.sequence();
  const std::uint32_t bits = in.u32();
  in.skip(4);
  if (!in.is_whole() || base != 0 || bits != 0) return std::nullopt;
  return DiscoveryWord{Kind::kGreeting, {}, reader, writer, 0};
}

}  // namespace

std::optional<DiscoveryWord> discovery_word(Bytes message) {
  std::optional<DiscoveryWord> found;
  const auto read = [&](std::uint8_t id, std::uint8_t flags, const Cursor& body) {
    if (found) return false;
    if (id == kData) found = announcement_in(body, flags);
    if (id == kHeartbeat) found = reminder_in(body);
    if (id == kAckNack) found = greeting_in(body);
    return found.has_value();
  };
  if (!for_each_word(message, read)) return std::nullopt;
  if (found) std::copy_n(message.begin() + 8, found->own.size(), found->own.begin());
  return found;
}

DiscoveryPace::DiscoveryPace(double period_s) : longest_s_(kEarly * period_s) {}

bool DiscoveryPace::may_go(const DiscoveryWord& word, const RtpsPlace& place, double now_s) {
  own_ = word.own;
  auto at = told_.find(place);
  if (word.kind == Kind::kAnnouncement) {
    if (at == told_.end()) {
      if (told_.size() >= kMaxPlaces) told_.clear();
      at = told_.try_emplace(place).first;
    }
  } else if (at == told_.end() || !at->second.is_home) {
    return true;
  }
  Told& told = at->second;
  const auto said = std::find_if(told.said.begin(), told.said.end(), [&](const Said& one) {
    return one.word.kind == word.kind && one.word.reader == word.reader &&
           one.word.writer == word.writer;
  });
  if (said == told.said.end()) {
    told.said.push_back({word, now_s, kFirst_s});
    return true;
  }
  const bool is_news = said->word.sequence != word.sequence;
  const bool is_confirmed = word.kind == Kind::kReminder &&
                            word.sequence < told.next[*place_of_endpoint_writer(word.writer)];
  if (!is_news && now_s - said->last_s < (is_confirmed ? kConfirmed_s : said->wait_s)) return false;
  const double longest_s = word.kind != Kind::kAnnouncement ? kLast_s
                           : is_multicast(place)            ? std::max(longest_s_, kCalled_s)
                                                            : longest_s_;
  *said = {word, now_s, is_news ? kFirst_s : std::min(2 * said->wait_s, longest_s)};
  return true;
}

void DiscoveryPace::expect(const ParticipantKey& key, const RtpsAnnouncement& announcement) {
  if (homes_.size() >= kMaxPlaces) {
    homes_.clear();
    told_.clear();
  }
  homes_[key] = {announcement.places, announcement.place_count};
  for (std::size_t i = 0; i < announcement.place_count; ++i) {
    if (told_.size() >= kMaxPlaces) told_.clear();
    told_[announcement.places[i]] = Told{.is_home = true, .said = {}};
  }
}

void DiscoveryPace::forget(const ParticipantKey& key) {
  const auto home = homes_.find(key);
  if (home == homes_.end()) return;
  for (std::size_t i = 0; i < home->second.count; ++i) told_.erase(home->second.places[i]);
  homes_.erase(home);
}

/// Whoever was here before, under the same address, may have been meant.
void DiscoveryPace::confirm(const ParticipantKey& key, const RtpsConfirmation& confirmation) {
  const auto home = homes_.find(key);
  if (home == homes_.end() || confirmation.to != own_) return;
  for (std::size_t i = 0; i < home->second.count; ++i) {
    const auto at = told_.find(home->second.places[i]);
    if (at == told_.end()) continue;
    Told& told = at->second;
    std::int64_t& next = told.next[*place_of_endpoint_writer(confirmation.writer)];
    // Whoever has forgotten what it had is reminded as soon as the writer wants to.
    if (confirmation.next < next)
      std::erase_if(told.said, [&](const Said& one) {
        return one.word.kind == Kind::kReminder && one.word.writer == confirmation.writer;
      });
    next = confirmation.next;
  }
}

}  // namespace nearmesh::wire
