// SPDX-License-Identifier: Apache-2.0
#pragma once
// A region as it travels: parts as 16-bit words in a frame around all of them. Requests are some hundred bytes where their
// answers are a few thousand, so a part has 24 bytes instead of 44. Rounded outward: what comes back covers what went in,
// and asks for no less.

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "nearmesh/core/base/status.hpp"
#include "nearmesh/core/spm/types.hpp"

namespace nearmesh {

struct RegionWords {
  std::array<std::int32_t, 3> origin{};  ///< cells of the model's grid; a multiple of 2^shift
  std::uint8_t shift = 0;                ///< a step is 2^shift cells; at most kMaxRegionShift
  /// Twelve for each part. 0 to 2: box.lo, 3 to 5: box.hi, in steps from the origin; 6: radius, 7: min_extent, in steps, the
  /// latter cut to 65,535 of them; 8: normal x, and y in the upper byte; 9: normal z; 10 and 11: slab_lo and slab_hi, signed,
  /// in double steps from floor(normal . origin / 128).
  std::vector<std::uint16_t> words;
};
inline constexpr std::size_t kWordsPerPart = 12;
inline constexpr std::uint8_t kMaxRegionShift = 17;

/// The finest steps in which all parts fit. Precondition: none of them has a fault (fault_of). A slab that is beyond the
/// frame is left out. Packing what unpack_region gave gives the same words.
[[nodiscard]] RegionWords pack_region(std::span<const RegionPart> parts);
/// Errors: kInvalidArgument naming what is out of range. Parts may still have a fault.
[[nodiscard]] Result<std::vector<RegionPart>> unpack_region(const RegionWords& region);

}  // namespace nearmesh
