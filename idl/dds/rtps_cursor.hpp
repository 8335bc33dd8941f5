// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>

#include "rtps_ids.hpp"

namespace nearmesh::wire {

/// Takes numbers off bytes. What is not there is 0, and leaves the cursor broken.
class Cursor {
 public:
  using Bytes = std::span<const std::uint8_t>;

  Cursor(Bytes bytes, bool little_endian) : bytes_(bytes), little_endian_(little_endian) {}

  [[nodiscard]] bool is_whole() const { return whole_; }
  [[nodiscard]] std::size_t at() const { return at_; }
  [[nodiscard]] std::size_t left() const { return bytes_.size() - at_; }
  [[nodiscard]] Bytes rest() const { return bytes_.subspan(at_); }
  void fail() { whole_ = false; }

  bool skip(std::size_t count) {
    if (count > left()) {
      whole_ = false;
      at_ = bytes_.size();
      return false;
    }
    at_ += count;
    return true;
  }
  Bytes take(std::size_t count) {
    const std::size_t from = at_;
    return skip(count) ? bytes_.subspan(from, count) : Bytes{};
  }
  std::uint16_t u16() { return static_cast<std::uint16_t>(number(2, little_endian_)); }
  std::uint32_t u32() { return static_cast<std::uint32_t>(number(4, little_endian_)); }
  /// Entity ids and the like, whatever the order of numbers.
  std::uint32_t big_u32() { return static_cast<std::uint32_t>(number(4, false)); }
  std::int64_t sequence() {
    const auto high = static_cast<std::int32_t>(u32());
    const std::uint32_t low = u32();
    return static_cast<std::int64_t>(
        (static_cast<std::uint64_t>(static_cast<std::int64_t>(high)) << 32) | low);
  }
  /// To a multiple of four; at the end the padding may be missing.
  void align() { at_ = std::min((at_ + 3) & ~std::size_t{3}, bytes_.size()); }

  Bytes bytes() {
    const Bytes found = take(u32());
    align();
    return found;
  }
  void text() { static_cast<void>(bytes()); }
  /// As above, read by Fast DDS up to its end mark.
  void terminated_text() {
    const Bytes bytes = take(u32());
    if (bytes.empty() || bytes.back() != 0) whole_ = false;
    align();
  }
  /// A list of so many things, each of at least so many bytes: the count is used for memory before
  /// the things are read.
  std::uint32_t count(std::size_t least_bytes) {
    const std::uint32_t found = u32();
    if (!whole_ || found > left() / least_bytes) {
      whole_ = false;
      return 0;
    }
    return found;
  }

 private:
  std::uint64_t number(std::size_t bytes, bool little_endian) {
    const Bytes found = take(bytes);
    std::uint64_t value = 0;
    for (std::size_t i = 0; i < found.size(); ++i)
      value |= static_cast<std::uint64_t>(found[i])
               << (8 * (little_endian ? i : found.size() - 1 - i));
    return value;
  }

  Bytes bytes_;
  bool little_endian_;
  std::size_t at_ = 0;
  bool whole_ = true;
};

/// What a message says: use(id, flags, body) of each submessage, but for those that only tell when
/// it was said, to whom, and statistics.
/// Out: false where use() gave false, and where it is malformed; then what follows is not looked
/// at.
template <class Use>
[[nodiscard]] bool for_each_word(Cursor::Bytes message, const Use& use) {
  for (std::size_t at = rtps_ids::kHeaderBytes; at + 4 <= message.size();) {
    const std::uint8_t id = message[at], flags = message[at + 1];
    const bool little_endian = (flags & 1) != 0;
    const std::size_t length = Cursor(message.subspan(at + 2, 2), little_endian).u16();
    if (length > message.size() - at - 4) return false;
    const bool is_word = id != rtps_ids::kInfoTimestamp && id != rtps_ids::kInfoDestination &&
                         id != rtps_ids::kStatistics;
    if (is_word && !use(id, flags, Cursor(message.subspan(at + 4, length), little_endian)))
      return false;
    at += 4 + length;
  }
  return true;
}

}  // namespace nearmesh::wire
