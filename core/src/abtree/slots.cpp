// SPDX-License-Identifier: Apache-2.0
// The part of AbTree that follows slots: which of a slot's faces are exact, and the micro tree over them.
// A slot watches as clauses of a SAT solver watch literals (Moskewicz et al. 2001, Chaff): a face that is not exact yet is
// woken by one of its missing corners only, an exact one by any that it may lose.

#include <algorithm>
#include <bit>
#include <initializer_list>

#include "build.hpp"
#include "nearmesh/core/abtree/ab_tree.hpp"

namespace nearmesh {

static_assert(kSlotSize == 64, "a slot's vertices are the bits of a word");

// A leaf that is no slot has nothing exact; what becomes of its faces its own splits tell.
void AbTree::look_at(std::uint32_t index) {
  Leaf& leaf = leaves_[index];
  const bool changed = leaf.changed;
  leaf.changed = false;
  if (leaf.is_slot()) {
    find_exact_faces(index);
    if (changed || exact_faces_.size() != leaf.exact_count) build_micro_tree(index);
    return;
  }
  TreeEntry frontier;
  frontier.box = mesh_->store().box(leaf.node);
  frontier.set(TreeEntry::Kind::kFrontier, leaf.node.begin(), leaf.node.size);
  set_entry(leaf.place, frontier);
}

void AbTree::watch(std::uint32_t leaf, std::uint32_t watcher, VertexId corner) {
  std::vector<Watch>& watchers = leaves_[leaf].watchers;
  // Neighbouring faces have the same neighbours: the latest is looked for first.
  if (watchers.empty() || watchers.back().leaf != watcher) {
    const auto found = std::find_if(watchers.begin(), watchers.end(),
                                    [&](const Watch& watch) { return watch.leaf == watcher; });
    if (found == watchers.end()) {
      watchers.push_back({watcher, 0});
    } else {
      std::swap(*found, watchers.back());
    }
  }
  watchers.back().corners |= bit_of(corner);
}

// Which of a slot's vertices are active, and which of these are vertices of the full mesh: bits from its first vertex.
AbTree::SlotBits AbTree::bits_of(NodeSpan slot) const {
  const std::uint64_t active = mesh_->active_bits(slot.first) & ~std::uint64_t{0} >> (64 - slot.size);
  return {active, active & mesh_->active_bits({slot.begin() + 1})};
}

// Whether a face of the slot with these corners elsewhere is exact, and whom to watch. Its other corners are leaves.
bool AbTree::is_exact_elsewhere(std::uint32_t slot, std::initializer_list<VertexId> corners) {
  for (const VertexId corner : corners)
    if (!mesh_->is_leaf(corner)) {
      watch(leaf_of(mesh_->active_predecessor(corner)), slot, corner);
      return false;
    }
  for (const VertexId corner : corners) watch(leaf_of(corner), slot, corner);
  return true;
}

// By key, so that the tree does not depend on the order of arrival. A face's home is its right corner's slot: while that
// or another corner in the slot is missing there is nothing to wait for elsewhere.
void AbTree::find_exact_faces(std::uint32_t index) {
  const SplitStore& store = mesh_->store();
  const NodeSpan node = leaves_[index].node;
  const SlotBits bits = bits_of(node);
  exact_faces_.clear();
  if (bits.leaves == 0) return;
  const auto lacks = [&](VertexId v) { return (bits.leaves >> (v.value - node.begin()) & 1U) == 0; };

  for (const FaceKey key : leaves_[index].inherited) {
    const SplitFace face = store.face(key);  // of a split above the slot: two corners are elsewhere
    if (!lacks(face.right) && is_exact_elsewhere(index, {face.left, face.outside}))
      exact_faces_.push_back({key, face.corners()});
  }
  const auto by_key = [](const ExactFace& x, const ExactFace& y) { return x.key < y.key; };
  std::sort(exact_faces_.begin(), exact_faces_.end(), by_key);
  const auto inherited = static_cast<std::ptrdiff_t>(exact_faces_.size());

  for (std::uint64_t left = bits.active & (bits.active - 1); left != 0; left &= left - 1) {
    const VertexId v{node.begin() + static_cast<std::uint32_t>(std::countr_zero(left))};
    const std::span<const SplitFace> faces = store.faces(v);
    for (std::uint32_t i = 0; i < faces.size(); ++i) {
      const SplitFace& face = faces[i];
      if (lacks(face.left) || lacks(face.right)) continue;  // both lie in the slot
      if (node.contains(face.outside) ? lacks(face.outside)
                                      : !is_exact_elsewhere(index, {face.outside}))
        continue;
      exact_faces_.push_back({{v, i}, face.corners()});
    }
  }
  std::inplace_merge(exact_faces_.begin(), exact_faces_.begin() + inherited, exact_faces_.end(),
                     by_key);
}

void AbTree::build_micro_tree(std::uint32_t index) {
  const SplitStore& store = mesh_->store();
  Leaf& slot = leaves_[index];
  builder_->clear();
  for (const ExactFace& face : exact_faces_)
    builder_->add_face(face.key,
                       {store.position(face.corners[0]), store.position(face.corners[1]),
                        store.position(face.corners[2])});
  const SlotBits bits = bits_of(slot.node);
  for (std::uint64_t left = bits.active & ~bits.leaves; left != 0; left &= left - 1) {
    const NodeSpan at = mesh_->current_node(
        {slot.node.begin() + static_cast<std::uint32_t>(std::countr_zero(left))});
    builder_->add_frontier(at, store.box(at));
  }
  free_micro_tree(slot.place);
  set_entry(slot.place, builder_->build(arrays_));
  exact_total_ += exact_faces_.size();
  exact_total_ -= slot.exact_count;
  slot.exact_count = static_cast<std::uint32_t>(exact_faces_.size());
  ++rebuilt_slots_;
  rebuilt_faces_ += exact_faces_.size();
}

}  // namespace nearmesh
