// SPDX-License-Identifier: Apache-2.0
#pragma once
// What kind of surface a mesh is: whether it encloses anything, and how many parts it has. Whoever
// cleans a mesh reports it, whoever bakes one writes it into the header, and whoever checks a model
// counts again.

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "nearmesh/core/geometry/detail/grid.hpp"

namespace nearmesh {

/// Three different vertices each.
using SurfaceFaces = std::span<const std::array<std::uint32_t, 3>>;

/// Edges at which a surface does not close, i.e. that its faces do not pass equally often in both
/// directions. None: the surface is an oriented closed 2-cycle, so that every point off it has a
/// winding number.
struct UnclosedEdges {
  std::uint64_t boundary = 0;     ///< with one face
  std::uint64_t disagreeing = 0;  ///< with more faces, whose orientations do not cancel
};
/// Vertices are told apart by place. Segments and points pass each edge both ways, so they open
/// none.
/// In: below 2^31 vertices, each at a place of its own. Cost: O(n) where edges at a vertex are few,
/// 12 bytes a face.
[[nodiscard]] UnclosedEdges count_unclosed_edges(std::span<const GridPoint> positions,
                                                 SurfaceFaces faces);

/// For each vertex, the lowest vertex of its connected part (faces that share a vertex hang
/// together).
[[nodiscard]] std::vector<std::uint32_t> find_components(std::size_t vertices, SurfaceFaces faces);

}  // namespace nearmesh
