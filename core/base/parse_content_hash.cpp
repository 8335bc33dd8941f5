// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/core/base/parse_content_hash.hpp"

namespace nearmesh {

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
