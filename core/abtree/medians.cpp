// SPDX-License-Identifier: Apache-2.0
#undef HWY_TARGET_INCLUDE
// NOLINTNEXTLINE(readability-identifier-naming): Highway's name
#define HWY_TARGET_INCLUDE "core/abtree/medians.cpp"
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

/// Along the longest of the axes: the first of equals.
struct Extent {
  std::size_t axis;
  std::int32_t lo;
  std::uint32_t size;
};
HWY_INLINE Extent longest_extent(const PartCenters& centers, std::uint64_t parts) {
  const Units d;
  const auto end = static_cast<std::size_t>(std::bit_width(parts));
  UnitVec lo[3], hi[3];
  for (std::size_t k = 0; k < 3; ++k) {
    lo[k] = hn::Set(d, std::numeric_limits<std::int32_t>::max());
    hi[k] = hn::Set(d, std::numeric_limits<std::int32_t>::min());
  }
  for (std::size_t lane = 0; lane < end; lane += hn::Lanes(d)) {
    const auto used = mask_of(parts >> lane);
    for (std::size_t k = 0; k < 3; ++k) {
      const UnitVec x = hn::LoadU(d, centers.axis[k] + lane);
      lo[k] = hn::Min(lo[k], hn::IfThenElse(used, x, lo[k]));
      hi[k] = hn::Max(hi[k], hn::IfThenElse(used, x, hi[k]));
    }
  }
  Extent extents[3];
  for (std::size_t k = 0; k < 3; ++k) {
    const std::int32_t least = hn::GetLane(hn::MinOfLanes(d, lo[k]));
    const std::int32_t most = hn::GetLane(hn::MaxOfLanes(d, hi[k]));
    extents[k] = {k, least, static_cast<std::uint32_t>(most) - static_cast<std::uint32_t>(least)};
  }
  // By place: which is longest is hard to foretell.
  const std::size_t first = extents[1].size > extents[0].size ? 1 : 0;
  return extents[extents[2].size > extents[first].size ? 2 : first];
}

std::uint64_t least_parts_lanes(const PartCenters& centers, std::uint64_t parts,
                                std::uint32_t count) {
  const Units d;
  const std::size_t lanes = hn::Lanes(d);
  const hn::RebindToUnsigned<Units> du;
  const auto end = static_cast<std::size_t>(std::bit_width(parts));
  const Extent extent = longest_extent(centers, parts);
  // Keys: 25 bits of the centre and the part's bit, so no two are equal.
  const int shift = std::max(0, static_cast<int>(std::bit_width(extent.size)) - 25);
  HWY_ALIGN std::int32_t keys[kWordParts], own[kWordParts + 16];
  std::size_t total = 0;
  for (std::size_t lane = 0; lane < end; lane += lanes) {
    const auto from_lo = hn::BitCast(
        du, hn::Sub(hn::LoadU(d, centers.axis[extent.axis] + lane), hn::Set(d, extent.lo)));
    const UnitVec high = hn::BitCast(d, hn::ShiftLeft<6>(hn::ShiftRightSame(from_lo, shift)));
    const UnitVec key = hn::Or(high, hn::Iota(d, static_cast<std::int32_t>(lane)));
    const auto used = mask_of(parts >> lane);
    hn::StoreU(key, d, keys + lane);
    hn::StoreU(hn::Compress(key, used), d, own + total);
    total += hn::CountTrue(d, used);
  }
  // Then keys above all, so that they can be taken by fours.
  for (std::size_t i = 0; i < 4; i += lanes)
    hn::StoreU(hn::Set(d, std::numeric_limits<std::int32_t>::max()), d, own + total + i);
  std::uint64_t least = 0;
  for (std::size_t lane = 0; lane < end; lane += lanes) {
    const UnitVec key = hn::LoadU(d, keys + lane);
    UnitVec rank = hn::Zero(d);
    for (std::size_t j = 0; j < total; j += 4)
      for (std::size_t i = 0; i < 4; ++i)
        rank = hn::Sub(rank, hn::VecFromMask(d, hn::Lt(hn::Set(d, own[j + i]), key)));
    least |= bits_of(hn::Lt(rank, hn::Set(d, static_cast<std::int32_t>(count)))) << lane;
  }
  return least & parts;
}

std::uint32_t nth_least_lanes(const std::uint32_t* numbers, std::size_t size, std::size_t n) {
  const hn::CappedTag<std::uint32_t, 16> d;
  const std::size_t lanes = hn::Lanes(d);
  std::uint32_t most = 0;
  for (std::size_t i = 0; i < size; ++i) most = std::max(most, numbers[i]);
  // By bits from the highest on: the greatest number that no more than n are below.
  std::uint32_t nth = 0;
  for (int bit = static_cast<int>(std::bit_width(most)); bit-- > 0;) {
    const std::uint32_t higher = nth | std::uint32_t{1} << bit;
    auto below = hn::Zero(d);
    std::size_t i = 0;
    for (; i + lanes <= size; i += lanes)
      below =
          hn::Sub(below, hn::VecFromMask(d, hn::Lt(hn::LoadU(d, numbers + i), hn::Set(d, higher))));
    std::size_t count = hn::GetLane(hn::SumOfLanes(d, below));
    for (; i < size; ++i) count += static_cast<std::size_t>(numbers[i] < higher);
    nth = count <= n ? higher : nth;
  }
  return nth;
}

}  // namespace nearmesh::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace nearmesh {

HWY_EXPORT(set_centers_lanes);
HWY_EXPORT(least_parts_lanes);
HWY_EXPORT(nth_least_lanes);

void set_centers(const TriangleLanes& triangles, std::uint32_t first, PartCenters& centers) {
  HWY_DYNAMIC_DISPATCH(set_centers_lanes)(triangles, first, centers);
}

std::uint64_t least_parts(const PartCenters& centers, std::uint64_t parts, std::uint32_t count) {
  return HWY_DYNAMIC_DISPATCH(least_parts_lanes)(centers, parts, count);
}

std::uint32_t nth_least(std::span<const std::uint32_t> numbers, std::size_t n) {
  return HWY_DYNAMIC_DISPATCH(nth_least_lanes)(numbers.data(), numbers.size(), n);
}

}  // namespace nearmesh
#endif
