// SPDX-License-Identifier: Apache-2.0
#include "announcement_pace.hpp"

#include <algorithm>
#include <cstring>

#include "core/base/hash.hpp"

namespace nearmesh::wire {
namespace {

constexpr std::size_t kHeaderBytes = 20;
constexpr std::uint8_t kData = 0x15, kTimestamp = 0x09, kDestination = 0x0e, kStatistics = 0x80;
constexpr std::uint8_t kLittleEndian = 1, kWithInlineQos = 2, kWithPayload = 4;
constexpr std::uint8_t kParticipantsWriter[] = {0, 1, 0, 0xc2};

std::uint32_t word(std::span<const std::uint8_t> bytes, std::size_t at, bool little_endian) {
  std::uint32_t value = 0;
  for (std::size_t i = 0; i < 4; ++i)
    value |= std::uint32_t{bytes[at + i]} << (8 * (little_endian ? i : 3 - i));
  return value;
}

/// Of UDPv4 and UDPv6. (An address of version 4 is in the last four bytes.)
bool is_group(const RtpsPlace& place) {
  return (place.kind == 1 && place.address[12] >> 4 == 14) ||
         (place.kind == 2 && place.address[0] == 255);
}

/// Of the body of a DATA submessage.
std::int64_t announcement_in(std::span<const std::uint8_t> body, std::uint8_t flags) {
  // What it takes back is told with inline QoS.
  if (body.size() < 20 || (flags & kWithInlineQos) != 0 || (flags & kWithPayload) == 0) return 0;
  if (!std::equal(std::begin(kParticipantsWriter), std::end(kParticipantsWriter), body.begin() + 8))
    return 0;
  const bool little_endian = (flags & kLittleEndian) != 0;
  return static_cast<std::int64_t>(std::uint64_t{word(body, 12, little_endian)} << 32 |
                                   word(body, 16, little_endian));
}

}  // namespace

std::size_t AnnouncementPace::Hash::operator()(const RtpsPlace& place) const {
  std::array<std::uint8_t, 24> bytes{};
  std::memcpy(bytes.data(), &place.kind, 4);
  std::memcpy(bytes.data() + 4, &place.port, 4);
  std::copy(place.address.begin(), place.address.end(), bytes.begin() + 8);
  return static_cast<std::size_t>(hash_bytes(bytes));
}

bool AnnouncementPace::may_go(const RtpsPlace& place, std::int64_t sequence, double now_s) {
  if (told_.size() >= kMaxPlaces) told_.clear();
  const auto [at, is_new] = told_.try_emplace(place);
  Told& told = at->second;
  const double longest_s = is_group(place) ? group_wait_s_ : single_wait_s_;
  if (is_new || told.sequence != sequence) {
    told = {sequence, now_s, std::min(kFirst_s, longest_s)};
    return true;
  }
  if (now_s - told.last_s < told.wait_s) return false;
  told.last_s = now_s;
  told.wait_s = std::min(2 * told.wait_s, longest_s);
  return true;
}

std::int64_t announcement_alone(std::span<const std::uint8_t> message) {
  std::int64_t found = 0;
  for (std::size_t at = kHeaderBytes; at + 4 <= message.size();) {
    const std::uint8_t id = message[at], flags = message[at + 1];
    const bool little_endian = (flags & kLittleEndian) != 0;
    const std::size_t length =
        message[at + (little_endian ? 2 : 3)] | std::size_t{message[at + (little_endian ? 3 : 2)]} << 8;
    if (length > message.size() - at - 4) return 0;
    if (id == kData) {
      if (found != 0) return 0;
      found = announcement_in(message.subspan(at + 4, length), flags);
      if (found == 0) return 0;
    } else if (id != kTimestamp && id != kDestination && id != kStatistics) {
      return 0;
    }
    at += 4 + length;
  }
  return found;
}

}  // namespace nearmesh::wire
