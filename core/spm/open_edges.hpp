// SPDX-License-Identifier: Apache-2.0
#pragma once
// Guesses of outside corners, one for both directions of the record codec (core/spm_format.md,
// "Record").

#include <array>
#include <bit>
#include <cstdint>
#include <cstring>
#if defined(__SSE2__)
#include <emmintrin.h>
#endif

#include "nearmesh/core/spm/detail/types.hpp"

namespace nearmesh::record {

/// Guesses the outside corner of a face from its other two: where an earlier face of the batch lies
/// across one of the new face's edges, its corner there is the one. Holds, for the vertices seen
/// last, the directed edges of faces whose other side has not come; ids near each other fall on
/// different slots. Which of two values is wanted is as good as random here, so nothing branches:
/// masks choose.
class OpenEdges {
 public:
  /// Open edges of a vertex: from it to the first two, from the last two to it, each the latest
  /// first. The vertex itself stands for none, since it is never outside.
  using Lists = std::uint32_t __attribute__((vector_size(16)));
  /// What is known around a face with these two corners.
  struct Around {
    Lists left, right;
    Lists guesses;       // the latest of left's and of right's, then the ones before
    std::uint32_t kind;  // below 32: which of them are outside, and whether left and right agree
  };

  OpenEdges() { owners_.fill(0xffffffffU); }

  template <bool kFlipped>
  [[nodiscard]] Around around(std::uint32_t left, std::uint32_t right, const NodeSpan& node) const {
    Around a;
    a.left = lists(left);
    a.right = lists(right);
    a.guesses = kFlipped ? __builtin_shufflevector(a.left, a.right, 2, 4, 3, 5)
                         : __builtin_shufflevector(a.left, a.right, 0, 6, 1, 7);
    const Lists agree = Lists(__builtin_shufflevector(a.guesses, a.guesses, 0, 0, 2, 2) ==
                              __builtin_shufflevector(a.guesses, a.guesses, 1, 3, 1, 1));
    a.kind = outside(a.guesses, node) | ((high_bits(agree) + 15) & 16U);
    return a;
  }
  /// Some vertex outside of `node` that shares an open edge with the face's left or right corner,
  /// or `none`.
  [[nodiscard]] static std::uint32_t neighbour(const Around& around, const NodeSpan& node,
                                               std::uint32_t none) {
    const std::array<Lists, 2> all{around.left, around.right};
    std::array<std::uint32_t, 9> vertices;
    std::memcpy(vertices.data(), all.data(), sizeof all);
    vertices[8] = none;
    const std::uint32_t found = outside(around.left, node) | outside(around.right, node) << 4;
    return vertices[static_cast<std::size_t>(std::countr_zero(found | 0x100U))];
  }
  /// The face is there.
  template <bool kFlipped>
  void add(std::uint32_t left, std::uint32_t right, std::uint32_t outside) {
    const std::uint32_t a = kFlipped ? right : left, b = kFlipped ? left : right;
    add_corner(a, outside, b);
    add_corner(b, a, outside);
    add_corner(outside, b, a);
  }

 private:
  static constexpr std::uint32_t kSlots = 256;

  static Lists all(std::uint32_t v) { return Lists{v, v, v, v}; }
  static Lists select(Lists mask, Lists a, Lists b) { return b ^ ((a ^ b) & mask); }
  // Bit i: the highest bit of lane i.
  static std::uint32_t high_bits(Lists lanes) {
#if defined(__SSE2__)
    return static_cast<std::uint32_t>(_mm_movemask_ps(__m128(lanes)));
#else
    const Lists bits = lanes >> 31 << Lists{0, 1, 2, 3};
    return bits[0] | bits[1] | bits[2] | bits[3];
#endif
  }
  // Bit i: vertex i is outside. Ids are below 2^30, so a difference's highest bit says that it is
  // negative.
  static std::uint32_t outside(Lists vertices, const NodeSpan& node) {
    return high_bits((vertices - all(node.begin())) | (all(node.end() - 1) - vertices));
  }
  [[nodiscard]] Lists lists(std::uint32_t v) const {
    return select(Lists(all(owners_[v % kSlots]) == all(v)), lists_[v % kSlots], all(v));
  }
  // A face's edges at v, one from `before` and one to `after`. Each closes the edge that runs the
  // other way where the list still has it, and stays open otherwise.
  void add_corner(std::uint32_t v, std::uint32_t before, std::uint32_t after) {
    const Lists old = lists(v);
    const Lists none = all(v);
    const Lists ends{before, before, after, after};
    const Lists found = Lists(old == ends);
    const Lists gone = found | __builtin_shufflevector(found, found, 0, 0, 2, 2);
    const Lists kept = select(gone, __builtin_shufflevector(old, none, 1, 4, 3, 4), old);
    const Lists added = __builtin_shufflevector(kept, ends, 6, 0, 4, 2);
    lists_[v % kSlots] = select(__builtin_shufflevector(gone, gone, 3, 3, 1, 1), kept, added);
    owners_[v % kSlots] = v;
  }

  std::array<std::uint32_t, kSlots> owners_;
  std::array<Lists, kSlots> lists_;  // what has no owner is not read
};

}  // namespace nearmesh::record
