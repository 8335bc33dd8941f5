// SPDX-License-Identifier: Apache-2.0
#pragma once
// What a replica holds of its model, in a few kB. Takes a replica, gives bits; with the model's
// file the bits give the splits again. So a peer tells a recorder that came late where to begin.
//
// Bits, the lowest of each byte first: whether half-spaces are told. Then in the order of a walk
// from the roots down, left before right; a vertex of the full mesh has none:
//   0, box      unresolved; box: has a box of its own. Where half-spaces are told: for each of it
//               1, direction, reach; then 0
//   1, 1        every split below is done: nothing below follows
//   1, 0, box   split, and not all below is; both children follow
// Half-spaces are told as they came, so who is told knows as much as who tells.
// Boxes inside of what is done do not count: no answer depends on them before detail is given up.

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "core/replica/replica.hpp"

namespace nearmesh {

struct HeldNodes {
  std::vector<std::uint8_t> bits;
  std::uint64_t box_digest = 0;  ///< of the own boxes of unresolved nodes
};

/// Splits that wait for their parents are left out: what is said is all only where there is none
/// (Replica::parked_splits).
/// Cost: O(splits done).
[[nodiscard]] HeldNodes held_nodes(const Replica& replica);
/// The same of a mesh over any store that knows its splits.
[[nodiscard]] HeldNodes held_nodes(const ActiveMesh& mesh);

/// Goes through such bits a split at a time, for who has something else to do in between.
class HeldWalk {
 public:
  /// As of held_batch(). The model must outlive it.
  HeldWalk(const SplitStore& model, std::function<Status(NodeSpan)> require,
           std::vector<std::uint8_t> bits);

  static constexpr std::size_t kNoMaker = ~std::size_t{0};
  struct Node {
    NodeSpan node;
    VertexId split;  ///< invalid: unresolved
    /// Which of the splits before makes it, counted from 0; none makes a root.
    std::size_t maker = kNoMaker;
    bool has_box = false;
    std::vector<HalfSpace> half_spaces;
  };
  /// The next node of two vertices or more, of which something is said; what makes it came before.
  /// Null: there is no other.
  /// Errors: those of held_batch(); nothing follows then.
  [[nodiscard]] Result<const Node*> next();

 private:
  struct Step {
    NodeSpan node;
    std::size_t maker;
    bool whole;  ///< all below it is done
  };
  [[nodiscard]] Status take(const Step& step);
  bool get();
  [[nodiscard]] std::uint32_t get(int bits);

  const SplitStore* model_;
  std::function<Status(NodeSpan)> require_;
  std::vector<std::uint8_t> bits_;
  std::size_t at_ = 0;
  bool has_failed_ = false;  // it was read beyond the end
  bool tells_half_spaces_;
  std::size_t roots_ = 0, splits_ = 0;  // taken
  std::vector<Step> stack_;
  Node node_;
};

/// What brings a new replica to hold the same, as one batch. `model`: a store that knows the model,
/// or comes to know it by `require`. Whether the same came out is for the caller to see:
/// state_hash() and held_nodes().box_digest.
/// Errors: kInvalidArgument for bits that do not fit the model; those of `require`. Cost:
/// O(splits).
[[nodiscard]] Result<SplitBatch> held_batch(const SplitStore& model,
                                            const std::function<Status(NodeSpan)>& require,
                                            std::span<const std::uint8_t> bits);

}  // namespace nearmesh
