// SPDX-License-Identifier: Apache-2.0
#pragma once
// Meshes without any order, for tests of every kind.

#include <cstdint>

#include "core/base/random.hpp"
#include "nearmesh/core/mesh/detail/indexed_mesh.hpp"

namespace nearmesh::test {

/// Triangles between random ones of `vertices` points: edges with many faces, no orientation,
/// crossings.
inline IndexedMesh make_soup(std::uint32_t vertices, std::uint32_t faces, std::uint64_t seed) {
  Random random(seed);
  IndexedMesh mesh;
  for (std::uint32_t i = 0; i < vertices; ++i)
    mesh.positions_m.push_back(
        {random.between(-1, 1), random.between(-1, 1), random.between(-1, 1)});
  while (mesh.faces.size() < faces) {
    const std::uint32_t a = random.below(vertices), b = random.below(vertices),
                        c = random.below(vertices);
    if (a != b && b != c && c != a) mesh.faces.push_back({a, b, c});
  }
  return mesh;
}

}  // namespace nearmesh::test
