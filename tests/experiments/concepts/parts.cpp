// SPDX-License-Identifier: Apache-2.0
#include "parts.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace nearmesh::concepts {
namespace {

void add_below(const SplitStore& full, const ActiveMesh& mesh, ForestNode node,
               std::vector<ForestNode>& out) {
  const std::size_t place = out.size();
  out.push_back(node);
  if (node.node.size == 1) return;
  const VertexId split = full.split_of(node.node);
  for (const NodeSpan child : {node.node.left_of(split), node.node.right_of(split)}) {
    ForestNode below{child, node.depth + 1, ForestNode::Kind::kBelow, place};
    if (node.kind == ForestNode::Kind::kSplit)
      below.kind = !mesh.is_current(child) ? ForestNode::Kind::kSplit
                   : child.size == 1       ? ForestNode::Kind::kExact
                                           : ForestNode::Kind::kUnresolved;
    add_below(full, mesh, below, out);
  }
}

/// The slot that holds a vertex: the largest node of the forest with at most kSlotSize ids.
NodeSpan slot_of(const SplitStore& store, VertexId v) {
  NodeSpan node = store.roots()[store.root_index(v)].node;
  while (node.size > kSlotSize) {
    const VertexId split = store.split_of(node);
    if (!split.is_valid()) break;
    node = v < split ? node.left_of(split) : node.right_of(split);
  }
  return node;
}

/// Whether all ends below an entry are of one slot. A face is at home where its right corner is.
bool is_of(const TreeView& view, const SplitStore& store, const TreeEntry& entry, NodeSpan slot) {
  bool all = true;
  if (entry.kind() == TreeEntry::Kind::kUnresolved)
    return slot.contains(entry.unresolved_node().first);
  if (entry.kind() == TreeEntry::Kind::kFaces)
    view.for_each_face(entry, [&](const TreeFace& face) {
      all = all && slot.contains(store.face(face.key).right);
    });
  if (entry.kind() == TreeEntry::Kind::kInner)
    view.for_each_child(
        entry, [&](const TreeEntry& child) { all = all && is_of(view, store, child, slot); });
  return all;
}

VertexId first_end(const TreeView& view, const SplitStore& store, const TreeEntry& entry) {
  VertexId found{0};
  if (entry.kind() == TreeEntry::Kind::kUnresolved) return entry.unresolved_node().first;
  bool is_first = true;
  if (entry.kind() == TreeEntry::Kind::kFaces)
    view.for_each_face(entry, [&](const TreeFace& face) {
      if (is_first) found = store.face(face.key).right;
      is_first = false;
    });
  else
    view.for_each_child(entry, [&](const TreeEntry& child) {
      if (is_first) found = first_end(view, store, child);
      is_first = false;
    });
  return found;
}

void open_below(const TreeView& view, const SplitStore& store, const TreeEntry& entry,
                std::vector<OpenedSlot>& out) {
  if (entry.kind() != TreeEntry::Kind::kInner) return;
  const NodeSpan slot = slot_of(store, first_end(view, store, entry));
  if (slot.size > kSlotSize || !is_of(view, store, entry, slot)) {
    view.for_each_child(entry,
                        [&](const TreeEntry& child) { open_below(view, store, child, out); });
    return;
  }
  OpenedSlot opened{slot, {}};
  std::size_t blocks = 0, nodes = 0, inner = 0;
  view.for_each_child(entry, [&](const TreeEntry& lane) {
    opened.lanes.push_back({lane, {}});
    if (lane.kind() == TreeEntry::Kind::kFaces) {
      ++blocks;
      view.for_each_face(lane,
                         [&](const TreeFace& face) { opened.lanes.back().faces.push_back(face); });
    } else {
      ++(lane.kind() == TreeEntry::Kind::kUnresolved ? nodes : inner);
    }
  });
  if (blocks > 0 && nodes > 0 && inner == 0) out.push_back(std::move(opened));
}

/// Calls visit(ground's node, other's node) for all pairs.
template <class Visit>
void for_each_pair(const Exchange& exchange, const Visit& visit) {
  const std::vector<Unresolved> others = unresolved_nodes(exchange.other.held->mesh());
  for (const Unresolved& a : unresolved_nodes(exchange.ground.held->mesh()))
    for (const Unresolved& b : others) visit(a, b);
}

/// A gap that can be seen: a twelfth of the ground's box at least.
void keep_narrowest(ProvedApart apart, double cell_m, std::optional<ProvedApart>& best) {
  if (apart.gap_m * 36 < cell_m * double(apart.a.box.extent())) return;
  if (!best || apart.gap_m < best->gap_m) best = std::move(apart);
}

}  // namespace

std::vector<ForestNode> forest_of(const SplitStore& full, const ActiveMesh& mesh) {
  std::vector<ForestNode> out;
  for (const BaseRoot& root : full.roots()) {
    const bool is_current = mesh.is_current(root.node);
    add_below(full, mesh,
              {root.node,
               0,
               !is_current           ? ForestNode::Kind::kSplit
               : root.node.size == 1 ? ForestNode::Kind::kExact
                                     : ForestNode::Kind::kUnresolved,
               {}},
              out);
  }
  return out;
}

std::vector<OpenedSlot> open_slots(const Replica& replica) {
  std::vector<OpenedSlot> out;
  const TreeView view = replica.view();
  open_below(view, replica.store(), view.root(), out);
  return out;
}

std::optional<ProvedApart> narrowest_boxes(const Exchange& exchange) {
  std::optional<ProvedApart> best;
  for_each_pair(exchange, [&](const Unresolved& a, const Unresolved& b) {
    const Place lo_a = exchange.ground.place(a.box.lo), hi_a = exchange.ground.place(a.box.hi);
    const Place lo_b = exchange.other.place(b.box.lo), hi_b = exchange.other.place(b.box.hi);
    ProvedApart apart{a, b, -1, {}, -1};
    for (std::size_t k = 0; k < 3; ++k) {
      const double gap_m = std::max(lo_a[k] - hi_b[k], lo_b[k] - hi_a[k]);
      if (gap_m > apart.gap_m) {
        apart.gap_m = gap_m;
        apart.axis = static_cast<int>(k);
      }
    }
    if (apart.gap_m > 0)
      keep_narrowest(std::move(apart), std::ldexp(1.0, exchange.ground.grid().exponent), best);
  });
  return best;
}

std::optional<ProvedApart> narrowest_half_space(const Exchange& exchange) {
  std::optional<ProvedApart> best;
  const Body &ground = exchange.ground, &other = exchange.other;
  for_each_pair(exchange, [&](const Unresolved& a, const Unresolved& b) {
    const Place lo_a = ground.place(a.box.lo), hi_a = ground.place(a.box.hi);
    const Place lo_b = other.place(b.box.lo), hi_b = other.place(b.box.hi);
    for (std::size_t k = 0; k < 3; ++k)
      if (lo_a[k] > hi_b[k] || lo_b[k] > hi_a[k]) return;
    const Place from = ground.place(a.node.first);
    for (const HalfSpace& half_space : a.half_spaces) {
      const auto& n = half_space_normal(half_space.direction);
      double length = 0, least = -std::ldexp(double(half_space_reach(half_space.reach)),
                                             ground.grid().exponent);
      for (std::size_t k = 0; k < 3; ++k) {
        length += double(n[k]) * n[k];
        least += n[k] * ((n[k] > 0 ? lo_b[k] : hi_b[k]) - from[k]);
      }
      if (least > 0)
        keep_narrowest({a, b, -1, half_space, least / std::sqrt(length)},
                       std::ldexp(1.0, ground.grid().exponent), best);
    }
  });
  return best;
}

std::vector<Face> faces_at(const Body& body, NodeSpan node) {
  std::vector<Face> out;
  for (const Face& face : full_faces(body.full.store))
    if (std::any_of(face.corners.begin(), face.corners.end(),
                    [&](VertexId v) { return node.contains(v); }))
      out.push_back(face);
  return out;
}

std::vector<Point> outline(const Body& body, const GridBox& box, const View& view) {
  std::vector<Point> points;
  const Place lo = body.place(box.lo), hi = body.place(box.hi);
  for (int corner = 0; corner < 8; ++corner)
    points.push_back(view({(corner & 1) != 0 ? hi[0] : lo[0], (corner & 2) != 0 ? hi[1] : lo[1],
                           (corner & 4) != 0 ? hi[2] : lo[2]}));
  // The hull, by Andrew's monotone chain.
  std::sort(points.begin(), points.end());
  std::vector<Point> hull;
  for (int round = 0; round < 2; ++round) {
    const std::size_t begin = hull.size();
    for (const Point& p : points) {
      while (hull.size() >= begin + 2) {
        const Point &u = hull[hull.size() - 2], &v = hull.back();
        if ((v[0] - u[0]) * (p[1] - u[1]) - (v[1] - u[1]) * (p[0] - u[0]) > 0) break;
        hull.pop_back();
      }
      hull.push_back(p);
    }
    hull.pop_back();
    std::reverse(points.begin(), points.end());
  }
  return hull;
}

}  // namespace nearmesh::concepts
