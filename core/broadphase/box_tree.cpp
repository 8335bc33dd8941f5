// SPDX-License-Identifier: Apache-2.0
#include "box_tree.hpp"

#include <algorithm>
#include <array>

#include "nearmesh/core/base/detail/assert.hpp"

namespace nearmesh {
namespace {

/// Half the surface: how likely a box is met.
double area(const WorldBox& box) {
  std::array<double, 3> side;
  for (std::size_t k = 0; k < 3; ++k) side[k] = box.hi_m[k] - box.lo_m[k];
  return side[0] * side[1] + side[1] * side[2] + side[2] * side[0];
}

}  // namespace

BoxTree::Place BoxTree::make(const Node& node) {
  if (unused_.empty()) {
    nodes_.push_back(node);
    return static_cast<Place>(nodes_.size() - 1);
  }
  const Place place = unused_.back();
  unused_.pop_back();
  nodes_[place] = node;
  return place;
}

BoxTree::Place BoxTree::insert(const WorldBox& box, std::uint32_t item) {
  const Place leaf = make({.box = box, .item = item});
  link(leaf);
  return leaf;
}

void BoxTree::remove(Place leaf) {
  unlink(leaf);
  unused_.push_back(leaf);
}

void BoxTree::move(Place leaf, const WorldBox& box) {
  unlink(leaf);
  nodes_[leaf].box = box;
  link(leaf);
}

// Down while a child costs less than to stand beside the node: what all boxes above grow by counts
// on each way.
BoxTree::Place BoxTree::sibling_for(const WorldBox& box) const {
  Place at = root_;
  while (!nodes_[at].is_leaf()) {
    const Node& node = nodes_[at];
    const double together = area(hull(node.box, box));
    const double grown = together - area(node.box);
    const auto cost_of = [&](Place child) {
      const Node& its = nodes_[child];
      return area(hull(its.box, box)) - (its.is_leaf() ? 0 : area(its.box)) + grown;
    };
    const double left = cost_of(node.left), right = cost_of(node.right);
    if (together < std::min(left, right)) break;
    at = left <= right ? node.left : node.right;
  }
  return at;
}

void BoxTree::link(Place leaf) {
  nodes_[leaf].parent = kNowhere;
  if (root_ == kNowhere) {
    root_ = leaf;
    return;
  }
  const Place sibling = sibling_for(nodes_[leaf].box);
  const Place above = nodes_[sibling].parent;
  const Place parent = make({.box = {}, .parent = above, .left = sibling, .right = leaf});
  replace_child(above, sibling, parent);
  nodes_[sibling].parent = parent;
  nodes_[leaf].parent = parent;
  refit_from(parent);
}

void BoxTree::unlink(Place leaf) {
  const Place parent = nodes_[leaf].parent;
  if (parent == kNowhere) {
    root_ = kNowhere;
    return;
  }
  const Place sibling = nodes_[parent].left == leaf ? nodes_[parent].right : nodes_[parent].left;
  const Place above = nodes_[parent].parent;
  nodes_[sibling].parent = above;
  replace_child(above, parent, sibling);
  unused_.push_back(parent);
  refit_from(above);
}

/// `parent` may be none: then the root is replaced.
void BoxTree::replace_child(Place parent, Place before, Place after) {
  if (parent == kNowhere) {
    root_ = after;
  } else if (nodes_[parent].left == before) {
    nodes_[parent].left = after;
  } else {
    NEARMESH_ASSERT(nodes_[parent].right == before);
    nodes_[parent].right = after;
  }
}

void BoxTree::refit_from(Place node) {
  for (; node != kNowhere; node = nodes_[node].parent) {
    rotate(node);
    nodes_[node].box = hull(nodes_[nodes_[node].left].box, nodes_[nodes_[node].right].box);
  }
}

// Exchanges a child with a child of its sibling where that makes the sibling smaller.
void BoxTree::rotate(Place node) {
  struct Exchange {
    Place child = kNowhere, sibling = kNowhere, grandchild = kNowhere;
  } best;
  double best_gain = 0;
  const auto consider = [&](Place child, Place sibling) {
    const Node& its = nodes_[sibling];
    if (its.is_leaf()) return;
    const auto gain_of = [&](Place grandchild, Place stays) {
      const double gain = area(its.box) - area(hull(nodes_[child].box, nodes_[stays].box));
      if (gain <= best_gain) return;
      best_gain = gain;
      best = {child, sibling, grandchild};
    };
    gain_of(its.left, its.right);
    gain_of(its.right, its.left);
  };
  consider(nodes_[node].left, nodes_[node].right);
  consider(nodes_[node].right, nodes_[node].left);
  if (best.child == kNowhere) return;
  replace_child(node, best.child, best.grandchild);
  replace_child(best.sibling, best.grandchild, best.child);
  nodes_[best.grandchild].parent = node;
  nodes_[best.child].parent = best.sibling;
  Node& sibling = nodes_[best.sibling];
  sibling.box = hull(nodes_[sibling.left].box, nodes_[sibling.right].box);
}

}  // namespace nearmesh
