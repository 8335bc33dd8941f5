// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/core/spm/region_words.hpp"

#include <algorithm>
#include <limits>
#include <string>

namespace nearmesh {
namespace {

constexpr std::int64_t kMostSteps = 0xffff;
constexpr std::int64_t kLeastCell = std::numeric_limits<std::int32_t>::min();
constexpr std::int64_t kMostCell = std::numeric_limits<std::int32_t>::max();

// Shifts of negative numbers round down.
std::int64_t steps_down(std::int64_t cells, int shift) { return cells >> shift; }
std::int64_t steps_up(std::int64_t cells, int shift) { return -(-cells >> shift); }

std::int32_t clamp_cell(std::int64_t cells) {
  return static_cast<std::int32_t>(std::clamp(cells, kLeastCell, kMostCell));
}

// Where slabs across this normal are counted from.
std::int64_t slab_base(const std::array<std::int8_t, 3>& normal,
                       const std::array<std::int32_t, 3>& origin) {
  std::int64_t dot = 0;
  for (std::size_t k = 0; k < 3; ++k) dot += std::int64_t{normal[k]} * origin[k];
  return dot >> 7;
}

bool fits(std::span<const RegionPart> parts, const GridBox& bounds, int shift) {
  for (int k = 0; k < 3; ++k)
    if (steps_up(bounds.hi[k], shift) - steps_down(bounds.lo[k], shift) > kMostSteps) return false;
  return std::all_of(parts.begin(), parts.end(), [shift](const RegionPart& part) {
    return steps_up(part.radius, shift) <= kMostSteps;
  });
}

bool is_signed_word(std::int64_t x) { return x >= -0x8000 && x <= 0x7fff; }

void pack_slab(const RegionPart& part, const RegionWords& region, std::uint16_t* words) {
  const std::int64_t base = slab_base(part.normal, region.origin);
  const int shift = region.shift + 1;
  const std::int64_t from = steps_down(part.slab_lo - base, shift),
                     to = steps_up(part.slab_hi - base, shift);
  if (!is_signed_word(from) || !is_signed_word(to)) return;
  for (std::size_t k = 0; k < 3; ++k)
    words[k / 2] |= static_cast<std::uint16_t>(
        std::uint16_t{static_cast<std::uint8_t>(part.normal[k])} << (8 * (k % 2)));
  words[2] = static_cast<std::uint16_t>(from);
  words[3] = static_cast<std::uint16_t>(to);
}

}  // namespace

RegionWords pack_region(std::span<const RegionPart> parts) {
  RegionWords region;
  if (parts.empty()) return region;
  GridBox bounds;
  for (const RegionPart& part : parts) bounds.add(part.box);
  while (!fits(parts, bounds, region.shift)) ++region.shift;
  const int shift = region.shift;
  for (int k = 0; k < 3; ++k)
    region.origin[static_cast<std::size_t>(k)] =
        static_cast<std::int32_t>(steps_down(bounds.lo[k], shift) << shift);
  for (const RegionPart& part : parts) {
    std::array<std::uint16_t, kWordsPerPart> words{};
    for (std::size_t k = 0; k < 3; ++k) {
      const std::int64_t from = steps_down(region.origin[k], shift);
      const int axis = static_cast<int>(k);
      words[k] = static_cast<std::uint16_t>(steps_down(part.box.lo[axis], shift) - from);
      words[3 + k] = static_cast<std::uint16_t>(steps_up(part.box.hi[axis], shift) - from);
    }
    words[6] = static_cast<std::uint16_t>(steps_up(part.radius, shift));
    words[7] = static_cast<std::uint16_t>(std::min(steps_down(part.min_extent, shift), kMostSteps));
    pack_slab(part, region, &words[8]);
    region.words.insert(region.words.end(), words.begin(), words.end());
  }
  return region;
}

Result<std::vector<RegionPart>> unpack_region(const RegionWords& region) {
  const auto refuse = [](const std::string& what) {
    return Status{StatusCode::kInvalidArgument, "region boxes: " + what};
  };
  if (region.shift > kMaxRegionShift)
    return refuse("expected steps of at most 2^" + std::to_string(kMaxRegionShift) +
                  " cells, found 2^" + std::to_string(region.shift));
  if (region.words.size() % kWordsPerPart != 0 ||
      region.words.size() / kWordsPerPart > kMaxRegionBoxes)
    return refuse("expected at most " + std::to_string(kMaxRegionBoxes) + " times " +
                  std::to_string(kWordsPerPart) + " words, found " +
                  std::to_string(region.words.size()));
  const int shift = region.shift;
  std::vector<RegionPart> parts;
  for (std::size_t at = 0; at < region.words.size(); at += kWordsPerPart) {
    const std::uint16_t* words = &region.words[at];
    RegionPart part;
    const std::string number = std::to_string(at / kWordsPerPart);
    for (std::size_t k = 0; k < 3; ++k) {
      const int axis = static_cast<int>(k);
      const std::int64_t lo = region.origin[k] + (std::int64_t{words[k]} << shift);
      if (lo > kMostCell) return refuse("box " + number + " is beyond 2^31 cells");
      part.box.lo[axis] = static_cast<std::int32_t>(lo);
      part.box.hi[axis] = clamp_cell(region.origin[k] + (std::int64_t{words[3 + k]} << shift));
      part.normal[k] = static_cast<std::int8_t>(words[8 + k / 2] >> (8 * (k % 2)));
    }
    if (words[9] >> 8 != 0) return refuse("normal of box " + number);
    part.radius = clamp_cell(std::int64_t{words[6]} << shift);
    part.min_extent = clamp_cell(std::int64_t{words[7]} << shift);
    const std::int64_t base = slab_base(part.normal, region.origin);
    const auto slab = [&](std::uint16_t word) {
      return clamp_cell(base + std::int64_t{static_cast<std::int16_t>(word)} * (2LL << shift));
    };
    part.slab_lo = slab(words[10]);
    part.slab_hi = slab(words[11]);
    parts.push_back(part);
  }
  return parts;
}

}  // namespace nearmesh
