// SPDX-License-Identifier: Apache-2.0
#pragma once
// A region as it travels: 17 bytes a part in a frame around all of them. Requests weigh as much as
// their answers, and more parts ask for less, so a part has 17 bytes instead of 44. Rounded
// outward: what comes back covers what went in, and asks for no less.

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "nearmesh/core/base/status.hpp"
#include "nearmesh/core/spm/detail/types.hpp"

namespace nearmesh {

struct PackedRegion {
  std::array<std::int32_t, 3> origin{};  ///< cells of the model's grid; a multiple of 2^shift
  std::uint8_t shift = 0;                ///< a step is 2^shift cells; at most kMaxRegionShift
  std::uint16_t radius = 0;              ///< the greatest of all parts, in steps
  /// kBytesPerPart for each part:
  ///   0..5     lo x, y, z of the box, in steps from the origin, u16, little-endian
  ///   6..8     its size x, y, z, in 2^(byte 9) steps; hi is at most 65,535 steps from the origin
  ///   9        at most kMaxSizeShift
  ///   10..12   normal x, y, z, i8
  ///   13, 14   slab: 255ths of the box's extent along the normal cut off from below and from
  ///            above, then widened by the radius
  ///   15       radius, in 255ths of the greatest
  ///   16       min_extent, as in a BoxCode
  std::vector<std::uint8_t> parts;
};
inline constexpr std::size_t kBytesPerPart = 17;
inline constexpr std::uint8_t kMaxRegionShift = 17;
inline constexpr std::uint8_t kMaxSizeShift = 9;

/// The finest steps in which all parts fit. Precondition: none of them has a fault (fault_of). A
/// slab that reaches beyond its box and radius is cut there. Packing what unpack_region gave gives
/// the same bytes.
[[nodiscard]] PackedRegion pack_region(std::span<const RegionPart> parts);
/// Errors: kInvalidArgument naming what is out of range. Parts may still have a fault.
[[nodiscard]] Result<std::vector<RegionPart>> unpack_region(const PackedRegion& region);

}  // namespace nearmesh
