// SPDX-License-Identifier: Apache-2.0
#pragma once
// Which pairs of bodies may be near. All others are proved apart by their bounds. Takes a box a
// body, gives pairs.

#include <compare>
#include <cstdint>
#include <map>
#include <utility>
#include <vector>

#include "box_tree.hpp"

namespace nearmesh {

/// Whose company a body is looked at in: two bodies are a pair where each one's mask has a bit of
/// the other's group.
struct Company {
  std::uint32_t group = 1, mask = 0xffffffffU;
  bool is_scenery = false;  ///< stands in its place: no pair with other scenery
  bool is_other = false;  ///< is looked at for the sake of others alone: no pair with another such

  [[nodiscard]] bool wants(const Company& other) const {
    return (mask & other.group) != 0 && (other.mask & group) != 0 &&
           !(is_scenery && other.is_scenery) && !(is_other && other.is_other);
  }
  auto operator<=>(const Company&) const = default;
};

/// Two bodies are near where their boxes meet. So what is near depends on the boxes alone: not on
/// the order in which bodies came, on where they were before, nor on the trees below.
/// How: each body's *roam* is a larger box, where it is expected to stay for some frames. Only when
/// the box leaves the roam is the tree changed, and are pairs of roams that meet looked for again.
/// In between, only the boxes of these are compared.
/// Threads: one at a time.
class BroadPhase {
 public:
  using Slot = std::uint32_t;  ///< of a body; one that was removed is used again

  /// Of a body whose place is not known: near to nobody, and counted apart.
  Slot add(const Company& company);
  void remove(Slot slot);
  /// `roam()` gives a box, of which what holds `box` is used; it is called where the last one is
  /// left.
  template <class Roam>
  void place(Slot slot, const WorldBox& box, const Roam& roam) {
    boxes_[slot] = box;
    const Body& body = bodies_[slot];
    if (body.leaf != BoxTree::kNowhere && tree_of(body).box_of(body.leaf).holds(box)) return;
    settle(slot, roam());
  }
  /// The body's place is not known any more.
  void lose(Slot slot);

  /// In no order that means anything, each pair once. Valid until the next change.
  /// Cost: O(bodies + pairs of roams that meet), and what those that left their roams meet.
  const std::vector<std::pair<Slot, Slot>>& find_near();

  [[nodiscard]] bool is_placed(Slot slot) const { return bodies_[slot].leaf != BoxTree::kNowhere; }
  [[nodiscard]] bool wants(Slot a, Slot b) const {
    return bodies_[a].company.wants(bodies_[b].company);
  }
  /// Pairs of all bodies, by company; and of those whose place is known.
  [[nodiscard]] std::uint64_t pair_count() const { return all_pairs_; }
  [[nodiscard]] std::uint64_t placed_pair_count() const { return placed_pairs_; }

 private:
  struct Body {
    Company company;
    BoxTree::Place leaf = BoxTree::kNowhere;
  };
  struct Members {
    std::uint64_t all = 0, placed = 0;
  };

  [[nodiscard]] BoxTree& tree_of(const Body& body) {
    return body.company.is_scenery ? scenery_ : movers_;
  }
  void settle(Slot slot, const WorldBox& roam);
  void note_changed(Slot slot);
  void look_around(Slot slot);
  [[nodiscard]] std::uint64_t pairs_with(const Company& company,
                                         std::uint64_t Members::*members) const;

  // By slot. Arrays of their own, since each frame runs through them.
  std::vector<Body> bodies_;
  std::vector<WorldBox> boxes_;
  std::vector<std::uint8_t> is_changed_;
  std::vector<Slot> unused_;
  BoxTree movers_, scenery_;
  // Whose roams meet, but for those that have changed since find_near().
  std::vector<std::pair<Slot, Slot>> company_near_;
  std::vector<Slot> changed_;  // left their roams, came or went since then
  std::map<Company, Members> members_;
  std::uint64_t all_pairs_ = 0, placed_pairs_ = 0;
  std::vector<std::pair<Slot, Slot>> near_;
};

}  // namespace nearmesh
