// SPDX-License-Identifier: Apache-2.0
#include "mirror.hpp"

#include <algorithm>
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
  while (at != entries_.end() && (at->peer != peer || at->file != &file)) ++at;
  if (at != entries_.end() && at->state() == state && at->wake()) {
    entries_.splice(entries_.begin(), entries_, at);
    make_room();
    return entries_.front().mirror;
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
  entries_.push_front({.peer = peer, .file = &file, .mirror = mirror, .held = {}});
  make_room();
  return mirror;
}

void Mirrors::forget(std::uint64_t peer) {
  entries_.remove_if([peer](const Entry& entry) { return entry.peer == peer; });
}

void Mirrors::Entry::sleep() {
  asleep_state = mirror->state();
  asleep_splits = mirror->model().mesh.split_count();
  held = held_nodes(mirror->model().mesh).bits;
  held.shrink_to_fit();
  mirror.reset();
}

/// False where what was kept does not give the same again: its peer is to say what it holds.
bool Mirrors::Entry::wake() {
  if (mirror) return true;
  auto anew = std::make_shared<Mirror>(*file);
  if (!anew->hold(held).is_ok() || anew->state() != asleep_state) return false;
  mirror = std::move(anew);
  held = {};
  return true;
}

void Mirrors::make_room() {
  std::size_t splits = 0, count = 0, awake = 0;
  for (auto at = entries_.begin(); at != entries_.end();) {
    splits += at->splits();
    if (++count > 1 && (splits > kMaxSplits || count > kMaxMirrors)) {
      at = entries_.erase(at);
      continue;
    }
    if (at->mirror) awake += at->splits() + kSplitsAMirror;
    if (count > 1 && awake > kMaxAwakeSplits && at->mirror && at->mirror.use_count() == 1)
      at->sleep();
    ++at;
  }
}

std::size_t Mirrors::awake_count() const {
  return static_cast<std::size_t>(
      std::count_if(entries_.begin(), entries_.end(),
                    [](const Entry& entry) { return entry.mirror != nullptr; }));
}

std::size_t Mirrors::asleep_bytes() const {
  std::size_t bytes = 0;
  for (const Entry& entry : entries_)
    if (!entry.mirror) bytes += sizeof(Entry) + entry.held.capacity();
  return bytes;
}

}  // namespace nearmesh
