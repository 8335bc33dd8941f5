// SPDX-License-Identifier: Apache-2.0
#include "packed_region.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include "nearmesh/core/spm/detail/split_store.hpp"

namespace nearmesh {
namespace {

constexpr std::int64_t kMostSteps = 0xffff;
constexpr std::int64_t kMostByte = 0xff;
constexpr std::int64_t kLeastCell = std::numeric_limits<std::int32_t>::min();
constexpr std::int64_t kMostCell = std::numeric_limits<std::int32_t>::max();

// Shifts of negative numbers round down.
std::int64_t floor_shift(std::int64_t x, int shift) { return x >> shift; }
std::int64_t ceil_shift(std::int64_t x, int shift) { return -(-x >> shift); }

std::int32_t clamp_cell(std::int64_t cells) {
  return static_cast<std::int32_t>(std::clamp(cells, kLeastCell, kMostCell));
}

bool fits(std::span<const RegionPart> parts, const GridBox& bounds, int shift) {
  for (int k = 0; k < 3; ++k)
    if (ceil_shift(bounds.hi[k], shift) - floor_shift(bounds.lo[k], shift) > kMostSteps)
      return false;
  return std::all_of(parts.begin(), parts.end(), [shift](const RegionPart& part) {
    return ceil_shift(part.radius, shift) <= kMostSteps;
  });
}

// The greatest of 0..255 that is good, where all below it are; 0 is.
template <class IsGood>
std::uint8_t greatest_byte(const IsGood& is_good) {
  std::int64_t good = 0, bad = kMostByte + 1;
  while (bad - good > 1) {
    const std::int64_t middle = (good + bad) / 2;
    (is_good(middle) ? good : bad) = middle;
  }
  return static_cast<std::uint8_t>(good);
}

// Steps, of a byte that says how many 255ths of the greatest radius.
std::int64_t radius_steps(std::int64_t greatest, std::int64_t byte) {
  return (greatest * byte + kMostByte - 1) / kMostByte;
}

// The least code of the greatest extent that is at most x >= 0.
std::uint8_t extent_code_below(std::int32_t x) {
  const std::uint8_t code = box_extent_code(x);
  return box_extent(code) <= x ? code : box_extent_code(box_extent(code - 1));
}

// Where slabs of a part may lie: what its two bytes stand for. Numbers are 128 times what
// RegionPart has.
class SlabScale {
 public:
  // In: a part's box, radius and normal, as they are when it arrives.
  explicit SlabScale(const RegionPart& part) {
    std::int64_t square = 0;
    for (int k = 0; k < 3; ++k) {
      // NOLINTNEXTLINE(bugprone-signed-char-misuse): a number, not a character
      const auto n = static_cast<std::int64_t>(part.normal[static_cast<std::size_t>(k)]);
      least_ += std::min(n * part.box.lo[k], n * part.box.hi[k]);
      most_ += std::max(n * part.box.lo[k], n * part.box.hi[k]);
      square += n * n;
    }
    // The normal's length in 256ths, rounded up; the root of so small an integer is exact enough.
    const double length = std::ceil(std::sqrt(static_cast<double>(square << 16)));
    wider_ = ceil_shift(static_cast<std::int64_t>(length) * part.radius, 8);
  }
  [[nodiscard]] std::int32_t lo(std::int64_t byte) const {
    return clamp_cell(floor_shift(least_ + cut(byte) - wider_, 7));
  }
  [[nodiscard]] std::int32_t hi(std::int64_t byte) const {
    return clamp_cell(ceil_shift(most_ - cut(byte) + wider_, 7));
  }

 private:
  // Below 2^38 times 255.
  [[nodiscard]] std::int64_t cut(std::int64_t byte) const {
    return (most_ - least_) * byte / kMostByte;
  }
  std::int64_t least_ = 0, most_ = 0, wider_ = 0;
};

// Bytes 13 and 14. As much is cut off as leaves the slab whole.
void pack_slab(const RegionPart& part, const RegionPart& arrives, std::uint8_t* bytes) {
  if (part.normal == std::array<std::int8_t, 3>{}) return;
  const SlabScale scale(arrives);
  const std::int32_t lo = std::max(part.slab_lo, scale.lo(0));
  const std::int32_t hi = std::min(part.slab_hi, scale.hi(0));
  bytes[0] = greatest_byte([&](std::int64_t byte) { return scale.lo(byte) <= lo; });
  bytes[1] = greatest_byte([&](std::int64_t byte) { return scale.hi(byte) >= hi; });
}

// Box, normal and radius, as they are when they arrive. `bytes` are good.
RegionPart unpack_body(const PackedRegion& region, const std::uint8_t* bytes) {
  RegionPart part;
  for (std::size_t k = 0; k < 3; ++k) {
    const std::int64_t lo = bytes[2 * k] | bytes[2 * k + 1] << 8;
    const std::int64_t hi = std::min(lo + (std::int64_t{bytes[6 + k]} << bytes[9]), kMostSteps);
    const int axis = static_cast<int>(k);
    part.box.lo[axis] = clamp_cell(region.origin[k] + (lo << region.shift));
    part.box.hi[axis] = clamp_cell(region.origin[k] + (hi << region.shift));
    part.normal[k] = static_cast<std::int8_t>(bytes[10 + k]);
  }
  part.radius = clamp_cell(radius_steps(region.radius, bytes[15]) << region.shift);
  return part;
}

}  // namespace

PackedRegion pack_region(std::span<const RegionPart> parts) {
  PackedRegion region;
  if (parts.empty()) return region;
  GridBox bounds;
  for (const RegionPart& part : parts) bounds.add(part.box);
  while (!fits(parts, bounds, region.shift)) ++region.shift;
  const int shift = region.shift;
  for (int k = 0; k < 3; ++k)
    region.origin[static_cast<std::size_t>(k)] =
        static_cast<std::int32_t>(floor_shift(bounds.lo[k], shift) << shift);
  for (const RegionPart& part : parts)
    region.radius =
        std::max(region.radius, static_cast<std::uint16_t>(ceil_shift(part.radius, shift)));
  for (const RegionPart& part : parts) {
    std::array<std::uint8_t, kBytesPerPart> bytes{};
    std::array<std::int64_t, 3> size{};
    for (std::size_t k = 0; k < 3; ++k) {
      const int axis = static_cast<int>(k);
      const std::int64_t origin = floor_shift(region.origin[k], shift);
      const std::int64_t lo = floor_shift(part.box.lo[axis], shift) - origin;
      size[k] = ceil_shift(part.box.hi[axis], shift) - origin - lo;
      bytes[2 * k] = static_cast<std::uint8_t>(lo);
      bytes[2 * k + 1] = static_cast<std::uint8_t>(lo >> 8);
      bytes[10 + k] = static_cast<std::uint8_t>(part.normal[k]);
    }
    while (ceil_shift(*std::max_element(size.begin(), size.end()), bytes[9]) > kMostByte)
      ++bytes[9];
    for (std::size_t k = 0; k < 3; ++k)
      bytes[6 + k] = static_cast<std::uint8_t>(ceil_shift(size[k], bytes[9]));
    const std::int64_t radius = ceil_shift(part.radius, shift);
    bytes[15] = greatest_byte(
        [&](std::int64_t byte) { return radius_steps(region.radius, byte - 1) < radius; });
    bytes[16] = extent_code_below(part.min_extent);
    pack_slab(part, unpack_body(region, bytes.data()), &bytes[13]);
    region.parts.insert(region.parts.end(), bytes.begin(), bytes.end());
  }
  return region;
}

Result<std::vector<RegionPart>> unpack_region(const PackedRegion& region) {
  const auto refuse = [](const std::string& what) {
    return Status{StatusCode::kInvalidArgument, "region boxes: " + what};
  };
  if (region.shift > kMaxRegionShift)
    return refuse("expected steps of at most 2^" + std::to_string(kMaxRegionShift) +
                  " cells, found 2^" + std::to_string(region.shift));
  if (region.parts.size() % kBytesPerPart != 0 ||
      region.parts.size() / kBytesPerPart > kMaxRegionBoxes)
    return refuse("expected at most " + std::to_string(kMaxRegionBoxes) + " times " +
                  std::to_string(kBytesPerPart) + " bytes, found " +
                  std::to_string(region.parts.size()));
  std::vector<RegionPart> parts;
  for (std::size_t at = 0; at < region.parts.size(); at += kBytesPerPart) {
    const std::uint8_t* bytes = &region.parts[at];
    const auto box = [at] { return "box " + std::to_string(at / kBytesPerPart); };
    if (bytes[9] > kMaxSizeShift) return refuse("size of " + box());
    if (bytes[16] > kMaxExtentCode) return refuse("least extent of " + box());
    for (std::size_t k = 0; k < 3; ++k)
      if (region.origin[k] + (std::int64_t{bytes[2 * k] | bytes[2 * k + 1] << 8} << region.shift) >
          kMostCell)
        return refuse(box() + " is beyond 2^31 cells");
    RegionPart part = unpack_body(region, bytes);
    const SlabScale scale(part);
    part.slab_lo = scale.lo(bytes[13]);
    part.slab_hi = scale.hi(bytes[14]);
    part.min_extent = clamp_cell(box_extent(bytes[16]));
    parts.push_back(part);
  }
  return parts;
}

}  // namespace nearmesh
