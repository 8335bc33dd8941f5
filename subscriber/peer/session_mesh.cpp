// SPDX-License-Identifier: Apache-2.0
// What is held of a model, as a mesh that can be drawn.
#include "core/base/float_guard.hpp"
#include "core/base/hash.hpp"
#include "core/replica/triangles.hpp"
#include "session_impl.hpp"

namespace nearmesh::subscriber {

Result<Session::HeldMesh> Session::held_mesh(BodyId body) const {
  const FloatGuard guard;
  NEARMESH_RETURN_IF_ERROR(impl_->check_whole());
  const Body* asked = impl_->find(body);
  if (asked == nullptr) return no_such(body);
  if (!asked->model->is_ready())
    return Status{StatusCode::kNotFound, "body " + asked->name + ": the header of its model " +
                                             asked->model->name + " has not come yet"};
  HeldMesh held;
  add_triangles(*asked->model->replica, held.exact_m, held.coarse_m);
  return held;
}

std::uint64_t Session::held_state(BodyId body) const {
  const Body* asked = impl_->find(body);
  if (impl_->is_half_way || asked == nullptr || !asked->model->is_ready()) return 0;
  const Replica& replica = *asked->model->replica;
  return mix(replica.mesh().state_hash() ^ replica.header().content.low) | 1;
}

}  // namespace nearmesh::subscriber
