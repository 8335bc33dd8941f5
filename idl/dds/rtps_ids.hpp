// SPDX-License-Identifier: Apache-2.0
#pragma once
// Numbers that RTPS gives to what is in a message. Source: DDSI-RTPS 2.3, 9.3.1.5 and 9.4.5.1; 0x80
// is eProsima's.

#include <cstddef>
#include <cstdint>

namespace nearmesh::wire::rtps_ids {

inline constexpr std::size_t kHeaderBytes = 20;

enum Submessage : std::uint8_t {
  kPad = 0x01,
  kAckNack = 0x06,
  kHeartbeat = 0x07,
  kGap = 0x08,
  kInfoTimestamp = 0x09,
  kInfoSource = 0x0c,
  kInfoDestination = 0x0e,
  kNackFragment = 0x12,
  kHeartbeatFragment = 0x13,
  kData = 0x15,
  kDataFragment = 0x16,
  kSecureBody = 0x30,
  kSecurePrefix = 0x31,
  kSecurePostfix = 0x32,
  kRtpsPrefix = 0x33,
  kRtpsPostfix = 0x34,
  kStatistics = 0x80,
};

/// Writers of discovery, as a number of four bytes. What they write is read before anybody is
/// known.
enum BuiltinWriter : std::uint32_t {
  kParticipants = 0x000100c2,
  kWriters = 0x000003c2,
  kReaders = 0x000004c2,
  kSecureWriters = 0xff0003c2,
  kSecureReaders = 0xff0004c2,
  kLiveliness = 0x000200c2,
  kHandshakes = 0x000201c3,
  kNobody = 0,
};

}  // namespace nearmesh::wire::rtps_ids
