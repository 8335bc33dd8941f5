// SPDX-License-Identifier: Apache-2.0
#include "refined_mesh.hpp"

#include <algorithm>

namespace nearmesh {

RefinedMesh::RefinedMesh(SpmHeader header)
    : header_(std::move(header)),
      store_(std::make_unique<SplitStore>(header_)),
      mesh_(std::make_unique<ActiveMesh>(*store_)) {}

Status RefinedMesh::insert(const SplitRecord& record, std::span<const SplitFace> faces,
                           RefineDelta& delta) {
  const Result<SplitStore::Insertion> inserted = store_->insert(record, faces);
  NEARMESH_RETURN_IF_ERROR(inserted);
  if (inserted.value() == SplitStore::Insertion::kNoParent) {
    park(record, faces);
    return Status::ok();
  }
  if (inserted.value() == SplitStore::Insertion::kBoxed) delta.boxed.push_back(record.split);
  const bool done = mesh_->split(record.split, delta);
  NEARMESH_ASSERT(done);
  static_cast<void>(done);
  return Status::ok();
}

void RefinedMesh::park(const SplitRecord& record, std::span<const SplitFace> faces) {
  const auto at = parked_.find(key(record.node));
  if (at == parked_.end()) {
    if (parked_.size() < kMaxParked)
      parked_.emplace(key(record.node), Parked{record, {faces.begin(), faces.end()}});
    return;
  }
  // A repeat, from another batch, may carry boxes that the first did not.
  SplitRecord& first = at->second.record;
  if (first.split != record.split) return;
  if (first.left_box == kNoBox) first.left_box = record.left_box;
  if (first.right_box == kNoBox) first.right_box = record.right_box;
}

RefinedMesh::Applied RefinedMesh::apply_batch(const SplitBatch& batch) {
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
    applied.status =
        insert(record, {batch.faces.data() + record.face_begin, record.face_count}, applied.delta);
    if (applied.status.is_ok() && !parked_.empty()) applied.status = unpark(record, applied.delta);
    if (!applied.status.is_ok()) break;
  }
  return applied;
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
    NEARMESH_RETURN_IF_ERROR(insert(parked.record, parked.faces, delta));
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
