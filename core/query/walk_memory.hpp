// SPDX-License-Identifier: Apache-2.0
#pragma once
// What a walk of two trees keeps while it runs: nodes and blocks in their places, and the pairs
// still to be looked at. A short walk needs what is in here, some 48 KB of stack, and allocates
// nothing; a long one takes 190 KB more.

#include <algorithm>
#include <array>
#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

#include "core/geometry/placed_boxes.hpp"
#include "nearmesh/core/abtree/detail/tree.hpp"

namespace nearmesh {

/// The latest of one tree's nodes or blocks: a walk comes back to the same ones. Kept in the order
/// of their coming, so that short walks stay in the nearest cache.
template <class Boxes, std::uint32_t kFirst>
class Placed {
 public:
  Placed() { which_.fill(kNone); }  // the rest is not read before it is written
  Placed(const Placed&) = delete;
  Placed& operator=(const Placed&) = delete;

  [[nodiscard]] const Boxes* find(std::uint32_t which) const {
    const std::uint32_t entry = which % kEntries;
    return which_[entry] == which ? held_[entry] : nullptr;
  }
  /// Where to place what is not held yet.
  Boxes& add(std::uint32_t which) {
    if (next_ == kFirst) more_ = std::make_unique_for_overwrite<Boxes[]>(kHeld - kFirst);
    const std::uint32_t at = static_cast<std::uint32_t>(next_++ % kHeld), entry = which % kEntries;
    Boxes* const place = at < kFirst ? &first_[at] : &more_[at - kFirst];
    if (next_ > kHeld && held_[entry_of_[at]] == place) which_[entry_of_[at]] = kNone;
    which_[entry] = which;
    held_[entry] = place;
    entry_of_[at] = entry;
    return *place;
  }

 private:
  static constexpr std::uint32_t kHeld = 64, kEntries = 128, kNone = 0xffffffffU;
  std::size_t next_ = 0;
  std::array<std::uint32_t, kEntries> which_;
  std::array<Boxes*, kEntries> held_;
  std::array<std::uint32_t, kHeld> entry_of_;
  std::array<Boxes, kFirst> first_;
  std::unique_ptr<Boxes[]> more_;
};
using PlacedTreeNodes = Placed<PlacedBoxes, 16>;
using PlacedTreeBlocks = Placed<PlacedFaces, 8>;

/// A part of each body whose boxes may meet. Of a part of kind kFaces: the faces that may, as far
/// as is known.
struct PendingPair {
  TreePlace place[2];     ///< a's and b's
  std::uint8_t faces[2];  ///< as bits
};

/// The pairs still to be looked at, side by side. What is beyond `size` may be overwritten by any
/// push.
struct PairStack {
  std::uint32_t *place[2], *faces;  ///< faces of both in one, b's kLanes bits higher
  std::size_t size = 0;

  PairStack() { use(first_room_.data(), kFirst); }
  PairStack(const PairStack&) = delete;
  PairStack& operator=(const PairStack&) = delete;

  void reserve(std::size_t more) {
    if (size + more > room_) grow(2 * (size + more));
  }
  /// Precondition: reserved.
  void push(const PendingPair& pair) {
    place[0][size] = pair.place[0];
    place[1][size] = pair.place[1];
    faces[size++] = pair.faces[0] | std::uint32_t{pair.faces[1]} << kLanes;
  }
  [[nodiscard]] PendingPair at(std::size_t i) const {
    return {{place[0][i], place[1][i]},
            {static_cast<std::uint8_t>(faces[i]), static_cast<std::uint8_t>(faces[i] >> kLanes)}};
  }
  /// Precondition: not empty.
  PendingPair pop() { return at(--size); }

 private:
  static constexpr std::size_t kFirst = 256;

  void use(std::uint32_t* memory, std::size_t room) {
    place[0] = memory;
    place[1] = memory + room;
    faces = memory + 2 * room;
    room_ = room;
  }
  void grow(std::size_t room) {
    std::vector<std::uint32_t> memory(3 * room);
    std::size_t to = 0;
    for (const std::uint32_t* of : {place[0], place[1], faces}) {
      std::copy(of, of + size, memory.data() + to);
      to += room;
    }
    more_room_ = std::move(memory);
    use(more_room_.data(), room);
  }

  std::size_t room_;
  std::array<std::uint32_t, 3 * kFirst> first_room_;
  std::vector<std::uint32_t> more_room_;
};

struct WalkMemory {
  PlacedTreeNodes nodes[2];  ///< a's and b's
  PlacedTreeBlocks blocks[2];
  PairStack stack, ends;
};

}  // namespace nearmesh
