// SPDX-License-Identifier: Apache-2.0
#pragma once
// Bit strings, most significant bit first.

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <cstring>
#include <span>
#include <vector>

namespace nearmesh {

/// Number of bits needed for x: 0 for 0, 1 for 1, 2 for 2 and 3, ...
constexpr int bit_length(std::uint64_t x) { return static_cast<int>(std::bit_width(x)); }

/// Number of bits needed for count - 1, count in [1, 2^31]: to say which of so many. Without a
/// branch for 1.
constexpr int index_bits(std::uint32_t count) { return std::bit_width(2 * count - 1) - 1; }

class BitWriter {
 public:
  /// Appends the low `count` bits of value, count in [0, 32].
  void put(std::uint64_t value, int count) {
    pending_ = (pending_ << count) | (value & ((1ULL << count) - 1));
    pending_bits_ += count;
    if (pending_bits_ >= 32) {
      pending_bits_ -= 32;
      words_.push_back(static_cast<std::uint32_t>(pending_ >> pending_bits_));
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
  /// A number below 2^31: how many bits it has, then those below the leading one.
  void put_count(std::uint32_t value) {
    const int length = bit_length(value);
    put(static_cast<std::uint64_t>(length), 5);
    if (length > 1) put(value, length - 1);
  }
  void append(const BitWriter& other) {
    for (const std::uint32_t word : other.words_) put(word, 32);
    put(other.pending_, other.pending_bits_);
  }
  [[nodiscard]] std::size_t bit_count() const {
    return words_.size() * 32 + static_cast<std::size_t>(pending_bits_);
  }
  /// The bytes, the last one filled up with zeros.
  [[nodiscard]] std::vector<std::uint8_t> finish() && {
    const std::size_t size = (bit_count() + 7) / 8;
    put(0, 32 - pending_bits_);  // makes the rest a word
    std::vector<std::uint8_t> bytes(words_.size() * 4);
    for (std::size_t i = 0; i < words_.size(); ++i)
      for (std::size_t k = 0; k < 4; ++k)
        bytes[4 * i + k] = static_cast<std::uint8_t>(words_[i] >> (24 - 8 * k));
    bytes.resize(size);
    return bytes;
  }
  void clear() {
    words_.clear();
    pending_ = 0;
    pending_bits_ = 0;
  }
  /// Cuts back to an earlier bit_count().
  void truncate(std::size_t bits) {
    const std::size_t whole = bits / 32;
    const int rest = static_cast<int>(bits % 32);
    if (whole < words_.size()) {
      pending_ = words_[whole] >> 1 >> (31 - rest);
      words_.resize(whole);
    } else {
      pending_ >>= pending_bits_ - rest;
    }
    pending_bits_ = rest;
  }

 private:
  std::vector<std::uint32_t> words_;
  std::uint64_t pending_ = 0;  // its low pending_bits_ bits, fewer than 32
  int pending_bits_ = 0;
};

/// Reads zeros past the end and remembers that it did, as it does a code that no writer makes:
/// decoders check overrun(), never each read.
class BitReader {
 public:
  explicit BitReader(std::span<const std::uint8_t> bytes) : bytes_(bytes) {}

  /// The next bits, left-aligned: at least 57 of them, without consuming any.
  [[nodiscard]] std::uint64_t window() const {
    const std::size_t byte = used_ / 8;
    std::uint64_t word = 0;
    if (byte + sizeof word <= bytes_.size()) [[likely]] {
      std::memcpy(&word, bytes_.data() + byte, sizeof word);
    } else if (byte < bytes_.size()) {
      std::memcpy(&word, bytes_.data() + byte, bytes_.size() - byte);
    }
    return __builtin_bswap64(word) << (used_ % 8);
  }
  /// The next `count` bits without consuming them, count in [0, 32].
  [[nodiscard]] std::uint32_t peek(int count) const {
    return static_cast<std::uint32_t>((window() >> 1) >> (63 - count));
  }
  void skip(int count) { used_ += static_cast<std::size_t>(count); }
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
    const int zeros = std::countl_zero(window());
    // No number that put_gamma takes has 32 leading zeros: as good as an end of the bytes, and as
    // loud.
    if (zeros >= 32) {
      used_ = bytes_.size() * 8 + 1;
      return 0;
    }
    skip(zeros);
    return get(zeros + 1) - std::uint64_t{1};
  }
  std::uint32_t get_count() {
    const auto length = static_cast<int>(get(5));
    return length > 1 ? 1U << (length - 1) | get(length - 1) : static_cast<std::uint32_t>(length);
  }
  [[nodiscard]] bool overrun() const { return used_ > bytes_.size() * 8; }
  [[nodiscard]] std::size_t bits_left() const { return overrun() ? 0 : bytes_.size() * 8 - used_; }
  [[nodiscard]] std::span<const std::uint8_t> bytes() const { return bytes_; }
  [[nodiscard]] std::size_t used() const { return used_; }

 private:
  std::span<const std::uint8_t> bytes_;
  std::size_t used_ = 0;
};

/// Bytes and zeros after them, so that a reader who asks now and then how far it got need not check
/// each read.
class PaddedBytes {
 public:
  static constexpr std::size_t kPadding = 256;

  explicit PaddedBytes(std::span<const std::uint8_t> bytes) {
    if (bytes.size() + kPadding > few_.size()) many_.resize(bytes.size() + kPadding);
    std::uint8_t* const begin = many_.empty() ? few_.data() : many_.data();
    std::copy(bytes.begin(), bytes.end(), begin);
    std::memset(begin + bytes.size(), 0, kPadding);
    begin_ = begin;
  }
  PaddedBytes(const PaddedBytes&) = delete;
  PaddedBytes& operator=(const PaddedBytes&) = delete;
  [[nodiscard]] const std::uint8_t* begin() const { return begin_; }

 private:
  std::array<std::uint8_t, 2048> few_;  // enough for a batch on the wire
  std::vector<std::uint8_t> many_;
  const std::uint8_t* begin_;
};

/// For decoders that take many short fields: what refill() fetches is ready before the fields ahead
/// of it are known. Goes on past the end of what it reads: who uses it asks used_bits() before it
/// may have passed PaddedBytes::kPadding.
class WindowReader {
 public:
  /// From the bit `first` on.
  WindowReader(const PaddedBytes& bytes, std::size_t first)
      : begin_(bytes.begin()), next_(begin_ + first / 8) {
    refill();
    take(first % 8);
  }
  /// So many bits are ready after refill().
  static constexpr int kReadyBits = 56;
  void refill() {
    std::uint64_t word;
    std::memcpy(&word, next_, sizeof word);
    window_ |= __builtin_bswap64(word) >> held_;
    next_ += (63 - held_) / 8;
    held_ |= 56;
  }
  /// The bits ahead, left-aligned.
  [[nodiscard]] std::uint64_t window() const { return window_; }
  void take(std::uint64_t bits) {
    window_ <<= bits;
    held_ -= bits;
  }
  /// Of all bytes.
  [[nodiscard]] std::size_t used_bits() const {
    return static_cast<std::size_t>(next_ - begin_) * 8 - held_;
  }

 private:
  const std::uint8_t *begin_, *next_;  // next_: where the next word begins
  std::uint64_t window_ = 0;           // held_ bits, then zeros or the first of those that follow
  std::uint64_t held_ = 0;             // below 64
};

}  // namespace nearmesh
