// SPDX-License-Identifier: Apache-2.0
#pragma once
// Whether a message may be handed to Fast DDS: bytes in, verdict out. No Fast DDS here, no state, no clock.
//
// Fast DDS 2.9.1 trusts much of what it is sent. An assertion of a debug build, a size that is used before it is compared, or a
// loop from one number of a packet to another ends or stops the whole process, whatever DDS Security says: all of it lies before
// the signature is looked at. So everything that Fast DDS reads before it knows who speaks is checked here first.
// Source: DDSI-RTPS 2.3, chapter 9.4 (submessages) and 9.6 (parameters); DDS Security 1.1, 7.4.4 (generic messages).

#include <array>
#include <cstdint>
#include <optional>
#include <span>

#include "nearmesh/idl/messages/messages.hpp"
#include "rtps_ids.hpp"

namespace nearmesh::wire {

/// Names a participant in every message of it.
using ParticipantKey = std::array<std::uint8_t, 12>;
struct ParticipantKeyHash {
  std::size_t operator()(const ParticipantKey& key) const;
};

/// Above any number that a writer of a thousand samples a second reaches in a thousand years.
inline constexpr std::int64_t kMaxSequence = std::int64_t{1} << 45;
/// Numbers that one gap may declare void: Fast DDS takes each by itself, with its locks held.
inline constexpr std::int64_t kMaxGap = 1 << 16;
/// Of a sample in fragments: its memory is taken with the first of them.
inline constexpr std::uint32_t kMaxFragmentedBytes = 256U << 20;
/// A participant that is to be forgotten sooner would only be found anew, again and again.
inline constexpr double kMinLease_s = 0.1;

/// Where a participant is reached, as RTPS writes it: of which transport, port, address.
struct RtpsPlace {
  std::int32_t kind = 0;
  std::uint32_t port = 0;
  std::array<std::uint8_t, 16> address{};
  bool operator==(const RtpsPlace&) const = default;
};
/// Of one participant that are kept; the first ones that it tells.
inline constexpr std::size_t kMaxRtpsPlaces = 8;

/// A participant's announcement of itself, where a message holds one.
struct RtpsAnnouncement {
  std::int64_t sequence = 0;
  bool leaves = false;                 ///< takes itself back
  double lease_s = 0;                  ///< and below, unless it leaves
  std::size_t lease_at = 0;            ///< of its 8 bytes in the message
  bool little_endian = true;           ///< how they are written
  bool is_secured = false;             ///< has an identity
  std::uint8_t release = 0;            ///< of Fast DDS, 3 and later; those before do not tell
  std::span<const std::uint8_t> name;  ///< what it is called
  /// Where it hears others, and what they write.
  std::array<RtpsPlace, kMaxRtpsPlaces> places{};
  std::size_t place_count = 0;
};

/// The writers that tell of a participant's own writers and readers: 0, 1. Nothing: `writer` is neither.
[[nodiscard]] constexpr std::optional<std::size_t> place_of_endpoint_writer(std::uint32_t writer) {
  if (writer != rtps_ids::kWriters && writer != rtps_ids::kReaders) return std::nullopt;
  return writer == rtps_ids::kWriters ? 0 : 1;
}

/// What a participant says it has of what one of these writers told it.
struct RtpsConfirmation {
  ParticipantKey to{};  ///< whose writer
  std::uint32_t writer = 0;
  std::int64_t next = 0;  ///< all below
};

struct RtpsVerdict {
  std::optional<DoorRefusal> refusal;
  /// To be handed on: Fast DDS's statistics at the end are left out. Nothing of nearmesh reads them, and Fast DDS compares them
  /// by assertions.
  std::size_t size = 0;
  ParticipantKey source{};
  std::optional<RtpsAnnouncement> announcement;  ///< of the source itself
  bool only_announces = false;                   ///< and says nothing else
  /// The same was handed on a moment ago: to be left out (ParticipantBook::repeats).
  bool is_repeat = false;
  /// Whom a handshake of the source's shows itself to be: a certificate in PEM, as it stands in the message. Empty: it does not.
  std::span<const std::uint8_t> certificate;
  /// Holds an announcement, of whomever, or a handshake: what makes Fast DDS match the endpoints by which participants get to know
  /// each other.
  bool introduces = false;
  /// Discovery about another participant, or an endpoint of one: only a discovery server may.
  bool tells_of_others = false;
  std::array<std::optional<RtpsConfirmation>, 2> confirmations{};  ///< of either writer, the last
};

/// Cost: one pass over the submessages' heads, and over the parameters of discovery; no allocation.
[[nodiscard]] RtpsVerdict check_rtps(std::span<const std::uint8_t> message);

}  // namespace nearmesh::wire
