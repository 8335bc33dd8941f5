// SPDX-License-Identifier: Apache-2.0
#include "hoppe.hpp"

#include <algorithm>

namespace nearmesh::chart {

HoppeRule::HoppeRule(const SplitStore& store, const std::vector<VertexId>& order) {
  ActiveMesh mesh(store);
  RefineDelta delta;
  std::vector<std::vector<FaceKey>> around(store.vertex_count());  // faces at each active vertex
  const auto corners = [&](FaceKey key) {
    std::array<VertexId, 3> at = store.face(key).corners();
    for (VertexId& v : at) v = mesh.active_predecessor(v);
    return at;
  };
  const auto add = [&](FaceKey key) {
    for (const VertexId v : corners(key)) around[v.value].push_back(key);
  };
  for (std::uint32_t i = 0; i < store.base_faces().size(); ++i) add({{}, i});
  std::vector<std::vector<VertexId>> needs(store.vertex_count());
  for (const VertexId u : order) {
    const NodeSpan node = store.node_of(u);
    static_cast<void>(mesh.split(u, delta));
    // Faces of the old vertex that stand at the new one from now on.
    std::vector<FaceKey>& old = around[node.begin()];
    const auto moved = std::stable_partition(old.begin(), old.end(), [&](FaceKey key) {
      const auto at = corners(key);
      return std::find(at.begin(), at.end(), u) == at.end();
    });
    around[u.value].assign(moved, old.end());
    old.erase(moved, old.end());
    for (std::uint32_t i = 0; i < store.faces(u).size(); ++i) add({u, i});
    for (std::uint32_t i = 0; i < store.faces(u).size(); ++i) {
      const auto own = corners({u, i});
      const VertexId third = *std::find_if(own.begin(), own.end(),
                                           [&](VertexId v) { return v != u && v != node.first; });
      for (const FaceKey& key : around[third.value]) {
        if (key.split == u || !key.split.is_valid()) continue;
        const auto at = corners(key);
        if (std::any_of(at.begin(), at.end(),
                        [&](VertexId v) { return v == u || v == node.first; }))
          needs[u.value].push_back(key.split);
      }
    }
  }
  first_.push_back(0);
  for (const auto& of_split : needs) {
    needs_.insert(needs_.end(), of_split.begin(), of_split.end());
    first_.push_back(static_cast<std::uint32_t>(needs_.size()));
  }
}

void HoppeRule::split(ActiveMesh& mesh, VertexId u, RefineDelta& delta) const {
  std::vector<VertexId> stack{u};
  while (!stack.empty()) {
    const VertexId v = stack.back();
    if (mesh.is_active(v)) {
      stack.pop_back();
      continue;
    }
    const std::size_t before = stack.size();
    const NodeSpan node = mesh.store().node_of(v), parent = mesh.store().parent_of(node);
    if (parent.size > 0 && !mesh.is_active(mesh.store().split_of(parent)))
      stack.push_back(mesh.store().split_of(parent));
    for (std::uint32_t i = first_[v.value]; i < first_[v.value + 1]; ++i)
      if (!mesh.is_active(needs_[i])) stack.push_back(needs_[i]);
    if (stack.size() > before) continue;
    static_cast<void>(mesh.split(v, delta));
    stack.pop_back();
  }
}

}  // namespace nearmesh::chart
