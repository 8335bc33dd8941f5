// SPDX-License-Identifier: Apache-2.0
#pragma once
// Medians of few parts in vectors: each part is held against each other one, which for up to 64
// costs less than to sort them, and no branch depends on the data. Parts are the bits of a word, so
// that to divide them moves nothing.

#include <cstdint>
#include <span>

#include "nearmesh/core/geometry/detail/lanes.hpp"

namespace nearmesh {

inline constexpr std::uint32_t kWordParts = 64;

/// Centres of parts by axis, by halves, so that they fit. Those that are not used may be anything.
struct PartCenters {
  std::int32_t axis[3][kWordParts];
};
/// Sets the centres of eight triangles, from `first` on.
void set_centers(const TriangleLanes& triangles, std::uint32_t first, PartCenters& centers);
/// Of the parts whose bits are set, the `count` with the least centres along the longest axis of
/// all their centres. Equal centres are as good on either side, but must fall the same way
/// everywhere: lower bits are less. Of extents of 2^25 and more only the upper 25 bits count.
/// Precondition: 0 < count < bits that are set.
[[nodiscard]] std::uint64_t least_parts(const PartCenters& centers, std::uint64_t parts,
                                        std::uint32_t count);
/// The number that `n` of them stand before when they are sorted. No branch depends on the data.
/// Precondition: n < their count.
[[nodiscard]] std::uint32_t nth_least(std::span<const std::uint32_t> numbers, std::size_t n);

}  // namespace nearmesh
