// SPDX-License-Identifier: Apache-2.0
// How the tree follows a mesh that is refined here and made coarse there. (Slots from the inside:
// slots.cpp; what is above them: upper_tree.cpp.)
//
// 1. What hangs where. Take a model of two roots, [0..999] and [1000..1003], of which a good part
//    is refined:
//
//      node 0, lane 0
//      the fixed tree over the roots             made once, by the constructor: a tip for each root
//         |                      |
//      [0..999]               [1000..1003]       a tip, and a slot since it has at most 64 vertices
//         |
//      upper node of [0..999]
//        lane 0     lane 1      lane 2 ...  lane 7
//        [0..59]    [60..203]   [204..297]   [898..999]
//        slot       not split   upper node   not split
//         |                      |
//      micro tree               its lanes: what became of [204..297]
//
//    The lanes of an upper node are what became of its vertices, by first vertex, without gaps: the
//    largest is opened again and again until there are eight. What is not split and has more than
//    64 vertices is an unresolved node with its box.
//
//    A *tip* is where the upper tree ends: a slot, or a larger node that is not split. Tips share
//    out all vertices. tip_of_ finds the tip of an active vertex, Upper::first_vertices the way
//    back from a lane.
//
// 2. One slot from the inside. [128..191], where the splits 129, 130 and 134 are done:
//
//      vertex      128 129 130 131 132 133 134 135 ... 191
//      active       1   1   1   0   0   0   1   0  ...  0
//      resolved     1   1   0   0   0   0   0   0  ...  0     active, and so is the next
//      node        [ ] [ ] [130 ..... 133] [134 .......191]   the last two are unresolved
//
//      micro tree   one node of four lanes, say:
//                   8 exact faces | 5 exact faces | [130..133] | [134..191]
//
//    It holds those exact faces whose *home* is here, and the unresolved nodes with their boxes.
//    The home of a face is the tip that has its right corner (SplitFace), so each face has one.
//    Faces of the slot's own splits are found through the store. Faces of splits above stand in
//    `inherited` of the tip that is their home; when a tip is split, they go with their right
//    corner.
//
// 3. Who watches whom. A face may have corners in other tips, and becomes exact when the last of
//    its three is resolved. Its slot must hear of that. It would cost much to tell every slot
//    around of every split, so a face names *one* corner that it waits for, as clauses of a SAT
//    solver watch one literal: while that is missing the others do not matter. An exact face names
//    all its corners elsewhere: a collapse may take any of them. "Slot 7 watches corners 3 and 5 of
//    mine" stands in `watchers` of the tip that has these corners.
//
// 4. When a slot is rebuilt. A split or collapse in it, or a box of one of its nodes that comes
//    late, marks it `changed`. A corner that it watches only queues it: it counts its exact faces
//    again and is rebuilt if there are more. (A corner that is lost marks it changed: as many faces
//    may have come as went.) Rebuilt means: its exact faces are collected in the order of their
//    keys and the micro tree is made anew (build.cpp). Some 20 faces take a few microseconds, and
//    no order of arrival leaves a trace.
//
// 5. Bounds above. The lane that a micro tree hangs in gets the box and slab around the tree, and
//    its node is queued. Of a queued node the lane that it hangs in, one node up, is taken anew
//    around all its lanes. Does it come out as it was, the way up ends there; else the node up
//    there is queued too. The deepest node comes first, so each is looked at once, after all that
//    changed below it. What lies far from a change is not read.
//
// The shape follows from what is active, by rule 1, and the content of slots by rule 4. So a tree
// that followed a replica equals one made from scratch, which the tests compare. Places in the
// arrays do depend on history; therefore nothing that a query answers may depend on them.
#include "nearmesh/core/abtree/detail/ab_tree.hpp"

#include <algorithm>
#include <bit>
#include <memory>
#include <utility>

#include "build.hpp"
#include "core/base/float_guard.hpp"

namespace nearmesh {
namespace {

using Kind = TreeEntry::Kind;

constexpr std::size_t kFirstTips = 256;

/// Tells the processor that all of it will be read or written soon.
template <class T>
void fetch(const T* what) {
  const char* at = reinterpret_cast<const char*>(what);
  for (std::size_t i = 0; i < sizeof(T); i += 64) __builtin_prefetch(at + i, 1);
}

}  // namespace

AbTree::AbTree(const ActiveMesh& mesh)
    : mesh_(&mesh),
      tip_of_(mesh.store().vertex_count()),
      builder_(std::make_unique<TreeBuilder>()) {
  const FloatGuard guard;
  const SplitStore& store = mesh.store();
  // A fixed tree over the roots; each of its tips then grows with its root's splits.
  builder_->clear();
  for (const BaseRoot& root : store.roots())
    builder_->add_unresolved(root.node, store.box(root.node));
  TreeArrays fixed;
  TreeEntry top = builder_->build(fixed);
  if (top.kind() == Kind::kInner) top = inner_entry(fixed.nodes, top.first);
  root_places_.resize(store.roots().size());
  // Node 0 holds the root of all, so the nodes of the fixed tree come one place later than the
  // builder put them.
  const auto add = [&](std::uint32_t at, std::uint32_t lane, TreeEntry part) {
    if (part.kind() == Kind::kInner) upper(++part.first).parent = at * kLanes + lane;
    arrays_.nodes[at].set(lane, part);
    if (part.kind() != Kind::kUnresolved) return;
    const NodeSpan span = part.unresolved_node();
    const TreePlace place = at * kLanes + lane;
    upper(at).first_vertices[lane] = span.begin();
    root_places_[store.root_index(span.first)] = place;
    set_tip_of(span.first, new_tip(span, place));
  };
  const auto nodes = fixed.nodes.view();
  for (std::size_t i = 0; i <= nodes.size(); ++i) new_upper(kNone, {});
  add(0, 0, top);
  for (std::uint32_t at = 1; at <= nodes.size(); ++at) {  // parents stand before their children
    upper(at).order = upper(upper(at).parent / kLanes).order + 1;
    for (std::uint32_t lane = 0; lane < kLanes; ++lane) add(at, lane, nodes[at - 1].entry(lane));
  }
  // Until its root is split a base face waits there, as the faces of any split above a tip do.
  for (std::uint32_t i = 0; i < store.base_faces().size(); ++i) {
    const VertexId home = store.base_faces()[i].right;
    tips_[tip_of(store.roots()[store.root_index(home)].node.first)].inherited.push_back({{}, i});
  }
  // What is active already is caught up with as if it came now.
  RefineDelta delta;
  for (VertexId v{0}; v.value < store.vertex_count(); v = {mesh.current_node(v).end()})
    if (!store.is_root(v)) delta.split.push_back(v);
  // Parents first: larger nodes before smaller.
  std::sort(delta.split.begin(), delta.split.end(), [&](VertexId a, VertexId b) {
    return std::pair(~store.node_of(a).size, a) < std::pair(~store.node_of(b).size, b);
  });
  for (std::uint32_t tip = 0; tip < tips_.size(); ++tip) mark_changed(tip);
  update(delta);
}

AbTree::AbTree(AbTree&&) noexcept = default;
AbTree& AbTree::operator=(AbTree&&) noexcept = default;
AbTree::~AbTree() = default;

// ---- memory -------------------------------------------------------------------------------------

std::uint32_t AbTree::new_tip(NodeSpan node, TreePlace place) {
  std::uint32_t index;
  if (free_tips_.empty()) {
    index = static_cast<std::uint32_t>(tips_.size());
    // By a quarter, not twofold: they take some 70 bytes each.
    if (tips_.size() == tips_.capacity())
      tips_.reserve(tips_.size() + tips_.size() / 4 + kFirstTips);
    tips_.emplace_back();
  } else {
    index = free_tips_.back();
    free_tips_.pop_back();
  }
  tips_[index].node = node;
  tips_[index].place = place;
  if (tips_[index].is_slot()) ++slot_total_;
  return index;
}

void AbTree::free_tip(std::uint32_t index) {
  Tip& tip = tips_[index];
  if (tip.is_slot()) {
    --slot_total_;
    free_micro_tree(tip.place);
  }
  exact_total_ -= tip.exact_count;
  const bool queued = tip.queued;
  tip = Tip{};          // of size 0, so that nobody looks at it
  tip.queued = queued;  // its place in pending_ stays; a reused tip is simply looked at
  free_tips_.push_back(index);
}

// What free_micro_tree() gives back is what the next tree is written to.
void AbTree::fetch_micro_tree(TreePlace place) {
  const TreeNode& above = arrays_.nodes[place / kLanes];
  if (above.kind(place % kLanes) != Kind::kInner) return;
  const TreeNode& node = arrays_.nodes[above.first[place % kLanes]];
  for (std::uint32_t left = node.lanes; left != 0; left &= left - 1) {
    const auto lane = static_cast<std::uint32_t>(std::countr_zero(left));
    if (node.kind(lane) == Kind::kInner) fetch(&arrays_.nodes[node.first[lane]]);
    if (node.kind(lane) == Kind::kFaces) fetch(&arrays_.blocks[node.first[lane]]);
  }
}

void AbTree::free_micro_tree(TreePlace place) {
  const TreeNode& node = arrays_.nodes[place / kLanes];
  arrays_.free_below(node.kind(place % kLanes), node.first[place % kLanes]);
}

// ---- following ----------------------------------------------------------------------------------

void AbTree::queue(std::uint32_t tip) {
  if (tips_[tip].queued) return;
  tips_[tip].queued = true;
  pending_.push_back(tip);
}

void AbTree::mark_changed(std::uint32_t tip) {
  tips_[tip].changed = true;
  queue(tip);
}

// At these vertices of a tip it changed whether they are vertices of the full mesh. Who waits for
// one looks again, which need not come to anything; where exact faces may be lost their number
// alone would not tell.
void AbTree::tell_watchers(std::uint32_t index, VertexBits corners, bool may_lose) {
  for (const Watch& watch : tips_[index].watchers) {
    if ((watch.corners & corners) == 0) continue;
    tips_[watch.tip].changed |= may_lose;
    queue(watch.tip);
  }
}

// First the shape above slots, and who is to be looked at; then slots; then bounds. Each of the
// three sees all that the one before has done, so a slot with ten new splits is built once.
void AbTree::update(const RefineDelta& delta) {
  const FloatGuard guard;
  rebuilt_slots_ = rebuilt_faces_ = 0;
  contradiction_ = {};
  for (const NodeSpan& node : delta.collapsed) apply_collapse(node);
  constexpr std::size_t kAhead = 8;  // splits: enough for what a split looks up to come from memory
  for (std::size_t i = 0; i < delta.split.size(); ++i) {
    if (i + kAhead < delta.split.size()) tip_of_.prefetch(delta.split[i + kAhead].value);
    apply_split(delta.split[i]);
  }
  pack_loose();
  for (const VertexId u : delta.boxed) {
    const NodeSpan node = mesh_->store().node_of(u);
    apply_box(node.left_of(u));
    apply_box(node.right_of(u));
  }
  // A node's half-space is in the slab of its lane. It may have been split since: then its tip is
  // looked at in vain.
  for (const NodeSpan& node : delta.told_of) mark_changed(tip_of(node.first));
  for (const std::uint32_t tip : pending_) {
    const TreePlace place = tips_[tip].place;
    fetch(&arrays_.nodes[place / kLanes].first[place % kLanes]);
    fetch(&arrays_.nodes[place / kLanes].kind_and_count[place % kLanes]);
  }
  // In order of their numbers, which is about that of their places in memory.
  std::sort(pending_.begin(), pending_.end());
  for (const std::uint32_t tip : pending_) tips_[tip].queued = false;
  // Who is looked at may watch others, but queues nothing, so one pass suffices.
  if (!pending_.empty()) fetch_slot(pending_.front());
  for (std::size_t i = 0; i < pending_.size(); ++i) {
    if (i + 1 < pending_.size()) fetch_slot(pending_[i + 1]);
    if (tips_[pending_[i]].node.size > 0) look_at(pending_[i]);
  }
  pending_.clear();
  refit();
}

// What will be read of a slot, while another is looked at: no other effect. A quarter of the time
// would go by waiting.
void AbTree::fetch_slot(std::uint32_t tip) {
  const Tip& slot = tips_[tip];
  if (!slot.is_slot() || slot.node.size == 0) return;
  for (std::uint64_t left = bits_of(slot.node).active; left != 0; left &= left - 1)
    mesh_->store().prefetch(
        {slot.node.begin() + static_cast<std::uint32_t>(std::countr_zero(left))});
  const TreeNode& node = arrays_.nodes[slot.place / kLanes];
  const std::uint32_t lane = slot.place % kLanes;
  if (node.kind(lane) == Kind::kInner) fetch(&arrays_.nodes[node.first[lane]]);
  if (node.kind(lane) == Kind::kFaces) fetch(&arrays_.blocks[node.first[lane]]);
}

// The lane changed, so the node's own lane above must be looked at.
void AbTree::set_entry(TreePlace place, const TreeEntry& entry) {
  arrays_.nodes[place / kLanes].set(place % kLanes, entry);
  queue_refit(place / kLanes);
}

void AbTree::queue_refit(std::uint32_t tree_node) {
  Upper& at = upper(tree_node);
  if (at.queued || at.parent == kNone) return;
  at.queued = true;
  refits_.emplace_back(at.order, tree_node);
  std::push_heap(refits_.begin(), refits_.end());
}

// Takes the box and slab of an inner lane anew; false where they stay.
bool AbTree::refit_lane(TreePlace place) {
  TreeNode& node = arrays_.nodes[place / kLanes];
  const std::uint32_t lane = place % kLanes;
  const TreeEntry entry = inner_entry(arrays_.nodes, node.first[lane]);
  // An inner lane with nothing below it counts as empty for queries, but keeps leading to its node:
  // more may come there.
  if (entry.box.is_empty()) {
    const std::uint32_t before = std::exchange(node.lanes, node.lanes & ~(1U << lane));
    return node.lanes != before;
  }
  if (node.holds(lane, entry)) return false;
  node.set(lane, entry);
  return true;
}

// Boxes and slabs of the lanes above those that changed, lowest first: the heap gives the greatest
// order. A lane that comes out as it was queues nothing, and there the way up ends.
void AbTree::refit() {
  // Micro trees were written a while ago by now: to read back what has just been written would
  // stall.
  for (const TreePlace place : micro_roots_) refit_lane(place);
  micro_roots_.clear();
  while (!refits_.empty()) {
    std::pop_heap(refits_.begin(), refits_.end());
    const std::uint32_t at = refits_.back().second;
    refits_.pop_back();
    if (upper_of_[at] == kNone) continue;  // freed since
    upper(at).queued = false;
    const TreePlace parent = upper(at).parent;
    if (refit_lane(parent)) queue_refit(parent / kLanes);
  }
}

// A node's own box has come: what had its ancestor's until now takes it over, as a tree made anew
// would.
void AbTree::apply_box(NodeSpan node) {
  const SplitStore& store = mesh_->store();
  if (node.size < 2) return;
  const std::uint32_t first = tip_of(node.first);
  if (tips_[first].is_slot() && tips_[first].node.size >= node.size) {
    mark_changed(first);
    return;
  }
  // Down through larger nodes: also tips further down had that ancestor's box, unless one between
  // has its own.
  std::vector<NodeSpan> stack{node};
  while (!stack.empty()) {
    const NodeSpan span = stack.back();
    stack.pop_back();
    const std::uint32_t tip = tip_of(span.first);
    if (tips_[tip].node == span) {
      mark_changed(tip);
      continue;
    }
    const VertexId split = store.split_of(span);
    for (const NodeSpan child : {span.left_of(split), span.right_of(split)})
      if (!store.has_box(child)) stack.push_back(child);
  }
}

AbTreeStats AbTree::stats() const {
  AbTreeStats stats{slot_total_, exact_total_, rebuilt_slots_, rebuilt_faces_, 0};
  stats.bytes = arrays_.nodes.bytes() + arrays_.nodes.view().size() * sizeof(std::uint32_t) +
                arrays_.blocks.bytes() + uppers_.capacity() * sizeof(Upper) +
                tips_.capacity() * sizeof(Tip);
  for (const Tip& tip : tips_)
    stats.bytes +=
        tip.inherited.capacity() * sizeof(FaceKey) + tip.watchers.capacity() * sizeof(Watch);
  return stats;
}

}  // namespace nearmesh
