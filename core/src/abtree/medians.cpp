// SPDX-License-Identifier: Apache-2.0
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "medians.cpp"  // NOLINT(readability-identifier-naming): Highway's name
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include <algorithm>
#include <bit>
#include <limits>

#include "medians.hpp"

HWY_BEFORE_NAMESPACE();
namespace nearmesh::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

using Units = hn::CappedTag<std::int32_t, 16>;
using UnitVec = hn::Vec<Units>;

void set_centers_lanes(const TriangleLanes& triangles, std::uint32_t first, PartCenters& centers) {
  const hn::CappedTag<std::int32_t, kLanes> d;
  for (std::size_t k = 0; k < 3; ++k)
    for (std::size_t lane = 0; lane < kLanes; lane += hn::Lanes(d)) {
      const auto x = hn::LoadU(d, triangles.corner[0][k] + lane),
                 y = hn::LoadU(d, triangles.corner[1][k] + lane),
                 z = hn::LoadU(d, triangles.corner[2][k] + lane);
      const auto lo = hn::Min(hn::Min(x, y), z), hi = hn::Max(hn::Max(x, y), z);
      hn::StoreU(hn::Add(hn::ShiftRight<1>(lo), hn::ShiftRight<1>(hi)), d,
                 centers.axis[k] + first + lane);
    }
}

HWY_INLINE hn::Mask<Units> mask_of(std::uint64_t bits) {
  const std::uint8_t bytes[8] = {static_cast<std::uint8_t>(bits),
                                 static_cast<std::uint8_t>(bits >> 8)};
  return hn::LoadMaskBits(Units(), bytes);
}
HWY_INLINE std::uint64_t bits_of(hn::Mask<Units> mask) {
  std::uint8_t bytes[8] = {};
  hn::StoreMaskBits(Units(), mask, bytes);
  return bytes[0] | std::uint64_t{bytes[1]} << 8;
}

struct Extent {
  std::int32_t lo, hi;
  [[nodiscard]] std::uint32_t size() const {
    return static_cast<std::uint32_t>(hi) - static_cast<std::uint32_t>(lo);
  }
};
HWY_INLINE Extent extent_of(const std::int32_t* along, std::uint64_t parts) {
  const Units d;
  const auto end = static_cast<std::size_t>(std::bit_width(parts));
  UnitVec lo = hn::Set(d, std::numeric_limits<std::int32_t>::max());
  UnitVec hi = hn::Set(d, std::numeric_limits<std::int32_t>::min());
  for (std::size_t lane = 0; lane < end; lane += hn::Lanes(d)) {
    const auto used = mask_of(parts >> lane);
    const UnitVec x = hn::LoadU(d, along + lane);
    lo = hn::Min(lo, hn::IfThenElse(used, x, lo));
    hi = hn::Max(hi, hn::IfThenElse(used, x, hi));
  }
  return {hn::GetLane(hn::MinOfLanes(d, lo)), hn::GetLane(hn::MaxOfLanes(d, hi))};
}

std::uint64_t least_parts_lanes(const PartCenters& centers, std::uint64_t parts,
                                std::uint32_t count) {
  const Units d;
  const hn::RebindToUnsigned<Units> du;
  const auto end = static_cast<std::size_t>(std::bit_width(parts));
  std::size_t axis = 0;
  Extent extent = extent_of(centers.axis[0], parts);
  for (std::size_t k = 1; k < 3; ++k) {
    const Extent along = extent_of(centers.axis[k], parts);
    if (along.size() <= extent.size()) continue;
    axis = k;
    extent = along;
  }
  // Keys: 25 bits of the centre and the part's bit, so no two are equal.
  const int shift = std::max(0, static_cast<int>(std::bit_width(extent.size())) - 25);
  HWY_ALIGN std::int32_t keys[kWordParts], own[kWordParts];
  for (std::size_t lane = 0; lane < end; lane += hn::Lanes(d)) {
    const auto from_lo =
        hn::BitCast(du, hn::Sub(hn::LoadU(d, centers.axis[axis] + lane), hn::Set(d, extent.lo)));
    const UnitVec key = hn::BitCast(d, hn::ShiftLeft<6>(hn::ShiftRightSame(from_lo, shift)));
    hn::StoreU(hn::Or(key, hn::Iota(d, static_cast<std::int32_t>(lane))), d, keys + lane);
  }
  std::size_t total = 0;
  for (std::uint64_t left = parts; left != 0; left &= left - 1)
    own[total++] = keys[std::countr_zero(left)];
  std::uint64_t least = 0;
  for (std::size_t lane = 0; lane < end; lane += hn::Lanes(d)) {
    const UnitVec key = hn::LoadU(d, keys + lane);
    UnitVec rank = hn::Zero(d);
    for (std::size_t j = 0; j < total; ++j)
      rank = hn::Sub(rank, hn::VecFromMask(d, hn::Lt(hn::Set(d, own[j]), key)));
    least |= bits_of(hn::Lt(rank, hn::Set(d, static_cast<std::int32_t>(count)))) << lane;
  }
  return least & parts;
}

}  // namespace nearmesh::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace nearmesh {

HWY_EXPORT(set_centers_lanes);
HWY_EXPORT(least_parts_lanes);

void set_centers(const TriangleLanes& triangles, std::uint32_t first, PartCenters& centers) {
  HWY_DYNAMIC_DISPATCH(set_centers_lanes)(triangles, first, centers);
}

std::uint64_t least_parts(const PartCenters& centers, std::uint64_t parts, std::uint32_t count) {
  return HWY_DYNAMIC_DISPATCH(least_parts_lanes)(centers, parts, count);
}

}  // namespace nearmesh
#endif
