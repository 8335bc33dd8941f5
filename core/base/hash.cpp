// SPDX-License-Identifier: Apache-2.0
#include "hash.hpp"

#include <algorithm>

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

Result<ContentHash> parse_content_hash(std::string_view text) {
  const std::size_t digits = to_hex(ContentHash{}).size();
  ContentHash hash;
  bool is_hex = text.size() == digits;
  for (std::size_t i = 0; is_hex && i < digits; ++i) {
    const std::size_t digit = std::string_view("0123456789abcdef").find(text[i]);
    is_hex = digit != std::string_view::npos;
    std::uint64_t& word = i < digits / 2 ? hash.high : hash.low;
    word = word << 4 | (digit & 15U);
  }
  if (is_hex && hash.is_set()) return hash;
  return Status{StatusCode::kInvalidArgument,
                "content: expected " + std::to_string(digits) +
                    " hexadecimal digits, as nearmesh-model info prints them, found '" +
                    std::string(text) + "'"};
}

}  // namespace nearmesh
