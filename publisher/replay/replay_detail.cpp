// SPDX-License-Identifier: Apache-2.0
#include "replay_detail.hpp"

#include <algorithm>

#include "core/demand/answer.hpp"

namespace nearmesh::publisher {

RecordedDetail::RecordedDetail(SpmHeader header)
    : all_(std::move(header)), delivered_(all_.header().vertex_count) {
  rewind(0);
}

void RecordedDetail::rewind(std::int64_t end) {
  now_ = std::make_unique<SplitStore>(all_.header());
  end_ = end;
}

Status RecordedDetail::add(std::int64_t id, std::span<const std::uint8_t> batch) {
  if (is_audit_piece(batch)) return Status::ok();  // nothing but what was sent before
  const Result<SplitBatch> decoded = decode_sealed(all_.header(), batch);
  NEARMESH_RETURN_IF_ERROR(decoded);
  const RefinedMesh::Applied applied = all_.apply_batch(decoded.value());
  for (const VertexId split : applied.delta.split) delivered_[split.value] = id;
  if (applied.status.is_ok())
    for (const NodeHalfSpace& told : decoded.value().half_spaces)
      told_[told.node].push_back({id, told.half_space});
  return applied.status;
}

Status RecordedDetail::require(NodeSpan node) {
  if (node.size < 2 || now_->split_of(node).is_valid()) return Status::ok();
  const SplitStore& store = all_.store();
  const VertexId split = store.split_of(node);
  if (!split.is_valid() || delivered_[split.value] >= end_) return Status::ok();
  SplitRecord record{.node = node, .split = split};
  const GridPoint &from = store.position(node.first), &to = store.position(split);
  for (int k = 0; k < 3; ++k) record.offset[k] = to[k] - from[k];
  record.left_box = store.box_code(record.left());
  record.right_box = store.box_code(record.right());
  return now_->insert(record, store.faces(split).span()).status();
}

/// From the root down; false when the node was not known.
bool RecordedDetail::reach(NodeSpan target) {
  NodeSpan node = now_->roots()[now_->root_index(target.first)].node;
  while (node.size > target.size && require(node).is_ok()) {
    const VertexId split = now_->split_of(node);
    if (!split.is_valid()) return false;
    node = target.first < split ? node.left_of(split) : node.right_of(split);
  }
  return node == target;
}

std::span<const HalfSpace> RecordedDetail::half_spaces_of(NodeSpan node) {
  told_by_then_.clear();
  if (const auto at = told_.find(node); at != told_.end())
    for (const Told& told : at->second)
      if (told.id < end_) static_cast<void>(add_half_space(told.half_space, told_by_then_));
  return told_by_then_;
}

Result<std::vector<std::vector<std::uint8_t>>> RecordedDetail::answer(const RegionRequest& request,
                                                                      std::int64_t end) {
  NEARMESH_RETURN_IF_ERROR(check_request(*now_, request));
  if (end < end_) rewind(end);
  end_ = end;
  RegionRequest known = request;
  std::erase_if(known.attach, [this](NodeSpan node) { return !reach(node); });
  return answer_request(
      all_.header(), *now_, known, [this](NodeSpan node) { return require(node); },
      [this](NodeSpan node) { return half_spaces_of(node); });
}

}  // namespace nearmesh::publisher
