// SPDX-License-Identifier: Apache-2.0
// What the vector kernels of this room share; included once for each instruction set, so its guard
// is Highway's.
#if defined(NEARMESH_GEOMETRY_VECTORS) == defined(HWY_TARGET_TOGGLE)
#ifdef NEARMESH_GEOMETRY_VECTORS
#undef NEARMESH_GEOMETRY_VECTORS
#else
#define NEARMESH_GEOMETRY_VECTORS
#endif

#include <hwy/highway.h>

#include <cstdint>

#include "nearmesh/core/geometry/detail/lanes.hpp"

HWY_BEFORE_NAMESPACE();
namespace nearmesh::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

using Doubles = hn::CappedTag<double, kLanes>;
using Ints = hn::Rebind<std::int32_t, Doubles>;
using Bytes = hn::Rebind<std::int8_t, Doubles>;
using Floats = hn::Rebind<float, Doubles>;
using Vec = hn::Vec<Doubles>;
using Mask = hn::Mask<Doubles>;

/// Covers the rounding of the last few operations of a gap.
constexpr double kGapShrink = 1 - 0x1p-40;

HWY_INLINE Vec dot(const Vec (&a)[3], const Vec (&b)[3]) {
  return hn::Add(hn::Add(hn::Mul(a[0], b[0]), hn::Mul(a[1], b[1])), hn::Mul(a[2], b[2]));
}
HWY_INLINE Vec dot(const double* a, const Vec (&b)[3]) {
  const Doubles d;
  return hn::Add(hn::Add(hn::Mul(hn::Set(d, a[0]), b[0]), hn::Mul(hn::Set(d, a[1]), b[1])),
                 hn::Mul(hn::Set(d, a[2]), b[2]));
}
HWY_INLINE Vec load(const std::int32_t* p) {
  return hn::PromoteTo(Doubles(), hn::LoadU(Ints(), p));
}
HWY_INLINE Vec load(const float* p) { return hn::PromoteTo(Doubles(), hn::LoadU(Floats(), p)); }
HWY_INLINE Vec load(const std::int8_t* p) {
  return hn::PromoteTo(Doubles(), hn::PromoteTo(Ints(), hn::LoadU(Bytes(), p)));
}
/// Coordinate k of u x v.
HWY_INLINE Vec cross(const Vec (&u)[3], const Vec (&v)[3], std::size_t k) {
  const std::size_t i = (k + 1) % 3, j = (k + 2) % 3;
  return hn::Sub(hn::Mul(u[i], v[j]), hn::Mul(u[j], v[i]));
}
/// Centres and half extents of the boxes from `lane` on.
HWY_INLINE void load_boxes(const BoxLanes& boxes, std::size_t lane, Vec (&center)[3],
                           Vec (&half)[3]) {
  const Vec by_two = hn::Set(Doubles(), 0.5);
  for (std::size_t k = 0; k < 3; ++k) {
    const Vec lo = load(boxes.lo[k] + lane), hi = load(boxes.hi[k] + lane);
    center[k] = hn::Mul(by_two, hn::Add(lo, hi));
    half[k] = hn::Mul(by_two, hn::Sub(hi, lo));
  }
}
HWY_INLINE std::uint32_t bits_of(Mask mask) {
  std::uint8_t bytes[8] = {};
  hn::StoreMaskBits(Doubles(), mask, bytes);
  return bytes[0];
}

}  // namespace nearmesh::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();
#endif
