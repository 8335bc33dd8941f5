// SPDX-License-Identifier: Apache-2.0
#pragma once
// What a sweep remembers of unresolved nodes.

#include <cstdint>
#include <unordered_map>
#include <vector>

#include "swept_frames.hpp"
#include "walk.hpp"

namespace nearmesh {

/// Unresolved nodes that a sweep met, those of the tree and parts of missing ones: by number, since
/// it comes back to the same ones in each interval.
class MetNodes {
 public:
  static constexpr std::uint32_t kNone = 0xffffffffU;
  struct Met {
    TreeEntry entry;
    std::uint32_t whole = kNone;              ///< what it is a part of
    std::uint32_t parts[2] = {kNone, kNone};  ///< of more than one vertex, where they are known
    std::uint32_t open_parts = 0;             ///< of which something may be found yet
    /// Of a missing one: the start of the first interval in which it might touch.
    double since_s = 0;
    bool has_half_spaces = false, is_missing = false, has_parts = false;
    /// It is missing, and so is all below it: nothing more is to be found.
    bool is_settled = false;
  };
  /// Of an entry of the tree.
  std::uint32_t number_of(const TreeView& tree, const TreeEntry& entry) {
    const auto [at, is_new] =
        by_first_.try_emplace(entry.first, static_cast<std::uint32_t>(met_.size()));
    if (is_new) met_.push_back({.entry = entry, .has_half_spaces = has_half_spaces(tree, entry)});
    return at->second;
  }
  /// The split of a missing node is known.
  void add_parts(const TreeView& tree, std::uint32_t number, VertexId split) {
    const NodeSpan node = met_[number].entry.unresolved_node();
    const NodeSpan parts[2] = {node.right_of(split), node.left_of(split)};
    for (const std::size_t side : {0U, 1U}) {
      if (parts[side].size < 2) continue;
      met_[number].parts[side] = static_cast<std::uint32_t>(met_.size());
      ++met_[number].open_parts;
      met_.push_back({.entry = unresolved_entry(tree, parts[side]), .whole = number});
    }
    met_[number].has_parts = true;
    settle(number);
  }
  void add_missing(std::uint32_t number, double since_s) {
    met_[number].is_missing = true;
    met_[number].since_s = since_s;
  }
  [[nodiscard]] const Met& operator[](std::uint32_t number) const { return met_[number]; }
  [[nodiscard]] const std::vector<Met>& all() const { return met_; }

 private:
  void settle(std::uint32_t number) {
    while (number != kNone && met_[number].open_parts == 0) {
      met_[number].is_settled = true;
      number = met_[number].whole;
      if (number != kNone) --met_[number].open_parts;
    }
  }

  std::vector<Met> met_;
  std::unordered_map<std::uint32_t, std::uint32_t> by_first_;  // by the first vertex; look-ups only
};

}  // namespace nearmesh
