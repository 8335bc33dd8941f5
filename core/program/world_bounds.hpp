// SPDX-License-Identifier: Apache-2.0
#pragma once
// A box around points, metres. For world_plan.cpp and tile_source.cpp alone.

#include <algorithm>
#include <array>

#include "nearmesh/core/mesh/indexed_mesh.hpp"

namespace nearmesh::program {

struct Bounds {
  std::array<double, 3> lo{}, hi{};
  bool is_empty = true;

  void add(const std::array<double, 3>& p) {
    for (std::size_t k = 0; k < 3; ++k) {
      lo[k] = is_empty ? p[k] : std::min(lo[k], p[k]);
      hi[k] = is_empty ? p[k] : std::max(hi[k], p[k]);
    }
    is_empty = false;
  }
  [[nodiscard]] double longest() const {
    double side = 0;
    for (std::size_t k = 0; k < 3; ++k) side = std::max(side, hi[k] - lo[k]);
    return side;
  }
};

/// Of all corners.
[[nodiscard]] inline Bounds bounds_of(const IndexedMesh& mesh) {
  Bounds bounds;
  for (const auto& face : mesh.faces)
    for (const std::uint32_t v : face) bounds.add(mesh.positions_m[v]);
  return bounds;
}

}  // namespace nearmesh::program
