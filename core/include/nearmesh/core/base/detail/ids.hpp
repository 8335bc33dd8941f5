// SPDX-License-Identifier: Apache-2.0
#pragma once
// 32-bit identifiers of different kinds that do not compare with each other.

#include <compare>
#include <cstdint>

namespace nearmesh {

/// A typed index. All ones means "none".
template <class Tag>
struct Id {
  std::uint32_t value = 0xffffffffU;

  [[nodiscard]] constexpr bool is_valid() const { return value != 0xffffffffU; }
  constexpr auto operator<=>(const Id&) const = default;
};

/// Rank of a vertex in the depth-first order of the merge forest (spm/forest.hpp). The split that
/// activates a vertex has the same number.
using VertexId = Id<struct VertexTag>;
/// Number of a face in the user's input file, counted after polygons were cut into triangles.
using FaceId = Id<struct FaceTag>;

}  // namespace nearmesh
