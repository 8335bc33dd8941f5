// SPDX-License-Identifier: Apache-2.0
#include "hash.hpp"

#define XXH_INLINE_ALL  // NOLINT(readability-identifier-naming): the name is xxhash's
#include <xxhash.h>

namespace nearmesh {

std::uint64_t hash_bytes(std::span<const std::uint8_t> bytes, std::uint64_t seed) {
  return XXH3_64bits_withSeed(bytes.data(), bytes.size(), seed);
}

std::string to_hex(std::uint64_t value) {
  std::string text(16, '0');
  for (std::size_t i = 16; i-- > 0; value >>= 4) text[i] = "0123456789abcdef"[value & 15U];
  return text;
}

std::string to_hex(const ContentHash& hash) { return to_hex(hash.high) + to_hex(hash.low); }

}  // namespace nearmesh
