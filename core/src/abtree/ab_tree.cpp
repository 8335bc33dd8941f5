// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/core/abtree/ab_tree.hpp"

#include <algorithm>
#include <bit>

#include "build.hpp"
#include "nearmesh/core/base/hash.hpp"

namespace nearmesh {

AbTree::AbTree(const ActiveMesh& mesh)
    : mesh_(&mesh), free_nodes_(32), free_faces_(32), leaf_of_(mesh.store().vertex_count()) {
  const SplitStore& store = mesh.store();
  // A fixed tree over the roots; each of its leaves then grows with its root's splits.
  std::vector<BuildItem> items;
  for (const BaseRoot& root : store.roots()) {
    items.push_back({.box = store.box(root.node), .frontier = root.node});
  }
  BuildOutput built;
  build_tree(items, built);
  nodes_ = {built.root, TreeNode{}};
  nodes_.insert(nodes_.end(), built.nodes.begin(), built.nodes.end());
  root_nodes_.resize(store.roots().size());
  for (std::uint32_t i = 0; i < nodes_.size(); ++i) {
    TreeNode& node = nodes_[i];
    if (node.kind() == TreeNode::Kind::kInner) {
      node.first += 2;
    } else if (node.kind() == TreeNode::Kind::kFrontier) {
      const NodeSpan span = node.frontier_node();
      root_nodes_[store.root_index(span.first)] = i;
      set_leaf_of(span.first, new_leaf(span, i));
    }
  }
  for (std::uint32_t i = 0; i < store.base_faces().size(); ++i) {
    const VertexId home = store.base_faces()[i].right;
    leaves_[leaf_of(store.roots()[store.root_index(home)].node.first)].bucket.push_back({{}, i});
  }
  RefineDelta delta;
  for (VertexId v{0}; v.value < store.vertex_count(); v = {mesh.current_node(v).end()})
    if (!store.is_root(v)) delta.split.push_back(v);
  // Parents first: larger nodes before smaller.
  std::sort(delta.split.begin(), delta.split.end(), [&](VertexId a, VertexId b) {
    return std::pair(~store.node_of(a).size, a) < std::pair(~store.node_of(b).size, b);
  });
  for (std::uint32_t leaf = 0; leaf < leaves_.size(); ++leaf) mark_changed(leaf);
  update(delta);
}

template <class T>
std::uint32_t AbTree::allocate(std::vector<T>& pool, std::vector<std::vector<std::uint32_t>>& free,
                               std::uint32_t capacity) {
  auto& list = free[static_cast<std::size_t>(std::countr_zero(capacity))];
  if (!list.empty()) {
    const std::uint32_t place = list.back();
    list.pop_back();
    return place;
  }
  const auto place = static_cast<std::uint32_t>(pool.size());
  pool.resize(pool.size() + capacity);
  return place;
}

std::uint32_t AbTree::new_leaf(NodeSpan node, std::uint32_t tree_node) {
  std::uint32_t index;
  if (free_leaves_.empty()) {
    index = static_cast<std::uint32_t>(leaves_.size());
    leaves_.emplace_back();
  } else {
    index = free_leaves_.back();
    free_leaves_.pop_back();
  }
  leaves_[index].node = node;
  leaves_[index].tree_node = tree_node;
  if (leaves_[index].is_slot()) ++slot_total_;
  return index;
}

void AbTree::free_leaf(std::uint32_t index) {
  Leaf& leaf = leaves_[index];
  if (leaf.is_slot()) --slot_total_;
  exact_total_ -= leaf.exact_count;
  if (leaf.node_capacity > 0)
    free_nodes_[static_cast<std::size_t>(std::countr_zero(leaf.node_capacity))].push_back(
        leaf.node_range);
  if (leaf.face_capacity > 0)
    free_faces_[static_cast<std::size_t>(std::countr_zero(leaf.face_capacity))].push_back(
        leaf.face_range);
  const bool queued = leaf.queued;
  leaf = Leaf{};
  leaf.queued = queued;  // its place in pending_ stays; a reused leaf is simply looked at
  free_leaves_.push_back(index);
}

void AbTree::mark_changed(std::uint32_t index) {
  // Whoever has a face with a corner here may have gained or lost an exact face.
  const auto queue = [this](std::uint32_t i) {
    if (leaves_[i].queued) return;
    leaves_[i].queued = true;
    pending_.push_back(i);
  };
  leaves_[index].changed = true;
  queue(index);
  for (const std::uint32_t watcher : leaves_[index].watchers) queue(watcher);
  leaves_[index].watchers.clear();
}

void AbTree::update(const RefineDelta& delta) {
  rebuilt_slots_ = rebuilt_faces_ = 0;
  for (const NodeSpan& node : delta.collapsed) apply_collapse(node);
  for (const VertexId u : delta.split) apply_split(u);
  for (const VertexId u : delta.boxed) {
    const NodeSpan node = mesh_->store().node_of(u);
    apply_box(node.left_of(u));
    apply_box(node.right_of(u));
  }
  std::sort(pending_.begin(), pending_.end());
  for (const std::uint32_t leaf : pending_) leaves_[leaf].queued = false;
  // rebuild() registers watchers but queues nothing, so one pass suffices.
  for (const std::uint32_t leaf : pending_)
    if (leaves_[leaf].node.size > 0) rebuild(leaf);
  pending_.clear();
}

void AbTree::apply_split(VertexId u) {
  const SplitStore& store = mesh_->store();
  const NodeSpan node = store.node_of(u);
  const NodeSpan left_node = node.left_of(u);
  const NodeSpan right_node = node.right_of(u);
  const std::uint32_t left = leaf_of(node.first);
  std::uint32_t right = left;
  if (!leaves_[left].is_slot()) {
    NEARMESH_ASSERT(leaves_[left].node == node);
    mark_changed(left);
    const std::uint32_t pair = allocate(nodes_, free_nodes_, 2);
    TreeNode& parent = nodes_[leaves_[left].tree_node];
    parent.box = store.box(node);
    parent.set(TreeNode::Kind::kInner, pair, 0);
    right = new_leaf(right_node, pair + 1);
    leaves_[left].node = left_node;
    leaves_[left].tree_node = pair;
    if (leaves_[left].is_slot()) ++slot_total_;
    // Faces go with their home vertex.
    std::vector<FaceKey> bucket;
    bucket.swap(leaves_[left].bucket);
    for (const FaceKey key : bucket)
      leaves_[store.face(key).right < u ? left : right].bucket.push_back(key);
    mark_changed(right);
  }
  set_leaf_of(u, right);
  mark_changed(left);
  // A face's home is its right corner, which lies in the right child.
  const std::size_t count = store.faces(u).size();
  for (std::uint32_t i = 0; i < count; ++i) leaves_[right].bucket.push_back({u, i});
}

std::uint32_t AbTree::find_tree_node(NodeSpan node) const {
  const SplitStore& store = mesh_->store();
  const std::size_t root = store.root_index(node.first);
  std::uint32_t place = root_nodes_[root];
  for (NodeSpan at = store.roots()[root].node; at != node;) {
    const VertexId split = store.split_of(at);
    place = nodes_[place].first + (node.first < split ? 0 : 1);
    at = node.first < split ? at.left_of(split) : at.right_of(split);
  }
  return place;
}

void AbTree::apply_collapse(NodeSpan node) {
  const auto owned = [node](FaceKey key) {  // by a split of the node or below
    return key.split.is_valid() && key.split > node.first && key.split.value < node.end();
  };
  const std::uint32_t first = leaf_of(node.first);
  if (leaves_[first].is_slot() && leaves_[first].node.size >= node.size) {
    std::erase_if(leaves_[first].bucket, owned);
    for (std::uint32_t v = node.begin() + 1; v < node.end(); ++v) leaf_of_[v] = 0;
    mark_changed(first);
    return;
  }
  // A larger node: its whole part of the tree becomes one leaf.
  const std::uint32_t place = find_tree_node(node);
  std::vector<FaceKey> bucket;
  std::vector<std::pair<std::uint32_t, NodeSpan>> stack{{place, node}};
  std::vector<std::uint32_t> pairs, gone;
  while (!stack.empty()) {
    const auto [at, span] = stack.back();
    stack.pop_back();
    const std::uint32_t leaf = leaf_of_[span.begin()] - 1;
    if (leaf_of_[span.begin()] != 0 && leaves_[leaf].tree_node == at &&
        leaves_[leaf].node == span) {
      gone.push_back(leaf);
      continue;
    }
    const VertexId split = mesh_->store().split_of(span);
    const std::uint32_t pair = nodes_[at].first;
    pairs.push_back(pair);
    stack.push_back({pair, span.left_of(split)});
    stack.push_back({pair + 1, span.right_of(split)});
  }
  for (const std::uint32_t leaf : gone) {
    mark_changed(leaf);
    for (const FaceKey key : leaves_[leaf].bucket)
      if (!owned(key)) bucket.push_back(key);
    // A leaf that is no slot has one active vertex, its first, and may span most of the model.
    const NodeSpan span = leaves_[leaf].node;
    const std::uint32_t end = leaves_[leaf].is_slot() ? span.end() : span.begin() + 1;
    for (std::uint32_t v = span.begin(); v < end; ++v) leaf_of_[v] = 0;
    free_leaf(leaf);
  }
  for (const std::uint32_t pair : pairs) free_nodes_[1].push_back(pair);
  const std::uint32_t leaf = new_leaf(node, place);
  leaves_[leaf].bucket = std::move(bucket);
  set_leaf_of(node.first, leaf);
  mark_changed(leaf);
}

// A node's own box has come: what had its ancestor's until now takes it over, as a tree made anew would.
void AbTree::apply_box(NodeSpan node) {
  const SplitStore& store = mesh_->store();
  if (node.size < 2) return;
  const std::uint32_t first = leaf_of(node.first);
  if (leaves_[first].is_slot() && leaves_[first].node.size >= node.size) {
    mark_changed(first);
    return;
  }
  std::vector<std::pair<std::uint32_t, NodeSpan>> stack{{find_tree_node(node), node}};
  while (!stack.empty()) {
    const auto [at, span] = stack.back();
    stack.pop_back();
    const std::uint32_t leaf = leaf_of(span.first);
    if (leaves_[leaf].tree_node == at && leaves_[leaf].node == span) {
      mark_changed(leaf);
      continue;
    }
    nodes_[at].box = store.box(span);
    const VertexId split = store.split_of(span);
    const std::uint32_t pair = nodes_[at].first;
    for (const auto& child :
         {std::pair(pair, span.left_of(split)), std::pair(pair + 1, span.right_of(split))})
      if (store.box_code(child.second) == kNoBox) stack.push_back(child);
  }
}

void AbTree::rebuild(std::uint32_t index) {
  const SplitStore& store = mesh_->store();
  Leaf& leaf = leaves_[index];
  const bool changed = leaf.changed;
  leaf.changed = false;

  // Which faces are exact now; and whom to watch for the rest, and for those that may be lost.
  exact_keys_.clear();
  std::uint64_t digest = 0;
  for (const FaceKey key : leaf.bucket) {
    const SplitFace face = store.face(key);
    bool exact = leaf.is_slot();
    for (const VertexId corner : {face.left, face.right, face.outside}) {
      exact = exact && mesh_->is_leaf(corner);
      if (leaf.node.contains(corner)) continue;
      std::vector<std::uint32_t>& watchers =
          leaves_[leaf_of(mesh_->active_predecessor(corner))].watchers;
      if (std::find(watchers.begin(), watchers.end(), index) == watchers.end())
        watchers.push_back(index);
    }
    if (!exact) continue;
    exact_keys_.push_back(key);
    digest += mix(std::uint64_t{key.split.value} << 32 | key.index);
  }
  if (!changed && digest == leaf.exact_digest && exact_keys_.size() == leaf.exact_count) return;
  leaf.exact_digest = digest;

  TreeNode& node = nodes_[leaf.tree_node];
  if (!leaf.is_slot()) {
    node.box = store.box(leaf.node);
    node.set(TreeNode::Kind::kFrontier, leaf.node.begin(), leaf.node.size);
    return;
  }
  store_micro_tree(index);
}

void AbTree::store_micro_tree(std::uint32_t index) {
  const SplitStore& store = mesh_->store();
  Leaf& leaf = leaves_[index];
  std::vector<BuildItem> items;
  exact_faces_.clear();
  // In a canonical order, so that the tree does not depend on the order of arrival.
  std::sort(exact_keys_.begin(), exact_keys_.end());
  for (const FaceKey key : exact_keys_) {
    TreeFace face{{}, key};
    BuildItem item{.face = static_cast<std::uint32_t>(exact_faces_.size())};
    const auto corners = store.face(key).corners();
    for (std::size_t k = 0; k < 3; ++k) {
      face.corners[k] = store.position(corners[k]);
      item.box.add(face.corners[k]);
    }
    exact_faces_.push_back(face);
    items.push_back(item);
  }
  for (VertexId v = leaf.node.first; v.value < leaf.node.end();) {
    const NodeSpan at = mesh_->current_node(v);
    if (at.size > 1) items.push_back({.box = store.box(at), .frontier = at});
    v = {at.end()};
  }
  BuildOutput built;
  build_tree(items, built);

  const auto place_range = [](auto& pool, auto& free, std::uint32_t& range, std::uint32_t& capacity,
                              std::size_t need) {
    if (need <= capacity) return;
    if (capacity > 0) free[static_cast<std::size_t>(std::countr_zero(capacity))].push_back(range);
    capacity = std::bit_ceil(static_cast<std::uint32_t>(need));
    range = allocate(pool, free, capacity);
  };
  place_range(nodes_, free_nodes_, leaf.node_range, leaf.node_capacity, built.nodes.size());
  place_range(faces_, free_faces_, leaf.face_range, leaf.face_capacity, built.faces.size());
  const auto shift = [&leaf](TreeNode& node) {
    if (node.kind() == TreeNode::Kind::kInner) node.first += leaf.node_range;
    if (node.kind() == TreeNode::Kind::kFaces) node.first += leaf.face_range;
  };
  shift(built.root);
  nodes_[leaf.tree_node] = built.root;
  for (std::size_t i = 0; i < built.nodes.size(); ++i) {
    shift(built.nodes[i]);
    nodes_[leaf.node_range + i] = built.nodes[i];
  }
  for (std::size_t i = 0; i < built.faces.size(); ++i)
    faces_[leaf.face_range + i] = exact_faces_[built.faces[i]];
  exact_total_ += exact_keys_.size() - leaf.exact_count;
  leaf.exact_count = static_cast<std::uint32_t>(exact_keys_.size());
  ++rebuilt_slots_;
  rebuilt_faces_ += exact_keys_.size();
}

AbTreeStats AbTree::stats() const {
  AbTreeStats stats{slot_total_, exact_total_, rebuilt_slots_, rebuilt_faces_, 0};
  stats.bytes = nodes_.capacity() * sizeof(TreeNode) + faces_.capacity() * sizeof(TreeFace) +
                leaves_.capacity() * sizeof(Leaf);
  for (const Leaf& leaf : leaves_)
    stats.bytes += leaf.bucket.capacity() * sizeof(FaceKey) + leaf.watchers.capacity() * 4;
  return stats;
}

}  // namespace nearmesh
