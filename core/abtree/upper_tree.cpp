// SPDX-License-Identifier: Apache-2.0
// The shape of the tree above its slots: how it follows splits, collapses and boxes. What hangs where stands at the top of
// ab_tree.cpp.
#include <utility>

#include "nearmesh/core/abtree/detail/ab_tree.hpp"

namespace nearmesh {
namespace {

using Kind = TreeEntry::Kind;

}  // namespace

// The tip of an upper lane, or kNone where the lane leads to another node.
std::uint32_t AbTree::tip_at(TreePlace place) const {
  const std::uint32_t tip = tip_of_[upper(place / kLanes).first_vertices[place % kLanes]] - 1;
  return tips_[tip].place == place ? tip : kNone;
}

// Lanes of an upper node have no gaps, so the first without a vertex ends them. (A lane with a vertex may still be empty: a
// slot without an unresolved node that is home to no exact face.)
std::uint32_t AbTree::lane_count(std::uint32_t tree_node) const {
  std::uint32_t count = 0;
  while (count < kLanes && upper(tree_node).first_vertices[count] != kNone) ++count;
  return count;
}

// To another lane of its node, with what leads back to it from below.
void AbTree::move_lane(std::uint32_t tree_node, std::uint32_t from, std::uint32_t to) {
  NEARMESH_ASSERT(from != to);
  const std::uint32_t tip = tip_at(tree_node * kLanes + from);
  TreeNode& node = arrays_.nodes[tree_node];
  node.set(to, node.entry(from));
  node.first[to] = node.first[from];  // also of an inner lane that has nothing below it
  node.kind_and_count[to] = node.kind_and_count[from];
  upper(tree_node).first_vertices[to] = upper(tree_node).first_vertices[from];
  if (tip != kNone) {
    tips_[tip].place = tree_node * kLanes + to;
  } else {
    upper(arrays_.nodes[tree_node].first[to]).parent = tree_node * kLanes + to;
  }
}

// Which lanes hold what became of a node: down from its root, split by split. Each split parts a range of lanes at its
// vertex; each third level is a tree node further down.
// Precondition: the node is a root, or its parent is split here.
AbTree::Lanes AbTree::find_lanes(NodeSpan node) const {
  const SplitStore& store = mesh_->store();
  const std::size_t root = store.root_index(node.first);
  const TreePlace place = root_places_[root];
  Lanes at{place / kLanes, place % kLanes, place % kLanes + 1, 0};
  for (NodeSpan span = store.roots()[root].node; span != node;) {
    if (at.depth % kLevelsPerNode == 0) {
      at.tree_node = arrays_.nodes[at.tree_node].first[at.begin];
      at.begin = 0;
      at.end = lane_count(at.tree_node);
    }
    const VertexId split = store.split_of(span);
    const auto& firsts = upper(at.tree_node).first_vertices;
    std::uint32_t middle = at.begin;
    while (middle < at.end && firsts[middle] < split.value) ++middle;
    const bool left = node.first < split;
    (left ? at.end : at.begin) = middle;
    span = left ? span.left_of(split) : span.right_of(split);
    ++at.depth;
  }
  return at;
}

void AbTree::apply_split(VertexId u) {
  const SplitStore& store = mesh_->store();
  const NodeSpan node = store.node_of(u);
  const std::uint32_t left = tip_of(node.first);
  // Within a slot the shape above stays. Others wait for vertices that this split has resolved, if any.
  if (tips_[left].is_slot()) {
    set_tip_of(u, left);
    mark_changed(left);
    const VertexBits corners = (node.left_of(u).size == 1 ? bit_of(node.first) : 0) |
                               (node.right_of(u).size == 1 ? bit_of(u) : 0);
    if (corners != 0) tell_watchers(left, corners, false);
    return;
  }
  // A larger tip becomes two: the old one keeps the left child, a new one gets the right child.
  NEARMESH_ASSERT(tips_[left].node == node);
  mark_changed(left);
  tell_watchers(left, kAllVertices, false);  // they find out which child to watch
  tips_[left].watchers.clear();
  const TreePlace place = tips_[left].place;
  const std::uint16_t depth = tips_[left].depth;
  std::uint32_t at = place / kLanes, lane = place % kLanes;
  // On each third level a tree node is hung below the lane; on the others the lane is parted in two, side by side.
  if (depth % kLevelsPerNode == 0) {
    at = new_upper(place);
    lane = 0;
    TreeEntry inner;
    inner.box = store.box(node);  // until refit(), which will reach it: both new lanes are marked
    inner.set(Kind::kInner, at, 0);
    set_entry(place, inner);
    upper(at).first_vertices[0] = node.begin();
  } else {
    for (std::uint32_t i = lane_count(at) - 1; i > lane; --i) move_lane(at, i, i + 1);
  }
  upper(at).first_vertices[lane + 1] = u.value;
  const auto below = static_cast<std::uint16_t>(depth + 1);
  arrays_.nodes[at].set(lane, {});
  arrays_.nodes[at].set(lane + 1, {});
  const std::uint32_t right = new_tip(node.right_of(u), at * kLanes + lane + 1, below);
  tips_[left].node = node.left_of(u);
  tips_[left].place = at * kLanes + lane;
  tips_[left].depth = below;
  if (tips_[left].is_slot()) ++slot_total_;
  set_tip_of(u, right);
  // Faces go with their home vertex, the right corner: that of the new ones lies in the right child.
  std::vector<FaceKey>& stay = tips_[left].inherited;
  std::vector<FaceKey>& go = tips_[right].inherited;
  const auto gone = std::partition(stay.begin(), stay.end(),
                                   [&](FaceKey key) { return store.face(key).right < u; });
  const auto count = static_cast<std::uint32_t>(store.faces(u).size());
  go.reserve(static_cast<std::size_t>(stay.end() - gone) + count);
  go.assign(gone, stay.end());
  stay.erase(gone, stay.end());
  for (std::uint32_t i = 0; i < count; ++i) go.push_back({u, i});
  mark_changed(right);
}

// Makes a node whole: unlike a split it may undo any number of levels at once.
void AbTree::apply_collapse(NodeSpan node) {
  const std::uint32_t first = tip_of(node.first);
  if (tips_[first].is_slot() && tips_[first].node.size >= node.size) {
    VertexBits corners = bit_of(node.first);  // all of them, whichever were resolved
    for (std::uint32_t v = node.begin() + 1; v < node.end(); ++v) {
      tip_of_.unset(v);
      corners |= bit_of({v});
    }
    mark_changed(first);
    tell_watchers(first, corners, true);
    return;
  }
  // A larger node: its whole part of the tree becomes one tip.
  const Lanes lanes = find_lanes(node);
  std::vector<std::uint32_t> gone, below;
  const auto take = [&](TreePlace place) {
    const std::uint32_t tip = tip_at(place);
    if (tip != kNone) {
      gone.push_back(tip);
    } else {
      below.push_back(arrays_.nodes[place / kLanes].first[place % kLanes]);
    }
  };
  for (std::uint32_t lane = lanes.begin; lane < lanes.end; ++lane)
    take(lanes.tree_node * kLanes + lane);
  for (std::size_t i = 0; i < below.size(); ++i)
    for (std::uint32_t lane = 0; lane < lane_count(below[i]); ++lane)
      take(below[i] * kLanes + lane);
  std::vector<FaceKey> inherited;
  for (const std::uint32_t tip : gone) {
    tell_watchers(tip, kAllVertices, true);
    for (const FaceKey key : tips_[tip].inherited)  // but for the faces of splits that are gone
      if (!key.split.is_valid() || key.split <= node.first || key.split.value >= node.end())
        inherited.push_back(key);
    // A tip that is no slot has one active vertex, its first, and may span most of the model.
    const NodeSpan span = tips_[tip].node;
    const std::uint32_t end = tips_[tip].is_slot() ? span.end() : span.begin() + 1;
    for (std::uint32_t v = span.begin(); v < end; ++v) tip_of_.unset(v);
    free_tip(tip);
  }
  for (const std::uint32_t tree_node : below) free_upper(tree_node);
  // One lane is left of those that the node had; the lanes right of them move up.
  const std::uint32_t count = lane_count(lanes.tree_node), fewer = lanes.end - lanes.begin - 1;
  const TreePlace place = lanes.tree_node * kLanes + lanes.begin;
  upper(lanes.tree_node).first_vertices[lanes.begin] = node.begin();
  for (std::uint32_t lane = lanes.end; fewer > 0 && lane < count; ++lane)
    move_lane(lanes.tree_node, lane, lane - fewer);
  for (std::uint32_t lane = count - fewer; lane < count; ++lane) {
    arrays_.nodes[lanes.tree_node].set(lane, {});
    upper(lanes.tree_node).first_vertices[lane] = kNone;
  }
  arrays_.nodes[lanes.tree_node].set(lanes.begin, {});
  const std::uint32_t tip = new_tip(node, place, lanes.depth);
  tips_[tip].inherited = std::move(inherited);
  set_tip_of(node.first, tip);
  mark_changed(tip);
}

// A node's own box has come: what had its ancestor's until now takes it over, as a tree made anew would.
void AbTree::apply_box(NodeSpan node) {
  const SplitStore& store = mesh_->store();
  if (node.size < 2) return;
  const std::uint32_t first = tip_of(node.first);
  if (tips_[first].is_slot() && tips_[first].node.size >= node.size) {
    mark_changed(first);
    return;
  }
  // Down through larger nodes: also tips further down had that ancestor's box, unless one between has its own.
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
      if (store.box_code(child) == kNoBox) stack.push_back(child);
  }
}

}  // namespace nearmesh
