// SPDX-License-Identifier: Apache-2.0
// A sort that compares waits for its branches, which cannot be predicted. So the bits in which any
// two of many pairs differ are put side by side, and sorted by bytes, the least first.
#include "sort_pairs.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <numeric>

namespace nearmesh {
namespace {

/// A pair's numbers, the weightiest first.
using PairWords = std::array<std::uint32_t, 4>;
PairWords words_of(const FacePair& pair) { return std::bit_cast<PairWords>(pair); }

/// False, and nothing done, where the pairs differ in too many bits. Precondition: there is one.
bool sort_by_bytes(std::vector<FacePair>& pairs) {
  PairWords common = words_of(pairs[0]), own{};
  for (const FacePair& pair : pairs)
    for (std::size_t k = 0; k < 4; ++k) own[k] |= words_of(pair)[k] ^ common[k];
  std::array<int, 4> widths;
  for (std::size_t k = 0; k < 4; ++k) {
    widths[k] = std::bit_width(own[k]);
    own[k] = static_cast<std::uint32_t>((std::uint64_t{1} << widths[k]) - 1);
    common[k] &= ~own[k];
  }
  const int bits = std::accumulate(widths.begin(), widths.end(), 0);
  if (bits > 64) return false;
  std::vector<std::uint64_t> keys(pairs.size()), sorted(pairs.size());
  for (std::size_t i = 0; i < pairs.size(); ++i)
    for (std::size_t k = 0; k < 4; ++k)
      keys[i] = keys[i] << widths[k] | (words_of(pairs[i])[k] & own[k]);
  for (int shift = 0; shift < bits; shift += 8) {
    std::array<std::uint32_t, 257> place{};
    for (const std::uint64_t key : keys) ++place[(key >> shift & 0xffU) + 1];
    std::partial_sum(place.begin(), place.end(), place.begin());
    for (const std::uint64_t key : keys) sorted[place[key >> shift & 0xffU]++] = key;
    keys.swap(sorted);
  }
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    PairWords words = common;
    for (std::size_t k = 4; k-- > 0; keys[i] >>= widths[k])
      words[k] |= static_cast<std::uint32_t>(keys[i]) & own[k];
    pairs[i] = std::bit_cast<FacePair>(words);
  }
  return true;
}

}  // namespace

void sort_pairs(std::vector<FacePair>& pairs) {
  constexpr std::size_t kFew = 64;
  if (pairs.size() < kFew || !sort_by_bytes(pairs)) std::sort(pairs.begin(), pairs.end());
}

}  // namespace nearmesh
