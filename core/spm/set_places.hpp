// SPDX-License-Identifier: Apache-2.0
#pragma once
// A built-in set of coding tables is made for one length of offsets. Models differ in that: by how
// many grid cells there are to an edge, their offsets and boxes are all some bits longer or
// shorter. So a model names a set and its scale, and each of its symbols has the code of the symbol
// that stands so many bits below it in the set (core/spm_format.md, "Coding tables").

#include <algorithm>
#include <array>
#include <cstdint>

#include "contexts.hpp"
#include "nearmesh/core/spm/detail/types.hpp"

namespace nearmesh::record {

/// Where symbols of a model stand in a set.
class SetPlaces {
 public:
  /// `scale`: bits. Offsets are counted in steps of 2^shift, boxes are not: these are longer still.
  SetPlaces(int scale, const std::array<std::uint8_t, 3>& lattice_shift)
      : scale_(scale), shift_(lattice_shift) {}

  /// The set's context. Nothing is shorter than no bits: length 0 stays what it is.
  [[nodiscard]] int context(int context) const {
    if (context < kOffset1 || context >= kFaceCount) return context;
    const int first = context < kOffset2 ? kOffset1 : kOffset2;
    const int length = context - first;
    return length == 0 ? context : first + std::clamp(length - scale_, 1, kLengthClasses - 1);
  }
  /// The symbol there. One to one in each context, so that codes stay complete.
  [[nodiscard]] std::uint32_t symbol(int context, std::uint32_t symbol) const {
    if (context >= kOffset0 && context < kFaceCount) {
      const std::uint32_t unusual = symbol >= kUnusualFaces ? kUnusualFaces : 0;
      return unusual + turned<32>(symbol - unusual, scale_);
    }
    if (context >= kBox)
      return turned<kMaxExtentCode>(
          symbol, kCodesABit * (scale_ + shift_[static_cast<std::size_t>(context - kBox) % 3]));
    return symbol;
  }

 private:
  /// Extents double every so many codes.
  static constexpr int kCodesABit = 4;
  /// 1 to kLast in a circle, so many steps down; others stay.
  template <int kLast>
  static std::uint32_t turned(std::uint32_t symbol, int steps) {
    if (symbol == 0 || symbol > kLast) return symbol;
    const int at = (static_cast<int>(symbol) - 1 - steps) % kLast;
    return static_cast<std::uint32_t>(at < 0 ? at + kLast : at) + 1;
  }

  int scale_;
  std::array<std::uint8_t, 3> shift_;
};

}  // namespace nearmesh::record
