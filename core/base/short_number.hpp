// SPDX-License-Identifier: Apache-2.0
#pragma once
// Numbers in as few bytes as they need: seven bits a byte, the lowest first, the highest bit set in
// all but the last.

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

namespace nearmesh {

inline void append_number(std::uint64_t rest, std::vector<std::uint8_t>& to) {
  for (; rest >= 128; rest >>= 7U) to.push_back(static_cast<std::uint8_t>(rest % 128 + 128));
  to.push_back(static_cast<std::uint8_t>(rest));
}

/// Takes it away from the bytes; nothing where it does not end, is longer than it must be, or has
/// more than 56 bits.
[[nodiscard]] inline std::optional<std::uint64_t> take_number(
    std::span<const std::uint8_t>& bytes) {
  constexpr unsigned kMostBits = 56;
  std::uint64_t number = 0;
  for (unsigned shift = 0; shift < kMostBits && !bytes.empty(); shift += 7) {
    const std::uint8_t byte = bytes.front();
    bytes = bytes.subspan(1);
    number |= static_cast<std::uint64_t>(byte % 128) << shift;
    if (byte >= 128) continue;
    if (byte == 0 && shift > 0) return std::nullopt;
    return number;
  }
  return std::nullopt;
}

}  // namespace nearmesh
