// SPDX-License-Identifier: Apache-2.0
#pragma once
// RTPS messages, written byte by byte: right ones, for tests to spoil. Little-endian.

#include <array>
#include <cstdint>
#include <initializer_list>
#include <string>
#include <vector>

namespace nearmesh::test {

using RtpsBytes = std::vector<std::uint8_t>;

/// Entity ids as four bytes, read as a big-endian number.
inline constexpr std::uint32_t kParticipantWriter = 0x000100c2, kParticipantReader = 0x000100c7;
inline constexpr std::uint32_t kPublicationsWriter = 0x000003c2, kSubscriptionsWriter = 0x000004c2;
inline constexpr std::uint32_t kHandshakeWriter = 0x000201c3, kLivelinessWriter = 0x000200c2;

class Rtps {
 public:
  using Key = std::array<std::uint8_t, 12>;

  /// eProsima's as vendor.
  explicit Rtps(const Key& source, std::uint16_t vendor = 0x010f) : key_(source) {
    bytes = {'R', 'T', 'P', 'S', 2, 3};
    big16(vendor);
    add(source);
  }
  RtpsBytes bytes;

  Rtps& u8(std::uint8_t value) {
    bytes.push_back(value);
    return *this;
  }
  Rtps& u16(std::uint16_t value) { return little(value, 2); }
  Rtps& u32(std::uint32_t value) { return little(value, 4); }
  Rtps& u64(std::uint64_t value) { return little(value, 8); }
  Rtps& big16(std::uint16_t value) {
    return u8(static_cast<std::uint8_t>(value >> 8)).u8(static_cast<std::uint8_t>(value));
  }
  Rtps& entity(std::uint32_t id) {
    return big16(static_cast<std::uint16_t>(id >> 16)).big16(static_cast<std::uint16_t>(id));
  }
  Rtps& sequence(std::int64_t number) {
    const auto bits = static_cast<std::uint64_t>(number);
    return u32(static_cast<std::uint32_t>(bits >> 32)).u32(static_cast<std::uint32_t>(bits));
  }
  template <class List>
  Rtps& add(const List& list) {
    bytes.insert(bytes.end(), list.begin(), list.end());
    return *this;
  }
  Rtps& zeros(std::size_t count) {
    bytes.resize(bytes.size() + count);
    return *this;
  }
  /// Length, text, end mark, padding.
  Rtps& text(const std::string& words) {
    u32(static_cast<std::uint32_t>(words.size() + 1));
    add(words);
    return u8(0).align();
  }
  Rtps& align() {
    while (bytes.size() % 4 != 0) u8(0);
    return *this;
  }

  /// A submessage: what is written from here to end() is its body.
  Rtps& begin(std::uint8_t id, std::uint8_t flags = 1) {
    u8(id).u8(flags);
    length_at_ = bytes.size();
    return u16(0);
  }
  Rtps& end() { return set_length(length_at_); }
  /// A parameter, alike.
  Rtps& begin_parameter(std::uint16_t id) {
    u16(id);
    parameter_at_ = bytes.size();
    return u16(0);
  }
  Rtps& end_parameter() { return align().set_length(parameter_at_); }

  Rtps& to(const Key& participant) { return begin(0x0e).add(participant).end(); }
  Rtps& timestamp() { return begin(0x09).u32(1).u32(2).end(); }
  Rtps& heartbeat(std::int64_t first, std::int64_t last, std::uint32_t count = 1,
                  std::uint32_t reader = 0x000003c7, std::uint32_t writer = kPublicationsWriter) {
    return begin(0x07)
        .entity(reader)
        .entity(writer)
        .sequence(first)
        .sequence(last)
        .u32(count)
        .end();
  }
  Rtps& set(std::int64_t base, std::uint32_t bits) {
    sequence(base).u32(bits);
    for (std::uint32_t i = 0; i < (bits + 31) / 32; ++i) u32(0xffffffff);
    return *this;
  }
  Rtps& ack_nack(std::int64_t base, std::uint32_t bits, std::uint32_t count = 1,
                 std::uint32_t reader = 0x000003c7, std::uint32_t writer = kPublicationsWriter) {
    return begin(0x06).entity(reader).entity(writer).set(base, bits).u32(count).end();
  }
  Rtps& gap(std::int64_t start, std::int64_t base, std::uint32_t bits,
            std::uint32_t reader = 0x000003c7, std::uint32_t writer = kPublicationsWriter) {
    return begin(0x08).entity(reader).entity(writer).sequence(start).set(base, bits).end();
  }
  /// Flags: 2 inline QoS follow, 4 data, 8 key.
  Rtps& begin_data(std::uint32_t reader, std::uint32_t writer, std::int64_t number,
                   std::uint8_t flags) {
    return begin(0x15, static_cast<std::uint8_t>(1 | flags))
        .u16(0)
        .u16(16)
        .entity(reader)
        .entity(writer)
        .sequence(number);
  }
  Rtps& encapsulation(std::uint8_t kind) { return u8(0).u8(kind).u16(0); }
  Rtps& sentinel() { return u16(1).u16(0); }
  Rtps& guid(std::uint32_t entity_id) { return add(key_).entity(entity_id); }
  Rtps& locator(std::uint16_t id, std::uint32_t port, std::uint8_t last = 1) {
    begin_parameter(id).u32(1).u32(port).zeros(12);
    return u8(127).u8(0).u8(0).u8(last).end_parameter();
  }
  Rtps& user_data(const RtpsBytes& data) {
    begin_parameter(0x002c).u32(static_cast<std::uint32_t>(data.size())).add(data);
    return end_parameter();
  }
  /// What a participant says of itself, up to its own parameters; close with finish_announcement().
  Rtps& begin_announcement(std::int64_t number = 1) {
    begin_data(kParticipantReader, kParticipantWriter, number, 4).encapsulation(3);
    begin_parameter(0x0015).u8(2).u8(3).u16(0).end_parameter();
    begin_parameter(0x0016).big16(0x010f).u16(0).end_parameter();
    begin_parameter(0x0050).guid(0x000001c1).end_parameter();
    locator(0x0032, 7410);
    locator(0x0031, 7411);
    begin_parameter(0x0058).u32(0x3f).end_parameter();
    return *this;
  }
  Rtps& lease(std::int32_t seconds, std::uint32_t fraction = 0) {
    return begin_parameter(0x0002)
        .u32(static_cast<std::uint32_t>(seconds))
        .u32(fraction)
        .end_parameter();
  }
  /// With a name and an identity, after begin_announcement().
  Rtps& secured(const std::string& name) {
    begin_parameter(0x0062).text(name).end_parameter();
    return begin_parameter(0x1001).text("DDS:Auth:PKI-DH:1.0").u32(0).u32(0).end_parameter();
  }
  /// Of which Fast DDS it is, as 3 and later say.
  Rtps& product(std::uint32_t version) {
    return begin_parameter(0x8000).u32(version).end_parameter();
  }
  Rtps& finish_announcement() { return sentinel().end(); }
  Rtps& announcement(std::int64_t number = 1, std::int32_t lease_s = 20) {
    return begin_announcement(number).lease(lease_s).finish_announcement();
  }
  Rtps& farewell(std::int64_t number = 2) {
    begin_data(kParticipantReader, kParticipantWriter, number, 2);
    begin_parameter(0x0070).guid(0x000001c1).end_parameter();
    begin_parameter(0x0071).u8(0).u8(0).u8(0).u8(3).end_parameter();
    return sentinel().end();
  }
  /// What a participant says of an endpoint of its own, up to its own parameters; close with
  /// finish_announcement().
  Rtps& begin_endpoint(bool is_writer, const std::string& topic, const std::string& type,
                       std::int64_t number = 1) {
    begin_data(is_writer ? 0x000003c7 : 0x000004c7,
               is_writer ? kPublicationsWriter : kSubscriptionsWriter, number, 4)
        .encapsulation(3);
    begin_parameter(0x5a).guid(is_writer ? 0x103 : 0x104).end_parameter();
    begin_parameter(0x05).text(topic).end_parameter();
    return begin_parameter(0x07).text(type).end_parameter();
  }
  /// The type of an endpoint, a union by the kind of a type that nobody knows: Fast DDS 2.9 follows
  /// a null pointer there.
  Rtps& malformed_type() {
    constexpr std::uint8_t kComplete = 0xf2, kUnion = 0x52;
    begin_parameter(0x69).encapsulation(1).u8(kComplete).zeros(15).end_parameter();
    begin_parameter(0x72).encapsulation(1).u8(kComplete).u8(kUnion).zeros(24);
    return u8(kComplete).zeros(33).u32(1).zeros(60).end_parameter();  // its kind; one member
  }
  /// Of a sample: `count` fragments of `size` bytes, from the `first` on. Flags: 2 inline QoS
  /// follow, 4 key.
  Rtps& fragments(std::uint32_t first, std::uint16_t count, std::uint16_t size, std::uint32_t total,
                  std::size_t held, std::uint32_t writer = 0x103, std::uint8_t flags = 0,
                  std::uint32_t reader = 0, std::int64_t number = 1) {
    begin(0x16, static_cast<std::uint8_t>(1 | flags)).u16(0).u16(28).entity(reader).entity(writer);
    return sequence(number).u32(first).u16(count).u16(size).u32(total).zeros(held).end();
  }
  /// What follows is another participant's word.
  Rtps& speaker(const Key& key, std::uint16_t vendor = 0x0110) {
    key_ = key;
    return begin(0x0c).u32(0).u8(2).u8(3).big16(vendor).add(key).end();
  }
  /// As Fast DDS writes it, last.
  Rtps& statistics() { return u8(0x80).u8(0).big16(56).zeros(56); }

 private:
  Rtps& little(std::uint64_t value, std::size_t size) {
    for (std::size_t i = 0; i < size; ++i) u8(static_cast<std::uint8_t>(value >> (8 * i)));
    return *this;
  }
  Rtps& set_length(std::size_t at) {
    const std::size_t length = bytes.size() - at - 2;
    bytes[at] = static_cast<std::uint8_t>(length);
    bytes[at + 1] = static_cast<std::uint8_t>(length >> 8);
    return *this;
  }

  Key key_;
  std::size_t length_at_ = 0, parameter_at_ = 0;
};

inline Rtps::Key key_of(std::uint8_t number) { return {1, 15, 1, 2, 3, 4, 5, 6, 7, 8, 9, number}; }

/// The packet that ends Fast DDS 2.9.1 with assertions: statistics that are not last. 84 bytes.
inline RtpsBytes deadly_packet() {
  Rtps packet(Rtps::Key{});
  packet.u8(0x80).u8(1).u16(56).zeros(60);
  return packet.bytes;
}

}  // namespace nearmesh::test
