// SPDX-License-Identifier: Apache-2.0
#pragma once
// What both sides of an MCAP file know: kinds of records, its first and last bytes, checksums. For
// mcap_writer.cpp and mcap_reader.cpp alone.

#include <zlib.h>

#include <bit>
#include <cstddef>
#include <cstdint>
#include <string_view>

namespace nearmesh::mcap {

static_assert(std::endian::native == std::endian::little);

// A record is its kind, the length of what follows as 8 bytes, and that.
enum Kind : std::uint8_t {
  kHeader = 0x01,
  kFooter = 0x02,
  kSchema = 0x03,
  kChannel = 0x04,
  kMessage = 0x05,
  kChunk = 0x06,
  kMessageIndex = 0x07,
  kChunkIndex = 0x08,
  kAttachment = 0x09,
  kAttachmentIndex = 0x0a,
  kStatistics = 0x0b,
  kMetadata = 0x0c,
  kMetadataIndex = 0x0d,
  kSummaryOffset = 0x0e,
  kDataEnd = 0x0f,
};

inline constexpr std::string_view kMagic("\x89MCAP0\r\n", 8);
inline constexpr std::size_t kRecordHead = 9;

[[nodiscard]] inline std::uint32_t checksum(std::string_view bytes, std::uint32_t before = 0) {
  return static_cast<std::uint32_t>(
      crc32_z(before, reinterpret_cast<const Bytef*>(bytes.data()), bytes.size()));
}

}  // namespace nearmesh::mcap
