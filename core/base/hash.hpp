// SPDX-License-Identifier: Apache-2.0
#pragma once
// Checksums of bytes and an order-independent mix for digests of sets.

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "nearmesh/core/base/content_hash.hpp"

namespace nearmesh {

/// XXH3, 64 bits: for checksums (not against an adversary: digest.hpp).
[[nodiscard]] std::uint64_t hash_bytes(std::span<const std::uint8_t> bytes, std::uint64_t seed = 0);

/// 16 hexadecimal digits, as hashes and session ids are shown to people.
[[nodiscard]] std::string to_hex(std::uint64_t value);

/// Scrambles one number (SplitMix64's finaliser). The sum of mixes digests a set in any order.
[[nodiscard]] constexpr std::uint64_t mix(std::uint64_t x) {
  x += 0x9e3779b97f4a7c15ULL;
  x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9ULL;
  x = (x ^ (x >> 27)) * 0x94d049bb133111ebULL;
  return x ^ (x >> 31);
}

}  // namespace nearmesh
