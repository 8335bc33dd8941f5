// SPDX-License-Identifier: Apache-2.0
#pragma once
// What the codecs share: lists of words and lines of text, as samples carry them. For codec_*.cpp
// alone.

#include <cstddef>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "codec.hpp"

namespace nearmesh::wire {

using Octets = std::vector<std::uint8_t>;

inline constexpr std::size_t kWordsPerContent = 2;

inline Status malformed(std::string message) {
  return {StatusCode::kInvalidArgument, std::move(message)};
}

/// A flat list must hold whole records, and no more than the message may have.
inline Status check_words(std::size_t found, std::size_t per_record, std::size_t limit,
                          const char* field) {
  if (found % per_record == 0 && found / per_record <= limit) return Status::ok();
  return malformed(std::string(field) + ": expected at most " + std::to_string(limit) + " times " +
                   std::to_string(per_record) + " words, found " + std::to_string(found));
}

/// Nobody knows what an unknown bit would say.
inline Status check_bits(std::uint8_t found, unsigned known, const char* field) {
  if ((found & ~known) == 0) return Status::ok();
  return malformed(std::string(field) + ": found unknown bits, " + std::to_string(found));
}

template <class Message>
Result<Message> checked(Message message) {
  NEARMESH_RETURN_IF_ERROR(check(message));
  return message;
}

inline void append_line(const std::string& line, Octets& to) {
  to.insert(to.end(), line.begin(), line.end());
  to.push_back('\n');
}

/// The lines, each of which must end; `least` to `most` of them.
inline Result<std::vector<std::string>> split_lines(const Octets& octets, std::size_t least,
                                                    std::size_t most, const std::string& field) {
  std::vector<std::string> lines;
  std::string line;
  for (const std::uint8_t c : octets) {
    if (c != '\n') {
      line.push_back(static_cast<char>(c));
      continue;
    }
    if (lines.size() == most) return malformed(field + ": more than " + std::to_string(most));
    lines.push_back(std::exchange(line, {}));
  }
  if (lines.size() < least || !line.empty())
    return malformed(field + ": fewer whole ones than " + std::to_string(least));
  return lines;
}

inline void append_content(const ContentHash& content, std::vector<std::uint64_t>& to) {
  for (const std::uint64_t word : words_of(content)) to.push_back(word);
}

/// That of the place `at` in a list.
template <class Words>
ContentHash content_at(const Words& words, std::size_t at) {
  return {words[kWordsPerContent * at], words[kWordsPerContent * at + 1]};
}

}  // namespace nearmesh::wire
