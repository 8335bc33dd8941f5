// SPDX-License-Identifier: Apache-2.0
#pragma once
// The memory of trees that change: nodes and blocks of faces by place, reused when they are free
// again. Their pages come from the kernel on first use and are never moved or copied.

#include <algorithm>
#include <span>
#include <vector>

#include "nearmesh/core/abtree/detail/tree.hpp"
#include "nearmesh/core/base/detail/lazy_array.hpp"

namespace nearmesh {

/// Elements by place; the first are in use but for those that are listed as free.
template <class T>
class TreePages {
 public:
  /// The content is the caller's to set. References to elements become invalid.
  std::uint32_t take() {
    if (!free_.empty()) {
      const std::uint32_t place = free_.back();
      free_.pop_back();
      return place;
    }
    if (total_ == pages_.size()) pages_.grow(std::max(kFirstRoom, 2 * pages_.size()));
    if (total_ % kAtOnce == 0 && total_ > 0) pages_.prepare(total_, kAtOnce);
    return total_++;
  }
  void give_back(std::uint32_t place) { free_.push_back(place); }

  [[nodiscard]] T& operator[](std::uint32_t place) { return pages_[place]; }
  [[nodiscard]] const T& operator[](std::uint32_t place) const { return pages_[place]; }
  [[nodiscard]] std::span<const T> view() const { return {pages_.data(), total_}; }
  /// Pages ever used, and the list.
  [[nodiscard]] std::uint64_t bytes() const {
    return total_ * sizeof(T) + free_.capacity() * sizeof(std::uint32_t);
  }

 private:
  // Room is addresses, not memory, and to move it later takes the kernel time.
  static constexpr std::size_t kFirstRoom = 16384, kAtOnce = 128;
  LazyArray<T> pages_;
  std::uint32_t total_ = 0;
  std::vector<std::uint32_t> free_;
};

/// What trees are made of. Several may share one; each is known by its root's entry.
struct TreeArrays {
  TreePages<TreeNode> nodes;
  TreePages<FaceBlock> blocks;

  /// Gives back all that is below an entry.
  void free_below(TreeEntry::Kind kind, std::uint32_t first) {
    if (kind == TreeEntry::Kind::kFaces) blocks.give_back(first);
    if (kind != TreeEntry::Kind::kInner) return;
    const TreeNode& node = nodes[first];
    for (std::uint32_t left = node.lanes; left != 0; left &= left - 1) {
      const auto lane = static_cast<std::uint32_t>(std::countr_zero(left));
      free_below(node.kind(lane), node.first[lane]);
    }
    nodes.give_back(first);
  }
};

}  // namespace nearmesh
