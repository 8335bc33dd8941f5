// SPDX-License-Identifier: Apache-2.0
#pragma once
// The integer grid on which a model lives: points, boxes, and the grid's place in the model's
// frame. All peers hold bit-identical geometry because nothing here is floating point but the grid
// itself.

#include <algorithm>
#include <array>
#include <compare>
#include <cstdint>
#include <limits>

namespace nearmesh {

/// A point in grid units, each coordinate in [0, 2^bits), bits <= 31.
struct GridPoint {
  std::array<std::int32_t, 3> v{};

  std::int32_t& operator[](int axis) { return v[static_cast<std::size_t>(axis)]; }
  std::int32_t operator[](int axis) const { return v[static_cast<std::size_t>(axis)]; }
  auto operator<=>(const GridPoint&) const = default;
};

/// A closed axis-aligned box in grid units; lo > hi means empty. Corners may lie outside the grid
/// (conservative boxes are rounded outward) but never beyond int32.
struct GridBox {
  GridPoint lo{{std::numeric_limits<std::int32_t>::max(), std::numeric_limits<std::int32_t>::max(),
                std::numeric_limits<std::int32_t>::max()}};
  GridPoint hi{{std::numeric_limits<std::int32_t>::min(), std::numeric_limits<std::int32_t>::min(),
                std::numeric_limits<std::int32_t>::min()}};

  [[nodiscard]] bool is_empty() const { return lo[0] > hi[0]; }
  void add(const GridPoint& p) {
    for (int k = 0; k < 3; ++k) {
      lo[k] = std::min(lo[k], p[k]);
      hi[k] = std::max(hi[k], p[k]);
    }
  }
  void add(const GridBox& b) {
    for (int k = 0; k < 3; ++k) {
      lo[k] = std::min(lo[k], b.lo[k]);
      hi[k] = std::max(hi[k], b.hi[k]);
    }
  }
  [[nodiscard]] bool contains(const GridBox& b) const {
    for (int k = 0; k < 3; ++k)
      if (b.lo[k] < lo[k] || b.hi[k] > hi[k]) return false;
    return true;
  }
  [[nodiscard]] bool meets(const GridBox& b) const {
    for (int k = 0; k < 3; ++k)
      if (b.lo[k] > hi[k] || b.hi[k] < lo[k]) return false;
    return true;
  }
  /// How large the box is, in cells: the sum of its sides. Precondition: not empty.
  [[nodiscard]] std::int64_t extent() const {
    std::int64_t sides = 0;
    for (int k = 0; k < 3; ++k) sides += std::int64_t{hi[k]} - lo[k];
    return sides;
  }
  bool operator==(const GridBox&) const = default;
};

/// Where the grid lies: position in metres = origin_m + ldexp(grid coordinate, exponent).
struct Grid {
  std::array<double, 3> origin_m{};  ///< each a multiple of the cell
  int exponent = 0;                  ///< the cell is 2^exponent metres
  int bits = 21;                     ///< coordinates lie in [0, 2^bits)

  bool operator==(const Grid&) const = default;
};

inline constexpr int kMinGridBits = 4;
inline constexpr int kMaxGridBits = 31;
/// Cells are no smaller than 2^-kMaxGridExponent and no larger than 2^kMaxGridExponent metres, so that
/// no length of a model leaves the range of a double.
inline constexpr int kMaxGridExponent = 500;

}  // namespace nearmesh
