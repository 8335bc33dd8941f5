// SPDX-License-Identifier: Apache-2.0
#pragma once
// Bit strings, most significant bit first.

#include <bit>
#include <cstdint>
#include <span>
#include <vector>

namespace nearmesh {

/// Number of bits needed for x: 0 for 0, 1 for 1, 2 for 2 and 3, ...
inline int bit_length(std::uint64_t x) { return static_cast<int>(std::bit_width(x)); }

class BitWriter {
 public:
  /// Appends the low `count` bits of value, count in [0, 32].
  void put(std::uint64_t value, int count) {
    pending_ = (pending_ << count) | (value & ((1ULL << count) - 1));
    pending_bits_ += count;
    while (pending_bits_ >= 8) {
      pending_bits_ -= 8;
      bytes_.push_back(static_cast<std::uint8_t>(pending_ >> pending_bits_));
    }
  }
  void put64(std::uint64_t value) {
    put(value >> 32, 32);
    put(value & 0xffffffffU, 32);
  }
  /// Elias gamma of value + 1: about 2 log2 bits, value < 2^32 - 1.
  void put_gamma(std::uint64_t value) {
    const int length = bit_length(value + 1);
    put(0, length - 1);
    put(value + 1, length);
  }
  void append(const BitWriter& other) {
    for (const std::uint8_t byte : other.bytes_) put(byte, 8);
    put(other.pending_, other.pending_bits_);
  }
  [[nodiscard]] std::size_t bit_count() const {
    return bytes_.size() * 8 + static_cast<std::size_t>(pending_bits_);
  }
  /// The bytes, the last one filled up with zeros.
  [[nodiscard]] std::vector<std::uint8_t> finish() && {
    if (pending_bits_ > 0) put(0, 8 - pending_bits_);
    return std::move(bytes_);
  }
  void clear() {
    bytes_.clear();
    pending_ = 0;
    pending_bits_ = 0;
  }
  /// Cuts back to an earlier bit_count().
  void truncate(std::size_t bits) {
    const std::size_t whole = bits / 8;
    const int rest = static_cast<int>(bits % 8);
    std::uint64_t last = 0;
    if (rest > 0)
      last = (whole < bytes_.size() ? bytes_[whole] : pending_ << (8 - pending_bits_)) & 0xffU;
    bytes_.resize(whole);
    pending_ = last >> (8 - rest);
    pending_bits_ = rest;
  }

 private:
  std::vector<std::uint8_t> bytes_;
  std::uint64_t pending_ = 0;
  int pending_bits_ = 0;
};

/// Reads zeros past the end and remembers that it did, as it does a code that no writer makes: decoders check overrun(),
/// never each read.
class BitReader {
 public:
  explicit BitReader(std::span<const std::uint8_t> bytes) : bytes_(bytes) {}

  /// The next `count` bits without consuming them, count in [0, 32].
  std::uint32_t peek(int count) {
    if (available_ < count) refill();
    return static_cast<std::uint32_t>((window_ >> 1) >> (63 - count));
  }
  void skip(int count) {
    window_ <<= count;
    available_ -= count;
    used_ += static_cast<std::size_t>(count);
  }
  std::uint32_t get(int count) {
    const std::uint32_t value = peek(count);
    skip(count);
    return value;
  }
  std::uint64_t get64() {
    const std::uint64_t high = get(32);
    return high << 32 | get(32);
  }
  std::uint64_t get_gamma() {
    int zeros = 0;
    while (peek(1) == 0) {
      skip(1);
      // No number that put_gamma takes has 32 leading zeros: as good as an end of the bytes, and as loud.
      if (++zeros == 32) used_ = bytes_.size() * 8 + 1;
      if (overrun()) return 0;
    }
    return get(zeros + 1) - std::uint64_t{1};
  }
  [[nodiscard]] bool overrun() const { return used_ > bytes_.size() * 8; }
  [[nodiscard]] std::size_t bits_left() const { return overrun() ? 0 : bytes_.size() * 8 - used_; }

 private:
  void refill() {
    while (available_ <= 56) {
      const std::uint64_t byte = next_ < bytes_.size() ? bytes_[next_] : 0;
      ++next_;
      window_ |= byte << (56 - available_);
      available_ += 8;
    }
  }
  std::span<const std::uint8_t> bytes_;
  std::uint64_t window_ = 0;  // left-aligned
  int available_ = 0;
  std::size_t next_ = 0;
  std::size_t used_ = 0;
};

}  // namespace nearmesh
