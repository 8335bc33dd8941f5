// SPDX-License-Identifier: Apache-2.0
// What is held of a model, as a mesh that can be drawn.
#include <algorithm>
#include <cmath>

#include "core/base/hash.hpp"
#include "session_impl.hpp"

namespace nearmesh::subscriber {

Result<Session::HeldMesh> Session::held_mesh(BodyId body) const {
  const Body* asked = impl_->find(body);
  if (asked == nullptr) return no_such(body);
  if (!asked->model->is_ready())
    return Status{StatusCode::kNotFound, "no header of " + asked->model->name + " has come"};
  const Replica& replica = *asked->model->replica;
  const Grid& grid = replica.header().grid;
  const auto in_metres = [&](VertexId vertex) {
    const GridPoint& point = replica.store().position(vertex);
    std::array<double, 3> at{};
    for (std::size_t k = 0; k < 3; ++k)
      at[k] = grid.origin_m[k] + std::ldexp(double{1} * point.v[k], grid.exponent);
    return at;
  };
  HeldMesh held;
  for (const ActiveFace& face : extract_faces(replica.mesh())) {
    const bool is_exact =
        std::all_of(face.corners.begin(), face.corners.end(),
                    [&](VertexId corner) { return replica.mesh().is_resolved(corner); });
    for (const VertexId corner : face.corners)
      (is_exact ? held.exact_m : held.coarse_m).push_back(in_metres(corner));
  }
  return held;
}

std::uint64_t Session::held_state(BodyId body) const {
  const Body* asked = impl_->find(body);
  if (asked == nullptr || !asked->model->is_ready()) return 0;
  const Replica& replica = *asked->model->replica;
  return mix(replica.mesh().state_hash() ^ replica.header().content.low) | 1;
}

}  // namespace nearmesh::subscriber
