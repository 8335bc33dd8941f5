// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/core/refine/detail/active_mesh.hpp"

#include <algorithm>
#include <bit>

#include "core/base/hash.hpp"

namespace nearmesh {

ActiveMesh::ActiveMesh(const SplitStore& store)
    : store_(&store), bits_((std::size_t{store.vertex_count()} + 1 + 63) / 64) {
  const auto set = [this](std::uint32_t v) { bits_[v >> 6] |= std::uint64_t{1} << (v & 63U); };
  for (const BaseRoot& root : store.roots()) set(root.node.begin());
  set(store.vertex_count());
}

VertexId ActiveMesh::active_predecessor(VertexId v) const {
  std::size_t word = v.value >> 6;
  std::uint64_t bits = bits_[word] & (~std::uint64_t{0} >> (63U - (v.value & 63U)));
  while (bits == 0) bits = bits_[--word];  // ends at the latest at vertex 0, a root
  return {static_cast<std::uint32_t>(word * 64 + 63 -
                                     static_cast<std::size_t>(std::countl_zero(bits)))};
}

VertexId ActiveMesh::active_at(std::uint32_t index) const {
  std::size_t word = 0;
  for (auto count = static_cast<std::uint32_t>(std::popcount(bits_[0])); count <= index;
       count = static_cast<std::uint32_t>(std::popcount(bits_[++word])))
    index -= count;
  std::uint64_t bits = bits_[word];
  for (; index > 0; --index) bits &= bits - 1;
  return {static_cast<std::uint32_t>(word * 64 + static_cast<std::size_t>(std::countr_zero(bits)))};
}

NodeSpan ActiveMesh::current_node(VertexId v) const {
  NEARMESH_ASSERT(is_active(v));
  const std::uint32_t after = v.value + 1;
  std::size_t word = after >> 6;
  std::uint64_t bits = bits_[word] & (~std::uint64_t{0} << (after & 63U));
  while (bits == 0) bits = bits_[++word];  // ends at the latest at the sentinel
  const auto next =
      static_cast<std::uint32_t>(word * 64 + static_cast<std::size_t>(std::countr_zero(bits)));
  return {v, next - v.value};
}

bool ActiveMesh::is_current(NodeSpan node) const {
  return is_active(node.first) && current_node(node.first) == node;
}

bool ActiveMesh::split(VertexId u, RefineDelta& delta) {
  stack_.clear();
  // What u rests on, nearest first: the split that makes its node, and so on up to an active one.
  for (VertexId v = u; !is_active(v);) {
    if (!store_->is_known(v)) return false;
    stack_.push_back(v);
    const NodeSpan node = store_->node_of(v);
    const bool initial = node == store_->initial_node(node.first);
    v = initial ? node.first : VertexId{node.end()};
  }
  for (; !stack_.empty(); stack_.pop_back()) {
    const VertexId v = stack_.back();
    if (!half_spaces_.is_empty()) drop_half_spaces(store_->node_of(v).first);
    bits_[v.value >> 6] |= std::uint64_t{1} << (v.value & 63U);
    hash_ += mix(v.value);
    ++split_count_;
    delta.split.push_back(v);
  }
  return true;
}

bool ActiveMesh::add_half_space(NodeSpan node, const HalfSpace& half_space, RefineDelta& delta) {
  NEARMESH_ASSERT(node.size > 1 && is_current(node));
  const std::uint64_t before = hash_of_half_spaces(node.first);
  if (!half_spaces_.add(node.first, half_space)) return false;
  hash_ += hash_of_half_spaces(node.first) - before;
  delta.told_of.push_back(node);
  return true;
}

// The size of a node follows from the set of active vertices, so its first vertex names it.
std::uint64_t ActiveMesh::hash_of_half_spaces(VertexId first) const {
  std::uint64_t sum = 0;
  for (const HalfSpace& half_space : half_spaces_.of(first))
    sum += mix(mix(first.value) ^
               (std::uint64_t{half_space.direction} << kReachBits | half_space.reach));
  return sum;
}

void ActiveMesh::drop_half_spaces(VertexId first) {
  hash_ -= hash_of_half_spaces(first);
  half_spaces_.erase(first);
}

void ActiveMesh::collapse(NodeSpan node, RefineDelta& delta) {
  if (!is_active(node.first) || node.size < 2) return;
  bool changed = false;
  for (std::uint32_t v = node.begin() + 1; v < node.end();) {
    const std::uint32_t offset = v & 63U;
    const std::uint32_t span = std::min(64U - offset, node.end() - v);
    const std::uint64_t mask = (span == 64 ? ~std::uint64_t{0} : (std::uint64_t{1} << span) - 1)
                               << offset;
    std::uint64_t gone = bits_[v >> 6] & mask;
    if (gone != 0) bits_[v >> 6] &= ~mask;  // a page that was never written stays the kernel's
    for (; gone != 0; gone &= gone - 1) {
      const VertexId lost{(v & ~63U) + static_cast<std::uint32_t>(std::countr_zero(gone))};
      hash_ -= mix(lost.value);
      if (!half_spaces_.is_empty()) drop_half_spaces(lost);
      --split_count_;
      changed = true;
    }
    v += span;
  }
  if (!changed) return;
  if (!half_spaces_.is_empty()) drop_half_spaces(node.first);  // of the smaller node before
  delta.collapsed.push_back(node);
}

Treelet active_treelet(const ActiveMesh& mesh) {
  const SplitStore& store = mesh.store();
  Treelet treelet;
  // Preorder is by first id, then larger first; a vertex's splits shrink its node from the right.
  std::vector<NodeSpan> stack;
  for (const BaseRoot& root : store.roots()) {
    stack.assign(1, root.node);
    while (!stack.empty()) {
      const NodeSpan node = stack.back();
      stack.pop_back();
      const auto done = [&](NodeSpan n) {
        if (n.size < 2) return false;
        const VertexId u = store.split_of(n);
        return u.is_valid() && mesh.is_active(u);
      };
      if (!done(node)) continue;
      const VertexId u = store.split_of(node);
      const NodeSpan left = node.left_of(u), right = node.right_of(u);
      treelet.push_back({node, u, done(left), done(right)});
      stack.push_back(right);
      stack.push_back(left);
    }
  }
  return treelet;
}

std::vector<VertexId> global_order(const SplitStore& store, std::uint32_t count) {
  // Complement of the node's size, split.
  std::vector<std::pair<std::uint32_t, std::uint32_t>> order;
  for (std::uint32_t v = 0; v < store.vertex_count(); ++v)
    if (store.is_known({v}) && !store.is_root({v})) order.emplace_back(~store.node_of({v}).size, v);
  std::sort(order.begin(), order.end());
  order.resize(std::min<std::size_t>(order.size(), count));
  std::vector<VertexId> splits;
  for (const auto& [size, v] : order) splits.push_back({v});
  return splits;
}

std::vector<ActiveFace> extract_faces(const ActiveMesh& mesh) {
  std::vector<ActiveFace> faces;
  const SplitStore& store = mesh.store();
  const auto add = [&](FaceKey key, const SplitFace& face) {
    ActiveFace active{key, face.corners()};
    for (VertexId& corner : active.corners) corner = mesh.active_predecessor(corner);
    faces.push_back(active);
  };
  for (std::uint32_t i = 0; i < store.base_faces().size(); ++i) add({{}, i}, store.base_faces()[i]);
  for (VertexId v{0}; v.value < store.vertex_count(); v = {mesh.current_node(v).end()}) {
    if (store.is_root(v)) continue;
    const auto own = store.faces(v);
    for (std::uint32_t i = 0; i < own.size(); ++i) add({v, i}, own[i]);
  }
  return faces;
}

}  // namespace nearmesh
