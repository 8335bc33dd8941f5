// SPDX-License-Identifier: Apache-2.0
#pragma once
// What a walk of two trees keeps while it runs: nodes in their places, and the pairs still to be looked at. One for each
// thread, so that no query allocates it anew.

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <vector>

#include "nearmesh/core/abtree/tree.hpp"
#include "nearmesh/core/geometry/placed_boxes.hpp"

namespace nearmesh {

/// The latest of one tree's nodes or blocks: a walk comes back to the same ones. Kept in the order of their coming, so that
/// short walks stay in the nearest cache.
template <class Boxes>
class Placed {
 public:
  [[nodiscard]] const Boxes* find(std::uint32_t which) const {
    const Entry& entry = entries_[which % kEntries];
    return entry.which == which ? &boxes_[entry.at] : nullptr;
  }
  /// Where to place what is not held yet.
  Boxes& add(std::uint32_t which) {
    const std::uint32_t at = next_++ % kHeld, entry = which % kEntries;
    Entry& former = entries_[entry_of_[at]];
    if (former.at == at) former.which = kNone;
    entries_[entry] = {which, at};
    entry_of_[at] = entry;
    return boxes_[at];
  }
  void clear() {
    for (std::uint32_t at = 0; at < std::min(next_, kHeld); ++at)
      entries_[entry_of_[at]].which = kNone;
    next_ = 0;
  }

 private:
  static constexpr std::uint32_t kHeld = 64, kEntries = 128, kNone = 0xffffffffU;
  struct Entry {
    std::uint32_t which = kNone, at = 0;
  };
  std::array<Entry, kEntries> entries_;
  std::array<std::uint32_t, kHeld> entry_of_{};
  std::uint32_t next_ = 0;
  std::array<Boxes, kHeld> boxes_;
};

/// A part of each body whose boxes may meet. Of a part of kind kFaces: the faces that may, as far as is known.
struct PendingPair {
  TreePlace place[2];     ///< a's and b's
  std::uint8_t faces[2];  ///< as bits
};

/// The pairs still to be looked at, side by side. What is beyond `size` may be overwritten by any push.
struct PairStack {
  std::vector<std::uint32_t> place[2], faces;  ///< faces of both in one, b's kLanes bits higher
  std::size_t size = 0;

  void reserve(std::size_t more) {
    if (faces.size() >= size + more) return;
    for (std::vector<std::uint32_t>* of : {&place[0], &place[1], &faces})
      of->resize(2 * size + more + 1024);
  }
  /// Precondition: reserved.
  void push(const PendingPair& pair) {
    place[0][size] = pair.place[0];
    place[1][size] = pair.place[1];
    faces[size++] = pair.faces[0] | std::uint32_t{pair.faces[1]} << kLanes;
  }
  /// Precondition: not empty.
  PendingPair pop() {
    --size;
    return {
        {place[0][size], place[1][size]},
        {static_cast<std::uint8_t>(faces[size]), static_cast<std::uint8_t>(faces[size] >> kLanes)}};
  }
};

struct WalkMemory {
  Placed<PlacedBoxes> nodes[2];  ///< a's and b's
  Placed<PlacedFaces> blocks[2];
  PairStack stack;

  void clear() {
    for (auto& placed : nodes) placed.clear();
    for (auto& placed : blocks) placed.clear();
    stack.size = 0;
  }
};

}  // namespace nearmesh
