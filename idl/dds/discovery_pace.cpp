// SPDX-License-Identifier: Apache-2.0
#include "discovery_pace.hpp"

#include <algorithm>
#include <cstring>

#include "core/base/hash.hpp"
#include "rtps_ids.hpp"

namespace nearmesh::wire {
namespace {

using namespace rtps_ids;
using Bytes = std::span<const std::uint8_t>;
using Kind = DiscoveryWord::Kind;

constexpr std::uint8_t kLittleEndian = 1, kWithInlineQos = 2, kWithPayload = 4;
/// Of a period: Fast DDS's own timer comes a little early at times.
constexpr double kEarly = 0.9;

std::uint32_t word_at(Bytes bytes, std::size_t at, bool little_endian) {
  std::uint32_t value = 0;
  for (std::size_t i = 0; i < 4; ++i)
    value |= std::uint32_t{bytes[at + i]} << (8 * (little_endian ? i : 3 - i));
  return value;
}

std::int64_t sequence_at(Bytes bytes, std::size_t at, bool little_endian) {
  return static_cast<std::int64_t>(std::uint64_t{word_at(bytes, at, little_endian)} << 32 |
                                   word_at(bytes, at + 4, little_endian));
}

std::optional<DiscoveryWord> announcement_in(Bytes body, std::uint8_t flags) {
  // What it takes back is told with inline QoS.
  if (body.size() < 20 || (flags & kWithInlineQos) != 0 || (flags & kWithPayload) == 0 ||
      word_at(body, 8, false) != kParticipants)
    return std::nullopt;
  return DiscoveryWord{Kind::kAnnouncement,
                       {},
                       word_at(body, 4, false),
                       kParticipants,
                       sequence_at(body, 12, (flags & kLittleEndian) != 0)};
}

std::optional<DiscoveryWord> reminder_in(Bytes body, std::uint8_t flags) {
  if (body.size() < 28) return std::nullopt;
  const std::uint32_t writer = word_at(body, 4, false);
  if (!place_of_endpoint_writer(writer)) return std::nullopt;
  return DiscoveryWord{Kind::kReminder,
                       {},
                       word_at(body, 0, false),
                       writer,
                       sequence_at(body, 16, (flags & kLittleEndian) != 0)};
}

/// It names no number that it has or lacks.
std::optional<DiscoveryWord> greeting_in(Bytes body, std::uint8_t flags) {
  if (body.size() < 24) return std::nullopt;
  const bool little_endian = (flags & kLittleEndian) != 0;
  if (sequence_at(body, 8, little_endian) != 0 || word_at(body, 16, little_endian) != 0)
    return std::nullopt;
  return DiscoveryWord{Kind::kGreeting, {}, word_at(body, 0, false), word_at(body, 4, false), 0};
}

}  // namespace

std::optional<DiscoveryWord> discovery_word(Bytes message) {
  std::optional<DiscoveryWord> found;
  for (std::size_t at = kHeaderBytes; at + 4 <= message.size();) {
    const std::uint8_t id = message[at], flags = message[at + 1];
    const bool little_endian = (flags & kLittleEndian) != 0;
    const std::size_t length = message[at + (little_endian ? 2 : 3)] |
                               std::size_t{message[at + (little_endian ? 3 : 2)]} << 8;
    if (length > message.size() - at - 4) return std::nullopt;
    const Bytes body = message.subspan(at + 4, length);
    if (id == kData || id == kHeartbeat || id == kAckNack) {
      if (found) return std::nullopt;
      found = id == kData        ? announcement_in(body, flags)
              : id == kHeartbeat ? reminder_in(body, flags)
                                 : greeting_in(body, flags);
      if (!found) return std::nullopt;
    } else if (id != kInfoTimestamp && id != kInfoDestination && id != kStatistics) {
      return std::nullopt;
    }
    at += 4 + length;
  }
  if (found) std::copy_n(message.begin() + 8, found->own.size(), found->own.begin());
  return found;
}

std::size_t DiscoveryPace::PlaceHash::operator()(const RtpsPlace& place) const {
  std::array<std::uint8_t, 24> bytes{};
  std::memcpy(bytes.data(), &place.kind, 4);
  std::memcpy(bytes.data() + 4, &place.port, 4);
  std::copy(place.address.begin(), place.address.end(), bytes.begin() + 8);
  return static_cast<std::size_t>(hash_bytes(bytes));
}

std::size_t DiscoveryPace::KeyHash::operator()(const ParticipantKey& key) const {
  return static_cast<std::size_t>(hash_bytes(key));
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
  const double longest_s = word.kind == Kind::kAnnouncement ? longest_s_ : kLast_s;
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
    told.next[*place_of_endpoint_writer(confirmation.writer)] = confirmation.next;
    // Who lacks something is reminded as soon as the writer wants to.
    std::erase_if(told.said, [&](const Said& one) {
      return one.word.kind == Kind::kReminder && one.word.writer == confirmation.writer &&
             one.word.sequence >= confirmation.next;
    });
  }
}

}  // namespace nearmesh::wire
