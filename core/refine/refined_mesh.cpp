// SPDX-License-Identifier: Apache-2.0
#include "refined_mesh.hpp"

#include <algorithm>
#include <array>
#include <string>

namespace nearmesh {
namespace {

/// Whose faces are looked at with each batch.
constexpr std::size_t kVerticesChecked = 8;

}  // namespace

RefinedMesh::RefinedMesh(SpmHeader header)
    : header_(std::move(header)),
      store_(std::make_unique<SplitStore>(header_)),
      mesh_(std::make_unique<ActiveMesh>(*store_)),
      tellers_(store_->vertex_count()) {}

Status RefinedMesh::insert(const SplitRecord& record, std::span<const SplitFace> faces,
                           Teller teller, RefineDelta& delta) {
  if (!mesh_->half_spaces().is_empty()) [[unlikely]] {
    Status fault = check_against_half_spaces(record, faces);
    if (!fault.is_ok()) return fault;
  }
  const Result<SplitStore::Insertion> inserted = store_->insert(record, faces, outside_of(faces));
  NEARMESH_RETURN_IF_ERROR(inserted);
  if (inserted.value() == SplitStore::Insertion::kNoParent) {
    park(record, faces, teller);
    return Status::ok();
  }
  if (inserted.value() != SplitStore::Insertion::kKnown &&
      teller_of(record.split) != teller)  // most often both are the first, which is 0
    tellers_.set(record.split.value) =
        inserted.value() == SplitStore::Insertion::kAdded ? teller : kManyTellers;
  if (inserted.value() == SplitStore::Insertion::kBoxed) delta.boxed.push_back(record.split);
  const bool done = mesh_->split(record.split, delta);
  NEARMESH_ASSERT(done);
  static_cast<void>(done);
  if (!parked_half_spaces_.empty()) [[unlikely]]
    return tell_parked(record, delta);
  return Status::ok();
}

namespace {

Status outside_half_space(NodeSpan node, const HalfSpace& half_space) {
  return {StatusCode::kCorrupt, to_string(node) + ": a face of its lies outside its half-space " +
                                    std::to_string(half_space.direction) + ":" +
                                    std::to_string(half_space.reach)};
}

}  // namespace

// Once a node is split its half-spaces are gone. What its split shows is held against them before:
// the new vertex, and those corners of the split's faces that are known, as each of these faces has
// a vertex in the node.
Status RefinedMesh::check_against_half_spaces(const SplitRecord& record,
                                              std::span<const SplitFace> faces) const {
  if (!store_->is_node(record.node) || !mesh_->is_current(record.node)) return Status::ok();
  const GridPoint& from = store_->position(record.node.first);
  GridPoint to;
  for (int k = 0; k < 3; ++k) {
    const std::int64_t at = std::int64_t{from[k]} + record.offset[static_cast<std::size_t>(k)];
    if (at < 0 || at > store_->grid_max()) return Status::ok();  // the store will say so
    to[k] = static_cast<std::int32_t>(at);
  }
  for (const HalfSpace& half_space : mesh_->half_spaces().of(record.node.first)) {
    if (!contains(half_space, from, to)) return outside_half_space(record.node, half_space);
    for (const SplitFace& face : faces)
      if (face.outside.value < store_->vertex_count() && mesh_->is_active(face.outside) &&
          !contains(half_space, from, store_->position(face.outside)))
        return outside_half_space(record.node, half_space);
  }
  return Status::ok();
}

// A half-space that came. The faces that appeared with the node have a vertex in it, so those of
// their corners that are known lie in the half-space; check_faces() looks at other faces, in turn.
Status RefinedMesh::tell(const NodeHalfSpace& told, RefineDelta& delta) {
  if (!store_->is_node(told.node)) {
    if (parked_half_spaces_.size() < kMaxParked || parked_half_spaces_.contains(key(told.node)))
      nearmesh::add_half_space(told.half_space, parked_half_spaces_[key(told.node)]);
    return Status::ok();
  }
  if (!mesh_->is_current(told.node)) return Status::ok();
  if (!mesh_->add_half_space(told.node, told.half_space, delta)) return Status::ok();
  const bool is_first = told.node == store_->initial_node(told.node.first);
  const VertexId maker{is_first ? told.node.begin() : told.node.end()};
  if (store_->is_root(maker)) return Status::ok();
  for (const SplitFace& face : store_->faces(maker))
    for (const VertexId corner : face.corners())
      if (mesh_->is_active(corner) &&
          !contains(told.half_space, store_->position(told.node.first), store_->position(corner)))
        return outside_half_space(told.node, told.half_space);
  return Status::ok();
}

Status RefinedMesh::tell_parked(const SplitRecord& maker, RefineDelta& delta) {
  for (const NodeSpan node : {maker.left(), maker.right()}) {
    const auto at = parked_half_spaces_.find(key(node));
    if (at == parked_half_spaces_.end()) continue;
    const std::vector<HalfSpace> parked = std::move(at->second);
    parked_half_spaces_.erase(at);
    for (const HalfSpace& half_space : parked)
      NEARMESH_RETURN_IF_ERROR(tell({node, half_space}, delta));
  }
  return Status::ok();
}

// The mesh says which are known: to ask the store would read pages that were never written.
GridBox RefinedMesh::outside_of(std::span<const SplitFace> faces) const {
  return store_->outside_of(faces, [this](VertexId corner) { return mesh_->is_active(corner); });
}

void RefinedMesh::park(const SplitRecord& record, std::span<const SplitFace> faces, Teller teller) {
  const auto at = parked_.find(key(record.node));
  if (at == parked_.end()) {
    if (parked_.size() < kMaxParked)
      parked_.emplace(key(record.node), Parked{record, {faces.begin(), faces.end()}, teller});
    return;
  }
  // A repeat, from another batch, may carry boxes that the first did not.
  SplitRecord& first = at->second.record;
  if (first.split != record.split) return;
  if (at->second.teller != teller) at->second.teller = kManyTellers;
  if (first.left_box == kNoBox) first.left_box = record.left_box;
  if (first.right_box == kNoBox) first.right_box = record.right_box;
}

// What is known is active, but while it is collapsed.
std::bitset<kManyTellers + 1> RefinedMesh::tellers() const {
  std::bitset<kManyTellers + 1> found;
  const auto count = mesh_->split_count() + static_cast<std::uint32_t>(store_->roots().size());
  for (std::uint32_t i = 0; i < count; ++i)
    if (const VertexId split = mesh_->active_at(i); !store_->is_root(split))
      found.set(teller_of(split));
  for (const auto& [node, parked] : parked_) found.set(parked.teller);
  return found;
}

RefinedMesh::Applied RefinedMesh::apply_batch(const SplitBatch& batch, Teller teller) {
  Applied applied;
  applied.delta.split.reserve(batch.splits.size());
  constexpr std::size_t kAhead = 8;  // records: enough for the entry to come from memory
  for (std::size_t i = 0; i < batch.splits.size(); ++i) {
    const SplitRecord& record = batch.splits[i];
    if (i + kAhead < batch.splits.size()) {
      const SplitRecord& later = batch.splits[i + kAhead];
      store_->prefetch(later.split);
      for (std::uint32_t face = 0; face < std::min(later.face_count, 2U); ++face)
        store_->prefetch(batch.faces[later.face_begin + face].outside);
    }
    applied.status = insert(record, {batch.faces.data() + record.face_begin, record.face_count},
                            teller, applied.delta);
    if (applied.status.is_ok() && !parked_.empty()) applied.status = unpark(record, applied.delta);
    if (!applied.status.is_ok()) return applied;
  }
  for (const NodeHalfSpace& told : batch.half_spaces) {
    applied.status = tell(told, applied.delta);
    if (!applied.status.is_ok()) return applied;
  }
  applied.status = check_faces(kVerticesChecked);
  return applied;
}

// A face that is not exact yet shows in part: the places of its corners that have come lie in the
// box of the node of each that has not. What has come since may speak against a face of long ago,
// of any split, so all are looked at in turn: some with each batch.
Status RefinedMesh::check_faces(std::size_t count) {
  const std::span<const SplitFace> base = store_->base_faces();
  for (; count > 0; --count) {
    if (next_base_face_ < base.size()) {
      NEARMESH_RETURN_IF_ERROR(check_face(base[next_base_face_++]));
      continue;
    }
    if (!mesh_->is_active(next_vertex_)) next_vertex_ = mesh_->active_predecessor(next_vertex_);
    if (!store_->is_root(next_vertex_))
      for (const SplitFace& face : store_->faces(next_vertex_))
        NEARMESH_RETURN_IF_ERROR(check_face(face));
    next_vertex_ = {mesh_->current_node(next_vertex_).end()};
    if (next_vertex_.value < store_->vertex_count()) continue;
    next_vertex_ = {0};
    next_base_face_ = 0;
  }
  return Status::ok();
}

Status RefinedMesh::check_face(const SplitFace& face) const {
  GridBox known;
  std::array<NodeSpan, 3> open;
  std::size_t open_count = 0;
  for (const VertexId corner : face.corners()) {
    if (mesh_->is_active(corner)) known.add(store_->position(corner));
    if (!mesh_->is_resolved(corner))
      open[open_count++] = mesh_->current_node(mesh_->active_predecessor(corner));
  }
  for (std::size_t i = 0; i < open_count; ++i) {
    if (!store_->encloses(open[i], known))
      return {StatusCode::kCorrupt, to_string(open[i]) + ": a face of its lies outside its box"};
    for (const HalfSpace& half_space : mesh_->half_spaces().of(open[i].first))
      for (const VertexId corner : face.corners())
        if (mesh_->is_active(corner) &&
            !contains(half_space, store_->position(open[i].first), store_->position(corner)))
          return outside_half_space(open[i], half_space);
  }
  return Status::ok();
}

Status RefinedMesh::unpark(const SplitRecord& parent, RefineDelta& delta) {
  // Whatever waited for this record's children can go in now; and for theirs.
  std::vector<NodeSpan> waiting{parent.left(), parent.right()};
  while (!waiting.empty()) {
    const NodeSpan node = waiting.back();
    waiting.pop_back();
    const auto at = parked_.find(key(node));
    if (at == parked_.end() || !store_->is_node(node)) continue;
    const Parked parked = std::move(at->second);
    parked_.erase(at);
    NEARMESH_RETURN_IF_ERROR(insert(parked.record, parked.faces, parked.teller, delta));
    waiting.push_back(parked.record.left());
    waiting.push_back(parked.record.right());
  }
  return Status::ok();
}

RefineDelta RefinedMesh::collapse(NodeSpan node) {
  RefineDelta delta;
  mesh_->collapse(node, delta);
  return delta;
}

void RefinedMesh::forget(NodeSpan node) {
  NEARMESH_ASSERT(mesh_->is_current(node));
  std::vector<VertexId> below;
  std::vector<NodeSpan> stack{node};
  while (!stack.empty()) {
    const NodeSpan top = stack.back();
    stack.pop_back();
    if (top.size < 2) continue;
    const VertexId split = store_->split_of(top);
    if (!split.is_valid()) continue;
    below.push_back(split);
    stack.push_back(top.left_of(split));
    stack.push_back(top.right_of(split));
  }
  for (; !below.empty(); below.pop_back()) store_->erase(below.back());
}

}  // namespace nearmesh
