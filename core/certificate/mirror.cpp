// SPDX-License-Identifier: Apache-2.0
#include "mirror.hpp"

#include <string>

#include "core/replica/held_nodes.hpp"

namespace nearmesh {

Mirror::Mirror(ModelFile& file) : file_(&file), model_(file.store(), file.header().grid) {}

Result<std::vector<VertexId>> Mirror::split(std::span<const NodeSpan> nodes) {
  RefineDelta delta;
  for (const NodeSpan& node : nodes) {
    NEARMESH_RETURN_IF_ERROR(file_->require(node));
    const VertexId split = file_->store().split_of(node);
    if (!split.is_valid() || !model_.mesh.split(split, delta))
      return Status{StatusCode::kCorrupt, file_->path() + ": " + to_string(node) + " has no split"};
  }
  model_.tree.update(delta);
  return std::move(delta.split);
}

Status Mirror::hold(std::span<const std::uint8_t> held, std::size_t most) {
  std::size_t count = 0;
  const auto require = [&](NodeSpan node) -> Status {
    if (++count > most)
      return {StatusCode::kUnsupported, file_->path() + ": more than " + std::to_string(most) +
                                            " splits are said to be held"};
    return file_->require(node);
  };
  const Result<SplitBatch> batch = held_batch(file_->store(), require, held);
  NEARMESH_RETURN_IF_ERROR(batch);
  RefineDelta delta;
  for (const SplitRecord& record : batch.value().splits)
    static_cast<void>(model_.mesh.split(record.split, delta));  // parents come first
  for (const NodeHalfSpace& told : batch.value().half_spaces)
    static_cast<void>(model_.mesh.add_half_space(told.node, told.half_space, delta));
  model_.tree.update(delta);
  return Status::ok();
}

Result<std::shared_ptr<Mirror>> Mirrors::find(std::uint64_t peer, ModelFile& file,
                                              std::uint64_t state,
                                              std::span<const std::uint8_t> held) {
  auto at = entries_.begin();
  while (at != entries_.end() && (at->peer != peer || &at->mirror->file() != &file)) ++at;
  if (at != entries_.end() && at->mirror->state() == state) {
    entries_.splice(entries_.begin(), entries_, at);
    return at->mirror;
  }
  if (at != entries_.end()) entries_.erase(at);
  auto mirror = std::make_shared<Mirror>(file);
  if (mirror->state() != state) {
    if (held.empty()) return std::shared_ptr<Mirror>();
    NEARMESH_RETURN_IF_ERROR(mirror->hold(held));
    if (mirror->state() != state)
      return Status{StatusCode::kConflict, "what is held of content " +
                                               to_hex(file.content_hash()) +
                                               " is not the state that is said to be held"};
  }
  entries_.push_front({peer, mirror});
  make_room();
  return mirror;
}

void Mirrors::forget(std::uint64_t peer) {
  entries_.remove_if([peer](const Entry& entry) { return entry.peer == peer; });
}

void Mirrors::make_room() {
  std::size_t splits = 0, count = 0;
  for (auto at = entries_.begin(); at != entries_.end();) {
    splits += at->mirror->model().mesh.split_count();
    const bool stays = ++count == 1 || (splits <= kMaxSplits && count <= kMaxMirrors);
    at = stays ? std::next(at) : entries_.erase(at);
  }
}

}  // namespace nearmesh
