// SPDX-License-Identifier: Apache-2.0
#pragma once
// Whether a message may be handed to Fast DDS: bytes in, verdict out. No Fast DDS here, no state,
// no clock.
//
// Fast DDS 2.9.1 trusts much of what it is sent. An assertion of a debug build, a size that is used
// before it is compared, or a loop from one number of a packet to another ends or stops the whole
// process, whatever DDS Security says: all of it lies before the signature is looked at. So
// everything that Fast DDS reads before it knows who speaks is checked here first. Source:
// DDSI-RTPS 2.3, chapter 9.4 (submessages) and 9.6 (parameters); DDS Security 1.1, 7.4.4 (generic
// messages).

#include <array>
#include <cstdint>
#include <cstdlib>
#include <memory>
#include <optional>
#include <span>
#include <vector>

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
/// Above this the number that a heartbeat begins with is told (RtpsBeginning). Fast DDS counts up
/// to it one by one with its reader locked, some 0.2 us each where it asserts: to the largest that
/// there may be, for months.
inline constexpr std::int64_t kFarBeginning = 1 << 20;
/// Of a sample in fragments: its memory is taken with the first of them.
inline constexpr std::uint32_t kMaxFragmentedBytes = 256U << 20;
/// Fast DDS keeps a list of the missing ones at their beginnings, which in shorter ones would be
/// overwritten by what comes, and walks it with each that comes.
inline constexpr std::uint32_t kMinFragmentBytes = 8;
inline constexpr std::uint32_t kMaxFragments = 1U << 18;
/// In one submessage. Cyclone DDS sends as many of its 1,344 bytes as a datagram has room for.
inline constexpr std::uint32_t kMaxFragmentsAtOnce = 64;
/// Fast DDS reads the last fragment as long as the first one that it heard of the sample lets it
/// be, whatever has come.
inline constexpr std::size_t kFragmentRoomBytes = std::size_t{kMaxFragmentsAtOnce} * 0xffff;
/// Who speaks in one message: Cyclone DDS puts together what several participants of a process have
/// to say.
inline constexpr std::size_t kMaxSpeakers = 8;
/// A participant that is to be forgotten sooner would only be found anew, again and again.
inline constexpr double kMinLease_s = 0.1;

/// Where a participant is reached, as RTPS writes it: of which transport, port, address.
struct RtpsPlace {
  std::int32_t kind = 0;
  std::uint32_t port = 0;
  std::array<std::uint8_t, 16> address{};
  bool operator==(const RtpsPlace&) const = default;
};
struct RtpsPlaceHash {
  std::size_t operator()(const RtpsPlace& place) const;
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
  std::span<const std::uint8_t> user;  ///< its user data
  /// Where it hears others, and what they write.
  std::array<RtpsPlace, kMaxRtpsPlaces> places{};
  std::size_t place_count = 0;
};

/// The writers that tell of a participant's own writers and readers: 0, 1. Nothing: `writer` is
/// neither.
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

/// Where a writer's numbers begin, as a heartbeat says.
struct RtpsBeginning {
  std::uint32_t writer = 0;
  std::int64_t first = 0;
  std::size_t first_at = 0;  ///< of its 8 bytes in the message
  bool little_endian = true;
};

/// Where a place of TCP stands that is told as one's own: of a participant, a writer or a reader.
struct RtpsTcpPlace {
  std::size_t at = 0;  ///< its 24 bytes in the message
  std::uint32_t port = 0;
  std::int32_t kind = 0;
  bool little_endian = true;
};

/// A byte that is another in the message that is handed on.
struct RtpsChange {
  std::uint32_t at = 0;
  std::uint8_t value = 0;
};

struct RtpsVerdict {
  std::optional<DoorRefusal> refusal;
  bool is_kept_out = false;  ///< not handed on, which is no fault of it (ParticipantBook)
  /// To be handed on: Fast DDS's statistics at the end are left out. Nothing of nearmesh reads
  /// them, and Fast DDS compares them by assertions.
  std::size_t size = 0;
  ParticipantKey source{};
  std::optional<RtpsAnnouncement> announcement;  ///< of the source itself
  /// Whom a handshake of the source's shows itself to be: a certificate in PEM, as it stands in the
  /// message. Empty: it does not.
  std::span<const std::uint8_t> certificate;
  /// Holds an announcement, of whomever, or a handshake: what makes Fast DDS match the endpoints by
  /// which participants get to know each other.
  bool introduces = false;
  /// Discovery about another participant, or an endpoint of one: only a discovery server may.
  bool tells_of_others = false;
  bool tells_of_endpoints = false;                                 ///< of whomever
  std::array<std::optional<RtpsConfirmation>, 2> confirmations{};  ///< of either writer, the last
  std::vector<RtpsBeginning> far_beginnings;                       ///< above kFarBeginning
  std::vector<RtpsTcpPlace> tcp_places;
  /// What Fast DDS must not see as it came; few messages of lawful programs have any:
  /// * Descriptions of types with an endpoint's discovery become padding. Fast DDS 2.9 builds types
  ///   of them, and follows a null pointer where one is malformed. Endpoints match by their type's
  ///   name.
  /// * Of a gap above kMaxGap a part of that length is left. Other heartbeats bring the other
  ///   parts.
  /// * A sample whose last fragment is so short that its place in the list of missing ones lies
  ///   behind it becomes some bytes longer.
  std::vector<RtpsChange> changes;
  void change(std::size_t at, std::uint32_t number, bool little_endian);
  void change_sequence(std::size_t at, std::int64_t number, bool little_endian);
  /// All told places of the connection's kind become its own, with the logical ports that were
  /// told.
  void reach_by(const RtpsPlace& connection);
  bool is_cut_gap = false;     ///< one of these changes
  bool has_fragments = false;  ///< and needs room behind it (RtpsCopy)
  /// Where another participant's word begins, which is to be judged by itself
  /// (rtps_of_next_speaker). 0: nowhere.
  std::size_t next_speaker_at = 0;
  /// Of what comes there, unless it says so. Zeros: whoever hears it.
  ParticipantKey destination{};
};

/// Cost: one pass over the submessages' heads, and over the parameters of discovery; no allocation
/// but for changes, far beginnings, and places of TCP.
/// In: `turn`: which part of a long gap is left; to count up with each that was cut. Throws
/// std::bad_alloc.
[[nodiscard]] RtpsVerdict check_rtps(std::span<const std::uint8_t> message, std::uint32_t turn = 0);

/// How much of a message that Fast DDS sends by UDP goes out: all but the 60 bytes of statistics at
/// its end, which no door hands on. Where another 0x80 would stand 60 bytes before the end then,
/// all of it: Fast DDS 2.9 writes its statistics over what begins so.
[[nodiscard]] std::size_t size_without_statistics(std::span<const std::uint8_t> message);

/// What the next speaker says, as a message of its own. In: a verdict of `message` that names one.
/// Throws std::bad_alloc.
[[nodiscard]] std::vector<std::uint8_t> rtps_of_next_speaker(std::span<const std::uint8_t> message,
                                                             const RtpsVerdict& verdict);

/// A message as it is handed on where it may not be as it came. The memory is used again and again:
/// that behind a message is as good as never touched, so costs nothing.
class RtpsCopy {
 public:
  [[nodiscard]] static bool is_needed(const RtpsVerdict& verdict) {
    return !verdict.changes.empty() || verdict.has_fragments;
  }
  /// Good until the next call. Behind a message with fragments are kFragmentRoomBytes that may be
  /// read. Throws std::bad_alloc.
  [[nodiscard]] std::span<const std::uint8_t> of(std::span<const std::uint8_t> message,
                                                 const RtpsVerdict& verdict);
  [[nodiscard]] std::size_t size() const { return size_; }

 private:
  struct Free {
    void operator()(std::uint8_t* bytes) const { std::free(bytes); }
  };
  std::unique_ptr<std::uint8_t[], Free> bytes_;
  std::size_t size_ = 0;
};

}  // namespace nearmesh::wire
