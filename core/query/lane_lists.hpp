// SPDX-License-Identifier: Apache-2.0
#pragma once
// Which lanes a mask names, without a loop.

#include <array>
#include <cstdint>

#include "nearmesh/core/geometry/detail/lanes.hpp"

namespace nearmesh {

/// For each mask its lanes, the last first; then zeros.
inline constexpr auto kLanesOf = [] {
  std::array<std::array<std::uint8_t, kLanes>, kAllLanes + 1> lists{};
  for (std::uint32_t mask = 0; mask <= kAllLanes; ++mask) {
    std::size_t count = 0;
    for (std::uint32_t lane = kLanes; lane-- > 0;)
      if ((mask >> lane & 1U) != 0) lists[mask][count++] = static_cast<std::uint8_t>(lane);
  }
  return lists;
}();

}  // namespace nearmesh
