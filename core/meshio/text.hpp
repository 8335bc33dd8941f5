// SPDX-License-Identifier: Apache-2.0
#pragma once
// Lines, words and numbers of a text file that nobody vouches for.

#include <charconv>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <locale>
#include <optional>
#include <sstream>
#include <string>
#include <string_view>
#include <utility>

#include "nearmesh/core/base/status.hpp"

namespace nearmesh::meshio {

/// What such a text is told by: format, place, what was expected and what was found.
inline Status corrupt(std::string message) { return {StatusCode::kCorrupt, std::move(message)}; }

inline bool is_blank(char c) {
  return c == ' ' || c == '\t' || c == '\r' || c == '\n' || c == '\f' || c == '\v';
}

inline char to_lower(char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c; }

inline bool equal_ignoring_case(std::string_view a, std::string_view b) {
  if (a.size() != b.size()) return false;
  for (std::size_t k = 0; k < a.size(); ++k)
    if (to_lower(a[k]) != to_lower(b[k])) return false;
  return true;
}

/// Takes the next word off the front of `text`; empty at its end.
inline std::string_view take_word(std::string_view& text) {
  std::size_t begin = 0;
  while (begin < text.size() && is_blank(text[begin])) ++begin;
  std::size_t end = begin;
  while (end < text.size() && !is_blank(text[end])) ++end;
  const std::string_view word = text.substr(begin, end - begin);
  text.remove_prefix(end);
  return word;
}

/// Takes the next line off the front of `text`, without its end ("\n" or "\r\n"); none at its end.
inline std::optional<std::string_view> take_line(std::string_view& text) {
  if (text.empty()) return std::nullopt;
  const std::size_t end = text.find('\n');
  std::string_view line = text.substr(0, end);
  text.remove_prefix(end == std::string_view::npos ? text.size() : end + 1);
  if (!line.empty() && line.back() == '\r') line.remove_suffix(1);
  return line;
}

/// A whole number that fills the word.
inline std::optional<std::int64_t> parse_integer(std::string_view word) {
  if (word.starts_with('+')) word.remove_prefix(1);
  std::int64_t value = 0;
  const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
  if (error != std::errc() || end != word.data() + word.size()) return std::nullopt;
  return value;
}

/// What of a file a message quotes: short, printable.
inline std::string quote(std::string_view found) {
  if (found.empty()) return "nothing";
  std::string text = "\"";
  for (const char c : found.substr(0, 40)) text += c >= ' ' && c <= '~' ? c : '?';
  return text + (found.size() > 40 ? "...\"" : "\"");
}

/// A number as a message has it: short, and as exact as anybody needs to find it.
inline std::string quote_number(double x) {
  char text[40];
  std::snprintf(text, sizeof text, "%.9g", x);
  return text;
}

/// A finite number that a double holds; one too small for a double is zero.
/// Errors: kCorrupt (not a number), kInvalidArgument (not finite), both naming the place.
inline Status parse_coordinate(std::string_view word, const std::string& place, double& value) {
  std::string_view digits = word;
  if (digits.starts_with('+')) digits.remove_prefix(1);
  value = 0;
  const auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), value);
  if (error == std::errc::invalid_argument || end != digits.data() + digits.size())
    return {StatusCode::kCorrupt, place + ": expected a coordinate, found " + quote(word)};
  // from_chars does not tell too great from too small; a stream does. Not strtod: where the host's
  // locale has a decimal comma that reads 2.5e-400 as 2.
  if (error == std::errc::result_out_of_range) {
    std::istringstream text{std::string(digits)};
    text.imbue(std::locale::classic());
    if (!(text >> value)) value = HUGE_VAL;
  }
  if (!std::isfinite(value))
    return {StatusCode::kInvalidArgument,
            place + ": expected a finite coordinate, found " + quote(word)};
  return Status::ok();
}

}  // namespace nearmesh::meshio
