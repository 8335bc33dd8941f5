// SPDX-License-Identifier: Apache-2.0
#pragma once
// Numbers one after the other in bytes, the lowest byte first.

#include <array>
#include <bit>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "core/base/short_number.hpp"

namespace nearmesh {

/// Puts numbers one after the other.
class Packer {
 public:
  template <class Unsigned>
  void put(Unsigned value) {
    for (std::size_t k = 0; k < sizeof value; ++k)
      bytes.push_back(static_cast<std::uint8_t>(value >> 8 * k));
  }
  void put(float value) { put(std::bit_cast<std::uint32_t>(value)); }
  template <std::size_t N>
  void put(const std::array<float, N>& values) {
    for (const float value : values) put(value);
  }

  std::vector<std::uint8_t> bytes;
};

/// Takes them out again; zeros once the bytes are over.
class Unpacker {
 public:
  explicit Unpacker(std::span<const std::uint8_t> bytes) : bytes_(bytes) {}

  template <class Unsigned>
  void get(Unsigned& value) {
    value = 0;
    const std::span<const std::uint8_t> own = take(sizeof value);
    for (std::size_t k = 0; k < own.size(); ++k)
      value = static_cast<Unsigned>(value | static_cast<Unsigned>(Unsigned{own[k]} << 8 * k));
  }
  void get(float& value) {
    std::uint32_t bits = 0;
    get(bits);
    value = std::bit_cast<float>(bits);
  }
  template <std::size_t N>
  void get(std::array<float, N>& values) {
    for (float& value : values) get(value);
  }
  void get_number(std::uint64_t& value) {
    const std::optional<std::uint64_t> number = take_number(bytes_);
    failed_ |= !number;
    value = number.value_or(0);
  }
  std::span<const std::uint8_t> take(std::size_t count) {
    if (count > bytes_.size()) {
      failed_ = true;
      return {};
    }
    const std::span<const std::uint8_t> own = bytes_.first(count);
    bytes_ = bytes_.subspan(count);
    return own;
  }
  [[nodiscard]] bool is_whole() const { return !failed_ && bytes_.empty(); }
  [[nodiscard]] bool has_failed() const { return failed_; }

 private:
  std::span<const std::uint8_t> bytes_;
  bool failed_ = false;
};

}  // namespace nearmesh
