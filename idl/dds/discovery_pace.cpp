// SPDX-License-Identifier: Apache-2.0
#include "discovery_pace.hpp"

#include <cstdlib>
#include <cstring>

#include "core/base/hash.hpp"

namespace nearmesh::wire {
namespace {

using Bytes = std::span<const std::uint8_t>;

constexpr std::size_t kHeaderBytes = 20;
constexpr std::uint8_t kAckNack = 0x06, kHeartbeat = 0x07, kTimestamp = 0x09, kDestination = 0x0e,
                       kData = 0x15, kStatistics = 0x80;
constexpr std::uint8_t kLittleEndian = 1, kWithInlineQos = 2, kWithPayload = 4;
constexpr std::uint32_t kParticipants = 0x000100c2;

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
  return DiscoveryWord{DiscoveryWord::Kind::kAnnouncement, kParticipants,
                       sequence_at(body, 12, (flags & kLittleEndian) != 0)};
}

std::optional<DiscoveryWord> reminder_in(Bytes body, std::uint8_t flags) {
  if (body.size() < 28) return std::nullopt;
  const std::uint32_t writer = word_at(body, 4, false);
  if (writer != kWritersOfEndpoints[0] && writer != kWritersOfEndpoints[1]) return std::nullopt;
  return DiscoveryWord{DiscoveryWord::Kind::kReminder, writer,
                       sequence_at(body, 16, (flags & kLittleEndian) != 0)};
}

/// Of a reader that has heard nothing yet: it names no number.
std::optional<DiscoveryWord> greeting_in(Bytes body, std::uint8_t flags) {
  if (body.size() < 24) return std::nullopt;
  const std::uint32_t writer = word_at(body, 4, false);
  const bool little_endian = (flags & kLittleEndian) != 0;
  if ((writer != kWritersOfEndpoints[0] && writer != kWritersOfEndpoints[1]) ||
      sequence_at(body, 8, little_endian) != 0 || word_at(body, 16, little_endian) != 0)
    return std::nullopt;
  return DiscoveryWord{DiscoveryWord::Kind::kGreeting, writer, 0};
}

/// Of UDPv4, whose address is in the last four bytes, and UDPv6.
bool is_group(const RtpsPlace& place) {
  return (place.kind == 1 && place.address[12] >> 4 == 14) ||
         (place.kind == 2 && place.address[0] == 255);
}

std::size_t index_of(std::uint32_t writer) { return writer == kWritersOfEndpoints[0] ? 0 : 1; }

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
    } else if (id != kTimestamp && id != kDestination && id != kStatistics) {
      return std::nullopt;
    }
    at += 4 + length;
  }
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

bool DiscoveryPace::may_go(const RtpsPlace& place, const DiscoveryWord& word, double now_s) {
  if (std::getenv("NOPACE") != nullptr) return true;
  if (word.kind != DiscoveryWord::Kind::kAnnouncement) {
    const auto at = told_.find(place);
    if (at == told_.end()) return true;
    const std::size_t writer = index_of(word.writer);
    if (word.kind == DiscoveryWord::Kind::kGreeting)
      return may_remind(at->second.greetings[writer], 0, now_s);
    return word.sequence >= at->second.next[writer] &&
           may_remind(at->second.reminders[writer], word.sequence, now_s);
  }
  if (told_.size() >= kMaxPlaces) told_.clear();
  return may_announce(told_[place], is_group(place), word.sequence, now_s);
}

bool DiscoveryPace::may_remind(Told::Paced& paced, std::int64_t sequence, double now_s) {
  const bool is_news = paced.sequence != sequence;
  if (!is_news && now_s - paced.last_s < paced.wait_s) return false;
  paced.wait_s = is_news ? kFirstReminder_s : std::min(2 * paced.wait_s, kLastReminder_s);
  paced.sequence = sequence;
  paced.last_s = now_s;
  return true;
}

bool DiscoveryPace::may_announce(Told& told, bool is_group, std::int64_t sequence,
                                 double now_s) const {
  // A group's word reaches all: in a crowd it is said less often.
  const double crowd = std::max(1.0, static_cast<double>(homes_.size()) / kCrowd);
  const double longest_s =
      is_group ? std::min(crowd * group_wait_s_, std::max(group_wait_s_, single_wait_s_))
               : single_wait_s_;
  const bool is_news = told.sequence != sequence;
  if (!is_news && now_s - told.last_s < told.wait_s) return false;
  told.wait_s =
      std::min(is_news ? (is_group ? kFirst_s : kFirstSingle_s) : 2 * told.wait_s, longest_s);
  told.sequence = sequence;
  told.last_s = now_s;
  return true;
}

void DiscoveryPace::expect(const ParticipantKey& key, const RtpsAnnouncement& announcement) {
  if (homes_.size() >= kMaxPlaces) homes_.clear();
  homes_[key] = {announcement.places, announcement.place_count};
  for (std::size_t i = 0; i < announcement.place_count; ++i) told_.erase(announcement.places[i]);
}

void DiscoveryPace::confirm(const ParticipantKey& key, const RtpsConfirmation& confirmation) {
  const auto home = homes_.find(key);
  if (home == homes_.end()) return;
  for (std::size_t i = 0; i < home->second.count; ++i)
    told_[home->second.places[i]].next[index_of(confirmation.writer)] = confirmation.next;
}

}  // namespace nearmesh::wire
