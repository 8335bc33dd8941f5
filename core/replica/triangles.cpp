// SPDX-License-Identifier: Apache-2.0
#include "triangles.hpp"

#include <algorithm>
#include <cmath>

namespace nearmesh {

void add_triangles(const Replica& replica, std::vector<std::array<double, 3>>& exact_m,
                   std::vector<std::array<double, 3>>& coarse_m) {
  const Grid& grid = replica.header().grid;
  const auto in_metres = [&](VertexId vertex) {
    const GridPoint& point = replica.store().position(vertex);
    std::array<double, 3> at{};
    for (std::size_t k = 0; k < 3; ++k)
      at[k] = grid.origin_m[k] + std::ldexp(double{1} * point.v[k], grid.exponent);
    return at;
  };
  for (const ActiveFace& face : extract_faces(replica.mesh())) {
    const bool is_exact =
        std::all_of(face.corners.begin(), face.corners.end(),
                    [&](VertexId corner) { return replica.mesh().is_resolved(corner); });
    for (const VertexId corner : face.corners)
      (is_exact ? exact_m : coarse_m).push_back(in_metres(corner));
  }
}

}  // namespace nearmesh
