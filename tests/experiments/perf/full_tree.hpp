// SPDX-License-Identifier: Apache-2.0
#pragma once
// A mesh as measurements take it: cleaned on a grid of 21 bits, without levels.

#include "nearmesh/core/abtree/detail/tree.hpp"
#include "nearmesh/core/mesh/clean.hpp"

namespace nearmesh {

/// The tree over all faces; their keys count them.
inline TriangleTree full_tree(const IndexedMesh& input) {
  const CleanResult clean = clean_mesh(input).value();
  std::vector<TreeFace> faces;
  for (const auto& f : clean.mesh.faces) {
    TreeFace face{{}, {{}, static_cast<std::uint32_t>(faces.size())}};
    for (std::size_t k = 0; k < 3; ++k) face.corners[k] = clean.mesh.positions[f[k]];
    faces.push_back(face);
  }
  return build_triangle_tree(clean.mesh.grid, faces);
}

}  // namespace nearmesh
