// SPDX-License-Identifier: Apache-2.0
#pragma once
// Contexts of the record codec, one code each (core/spm_format.md, "Coding tables"), and what
// stands after a symbol.

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>

#include "bits.hpp"

namespace nearmesh::record {

inline constexpr int kShapeSmall = 0;                // node sizes 3..8, one each
inline constexpr int kShapeLarge = kShapeSmall + 6;  // six classes of larger nodes
inline constexpr int kOffset0 = kShapeLarge + 6;     // twelve levels
inline constexpr int kLengthClasses = 24;
inline constexpr int kOffset1 = kOffset0 + 12;  // by the length on the axes before
inline constexpr int kOffset2 = kOffset1 + kLengthClasses;
inline constexpr int kFaceCount = kOffset2 + kLengthClasses;
inline constexpr int kInLeft = kFaceCount + 1;  // eight classes of side size
inline constexpr int kInRight = kInLeft + 8;
// All inner corners of two faces, by the sizes of both sides.
inline constexpr int kCorners = kInRight + 8;
inline constexpr int kOutside = kCorners + 19;  // 32 kinds of guesses
// 13 kinds of the first face's guesses x 13 of the second's.
inline constexpr int kOutsidePair = kOutside + 32;
// Known neighbour or the node x below or above x 12 node sizes.
inline constexpr int kDistance = kOutsidePair + 169;
inline constexpr int kBox = kDistance + 48;  // eleven classes of node size x three axes
inline constexpr int kContextCount = kBox + 33;

// Symbols with a meaning of their own.
inline constexpr std::uint32_t kLongShape = 120;  // kShapeLarge: the length stands after it
// kOffset0: added when the faces are not the usual two.
inline constexpr std::uint32_t kUnusualFaces = 33;
inline constexpr std::uint32_t kManyNewFaces = 10;  // kFaceCount: counts stand after it
// kOutside: no guess is right; kOutsideBelow + 1: above.
inline constexpr std::uint32_t kOutsideBelow = 4;
inline constexpr std::uint32_t kOutsideSymbols = 6;

/// What follows the symbol of a number, its bit length: the bits below its leading one.
struct NumberTail {
  static constexpr std::uint32_t bits(std::uint32_t symbol) {
    return symbol > 32 ? 0 : symbol - (symbol != 0 ? 1 : 0);
  }
};
/// Of an offset: the same and its sign.
struct OffsetTail {
  static constexpr std::uint32_t bits(std::uint32_t symbol) {
    const std::uint32_t length = symbol - (symbol >= kUnusualFaces ? kUnusualFaces : 0);
    return length > 32 ? 0 : length;
  }
};
/// How many bits follow a symbol whatever else is known.
constexpr std::uint32_t tail_bits(int context, std::uint32_t symbol) {
  if (context >= kOffset0 && context < kFaceCount) return OffsetTail::bits(symbol);
  const bool is_number =
      (context >= kInLeft && context < kCorners) || (context >= kDistance && context < kBox);
  return is_number ? NumberTail::bits(symbol) : 0;
}

// Classes of a node's size, by how many bits size - 1 has.
template <std::size_t kCount>
constexpr std::array<std::int8_t, 33> classes_of(const std::array<int, kCount>& last_bits) {
  std::array<std::int8_t, 33> classes{};
  for (int bits = 0; bits < 33; ++bits)
    for (const int last : last_bits)
      if (bits > last) ++classes[static_cast<std::size_t>(bits)];
  return classes;
}
// 2, 3-4, 5-8, 9-16, 17-64, and so on by fours to 65,536, more.
inline constexpr auto kBoxClasses = classes_of(std::array{1, 2, 3, 4, 6, 8, 10, 12, 14, 16});
// 2, 3-4, 5-8, 9-16, 17-32, and so on by fours to 131,072, more.
inline constexpr auto kLevelClasses = classes_of(std::array{1, 2, 3, 4, 5, 7, 9, 11, 13, 15, 17});
// 9-16, 17-32, 33-64, 65-512, 513-8192, more.
inline constexpr auto kLargeClasses = classes_of(std::array{4, 5, 6, 9, 13});
inline int class_of(std::uint32_t size, const std::array<std::int8_t, 33>& classes) {
  return classes[static_cast<std::size_t>(index_bits(size))];
}

/// Context of the distance to an outside corner that no guess names.
inline int distance_context(bool has_neighbour, bool below, std::uint32_t node_size) {
  const int direction = (has_neighbour ? 0 : 2) + (below ? 0 : 1);
  return kDistance + direction * 12 + std::min(index_bits(node_size), 12) - 1;
}

/// One symbol says all inner corners of two faces where both sides' sizes less one have so many
/// bits together.
inline constexpr int kMaxCornerBits = 3;
inline constexpr std::size_t kMaxCornerSize = 8;
/// By size of the left side, then of the right one.
inline constexpr auto kCornerContexts = [] {
  std::array<std::array<std::int16_t, kMaxCornerSize + 1>, kMaxCornerSize + 1> contexts{};
  int next = kCorners;
  for (std::size_t left = 1; left <= kMaxCornerSize; ++left)
    for (std::size_t right = left == 1 ? 2 : 1; right <= kMaxCornerSize; ++right)
      if (bit_length(left - 1) + bit_length(right - 1) <= kMaxCornerBits)
        contexts[left][right] = static_cast<std::int16_t>(next++);
  return contexts;
}();
static_assert(kCornerContexts[kMaxCornerSize][1] == kOutside - 1);

/// The kinds of guesses (OpenEdges::Around) that faces of a record have before any of them is
/// there: on each of the two lists the free places stand last. Others, which no model has, count as
/// the first.
inline constexpr auto kPairKinds = [] {
  std::array<std::uint8_t, 32> kinds{};
  std::uint8_t next = 0;
  for (const std::size_t kind : {0, 1, 2, 3, 5, 7, 10, 11, 15, 19, 23, 27, 31})
    kinds[kind] = next++;
  return kinds;
}();

}  // namespace nearmesh::record
