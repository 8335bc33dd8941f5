// SPDX-License-Identifier: Apache-2.0
#pragma once
// The integer grid on which a model lives: points, boxes, and the grid's place in the model's
// frame. All peers hold bit-identical geometry because nothing here is floating point but the grid
// itself.

#include <algorithm>
#include <array>
#include <cmath>
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
  /// Models that border on each other may share a lattice: one cell, one number of bits and one
  /// origin. These are the cells from the lattice's origin to origin_m, each within
  /// kMaxLatticeCells. A pose then places the points that two of them share alike, to the bit. 0:
  /// the lattice is the model's own.
  std::array<std::int64_t, 3> lattice_cells{};

  [[nodiscard]] bool shares_lattice() const {
    return lattice_cells[0] != 0 || lattice_cells[1] != 0 || lattice_cells[2] != 0;
  }
  /// Exact where is_lattice_place.
  [[nodiscard]] std::array<double, 3> lattice_origin_m() const {
    std::array<double, 3> out;
    for (std::size_t k = 0; k < 3; ++k)
      out[k] = origin_m[k] - std::ldexp(static_cast<double>(lattice_cells[k]), exponent);
    return out;
  }
  bool operator==(const Grid&) const = default;
};

/// A lattice for models that border on each other: the vertices that two of them share, equal in
/// the input, are equal afterwards, and under each pose (Grid::lattice_cells).
struct CommonLattice {
  /// Whole cells, within 2^52 of them; near the models, as posing is finest there.
  std::array<double, 3> origin_m{};
  int exponent = 0;  ///< the cell is 2^exponent metres

  /// The grid that begins so many cells from the origin.
  [[nodiscard]] Grid grid_at(const std::array<std::int64_t, 3>& cells, int bits) const {
    Grid grid{.exponent = exponent, .bits = bits, .lattice_cells = cells};
    for (std::size_t k = 0; k < 3; ++k)
      grid.origin_m[k] = origin_m[k] + std::ldexp(static_cast<double>(cells[k]), exponent);
    return grid;
  }
  bool operator==(const CommonLattice&) const = default;
};

/// 2^32 cells an axis are a planet in steps of 3 mm.
inline constexpr std::int64_t kMaxLatticeCells = std::int64_t{1} << 31;
/// Whether cells so far from zero, whole numbers, and a place so many cells from them are exact in
/// doubles.
[[nodiscard]] inline bool is_lattice_place(double origin_cells, std::int64_t lattice_cells) {
  return lattice_cells >= -kMaxLatticeCells && lattice_cells <= kMaxLatticeCells &&
         std::fabs(origin_cells) <= 0x1p52 && origin_cells == std::floor(origin_cells);
}

inline constexpr int kMinGridBits = 4;
inline constexpr int kMaxGridBits = 31;
/// Cells are no smaller than 2^-kMaxGridExponent and no larger than 2^kMaxGridExponent metres, so
/// that no length of a model leaves the range of a double.
inline constexpr int kMaxGridExponent = 500;

}  // namespace nearmesh
