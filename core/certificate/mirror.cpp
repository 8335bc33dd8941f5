// SPDX-License-Identifier: Apache-2.0
#include "mirror.hpp"

#include <algorithm>
#include <string>
#include <utility>

namespace nearmesh {

Mirror::Mirror(std::shared_ptr<ModelFile> file)
    : file_(std::move(file)), model_(file_->store(), file_->header().grid) {}

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

MirrorMaker::MirrorMaker(std::shared_ptr<ModelFile> file, std::vector<std::uint8_t> held,
                         std::size_t most)
    : mirror_(std::make_shared<Mirror>(std::move(file))),
      walk_(
          mirror_->file().store(),
          [this](NodeSpan node) -> Status {
            if (++told_splits_ > most_)
              return {StatusCode::kUnsupported, mirror_->file().path() + ": more than " +
                                                    std::to_string(most_) +
                                                    " splits are said to be held"};
            return mirror_->file().require(node);
          },
          std::move(held)),
      most_(most) {}

Result<std::shared_ptr<Mirror>> MirrorMaker::next(std::size_t nodes) {
  LocalModel& model = mirror_->model();
  RefineDelta delta;
  while (nodes > 0) {
    const Result<const HeldWalk::Node*> next = walk_.next();
    NEARMESH_RETURN_IF_ERROR(next);
    if (next.value() == nullptr) {
      model.tree.update(delta);
      return std::move(mirror_);
    }
    const HeldWalk::Node& held = *next.value();
    for (const HalfSpace& half_space : held.half_spaces)
      static_cast<void>(model.mesh.add_half_space(held.node, half_space, delta));
    told_of_ += held.half_spaces.empty() ? 0 : 1;
    if (held.split.is_valid())
      static_cast<void>(model.mesh.split(held.split, delta));  // parents come first
    nodes -= held.split.is_valid() || !held.half_spaces.empty() ? 1 : 0;
  }
  model.tree.update(delta);
  return std::shared_ptr<Mirror>();
}

Result<std::shared_ptr<Mirror>> make_mirror(std::shared_ptr<ModelFile> file,
                                            std::vector<std::uint8_t> held, std::size_t most) {
  return MirrorMaker(std::move(file), std::move(held), most).next(~std::size_t{0});
}

Mirrors::Found Mirrors::find(std::uint64_t peer, const std::shared_ptr<ModelFile>& file,
                             std::uint64_t state) {
  Found found;
  if (const auto known = by_peer_.find({peer, file->content_hash()}); known != by_peer_.end()) {
    const auto at = known->second;
    if (at->state() == state && at->mirror) {
      entries_.splice(entries_.begin(), entries_, at);
      make_room();
      found.mirror = entries_.front().mirror;
      return found;
    }
    if (at->state() == state) found.held = std::move(at->held);
    erase(at);
    if (!found.held.empty()) return found;
  }
  // Who holds nothing need not say so.
  auto fresh = std::make_shared<Mirror>(file);
  if (fresh->state() != state) return found;
  keep(peer, fresh);
  found.mirror = std::move(fresh);
  return found;
}

bool Mirrors::is_asleep(std::uint64_t peer, const ContentHash& content) const {
  const auto known = by_peer_.find({peer, content});
  return known != by_peer_.end() && !known->second->mirror;
}

void Mirrors::keep(std::uint64_t peer, std::shared_ptr<Mirror> mirror) {
  const ContentHash content = mirror->file().content_hash();
  const auto [known, is_new] = by_peer_.try_emplace({peer, content});
  if (!is_new) entries_.erase(known->second);
  entries_.push_front({.peer = peer, .content = content, .mirror = std::move(mirror), .held = {}});
  known->second = entries_.begin();
  make_room();
}

Mirrors::Entries::iterator Mirrors::erase(Entries::iterator entry) {
  by_peer_.erase({entry->peer, entry->content});
  return entries_.erase(entry);
}

void Mirrors::forget(std::uint64_t peer) {
  for (auto at = by_peer_.lower_bound({peer, ContentHash{}});
       at != by_peer_.end() && at->first.first == peer; at = by_peer_.erase(at))
    entries_.erase(at->second);
}

void Mirrors::sleep(const ContentHash& content) {
  for (Entry& entry : entries_)
    if (entry.content == content && entry.mirror && entry.mirror.use_count() == 1) entry.sleep();
}

void Mirrors::Entry::sleep() {
  asleep_state = mirror->state();
  asleep_splits = mirror->model().mesh.split_count();
  held = held_nodes(mirror->model().mesh).bits;
  held.shrink_to_fit();
  mirror.reset();
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

/// Not the one used last. Of the others those that were longest without use go, or sleep; first of
/// peers beyond their share. What the one used last has beyond its peer's share is no reason for
/// others to go.
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
        at = erase(at);
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
