// SPDX-License-Identifier: Apache-2.0
#pragma once
// What kind of surface a cleaned mesh is: whether it encloses anything, and how many parts it has.
// Takes GridMesh, gives what clean_mesh reports and what bake writes into the header.

#include <cstdint>
#include <vector>

#include "nearmesh/core/mesh/clean.hpp"

namespace nearmesh {

/// Edges at which a surface does not close, i.e. that its faces do not pass equally often in both directions. None: the
/// surface is an oriented closed 2-cycle, so that every point off it has a winding number.
struct UnclosedEdges {
  std::uint64_t boundary = 0;     ///< with one face
  std::uint64_t disagreeing = 0;  ///< with more faces, whose orientations do not cancel
};
/// Vertices are told apart by place. Segments and points pass each edge both ways, so they open none.
/// In: what clean_mesh gives, below 2^31 vertices. Cost: O(n) where edges at a vertex are few, 12 bytes a face.
[[nodiscard]] UnclosedEdges count_unclosed_edges(const GridMesh& mesh);

/// For each vertex, the lowest vertex of its connected part (faces that share a vertex hang together).
[[nodiscard]] std::vector<std::uint32_t> find_components(const GridMesh& mesh);

}  // namespace nearmesh
