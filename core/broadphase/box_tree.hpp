// SPDX-License-Identifier: Apache-2.0
#pragma once
// A tree of boxes that come, move and go. Which boxes meet another does not depend on its shape;
// only the cost does.

#include <cstdint>
#include <vector>

#include "body_bounds.hpp"

namespace nearmesh {

/// Binary, each inner node around its two children. Threads: one at a time. Source: Goldsmith and
/// Salmon's insertion by surface area, and Kensler's rotations, as dynamic trees of physics engines
/// do it.
class BoxTree {
 public:
  using Place = std::uint32_t;
  static constexpr Place kNowhere = 0xffffffffU;

  /// Cost of all three: O(depth).
  Place insert(const WorldBox& box, std::uint32_t item);
  void remove(Place leaf);
  void move(Place leaf, const WorldBox& box);

  [[nodiscard]] const WorldBox& box_of(Place leaf) const { return nodes_[leaf].box; }

  /// Calls visit(item) for each box that meets `box`, in the order of the tree.
  template <class Visit>
  void for_each_meeting(const WorldBox& box, const Visit& visit) const {
    if (root_ == kNowhere) return;
    open_.assign(1, root_);
    while (!open_.empty()) {
      const Node& node = nodes_[open_.back()];
      open_.pop_back();
      if (!node.box.meets(box)) continue;
      if (node.is_leaf()) {
        visit(node.item);
      } else {
        open_.insert(open_.end(), {node.left, node.right});
      }
    }
  }

 private:
  struct Node {
    WorldBox box;
    Place parent = kNowhere, left = kNowhere, right = kNowhere;
    std::uint32_t item = 0;  // of leaves

    [[nodiscard]] bool is_leaf() const { return left == kNowhere; }
  };

  Place make(const Node& node);
  void link(Place leaf);
  void unlink(Place leaf);
  [[nodiscard]] Place sibling_for(const WorldBox& box) const;
  void refit_from(Place node);
  void rotate(Place node);
  void replace_child(Place parent, Place before, Place after);

  std::vector<Node> nodes_;
  std::vector<Place> unused_;
  Place root_ = kNowhere;
  mutable std::vector<Place> open_;  // of for_each_meeting, kept for its memory
};

}  // namespace nearmesh
