// SPDX-License-Identifier: Apache-2.0
#pragma once
// Boxes and points of a grid, three axes at a time: for checks that every split and every face goes
// through.

#include <cstdint>
#include <limits>

#include "nearmesh/core/geometry/detail/grid.hpp"

namespace nearmesh {

/// x, y, z and a fourth that is 0, by what GCC and clang make of any processor's vectors.
using Axes = std::int32_t __attribute__((vector_size(16)));

[[nodiscard]] inline Axes axes_of(const GridPoint& p) { return Axes{p[0], p[1], p[2], 0}; }
[[nodiscard]] inline Axes all_axes(std::int32_t x) { return Axes{x, x, x, 0}; }
[[nodiscard]] inline Axes least(Axes a, Axes b) {
  const Axes first = a < b;
  return (a & first) | (b & ~first);
}
[[nodiscard]] inline Axes most(Axes a, Axes b) {
  const Axes first = a > b;
  return (a & first) | (b & ~first);
}
[[nodiscard]] inline bool is_none(Axes mask) { return (mask[0] | mask[1] | mask[2]) == 0; }

struct AxesBox {
  Axes lo = all_axes(std::numeric_limits<std::int32_t>::max());
  Axes hi = all_axes(std::numeric_limits<std::int32_t>::min());

  AxesBox() = default;
  AxesBox(Axes low, Axes high) : lo(low), hi(high) {}
  explicit AxesBox(const GridBox& box) : lo(axes_of(box.lo)), hi(axes_of(box.hi)) {}
  void add(Axes p) {
    lo = least(lo, p);
    hi = most(hi, p);
  }
  void add(const AxesBox& b) {
    lo = least(lo, b.lo);
    hi = most(hi, b.hi);
  }
  /// Also true of an empty one.
  [[nodiscard]] bool contains(const AxesBox& b) const { return is_none((b.lo < lo) | (b.hi > hi)); }
  [[nodiscard]] bool meets(const AxesBox& b) const { return is_none((b.lo > hi) | (b.hi < lo)); }
};

}  // namespace nearmesh
