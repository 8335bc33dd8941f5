// SPDX-License-Identifier: Apache-2.0
#pragma once
// API (docs/api.md).
// What a model is called by those who must not mistake it for another: 128 bits of a cryptographic
// hash over all that peers may get of it (core/spm_format.md).

#include <compare>
#include <cstdint>
#include <string>

namespace nearmesh {

struct ContentHash {
  std::uint64_t high = 0, low = 0;

  /// Whether it names a content; all zeros name none.
  [[nodiscard]] constexpr bool is_set() const { return (high | low) != 0; }
  friend constexpr auto operator<=>(const ContentHash&, const ContentHash&) = default;
};

/// 32 hexadecimal digits.
[[nodiscard]] std::string to_hex(const ContentHash& hash);

}  // namespace nearmesh
