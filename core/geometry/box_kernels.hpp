// SPDX-License-Identifier: Apache-2.0
// Places boxes and faces (placed_boxes.hpp) and tests whether they are apart, for one instruction
// set, to be inlined where a walk needs them by the hundred; included once for each set, so its
// guard is Highway's.
//
// Errors. What doubles and posed corners do to boxes and slabs is bounded in box_overlap.cpp and
// lanes.cpp, and is in the slack. Here floats are added; u = 2^-24, h and r are the greatest half
// extents of a box and of the other as placed.
// 1. Centres are computed in doubles and rounded once: off by less than u |c|, `room` of the body's
//    bounds. Half extents grow by it, a slab's thickness by |normal|_1 of it. All else is of
//    floats, sums of three products at most, off by less than 6 u of their magnitudes. For half
//    extents that is below the 2^-17 h and 2^-18 r by which they grow. An axis is what it was
//    computed to; a slab's normal in the other's units is off by 6 u |e|_2 a component, so the slab
//    by 18 u |e|_1 r. A triangle's plane is off by 6 u |normal|_1 h, and has 8 u of it.
// 2. Tests along a box's axes: three roundings of positive terms, 3 u of the extents, less than
//    these have grown.
// 3. Tests along a slab's normal e, with the other part's slab n: e = a n + rest, for whatever a.
//    Wherever the axes do not part the boxes, centres are |b_k| <= (h_k + r_k)(1 + 3 u) from each
//    other. At most seven roundings stand between a term and the comparison, so that errs by no
//    more than
//      8 u (|e|_1 (h + r) + |a| (|middle| + thickness)
//           + (|e|_1 + 2 |a n|_1) h + |middle'| + thickness').
//    a is the projection's but for a few per cent, so |a n|_1 <= 1.8 |e|_1. Terms of one box alone
//    are added to it when it is placed: to e's own slab 2^-18 |e|_1 r, which are 64 u for 26, and
//    2^-20 (|middle'| + thickness'); to the other part 2^-17 h to each half extent, and
//    2^-17 kSlabLength h + 2^-20 (|middle| + thickness) to the thickness. There
//    |a| kSlabLength + |rest|_1 >= 0.99 |e|_2 >= 0.57 |e|_1, so these make up 73 u |e|_1 h; needed
//    are 8 u (1 + 4.6) |e|_1 h.
// 4. Triangles along a slab's normal: corners about the centre are off by u h, their products by 6
//    u |e|_1 h with the sums, the way of the centres by 8 u as above. Their room is |e|_1 times 64
//    u h and the centre's.
// Where cells differ so much in size that normals would leave the range of floats, there are no
// slabs. A centre beyond that range is as far off as it says: an infinite distance parts from what
// is finite alone.
#if defined(NEARMESH_GEOMETRY_BOX_KERNELS) == defined(HWY_TARGET_TOGGLE)
#ifdef NEARMESH_GEOMETRY_BOX_KERNELS
#undef NEARMESH_GEOMETRY_BOX_KERNELS
#else
#define NEARMESH_GEOMETRY_BOX_KERNELS
#endif

#include <hwy/highway.h>

#include <cmath>

#include "placed_boxes.hpp"
#include "vectors.hpp"

HWY_BEFORE_NAMESPACE();
namespace nearmesh::HWY_NAMESPACE {

using FloatLanes = hn::CappedTag<float, kLanes>;
using FloatVec = hn::Vec<FloatLanes>;
using FloatMask = hn::Mask<FloatLanes>;

HWY_INLINE FloatVec dot(const FloatVec (&a)[3], const FloatVec (&b)[3]) {
  return hn::Add(hn::Add(hn::Mul(a[0], b[0]), hn::Mul(a[1], b[1])), hn::Mul(a[2], b[2]));
}
HWY_INLINE std::uint32_t bits_of(FloatMask mask) {
  std::uint8_t bytes[8] = {};
  hn::StoreMaskBits(FloatLanes(), mask, bytes);
  return bytes[0];
}

using IntLanes = hn::Rebind<std::int32_t, FloatLanes>;

HWY_INLINE FloatVec dot(const float* a, const FloatVec (&b)[3]) {
  const FloatLanes d;
  return hn::Add(hn::Add(hn::Mul(hn::Set(d, a[0]), b[0]), hn::Mul(hn::Set(d, a[1]), b[1])),
                 hn::Mul(hn::Set(d, a[2]), b[2]));
}

/// Slabs of some lanes. The normals are of floats, kSlabLength long, nearly, or 0; from and to are
/// about the centre.
struct SlabLanes {
  FloatVec normal[3], from, to;
};

/// Places boxes by their corners and the slabs that slabs_at gives for the lanes from one on.
template <class SlabsAt>
HWY_INLINE void place_lanes_inline(const Placing& placing, const std::int32_t (&lo)[3][kLanes],
                                   const std::int32_t (&hi)[3][kLanes], const SlabsAt& slabs_at,
                                   PlacedBoxes& out) {
  float halves[3][kLanes];
  const Doubles doubles;
  for (std::size_t lane = 0; lane < kLanes; lane += hn::Lanes(doubles)) {
    const auto round_to = [](Vec x, float* p) {
      hn::StoreU(hn::DemoteTo(Floats(), x), Floats(), p);
    };
    const Vec by_two = hn::Set(doubles, 0.5);
    Vec center[3];
    for (std::size_t k = 0; k < 3; ++k) {
      const Vec from = load(lo[k] + lane), to = load(hi[k] + lane);
      center[k] = hn::Mul(by_two, hn::Add(from, to));
      round_to(center[k], out.own.center[k] + lane);
      round_to(hn::Mul(by_two, hn::Sub(to, from)), halves[k] + lane);
    }
    const RelativeFrame& f = placing.own_in_other;
    for (std::size_t k = 0; k < 3; ++k)
      round_to(hn::Add(dot(f.rotation.data() + 3 * k, center), hn::Set(doubles, f.translation[k])),
               out.other.center[k] + lane);
  }
  const FloatLanes d;
  const auto at = [&d](float x) { return hn::Set(d, x); };
  for (std::size_t lane = 0; lane < kLanes; lane += hn::Lanes(d)) {
    FloatVec half[3];
    for (std::size_t k = 0; k < 3; ++k) half[k] = hn::LoadU(d, halves[k] + lane);
    const SlabLanes slabs = slabs_at(lane);
    const FloatVec middle = hn::Mul(at(0.5F), hn::Add(slabs.from, slabs.to)),
                   thickness = hn::Mul(at(0.5F), hn::Sub(slabs.to, slabs.from));
    const FloatVec thick =
        hn::Add(thickness, hn::Mul(at(0x1p-20F), hn::Add(hn::Abs(middle), thickness)));
    const FloatVec box_room = hn::Mul(at(0x1p-17F), hn::Max(hn::Max(half[0], half[1]), half[2]));
    const FloatVec grown = hn::Add(box_room, at(placing.own_room));
    const auto store_up = [&](FloatVec x, float* p) {
      hn::StoreU(hn::Mul(x, at(1 + 0x1p-20F)), d, p + lane);
    };
    hn::StoreU(middle, d, out.middle + lane);
    // |normal|_1 <= sqrt(3) * 128
    store_up(hn::Add(thick, hn::Add(hn::Mul(box_room, at(static_cast<float>(kSlabLength))),
                                    at(222 * placing.own_room))),
             out.own.thickness);
    FloatVec reach[3], length = hn::Zero(d);
    for (std::size_t k = 0; k < 3; ++k) {
      hn::StoreU(slabs.normal[k], d, out.own.normal[k] + lane);
      store_up(hn::Add(half[k], grown), out.own.half[k]);
      // In the other's units.
      reach[k] = hn::Add(dot(placing.abs_rotation + 3 * k, half), at(placing.reach_room));
      hn::StoreU(hn::Mul(reach[k], at(1 + 0x1p-18F)), d, out.other.half[k] + lane);
      const FloatVec n = dot(placing.turned_back + 3 * k, slabs.normal);
      hn::StoreU(n, d, out.other.normal[k] + lane);
      length = hn::Add(length, hn::Abs(n));
    }
    const FloatVec most = hn::Max(hn::Max(reach[0], reach[1]), reach[2]);
    const FloatVec room = hn::Add(hn::Mul(at(0x1p-18F), most), at(placing.slab_room));
    store_up(hn::Add(thick, hn::Mul(length, room)), out.other.thickness);
    store_up(length, out.length);
  }
}

HWY_INLINE SlabLanes no_slabs() {
  const FloatVec zero = hn::Zero(FloatLanes());
  return {{zero, zero, zero}, zero, zero};
}

HWY_INLINE void place_boxes_inline(const Placing& placing, const BoxLanes& boxes,
                                   PlacedBoxes& out) {
  const auto slabs_at = [&](std::size_t lane) {
    if (HWY_UNLIKELY(!placing.has_slabs)) return no_slabs();
    const FloatLanes d;
    SlabLanes slabs;
    for (std::size_t k = 0; k < 3; ++k)
      slabs.normal[k] = hn::ConvertTo(
          d, hn::PromoteTo(IntLanes(), hn::LoadU(hn::Rebind<std::int8_t, FloatLanes>(),
                                                 boxes.normal[k] + lane)));
    slabs.from = hn::LoadU(d, boxes.from + lane);
    slabs.to = hn::LoadU(d, boxes.to + lane);
    return slabs;
  };
  place_lanes_inline(placing, boxes.lo, boxes.hi, slabs_at, out);
}

/// The planes of triangles as slabs, from their corners about the centres of their boxes.
HWY_INLINE SlabLanes planes_of(const PlacedFaces& faces, std::size_t lane) {
  const FloatLanes d;
  // By 2^-9, so that squares of areas stay in range.
  const FloatVec shrink = hn::Set(d, 0x1p-9F), grow = hn::Set(d, 0x1p9F);
  FloatVec corner[3][3], u[3], v[3], most = hn::Zero(d);
  for (std::size_t k = 0; k < 3; ++k) {
    for (std::size_t c = 0; c < 3; ++c) {
      corner[c][k] = hn::Mul(hn::LoadU(d, faces.corner[c][k] + lane), shrink);
      most = hn::Max(most, hn::Abs(corner[c][k]));
    }
    u[k] = hn::Sub(corner[1][k], corner[0][k]);
    v[k] = hn::Sub(corner[2][k], corner[0][k]);
  }
  FloatVec normal[3];
  for (std::size_t k = 0; k < 3; ++k) {
    const std::size_t i = (k + 1) % 3, j = (k + 2) % 3;
    normal[k] = hn::Sub(hn::Mul(u[i], v[j]), hn::Mul(u[j], v[i]));
  }
  const FloatVec square = dot(normal, normal);
  const FloatVec scale =
      hn::IfThenElseZero(hn::Gt(square, hn::Zero(d)),
                         hn::Div(hn::Set(d, static_cast<float>(kSlabLength)), hn::Sqrt(square)));
  SlabLanes slabs;
  for (std::size_t k = 0; k < 3; ++k) slabs.normal[k] = hn::Mul(normal[k], scale);
  const FloatVec x = dot(slabs.normal, corner[0]), y = dot(slabs.normal, corner[1]),
                 z = dot(slabs.normal, corner[2]);
  const FloatVec room = hn::Mul(most, hn::Set(d, 222 * 0x1p-21F));
  slabs.from = hn::Mul(grow, hn::Sub(hn::Min(hn::Min(x, y), z), room));
  slabs.to = hn::Mul(grow, hn::Add(hn::Max(hn::Max(x, y), z), room));
  return slabs;
}

HWY_INLINE void place_faces_inline(const Placing& placing, const TriangleLanes& faces,
                                   PlacedFaces& out) {
  const FloatLanes d;
  const IntLanes ints;
  std::int32_t lo[3][kLanes], hi[3][kLanes];
  for (std::size_t lane = 0; lane < kLanes; lane += hn::Lanes(d)) {
    FloatVec most = hn::Zero(d);
    for (std::size_t k = 0; k < 3; ++k) {
      const auto x = hn::LoadU(ints, faces.corner[0][k] + lane),
                 y = hn::LoadU(ints, faces.corner[1][k] + lane),
                 z = hn::LoadU(ints, faces.corner[2][k] + lane);
      const auto from = hn::Min(hn::Min(x, y), z), to = hn::Max(hn::Max(x, y), z);
      hn::StoreU(from, ints, lo[k] + lane);
      hn::StoreU(to, ints, hi[k] + lane);
      most = hn::Max(most, hn::ConvertTo(d, hn::Sub(to, from)));
      // Twice as far from the centre is a whole number, which fits, whatever its terms do.
      const auto sum = hn::Add(from, to);
      std::size_t c = 0;
      for (const auto& p : {x, y, z})
        hn::StoreU(hn::Mul(hn::ConvertTo(d, hn::Sub(hn::Add(p, p), sum)), hn::Set(d, 0.5F)), d,
                   out.corner[c++][k] + lane);
    }
    hn::StoreU(hn::Add(hn::Mul(most, hn::Set(d, 0x1p-19F)), hn::Set(d, placing.own_room)), d,
               out.room + lane);
  }
  const auto slabs_at = [&](std::size_t lane) {
    return HWY_UNLIKELY(!placing.has_slabs) ? no_slabs() : planes_of(out, lane);
  };
  place_lanes_inline(placing, lo, hi, slabs_at, out.boxes);
}

/// Parts of one body in one body's units.
struct BoxesThere {
  FloatVec center[3], half[3], normal[3], middle, thickness;
};
HWY_INLINE BoxesThere load_lanes(const PlacedBoxes& placed, const PlacedBoxes::There& p,
                                 std::size_t lane) {
  const FloatLanes d;
  BoxesThere out;
  for (std::size_t k = 0; k < 3; ++k) {
    out.center[k] = hn::LoadU(d, p.center[k] + lane);
    out.half[k] = hn::LoadU(d, p.half[k] + lane);
    out.normal[k] = hn::LoadU(d, p.normal[k] + lane);
  }
  out.middle = hn::LoadU(d, placed.middle + lane);
  out.thickness = hn::LoadU(d, p.thickness + lane);
  return out;
}
HWY_INLINE BoxesThere repeat_lane(const PlacedBoxes& placed, const PlacedBoxes::There& p,
                                  std::uint32_t i) {
  const FloatLanes d;
  BoxesThere out;
  for (std::size_t k = 0; k < 3; ++k) {
    out.center[k] = hn::Set(d, p.center[k][i]);
    out.half[k] = hn::Set(d, p.half[k][i]);
    out.normal[k] = hn::Set(d, p.normal[k][i]);
  }
  out.middle = hn::Set(d, placed.middle[i]);
  out.thickness = hn::Set(d, p.thickness[i]);
  return out;
}

/// Parts of two bodies in the units of the first, p's.
struct Meeting {
  FloatVec between[3];  ///< from q's centres to p's
  FloatMask parted;     ///< along an axis of these units
  FloatVec way;         ///< along q's normals, beyond the middle of its slabs
};
HWY_INLINE Meeting meet(const BoxesThere& p, const BoxesThere& q) {
  Meeting out;
  for (std::size_t k = 0; k < 3; ++k) {
    out.between[k] = hn::Sub(p.center[k], q.center[k]);
    const FloatMask found = hn::Gt(hn::Abs(out.between[k]), hn::Add(p.half[k], q.half[k]));
    out.parted = k == 0 ? found : hn::Or(out.parted, found);
  }
  out.way = hn::Sub(dot(q.normal, out.between), q.middle);
  return out;
}

/// Whether the normals of q's slabs part them, which are a times p's and a rest.
HWY_INLINE FloatMask slabs_part(const Meeting& m, const BoxesThere& p, const BoxesThere& q,
                                FloatVec a) {
  FloatVec rest[3];
  for (std::size_t k = 0; k < 3; ++k)
    rest[k] = hn::Abs(hn::Sub(q.normal[k], hn::Mul(a, p.normal[k])));
  const FloatVec reach =
      hn::Add(hn::Add(dot(rest, p.half), hn::Mul(hn::Abs(a), p.thickness)), q.thickness);
  return hn::Gt(hn::Abs(hn::Add(m.way, hn::Mul(a, p.middle))), reach);
}

/// p's normal in q's, in lengths of slabs' normals.
HWY_INLINE FloatVec share_of(const BoxesThere& p, const BoxesThere& q) {
  return hn::Mul(dot(p.normal, q.normal),
                 hn::Set(FloatLanes(), static_cast<float>(1 / (kSlabLength * kSlabLength))));
}

/// How far the centres are from each other: the most along the axes, in units of the extents of
/// both.
HWY_INLINE FloatVec depth_of(const Meeting& m, const BoxesThere& p, const BoxesThere& q) {
  FloatVec depth = hn::Zero(FloatLanes());
  for (std::size_t k = 0; k < 3; ++k)
    depth = hn::Max(depth, hn::Div(hn::Abs(m.between[k]), hn::Add(p.half[k], q.half[k])));
  return depth;
}

/// Bit i: lane i of one's own is certainly apart from one lane of the other model's. Tried are the
/// axes of both boxes and both slabs' normals. Bits of unused lanes mean nothing. In: the ratio of
/// cells of one's own placing. With kDepth also how deep each overlaps the other, along own axes:
/// least is deepest.
template <bool kDepth>
HWY_INLINE std::uint32_t boxes_apart_inline(const PlacedBoxes& own, const PlacedBoxes& other,
                                            std::uint32_t i, float cells_ratio, float* depths) {
  const FloatLanes d;
  std::uint32_t apart = 0;
  for (std::size_t lane = 0; lane < kLanes; lane += hn::Lanes(d)) {
    const BoxesThere p = load_lanes(own, own.own, lane), q = repeat_lane(other, other.other, i);
    const FloatVec a = share_of(p, q);
    const Meeting in_own = meet(p, q);
    FloatMask found = hn::Or(in_own.parted, slabs_part(in_own, p, q, a));
    if (kDepth) hn::StoreU(depth_of(in_own, p, q), d, depths + lane);
    // In the other's units the roles are exchanged; its normals turn back by the square of the
    // ratio of the cells.
    const BoxesThere r = repeat_lane(other, other.own, i), s = load_lanes(own, own.other, lane);
    const Meeting in_other = meet(r, s);
    found = hn::Or(found, hn::Or(in_other.parted,
                                 slabs_part(in_other, r, s,
                                            hn::Mul(a, hn::Set(d, cells_ratio * cells_ratio)))));
    apart |= bits_of(found) << lane;
  }
  return apart;
}

/// Whether the normals of q's slabs part triangles from q.
HWY_INLINE FloatMask slabs_part(const Meeting& m, const PlacedFaces& faces,
                                const PlacedBoxes& other, std::uint32_t i, const BoxesThere& q,
                                std::size_t lane) {
  const FloatLanes d;
  FloatVec along[3];
  for (std::size_t c = 0; c < 3; ++c) {
    const FloatVec corner[3] = {hn::LoadU(d, faces.corner[c][0] + lane),
                                hn::LoadU(d, faces.corner[c][1] + lane),
                                hn::LoadU(d, faces.corner[c][2] + lane)};
    along[c] = dot(q.normal, corner);
  }
  const FloatVec from = hn::Add(m.way, hn::Min(hn::Min(along[0], along[1]), along[2])),
                 to = hn::Add(m.way, hn::Max(hn::Max(along[0], along[1]), along[2]));
  const FloatVec reach =
      hn::Add(q.thickness, hn::Mul(hn::Set(d, other.length[i]), hn::LoadU(d, faces.room + lane)));
  return hn::Gt(hn::Max(from, hn::Neg(to)), reach);
}

/// The same of own triangles, of `wanted` alone. Along the other's slab they are held by their
/// corners: large ones are much smaller than their boxes. With kGuess it ends where own units part
/// all of these: a branch, which saves half where it can be predicted.
template <bool kGuess>
HWY_INLINE std::uint32_t faces_apart_inline(const PlacedFaces& faces, std::uint32_t wanted,
                                            const PlacedBoxes& other, std::uint32_t i,
                                            float cells_ratio) {
  const FloatLanes d;
  const PlacedBoxes& own = faces.boxes;
  std::uint32_t apart = 0;
  for (std::size_t lane = 0; lane < kLanes; lane += hn::Lanes(d)) {
    const BoxesThere p = load_lanes(own, own.own, lane), q = repeat_lane(other, other.other, i);
    const Meeting in_own = meet(p, q);
    FloatMask found = hn::Or(in_own.parted, slabs_part(in_own, faces, other, i, q, lane));
    if (!kGuess || (wanted >> lane & ~bits_of(found) & ((1U << hn::Lanes(d)) - 1)) != 0) {
      const BoxesThere r = repeat_lane(other, other.own, i), s = load_lanes(own, own.other, lane);
      const Meeting in_other = meet(r, s);
      const FloatVec a = hn::Mul(share_of(p, q), hn::Set(d, cells_ratio * cells_ratio));
      found = hn::Or(found, hn::Or(in_other.parted, slabs_part(in_other, r, s, a)));
    }
    apart |= bits_of(found) << lane;
  }
  return apart & wanted;
}

}  // namespace nearmesh::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();
#endif
