// SPDX-License-Identifier: Apache-2.0
// The upper tree: from the roots of the forest down to the tips, slots and larger nodes that are
// not split (ab_tree.cpp, 1).
#include <algorithm>
#include <memory>
#include <utility>

#include "nearmesh/core/abtree/detail/ab_tree.hpp"

namespace nearmesh {
namespace {

using Kind = TreeEntry::Kind;

constexpr std::size_t kFirstUppers = 256;

/// Also of an inner lane that has nothing below it: it keeps leading to its node.
void copy_lane(const TreeNode& from, std::uint32_t lane, TreeNode& to, std::uint32_t to_lane) {
  const std::uint32_t first = from.first[lane], kind_and_count = from.kind_and_count[lane];
  to.set(to_lane, from.entry(lane));
  to.first[to_lane] = first;
  to.kind_and_count[to_lane] = kind_and_count;
}

// Of an upper node: the first vertices of its lanes, by which these share out a node of the forest.
// kNone is greater than any vertex.
using FirstVertices = std::array<std::uint32_t, kLanes>;

std::uint32_t lane_of(const FirstVertices& firsts, VertexId vertex) {
  std::uint32_t lane = 0;
  while (lane + 1 < kLanes && firsts[lane + 1] <= vertex.value) ++lane;
  return lane;
}

NodeSpan span_of(const FirstVertices& firsts, std::uint32_t lane, NodeSpan shared_out) {
  const std::uint32_t end =
      lane + 1 < kLanes ? std::min(firsts[lane + 1], shared_out.end()) : shared_out.end();
  return {{firsts[lane]}, end - firsts[lane]};
}

}  // namespace

std::uint32_t AbTree::new_upper(TreePlace parent, NodeSpan node) {
  const std::uint32_t place = arrays_.nodes.take();
  std::construct_at(&arrays_.nodes[place]);
  if (place >= upper_of_.size()) upper_of_.grow(std::max(kFirstUppers, 2 * std::size_t{place}));
  if (free_uppers_.empty()) {
    free_uppers_.push_back(static_cast<std::uint32_t>(uppers_.size()));
    uppers_.emplace_back();
  }
  upper_of_[place] = free_uppers_.back();
  free_uppers_.pop_back();
  Upper& fresh = upper(place);
  fresh.first_vertices.fill(kNone);
  fresh.parent = parent;
  fresh.node = node;
  // Below the fixed tree the smaller is the deeper.
  fresh.order = node.size == 0 ? 0 : ~node.size;
  fresh.queued = fresh.loose = fresh.gone = false;
  return place;
}

// A new one, in that lane. Its box there is the node's until refit(), which its own lanes will
// bring.
std::uint32_t AbTree::hang_upper(TreePlace place, NodeSpan node) {
  const std::uint32_t fresh = new_upper(place, node);
  TreeEntry inner;
  inner.box = mesh_->store().box(node);
  inner.set(Kind::kInner, fresh, 0);
  set_entry(place, inner);
  return fresh;
}

void AbTree::free_upper(std::uint32_t tree_node) {
  free_uppers_.push_back(upper_of_[tree_node]);
  upper_of_[tree_node] = kNone;
  arrays_.nodes.give_back(tree_node);
}

// The tip of an upper lane, or kNone where the lane leads to another node.
std::uint32_t AbTree::tip_at(TreePlace place) const {
  const std::uint32_t tip = tip_of_[upper(place / kLanes).first_vertices[place % kLanes]] - 1;
  return tips_[tip].place == place ? tip : kNone;
}

// Lanes of an upper node have no gaps, so the first without a vertex ends them. (A lane with a
// vertex may still be empty: a slot without an unresolved node that is home to no exact face.)
std::uint32_t AbTree::lane_count(std::uint32_t tree_node) const {
  std::uint32_t count = 0;
  while (count < kLanes && upper(tree_node).first_vertices[count] != kNone) ++count;
  return count;
}

// To another lane of its node, with what leads back to it from below.
void AbTree::move_lane(std::uint32_t tree_node, std::uint32_t from, std::uint32_t to) {
  NEARMESH_ASSERT(from != to);
  const std::uint32_t tip = tip_at(tree_node * kLanes + from);
  copy_lane(arrays_.nodes[tree_node], from, arrays_.nodes[tree_node], to);
  upper(tree_node).first_vertices[to] = upper(tree_node).first_vertices[from];
  if (tip != kNone) {
    tips_[tip].place = tree_node * kLanes + to;
  } else {
    upper(arrays_.nodes[tree_node].first[to]).parent = tree_node * kLanes + to;
  }
}

// Which lanes hold what became of a node: down from its root, from upper node to upper node.
// Precondition: the node is a root, or its parent is split here.
AbTree::Lanes AbTree::find_lanes(NodeSpan node) const {
  const SplitStore& store = mesh_->store();
  const std::size_t root = store.root_index(node.first);
  const TreePlace place = root_places_[root];
  Lanes at{place / kLanes, place % kLanes, place % kLanes + 1};
  for (NodeSpan span = store.roots()[root].node; span != node;) {
    at.tree_node = arrays_.nodes[at.tree_node].first[at.begin];
    const FirstVertices& firsts = upper(at.tree_node).first_vertices;
    at.begin = lane_of(firsts, node.first);
    at.end = at.begin + 1;
    while (at.end < kLanes && firsts[at.end] < node.end()) ++at.end;
    if (at.end > at.begin + 1) break;  // it was opened here
    span = span_of(firsts, at.begin, upper(at.tree_node).node);
  }
  return at;
}

// ---- packing ------------------------------------------------------------------------------------

// How a node of the forest is shared out among eight lanes: the largest that is split further is
// opened, the first of equals, until there are eight. So the cut follows from what is active,
// whichever came first.
AbTree::Cut AbTree::cut(NodeSpan node) const {
  const SplitStore& store = mesh_->store();
  Cut cut{{node}, 1};
  std::array<std::uint32_t, kLanes> opened_size{node.size};  // 0: it is a tip
  while (cut.count < kLanes) {
    const auto largest = static_cast<std::uint32_t>(
        std::max_element(opened_size.begin(), opened_size.begin() + cut.count) -
        opened_size.begin());
    if (opened_size[largest] == 0) break;
    const NodeSpan opened = cut.nodes[largest];
    const VertexId split = store.split_of(opened);
    for (std::uint32_t i = cut.count++; i > largest + 1; --i) {
      cut.nodes[i] = cut.nodes[i - 1];
      opened_size[i] = opened_size[i - 1];
    }
    cut.nodes[largest] = opened.left_of(split);
    cut.nodes[largest + 1] = opened.right_of(split);
    for (const std::uint32_t i : {largest, largest + 1})
      opened_size[i] = is_tip(cut.nodes[i]) ? 0 : cut.nodes[i].size;
  }
  return cut;
}

bool AbTree::is_cut(std::uint32_t tree_node, const Cut& cut) const {
  if (lane_count(tree_node) != cut.count) return false;
  for (std::uint32_t lane = 0; lane < cut.count; ++lane)
    if (upper(tree_node).first_vertices[lane] != cut.nodes[lane].begin()) return false;
  return true;
}

void AbTree::loosen(std::uint32_t tree_node) {
  if (upper(tree_node).node.size == 0 || std::exchange(upper(tree_node).loose, true)) return;
  loose_.push_back(tree_node);
}

// The upper nodes whose lanes may be others now, from above: packed anew, one takes in what was
// below it.
void AbTree::pack_loose() {
  std::erase_if(loose_, [this](std::uint32_t at) { return upper_of_[at] == kNone; });
  std::sort(loose_.begin(), loose_.end(), [this](std::uint32_t one, std::uint32_t other) {
    return upper(one).order < upper(other).order;
  });
  // One that was freed meanwhile may be in use again: then it is packed, and this changes nothing.
  for (const std::uint32_t tree_node : loose_)
    if (upper_of_[tree_node] != kNone) pack(tree_node);
  loose_.clear();
}

/// What was below the node that is packed anew, until all of it has its new place.
struct AbTree::Packing {
  std::uint32_t top;
  TreeNode node;  // and its lanes' first vertices, as they were
  std::array<std::uint32_t, kLanes> first_vertices;
  std::vector<std::uint32_t> gone;  // upper nodes
  /// Whose lanes are to be filled, and the upper node that had its node of the forest opened: what
  /// stood below is found from there.
  std::vector<std::pair<std::uint32_t, std::uint32_t>> unfilled;
};

void AbTree::pack(std::uint32_t tree_node) {
  upper(tree_node).loose = false;
  const Cut cut = this->cut(upper(tree_node).node);
  if (is_cut(tree_node, cut)) return;
  Packing packing{tree_node, arrays_.nodes[tree_node], upper(tree_node).first_vertices, {}, {}};
  fill(tree_node, cut, tree_node, packing);
  while (!packing.unfilled.empty()) {  // not by calls: a forest may be deep
    const auto [fresh, opened_in] = packing.unfilled.back();
    packing.unfilled.pop_back();
    fill(fresh, this->cut(upper(fresh).node), opened_in, packing);
  }
  for (const std::uint32_t gone : packing.gone) free_upper(gone);
}

// Each lane takes over what stood for its node: a tip with what hangs in it, or an upper node with
// all below. Where nothing did, since its node was opened, a new upper node takes over what is
// below.
void AbTree::fill(std::uint32_t tree_node, const Cut& cut, std::uint32_t opened_in,
                  Packing& packing) {
  for (std::uint32_t lane = 0; lane < kLanes; ++lane) {
    const TreePlace place = tree_node * kLanes + lane;
    const NodeSpan node = lane < cut.count ? cut.nodes[lane] : NodeSpan{{kNone}, 0};
    upper(tree_node).first_vertices[lane] = node.begin();
    if (node.size == 0) {
      arrays_.nodes[tree_node].set(lane, {});
      continue;
    }
    if (is_tip(node)) {
      Tip& tip = tips_[tip_of(node.first)];
      take_over(tip.place, place, packing);
      tip.place = place;
      continue;
    }
    const auto [below, at] = find_upper(node, opened_in, packing);
    if (below != kNone) {
      take_over(upper(below).parent, place, packing);
      upper(below).parent = place;
    } else {
      packing.unfilled.emplace_back(hang_upper(place, node), at);
    }
  }
  queue_refit(tree_node);
}

// What hung in a lane hangs in another now. The upper node that had it goes, with those above it,
// up to the one that is packed.
void AbTree::take_over(TreePlace from, TreePlace to, Packing& packing) {
  const std::uint32_t before = from / kLanes;
  copy_lane(before == packing.top ? packing.node : arrays_.nodes[before], from % kLanes,
            arrays_.nodes[to / kLanes], to % kLanes);
  for (std::uint32_t at = before; at != packing.top && !std::exchange(upper(at).gone, true);
       at = upper(at).parent / kLanes)
    packing.gone.push_back(at);
}

// The upper node of a node of the forest, as it was before, kNone where that was opened; and the
// one above it, or in which it was.
std::pair<std::uint32_t, std::uint32_t> AbTree::find_upper(NodeSpan node, std::uint32_t from,
                                                           const Packing& packing) const {
  for (std::uint32_t at = from;;) {
    const bool is_top = at == packing.top;
    const FirstVertices& firsts = is_top ? packing.first_vertices : upper(at).first_vertices;
    const std::uint32_t lane = lane_of(firsts, node.first);
    const NodeSpan span = span_of(firsts, lane, upper(at).node);
    if (span.size < node.size) return {kNone, at};
    const std::uint32_t below = (is_top ? packing.node : arrays_.nodes[at]).first[lane];
    if (span == node) return {below, at};
    at = below;
  }
}

// ---- splits and collapses -----------------------------------------------------------------------

void AbTree::apply_split(VertexId u) {
  const SplitStore& store = mesh_->store();
  const NodeSpan node = store.node_of(u);
  const std::uint32_t left = tip_of(node.first);
  // Within a slot the shape above stays. Others wait for vertices that this split has resolved, if
  // any.
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
  std::uint32_t at = place / kLanes, lane = place % kLanes;
  // The lane is parted in two where there is room; else a tree node is hung below it, until those
  // that are full are packed anew.
  const std::uint32_t lanes = upper(at).node.size == 0 ? kLanes : lane_count(at);
  if (lanes == kLanes) {
    loosen(at);
    at = hang_upper(place, node);
    lane = 0;
    upper(at).first_vertices[0] = node.begin();
  } else {
    for (std::uint32_t i = lanes - 1; i > lane; --i) move_lane(at, i, i + 1);
  }
  upper(at).first_vertices[lane + 1] = u.value;
  arrays_.nodes[at].set(lane, {});
  arrays_.nodes[at].set(lane + 1, {});
  const std::uint32_t right = new_tip(node.right_of(u), at * kLanes + lane + 1);
  tips_[left].node = node.left_of(u);
  tips_[left].place = at * kLanes + lane;
  if (tips_[left].is_slot()) ++slot_total_;
  set_tip_of(u, right);
  // Faces go with their home vertex, the right corner: that of the new ones lies in the right
  // child.
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
  if (fewer > 0) loosen(lanes.tree_node);
  const std::uint32_t tip = new_tip(node, place);
  tips_[tip].inherited = std::move(inherited);
  set_tip_of(node.first, tip);
  mark_changed(tip);
}

}  // namespace nearmesh
