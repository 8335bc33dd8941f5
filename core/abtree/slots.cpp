// SPDX-License-Identifier: Apache-2.0
// The part of AbTree that follows slots: which of a slot's faces are exact, and the micro tree over
// them. A picture of one slot, and who watches whom, stand at the top of ab_tree.cpp.
// A slot watches as clauses of a SAT solver watch literals (Moskewicz et al. 2001, Chaff): a face
// that is not exact yet is woken by one of its missing corners only, an exact one by any that it
// may lose.

#include <algorithm>
#include <bit>
#include <cstdlib>
#include <utility>

#include "build.hpp"
#include "core/geometry/box_points.hpp"
#include "nearmesh/core/abtree/detail/ab_tree.hpp"

namespace nearmesh {

static_assert(kSlotSize == 64, "a slot's vertices are the bits of a word");

// A tip that is no slot has nothing exact; what becomes of its faces its own splits tell.
void AbTree::look_at(std::uint32_t index) {
  Tip& tip = tips_[index];
  const bool changed = tip.changed;
  tip.changed = false;
  if (tip.is_slot()) {
    fetch_micro_tree(tip.place);
    find_exact_faces(index);
    // Not marked as changed, it was woken by a corner that has come: then faces were only gained,
    // and their number tells.
    if (changed || exact_count_ != tip.exact_count) build_micro_tree(index);
    return;
  }
  TreeEntry unresolved;
  unresolved.box = mesh_->store().box(tip.node);
  unresolved.slab = slab_of(tip.node, unresolved.box);
  unresolved.set(TreeEntry::Kind::kUnresolved, tip.node.begin(), tip.node.size);
  set_entry(tip.place, unresolved);
}

// A lane has one slab: of the node's half-spaces the one that cuts most off its box, and the box on
// the other side.
Slab AbTree::slab_of(NodeSpan node, const GridBox& box) const {
  Slab slab;
  std::int64_t most = 0;
  const GridPoint& from = mesh_->store().position(node.first);
  for (const HalfSpace& half_space : mesh_->half_spaces().of(node.first)) {
    const std::array<std::int8_t, 3>& normal = half_space_normal(half_space.direction);
    // In halves of grid units, so that the box's centre is whole. All is below 2^43: exact.
    std::int64_t support = 0, way = 0;
    for (int k = 0; k < 3; ++k) {
      const auto n = std::int64_t{normal[static_cast<std::size_t>(k)]};
      support += std::abs(n) * (std::int64_t{box.hi[k]} - box.lo[k]);
      way += n * (2 * std::int64_t{from[k]} - (std::int64_t{box.lo[k]} + box.hi[k]));
    }
    const std::int64_t to = way + 2 * half_space_reach(half_space.reach);
    if (support - to <= most) continue;
    most = support - to;
    slab.normal = normal;
    slab.from = rounded_down(-0.5 * static_cast<double>(support));
    slab.to = -rounded_down(-0.5 * static_cast<double>(to));
  }
  return slab;
}

// Who has the corners elsewhere shall tell this slot when one of them changes.
void AbTree::watch_corners(std::uint32_t watcher) {
  // Looked up before any is watched, so that none waits for another to come from memory.
  tips_elsewhere_.resize(std::max(tips_elsewhere_.size(), elsewhere_count_));
  for (std::size_t i = 0; i < elsewhere_count_; ++i) {
    const VertexId corner = corners_elsewhere_[i];
    tips_elsewhere_[i] = tip_of(mesh_->active_predecessor(corner));
    __builtin_prefetch(&tips_[tips_elsewhere_[i]].watchers);
    mesh_->store().prefetch(corner);
  }
  std::uint32_t tip = kNone;
  VertexBits bits = 0;
  for (std::size_t i = 0; i < elsewhere_count_; ++i) {
    // Neighbouring faces have the same neighbours.
    const std::uint32_t next = tips_elsewhere_[i];
    if (next != tip && bits != 0) watch(tip, watcher, std::exchange(bits, 0));
    tip = next;
    bits |= bit_of(corners_elsewhere_[i]);
  }
  if (bits != 0) watch(tip, watcher, bits);
}

void AbTree::watch(std::uint32_t tip, std::uint32_t watcher, VertexBits corners) {
  std::vector<Watch>& watchers = tips_[tip].watchers;
  // From the latest on, who is likely to watch more.
  for (std::size_t i = watchers.size(); i-- > 0;)
    if (watchers[i].tip == watcher) {
      watchers[i].corners |= corners;
      std::swap(watchers[i], watchers.back());
      return;
    }
  watchers.push_back({watcher, corners});
}

// Which of a slot's vertices are active, and which of these are vertices of the full mesh: bits
// from its first vertex.
AbTree::SlotBits AbTree::bits_of(NodeSpan slot) const {
  const std::uint64_t active =
      mesh_->active_bits(slot.first) & ~std::uint64_t{0} >> (64 - slot.size);
  return {active, active & mesh_->active_bits({slot.begin() + 1})};
}

// By key, so that the tree does not depend on the order of arrival. A face's home is its right
// corner's slot: while that or another corner in the slot is missing there is nothing to wait for
// elsewhere.
void AbTree::find_exact_faces(std::uint32_t index) {
  const NodeSpan slot = tips_[index].node;
  const SlotBits bits = bits_of(slot);
  exact_count_ = elsewhere_count_ = 0;
  if (bits.resolved == 0) return;
  find_inherited_faces(index, bits);
  const std::size_t inherited = exact_count_;
  find_own_faces(slot, bits);
  watch_corners(index);
  // Splits above a slot are no later than its first vertex; base faces, of no split, are last.
  const auto first = exact_faces_.begin();
  const auto own = first + static_cast<std::ptrdiff_t>(inherited);
  const auto base =
      std::find_if(first, own, [](const ExactFace& face) { return !face.key.split.is_valid(); });
  std::rotate(base, own, first + static_cast<std::ptrdiff_t>(exact_count_));
}

// For so many faces more.
void AbTree::make_room(std::size_t faces) {
  const std::size_t exact = exact_count_ + faces, elsewhere = elsewhere_count_ + 2 * faces;
  if (exact_faces_.size() < exact) exact_faces_.resize(2 * exact);
  if (corners_elsewhere_.size() < elsewhere) corners_elsewhere_.resize(2 * elsewhere);
}

// Faces of splits above the slot: two of their corners are elsewhere.
void AbTree::find_inherited_faces(std::uint32_t index, const SlotBits& bits) {
  const Tip& slot = tips_[index];
  make_room(slot.inherited.size());
  for (const FaceKey key : slot.inherited) {
    const SplitFace face = mesh_->store().face(key);
    if ((bits.resolved >> (face.right.value - slot.node.begin()) & 1U) == 0) continue;
    // The one corner to wait for: the left one while it is missing, then the outside one.
    const bool has_left = mesh_->is_resolved(face.left);
    corners_elsewhere_[elsewhere_count_++] = has_left ? face.outside : face.left;
    if (!has_left || !mesh_->is_resolved(face.outside)) continue;
    corners_elsewhere_[elsewhere_count_++] = face.left;
    exact_faces_[exact_count_++] = {key, FaceCorners(face.corners())};
  }
  std::sort(exact_faces_.begin(), exact_faces_.begin() + static_cast<std::ptrdiff_t>(exact_count_),
            [](const ExactFace& x, const ExactFace& y) { return x.key < y.key; });
}

// Faces of the slot's own splits: only their outside corner may be elsewhere. Which are exact is
// hard to foretell, and so is how many a split has: two are put down for each, and counted where
// they are there and exact.
void AbTree::find_own_faces(NodeSpan slot, const SlotBits& bits) {
  const ActiveMesh& mesh = *mesh_;
  const SplitStore& store = mesh.store();
  ExactFace* exact = nullptr;
  VertexId* elsewhere = nullptr;
  const auto make_room_for = [&](std::size_t many) {
    make_room(2 * kSlotSize + many);
    exact = exact_faces_.data() + exact_count_;
    elsewhere = corners_elsewhere_.data() + elsewhere_count_;
  };
  const auto count = [&] {
    exact_count_ = static_cast<std::size_t>(exact - exact_faces_.data());
    elsewhere_count_ = static_cast<std::size_t>(elsewhere - corners_elsewhere_.data());
  };
  const auto put_down = [&](FaceKey key, const FaceCorners& face) {
    const std::uint64_t is_here = bits.resolved >> (face.first.value - slot.begin()) % 64 &
                                  bits.resolved >> (face.second.value - slot.begin()) % 64 &
                                  static_cast<std::uint64_t>(face.is_there());
    *exact = {key, face};
    exact += is_here & static_cast<std::uint64_t>(mesh.is_resolved(face.outside));
    *elsewhere = face.outside;
    elsewhere += is_here & static_cast<std::uint64_t>(!slot.contains(face.outside));
  };
  make_room_for(0);
  // Without the lowest: the slot's first vertex came with a split above, whose faces are inherited.
  for (std::uint64_t left = bits.active & (bits.active - 1); left != 0; left &= left - 1) {
    const VertexId v{slot.begin() + static_cast<std::uint32_t>(std::countr_zero(left))};
    if (const FaceCorners* two = store.two_faces(v)) {
      put_down({v, 0}, two[0]);
      put_down({v, 1}, two[1]);
      continue;
    }
    const SplitFaces faces = store.faces(v);
    count();
    make_room_for(faces.size());
    for (std::uint32_t i = 0; i < faces.size(); ++i)
      put_down({v, i}, FaceCorners(faces[i].corners()));
  }
  count();
}

// Faces with a corner in the tip, a slot, are to lie in the box of its node.
void AbTree::check_bounds(std::uint32_t tip, const AxesBox& faces) {
  Tip& slot = tips_[tip];
  if (slot.bounds.is_empty()) slot.bounds = mesh_->store().box(slot.node);
  if (!AxesBox(slot.bounds).contains(faces)) contradiction_ = slot.node;
}

void AbTree::build_micro_tree(std::uint32_t index) {
  const SplitStore& store = mesh_->store();
  Tip& slot = tips_[index];
  builder_->clear();
  FaceBlock* blocks = builder_->add_faces(exact_count_);
  AxesBox around;
  for (std::size_t i = 0; i < exact_count_; ++i) {
    FaceBlock& block = blocks[i / kLanes];
    const FaceCorners& face = exact_faces_[i].face;
    const std::array<VertexId, 3> corners{face.first, face.second, face.outside};
    AxesBox box;
    for (std::size_t c = 0; c < 3; ++c) {
      const GridPoint& at = store.position(corners[c]);
      box.add(axes_of(at));
      for (int k = 0; k < 3; ++k) block.triangles.corner[c][k][i % kLanes] = at[k];
    }
    block.keys[i % kLanes] = exact_faces_[i].key;
    around.add(box);
    // Of each corner the node's box was to enclose the face: here all faces at once, elsewhere
    // each.
    for (const VertexId corner : corners)
      if (!slot.node.contains(corner)) check_bounds(tip_of(corner), box);
  }
  check_bounds(index, around);
  const SlotBits bits = bits_of(slot.node);
  for (std::uint64_t left = bits.active & ~bits.resolved; left != 0; left &= left - 1) {
    const auto offset = static_cast<std::uint32_t>(std::countr_zero(left));
    // The node of an active vertex ends where the next active one begins. By two shifts: one by 64
    // is undefined.
    const std::uint64_t after = bits.active >> offset >> 1;
    const std::uint32_t size = after != 0 ? static_cast<std::uint32_t>(std::countr_zero(after)) + 1
                                          : slot.node.size - offset;
    const NodeSpan at{{slot.node.begin() + offset}, size};
    const GridBox box = store.box(at);
    builder_->add_unresolved(at, box, slab_of(at, box));
  }
  free_micro_tree(slot.place);
  const TreeEntry root = builder_->build(arrays_);
  set_entry(slot.place, root);
  if (root.kind() == TreeEntry::Kind::kInner) micro_roots_.push_back(slot.place);
  exact_total_ += exact_count_;
  exact_total_ -= slot.exact_count;
  slot.exact_count = static_cast<std::uint32_t>(exact_count_);
  ++rebuilt_slots_;
  rebuilt_faces_ += exact_count_;
}

}  // namespace nearmesh
