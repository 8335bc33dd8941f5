// SPDX-License-Identifier: Apache-2.0
#include "check_boxes.hpp"

#include <string>
#include <vector>

namespace nearmesh {
namespace {

/// Around the faces that touch each vertex.
std::vector<GridBox> boxes_around_vertices(const SplitStore& store) {
  std::vector<GridBox> boxes(store.vertex_count());
  const auto add = [&](const SplitFace& face) {
    GridBox box;
    for (const VertexId corner : face.corners()) box.add(store.position(corner));
    for (const VertexId corner : face.corners()) boxes[corner.value].add(box);
  };
  for (const SplitFace& face : store.base_faces()) add(face);
  for (VertexId v{0}; v.value < store.vertex_count(); ++v.value) {
    if (store.is_root(v)) continue;
    for (const SplitFace& face : store.faces(v)) add(face);
  }
  return boxes;
}

Status check_node(const SplitStore& store, NodeSpan node, const GridBox& faces) {
  // Of one vertex no box is kept but a root's: its face is there or is not.
  if (node.size < 2 || faces.is_empty() || store.box(node).contains(faces)) return Status::ok();
  return {StatusCode::kCorrupt, to_string(node) + ": its box leaves out faces of its vertices"};
}

}  // namespace

Status check_boxes(const SplitStore& store) {
  NEARMESH_ASSERT(store.known_splits() + store.roots().size() == store.vertex_count());
  std::vector<GridBox> whole = boxes_around_vertices(store);
  // Children of a vertex have higher ids, and what was merged into it first the lowest: its node
  // grows from left to right.
  for (VertexId v{store.vertex_count()}; v.value-- > 0;) {
    const NodeSpan all = store.initial_node(v);
    for (VertexId u{v.value + 1}; u.value < all.end(); u.value += store.initial_node(u).size) {
      NEARMESH_RETURN_IF_ERROR(check_node(store, {v, u.value - v.value}, whole[v.value]));
      whole[v.value].add(whole[u.value]);
    }
    NEARMESH_RETURN_IF_ERROR(check_node(store, all, whole[v.value]));
  }
  return Status::ok();
}

}  // namespace nearmesh
