// SPDX-License-Identifier: Apache-2.0
#include "mirror.hpp"

#include <algorithm>
#include <map>
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
  const std::size_t before = told_splits_;
  const auto require = [&](NodeSpan node) -> Status {
    if (++told_splits_ - before > most)
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
    const Status took = mirror->hold(held);
    told_splits_ += mirror->told_splits();
    NEARMESH_RETURN_IF_ERROR(took);
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
  make_room(
      kMaxSplits, [](const Entry& entry) { return entry.splits(); }, false);
  make_room(
      kMaxMirrors, [](const Entry&) { return std::size_t{1}; }, false);
  make_room(
      kMaxAwakeSplits,
      [](const Entry& entry) {
        return entry.mirror ? entry.splits() + kSplitsAMirror : std::size_t{0};
      },
      true);
}

/// Not the one used last. Of the others those that were longest without use go, or sleep; first of peers beyond their share. What the
/// one used last has beyond its peer's share is no reason for others to go.
template <class Size>
void Mirrors::make_room(std::size_t most, Size size, bool may_sleep) {
  std::size_t all = 0;
  for (const Entry& entry : entries_) all += size(entry);
  if (all <= most) return;
  const std::size_t share = most / kShares;
  std::map<std::uint64_t, std::size_t> of_peer;
  for (const Entry& entry : entries_) of_peer[entry.peer] += size(entry);
  const auto take_back = [&](bool is_of_greedy) {
    for (auto at = entries_.end(); all > most && at != std::next(entries_.begin());) {
      --at;
      const std::size_t its = size(*at);
      std::size_t& its_peers = of_peer[at->peer];
      const bool is_greedy = its_peers > share;
      if (its == 0 || is_greedy != is_of_greedy) continue;
      const bool sleeps = may_sleep && !is_greedy;
      if (sleeps && at->mirror.use_count() > 1) continue;
      all -= its;
      its_peers -= its;
      if (sleeps) {
        at->sleep();
      } else {
        at = entries_.erase(at);
      }
    }
  };
  take_back(true);
  all -= std::max(of_peer[entries_.front().peer], share) - share;
  take_back(false);
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
