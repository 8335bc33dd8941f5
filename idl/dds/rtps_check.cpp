// SPDX-License-Identifier: Apache-2.0
#include "rtps_check.hpp"

#include <algorithm>
#include <cstring>
#include <new>
#include <string_view>

#include "core/base/hash.hpp"
#include "rtps_cursor.hpp"
#include "rtps_parameters.hpp"

namespace nearmesh::wire {
namespace {

using namespace rtps_ids;
using Bytes = std::span<const std::uint8_t>;

constexpr std::size_t kStatisticsBytes = 56;
constexpr std::uint16_t kEprosima = 0x010f;

constexpr std::uint32_t kHandshakeReader = 0x000201c4;
/// The parameters that say where a participant hears what writers say, and of others.
constexpr std::uint16_t kDataPlace = 0x0031, kDiscoveryPlace = 0x0032;
/// And where one writer or reader does, if elsewhere.
constexpr std::uint16_t kEndpointPlace = 0x002f;
constexpr std::int32_t kTcp4 = 4, kTcp6 = 8;  ///< kinds of places, of Fast DDS
/// Of a product, which Fast DDS 3 tells: its release comes first.
constexpr std::uint16_t kProductVersion = 0x8000;
constexpr std::size_t kInfoSourceBytes = 20;
/// What Fast DDS reads of a fragment's beginning while that is missing.
constexpr std::uint64_t kLinkBytes = 4;

bool is_sequence(std::int64_t number) { return number >= 1 && number <= kMaxSequence; }

/// Base and bits of a set of at most 256 numbers.
bool read_set(Cursor& in, std::int64_t& base) {
  base = in.sequence();
  const std::uint32_t bits = in.u32();
  if (bits > 256) return false;
  in.skip((bits + 31) / 32 * 4);
  return in.is_whole() && base >= 0 && base <= kMaxSequence;
}

struct Submessages {
  Bytes message;
  RtpsVerdict& verdict;
  std::uint32_t turn = 0;
  std::size_t body_at = 0;  ///< in the message, of the submessage that is read

  using Refusal = std::optional<DoorRefusal>;
  static constexpr Refusal kNone{};

  Refusal read(std::uint8_t id, std::uint8_t flags, Bytes body) {
    const bool little_endian = (flags & 1) != 0;
    body_at = static_cast<std::size_t>(body.data() - message.data());
    Cursor in(body, little_endian);
    switch (id) {
      case kAckNack:
        return read_ack_nack(in);
      case kHeartbeat:
        return read_heartbeat(in, little_endian);
      case kGap:
        return read_gap(in, little_endian);
      case kNackFragment:
        return read_nack_fragment(in);
      case kHeartbeatFragment:
        in.skip(8);
        if (!is_sequence(in.sequence())) return of_sequence(in);
        return body.size() >= 24 ? kNone : DoorRefusal::kSubmessages;
      case kData:
        return read_data(in, flags, little_endian);
      case kDataFragment:
        return read_data_fragment(in, flags);
      case kInfoTimestamp:
        return (flags & 2) != 0 || body.size() >= 8 ? kNone : DoorRefusal::kSubmessages;
      case kInfoDestination:
        if (body.size() < 12) return DoorRefusal::kSubmessages;
        // Nobody means that it stays as it was.
        if (std::any_of(body.begin(), body.begin() + 12,
                        [](std::uint8_t byte) { return byte != 0; }))
          std::copy_n(body.begin(), verdict.destination.size(), verdict.destination.begin());
        return kNone;
      case kInfoSource:
        // Of another length Fast DDS reads no further; of another version it knows nothing.
        if (body.size() != kInfoSourceBytes) return DoorRefusal::kSubmessages;
        if (body[4] != 2) return DoorRefusal::kHeader;
        if (!std::equal(verdict.source.begin(), verdict.source.end(), body.begin() + 8))
          verdict.next_speaker_at = body_at;
        return kNone;
      case kSecurePrefix:
      case kSecurePostfix:
      case kRtpsPrefix:
      case kRtpsPostfix:
        return body.size() >= 20 ? kNone : DoorRefusal::kSubmessages;
      default:
        return kNone;  // Fast DDS skips it
    }
  }

 private:
  /// A number that is wrong because it is not there at all is a fault of the lengths.
  static Refusal of_sequence(const Cursor& in) {
    return in.is_whole() ? DoorRefusal::kSequence : DoorRefusal::kSubmessages;
  }

  Refusal read_ack_nack(Cursor& in) {
    in.skip(4);
    const std::uint32_t writer = in.big_u32();
    std::int64_t base = 0;
    if (!read_set(in, base)) return of_sequence(in);
    if (const auto place = place_of_endpoint_writer(writer))
      verdict.confirmations[*place] = {verdict.destination, writer, base};
    return in.skip(4) ? kNone : DoorRefusal::kSubmessages;
  }

  Refusal read_heartbeat(Cursor& in, bool little_endian) {
    in.skip(4);
    const std::uint32_t writer = in.big_u32();
    const std::size_t first_at = body_at + in.at();
    const std::int64_t first = in.sequence(), last = in.sequence();
    if (!is_sequence(first) || last < first - 1 || last > kMaxSequence) return of_sequence(in);
    if (first > kFarBeginning)
      verdict.far_beginnings.push_back({writer, first, first_at, little_endian});
    return in.skip(4) ? kNone : DoorRefusal::kSubmessages;
  }

  Refusal read_gap(Cursor& in, bool little_endian) {
    in.skip(8);
    const std::size_t start_at = body_at + in.at();
    const std::int64_t start = in.sequence();
    std::int64_t base = 0;
    if (!read_set(in, base) || !is_sequence(start) || base < start) return of_sequence(in);
    if (base - start > kMaxGap) cut_gap(start_at, start, base, little_endian);
    return kNone;
  }

  /// Lawful ones are long too: where a latched history keeps an old sample, all that was written
  /// since and replaced is one gap, told before each heartbeat. A reader that is not told of it
  /// asks for 256 numbers with each heartbeat.
  void cut_gap(std::size_t start_at, std::int64_t start, std::int64_t base, bool little_endian) {
    const std::int64_t parts = (base - start + kMaxGap - 1) / kMaxGap;
    // By the golden ratio: all parts come soon, also where only each second turn or so is this
    // writer's.
    const std::uint32_t spread = turn * 0x9e3779b1U;
    const auto part = static_cast<std::int64_t>(
        (std::uint64_t{spread} * static_cast<std::uint64_t>(parts)) >> 32);
    const std::int64_t from = start + part * kMaxGap;
    verdict.is_cut_gap = true;
    verdict.change_sequence(start_at, from, little_endian);
    if (part == parts - 1) return;  // and what is behind it
    verdict.change_sequence(start_at + 8, from + kMaxGap, little_endian);
    verdict.change(start_at + 16, 0, little_endian);  // no bits
  }

  static Refusal read_nack_fragment(Cursor& in) {
    in.skip(8);
    if (!is_sequence(in.sequence())) return of_sequence(in);
    const std::uint32_t base = in.u32(), bits = in.u32();
    if (base < 1 || bits > 256)
      return in.is_whole() ? DoorRefusal::kFragments : DoorRefusal::kSubmessages;
    in.skip((bits + 31) / 32 * 4);
    return in.skip(4) ? kNone : DoorRefusal::kSubmessages;
  }

  /// The head of both kinds of data, up to where the inline QoS begins. In: `known`: bytes of it
  /// that follow octetsToInlineQos.
  static Refusal read_data_head(Cursor& in, std::size_t known, std::uint32_t& writer,
                                std::int64_t& sequence, std::size_t& qos_at) {
    in.skip(2);
    const std::uint16_t to_qos = in.u16();
    qos_at = in.at() + to_qos;
    const std::uint32_t reader = in.big_u32();
    writer = in.big_u32();
    // The reader of handshakes takes them also from a writer without a name.
    if (writer == kNobody || reader == kHandshakeReader) writer = kHandshakes;
    sequence = in.sequence();
    if (!in.is_whole() || to_qos < known || to_qos > 0x7fff || to_qos % 4 != 0)
      return DoorRefusal::kSubmessages;
    return is_sequence(sequence) ? kNone : DoorRefusal::kSequence;
  }

  /// Whether a parameter of discovery that names who it is about names the source.
  [[nodiscard]] bool is_of_source(std::uint16_t id, Bytes bytes) const {
    return (id != 0x0050 && id != 0x005a && id != 0x0070) || bytes.size() < verdict.source.size() ||
           std::equal(verdict.source.begin(), verdict.source.end(), bytes.begin());
  }

  struct InlineQos {
    bool disposes = false;     ///< takes back what it is about
    bool is_of_source = true;  ///< by its key, where it is discovery
  };

  /// Parameters of one sample.
  Refusal read_inline_qos(Cursor& in, bool little_endian, InlineQos& found) const {
    const bool whole = read_parameters(in, [&](std::uint16_t id, std::size_t, Bytes bytes) {
      if (id == 0x0071 && bytes.size() >= 4) found.disposes = (bytes[3] & 3) != 0;
      found.is_of_source = found.is_of_source && is_of_source(id, bytes);
      return (id != 0x0070 || bytes.size() == 16) && (id != 0x0071 || bytes.size() >= 4) &&
             is_parameter(id, bytes, little_endian);
    });
    return whole ? kNone : DoorRefusal::kParameters;
  }

  Refusal read_data(Cursor& in, std::uint8_t flags, bool little_endian) {
    const bool has_qos = (flags & 2) != 0, has_data = (flags & 4) != 0, has_key = (flags & 8) != 0;
    std::uint32_t writer = 0;
    std::int64_t sequence = 0;
    std::size_t qos_at = 0;
    if (const Refusal refusal = read_data_head(in, 16, writer, sequence, qos_at)) return refusal;
    if (!in.skip(qos_at - in.at()) || (has_data && has_key)) return DoorRefusal::kSubmessages;
    InlineQos qos;
    if (has_qos)
      if (const Refusal refusal = read_inline_qos(in, little_endian, qos)) return refusal;
    const Bytes payload = has_data || has_key ? in.rest() : Bytes{};
    // Four bytes say how it is encoded; a reader looks at them whatever the length.
    if ((has_data || has_key) && payload.size() < 4) return DoorRefusal::kSubmessages;
    return read_builtin(writer, sequence, qos, payload);
  }

  /// Fast DDS compares nothing of what two fragments of one sample say of it: it takes sizes from
  /// the first that comes, and copies by them. So each must be right by itself, and what is read
  /// beyond it is room that RtpsCopy provides.
  Refusal read_data_fragment(Cursor& in, std::uint8_t flags) {
    const bool little_endian = (flags & 1) != 0;
    std::uint32_t writer = 0;
    std::int64_t sequence = 0;
    std::size_t qos_at = 0;
    if (const Refusal refusal = read_data_head(in, 28, writer, sequence, qos_at)) return refusal;
    const std::uint64_t first = in.u32();
    const std::uint64_t count = in.u16(), size = in.u16();
    const std::size_t total_at = body_at + in.at();
    const std::uint64_t total = in.u32();
    if (!in.is_whole() || !in.skip(qos_at - in.at())) return DoorRefusal::kSubmessages;
    InlineQos qos;
    if ((flags & 2) != 0)
      if (const Refusal refusal = read_inline_qos(in, little_endian, qos)) return refusal;
    // What is read before anybody is known comes whole, or it could not be looked at here. A key
    // Fast DDS reads from nowhere.
    if (writer == kParticipants || writer == kHandshakes || (flags & 4) != 0)
      return DoorRefusal::kFragments;
    if (first < 1 || count < 1 || count > kMaxFragmentsAtOnce || size < kMinFragmentBytes ||
        total < 4 || total > kMaxFragmentedBytes || (first - 1 + count - 1) * size >= total)
      return DoorRefusal::kFragments;
    const std::uint64_t fragments = (total + size - 1) / size;
    const std::uint64_t expected = std::min(count * size, total - (first - 1) * size);
    if (fragments > kMaxFragments || in.left() < expected) return DoorRefusal::kFragments;
    // In all fragments alike, so that the first that comes takes memory enough.
    const std::uint64_t link_end = ((fragments - 1) * size + 3) / 4 * 4 + kLinkBytes;
    if (link_end > total)
      verdict.change(total_at, static_cast<std::uint32_t>(link_end), little_endian);
    verdict.has_fragments = true;
    if (!is_discovery(writer)) return kNone;
    // Looked at as a whole, or not at all.
    if (count != fragments) return DoorRefusal::kFragments;
    return read_builtin(writer, sequence, qos, in.take(total));
  }

  static bool is_discovery(std::uint32_t writer) {
    return writer == kWriters || writer == kReaders || writer == kSecureWriters ||
           writer == kSecureReaders || writer == kLiveliness;
  }

  /// What discovery and the handshakes of security write.
  Refusal read_builtin(std::uint32_t writer, std::int64_t sequence, const InlineQos& qos,
                       Bytes payload) {
    verdict.introduces |= writer == kParticipants || writer == kHandshakes;
    switch (writer) {
      case kParticipants:
        return read_announcement(sequence, qos, payload);
      case kWriters:
      case kReaders:
      case kSecureWriters:
      case kSecureReaders: {
        verdict.tells_of_others |= !qos.is_of_source;
        verdict.tells_of_endpoints = true;
        if (payload.empty()) return kNone;
        const auto little_endian = parameter_order(payload);
        if (!little_endian) return DoorRefusal::kParameters;
        Cursor in(payload.subspan(4), *little_endian);
        const auto offset = static_cast<std::uint32_t>(payload.data() - message.data()) + 4;
        const bool whole = read_parameters(in, [&](std::uint16_t id, std::size_t place,
                                                   Bytes bytes) {
          verdict.tells_of_others |= !is_of_source(id, bytes);
          // Its number becomes that of padding, 0; its length stays.
          if (describes_type(id))
            for (const std::uint32_t before : {4U, 3U})
              verdict.changes.push_back({offset + static_cast<std::uint32_t>(place) - before, 0});
          if (!is_parameter(id, bytes, *little_endian)) return false;
          if (id == kEndpointPlace)
            note_tcp_place(offset + place, place_of(bytes, *little_endian), *little_endian);
          return true;
        });
        return whole ? kNone : DoorRefusal::kParameters;
      }
      case kLiveliness:  // who, a kind, a length
        return payload.empty() || payload.size() >= 24 ? kNone : DoorRefusal::kParameters;
      case kHandshakes:
        return payload.empty() ? kNone : read_handshake(payload);
      default:
        return kNone;
    }
  }

  /// Encapsulation of a list of parameters: numbers are little-endian or not. Nothing: it is none.
  static std::optional<bool> parameter_order(Bytes payload) {
    if (payload[0] != 0 || (payload[1] != 2 && payload[1] != 3)) return std::nullopt;
    return payload[1] == 3;
  }

  Refusal read_handshake(Bytes payload) {
    if (payload[0] != 0 || payload[1] > 1) return DoorRefusal::kParameters;
    Cursor in(payload.subspan(4), payload[1] == 1);
    const Bytes speaker = in.take(24);  // who names this message, and its number
    in.skip(24 + 3 * 16);               // another message's name, three GUIDs
    in.text();
    // PEM has a colon in its headers alone, and one of these says that it is encrypted: then Fast
    // DDS asks for the passphrase at the terminal, and its thread waits for an answer.
    bool is_one = true, is_clear = true;
    for (std::uint32_t left = in.count(12); left > 0 && in.is_whole(); --left)
      read_token(in, [&](Bytes name, Bytes value) {
        if (!is_certificate(name)) return;
        is_clear = is_clear && std::find(value.begin(), value.end(), ':') == value.end();
        if (verdict.certificate.empty()) verdict.certificate = value;
        // The second would hide the first from whoever looks at one.
        is_one = is_one && !value.empty() &&
                 std::equal(value.begin(), value.end(), verdict.certificate.begin(),
                            verdict.certificate.end());
      });
    if (!in.is_whole() || !is_one || !is_clear) return DoorRefusal::kParameters;
    // Fast DDS takes it for who this says, not for who sent it.
    return std::equal(verdict.source.begin(), verdict.source.end(), speaker.begin())
               ? kNone
               : DoorRefusal::kSource;
  }

  /// Named "c.id", whatever follows its end mark.
  static bool is_certificate(Bytes name) {
    constexpr std::string_view kName = "c.id";
    return name.size() >= kName.size() && std::equal(kName.begin(), kName.end(), name.begin()) &&
           (name.size() == kName.size() || name[kName.size()] == 0);
  }

  /// Of UDP or TCP; what is none is never sent to.
  static RtpsPlace place_of(Bytes bytes, bool little_endian) {
    RtpsPlace place;
    Cursor in(bytes, little_endian);
    place.kind = static_cast<std::int32_t>(in.u32());
    place.port = in.u32();
    const Bytes address = in.take(place.address.size());
    std::copy(address.begin(), address.end(), place.address.begin());
    return place;
  }

  void note_tcp_place(std::size_t at, const RtpsPlace& told, bool little_endian) {
    if (told.kind == kTcp4 || told.kind == kTcp6)
      verdict.tcp_places.push_back({at, told.port, told.kind, little_endian});
  }

  Refusal read_announcement(std::int64_t sequence, const InlineQos& qos, Bytes payload) {
    RtpsAnnouncement found;
    found.sequence = sequence;
    found.leaves = qos.disposes;
    bool is_own = qos.is_of_source;
    if (!payload.empty()) {
      const auto little_endian = parameter_order(payload);
      if (!little_endian) return DoorRefusal::kParameters;
      found.little_endian = *little_endian;
      Cursor in(payload.subspan(4), *little_endian);
      const auto offset = static_cast<std::size_t>(payload.data() - message.data()) + 4;
      const bool whole = read_parameters(in, [&](std::uint16_t id, std::size_t place, Bytes bytes) {
        if (!is_parameter(id, bytes, *little_endian)) return false;
        is_own = is_own && is_of_source(id, bytes);
        if (id == 0x0002) {
          Cursor lease(bytes, *little_endian);
          const auto seconds = static_cast<std::int32_t>(lease.u32());
          found.lease_s = seconds + lease.u32() * 0x1p-32;
          found.lease_at = offset + place;
          if (found.lease_s < kMinLease_s) return false;
        }
        if (id == kProductVersion && !bytes.empty()) found.release = bytes[0];
        if (id == 0x0062) found.name = Cursor(bytes, *little_endian).bytes();
        if (id == 0x002c) found.user = Cursor(bytes, *little_endian).bytes();
        if (id == 0x1001) found.is_secured = true;  // an identity
        if (id == kDataPlace || id == kDiscoveryPlace) {
          const RtpsPlace told = place_of(bytes, *little_endian);
          if (found.place_count < found.places.size()) found.places[found.place_count++] = told;
          note_tcp_place(offset + place, told, *little_endian);
        }
        return true;
      });
      if (!whole) return DoorRefusal::kParameters;
    }
    if (!is_own) {
      verdict.tells_of_others = true;
      return kNone;
    }
    // Fast DDS takes a lease that is not told for none, and forgets such a participant at once.
    if (!found.leaves && found.lease_at == 0) return DoorRefusal::kParameters;
    // The second would hide the first from whoever looks at one.
    if (verdict.announcement) return DoorRefusal::kParameters;
    verdict.announcement = found;
    return kNone;
  }
};

}  // namespace

std::size_t ParticipantKeyHash::operator()(const ParticipantKey& key) const {
  return static_cast<std::size_t>(hash_bytes(key));
}

std::size_t RtpsPlaceHash::operator()(const RtpsPlace& place) const {
  std::array<std::uint8_t, 24> bytes{};
  std::memcpy(bytes.data(), &place.kind, 4);
  std::memcpy(bytes.data() + 4, &place.port, 4);
  std::copy(place.address.begin(), place.address.end(), bytes.begin() + 8);
  return static_cast<std::size_t>(hash_bytes(bytes));
}

void RtpsVerdict::change(std::size_t at, std::uint32_t number, bool little_endian) {
  for (std::uint32_t i = 0; i < 4; ++i)
    changes.push_back({static_cast<std::uint32_t>(at) + i,
                       static_cast<std::uint8_t>(number >> (8 * (little_endian ? i : 3 - i)))});
}

void RtpsVerdict::change_sequence(std::size_t at, std::int64_t number, bool little_endian) {
  const auto bits = static_cast<std::uint64_t>(number);
  change(at, static_cast<std::uint32_t>(bits >> 32), little_endian);
  change(at + 4, static_cast<std::uint32_t>(bits), little_endian);
}

/// Of TCP the lower half of a port is that of the socket, the upper one the logical one.
void RtpsVerdict::reach_by(const RtpsPlace& connection) {
  for (const RtpsTcpPlace& told : tcp_places) {
    if (told.kind != connection.kind) continue;
    change(told.at + 4, (told.port & 0xffff0000U) | (connection.port & 0xffffU),
           told.little_endian);
    for (std::uint32_t i = 0; i < connection.address.size(); ++i)
      changes.push_back({static_cast<std::uint32_t>(told.at) + 8 + i, connection.address[i]});
  }
}

RtpsVerdict check_rtps(std::span<const std::uint8_t> message, std::uint32_t turn) {
  RtpsVerdict verdict;
  verdict.size = message.size();
  if (message.size() < kHeaderBytes || std::memcmp(message.data(), "RTPS", 4) != 0 ||
      message[4] != 2) {
    verdict.refusal = DoorRefusal::kHeader;
    return verdict;
  }
  const std::uint16_t vendor = static_cast<std::uint16_t>(message[6] << 8 | message[7]);
  std::copy_n(message.begin() + 8, verdict.source.size(), verdict.source.begin());
  Submessages submessages{message, verdict, turn};
  for (std::size_t at = kHeaderBytes; at < message.size();) {
    if (message.size() - at < 4) {
      verdict.refusal = DoorRefusal::kSubmessages;
      return verdict;
    }
    const std::uint8_t id = message[at], flags = message[at + 1];
    std::size_t length = (flags & 1) != 0 ? message[at + 2] | std::size_t{message[at + 3]} << 8
                                          : std::size_t{message[at + 2]} << 8 | message[at + 3];
    const std::size_t left = message.size() - at - 4;
    // Of some kinds a length of 0 means: all that is left. It is for what is longer than 64 kB.
    if (length == 0 && (id == kData || id == kDataFragment || id == kSecureBody)) {
      length = left;
    } else if (length > left || (length % 4 != 0 && length != left) ||
               (length == 0 && id != kPad && id != kInfoTimestamp && left != 0)) {
      verdict.refusal = DoorRefusal::kSubmessages;
      return verdict;
    }
    if (id == kStatistics && vendor == kEprosima) {
      if (length != kStatisticsBytes || length != left) verdict.refusal = DoorRefusal::kStatistics;
      verdict.size = at;
      return verdict;
    }
    verdict.refusal = submessages.read(id, flags, message.subspan(at + 4, length));
    if (verdict.refusal) return verdict;
    if (verdict.next_speaker_at != 0) {
      verdict.size = at;
      break;
    }
    at += 4 + length;
  }
  return verdict;
}

std::size_t size_without_statistics(std::span<const std::uint8_t> message) {
  constexpr std::size_t kAll = 4 + kStatisticsBytes;
  if (message.size() < kHeaderBytes + kAll) return message.size();
  const std::size_t end = message.size() - kAll;
  // By the lengths of what comes before: any byte may be 0x80.
  std::size_t at = kHeaderBytes;
  while (at < end) {
    const bool little_endian = (message[at + 1] & 1) != 0;
    const std::size_t length = Cursor(message.subspan(at + 2, 2), little_endian).u16();
    if (length == 0 && message[at] != kPad && message[at] != kInfoTimestamp) break;
    at += 4 + length;
  }
  const bool is_there = at == end && message[at] == kStatistics;
  const bool would_be_another = end >= kHeaderBytes + kAll && message[end - kAll] == kStatistics;
  return is_there && !would_be_another ? end : message.size();
}

std::vector<std::uint8_t> rtps_of_next_speaker(std::span<const std::uint8_t> message,
                                               const RtpsVerdict& verdict) {
  const Bytes info = message.subspan(verdict.next_speaker_at, kInfoSourceBytes);
  const Bytes rest = message.subspan(verdict.next_speaker_at + kInfoSourceBytes);
  constexpr std::array<std::uint8_t, 4> kMark{'R', 'T', 'P', 'S'};
  constexpr std::array<std::uint8_t, 4> kTo{kInfoDestination, 1, 12, 0};
  std::vector<std::uint8_t> bytes;
  bytes.reserve(kHeaderBytes + kTo.size() + verdict.destination.size() + rest.size());
  bytes.insert(bytes.end(), kMark.begin(), kMark.end());
  bytes.insert(bytes.end(), info.begin() + 4, info.end());
  // Whom one speaks to stays until it says otherwise.
  bytes.insert(bytes.end(), kTo.begin(), kTo.end());
  bytes.insert(bytes.end(), verdict.destination.begin(), verdict.destination.end());
  bytes.insert(bytes.end(), rest.begin(), rest.end());
  return bytes;
}

std::span<const std::uint8_t> RtpsCopy::of(std::span<const std::uint8_t> message,
                                           const RtpsVerdict& verdict) {
  const std::size_t needed = message.size() + (verdict.has_fragments ? kFragmentRoomBytes : 0);
  if (needed > size_) {
    bytes_.reset(static_cast<std::uint8_t*>(std::calloc(needed, 1)));
    size_ = bytes_ != nullptr ? needed : 0;
    if (bytes_ == nullptr) throw std::bad_alloc();
  }
  std::copy(message.begin(), message.end(), bytes_.get());
  for (const RtpsChange& change : verdict.changes) bytes_[change.at] = change.value;
  return {bytes_.get(), message.size()};
}

}  // namespace nearmesh::wire
