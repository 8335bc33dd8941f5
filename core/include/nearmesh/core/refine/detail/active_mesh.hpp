// SPDX-License-Identifier: Apache-2.0
#pragma once
// Which vertices of a progressive mesh are active: the state of a replica, as a set. The mesh is a
// function of that set (each corner replaced by its nearest active predecessor), so order of
// arrival, repetition and loss cannot change the result, and there are no cracks between fine and
// coarse. Source: Liu, Georganas, Roth 2006, section 3.3 (Local Vertex Split, Local Edge Collapse).
// Departure: a split's only legal condition is that its node is current ("ancestors" closure);
// Hoppe's neighbour conditions are not needed for certified answers.

#include <cstdint>
#include <vector>

#include "nearmesh/core/base/detail/lazy_array.hpp"
#include "nearmesh/core/spm/detail/codec.hpp"
#include "nearmesh/core/spm/detail/half_space.hpp"
#include "nearmesh/core/spm/detail/split_store.hpp"

namespace nearmesh {

/// What one operation changed; read by the AB-tree.
struct RefineDelta {
  std::vector<NodeSpan> collapsed;  ///< nodes that became whole, disjoint; before any split below
  std::vector<VertexId> split;      ///< splits done, parents first
  std::vector<VertexId> boxed;      ///< active splits of which a child's box has come only now
  std::vector<NodeSpan> told_of;    ///< nodes that have got a half-space; some may be split since

  [[nodiscard]] bool is_empty() const {
    return collapsed.empty() && split.empty() && boxed.empty() && told_of.empty();
  }
};

class ActiveMesh {
 public:
  /// The base mesh. The store must outlive this.
  explicit ActiveMesh(const SplitStore& store);

  [[nodiscard]] const SplitStore& store() const { return *store_; }
  [[nodiscard]] bool is_active(VertexId v) const {
    return (bits_[v.value >> 6] >> (v.value & 63U) & 1U) != 0;
  }
  /// Active and standing for itself alone: a vertex of the full mesh in its final place. What
  /// stands for more is unresolved.
  [[nodiscard]] bool is_resolved(VertexId v) const {
    // No branch: what comes of it is hard to foretell.
    const std::uint64_t* words = bits_.data();
    const std::uint32_t after = v.value + 1;
    NEARMESH_ASSERT((after >> 6) < bits_.size());
    return (words[v.value >> 6] >> (v.value & 63U) & words[after >> 6] >> (after & 63U) & 1U) != 0;
  }
  /// Which of [first, first + 64) are active, a bit for each; bits of ids beyond the last mean
  /// nothing.
  [[nodiscard]] std::uint64_t active_bits(VertexId first) const {
    const std::uint64_t* word = bits_.data() + (first.value >> 6);
    const std::uint32_t offset = first.value & 63U;
    // What lies beyond the sentinel's word is nobody's.
    const bool is_last = (first.value >> 6) + 1 >= bits_.size();
    return offset == 0 || is_last ? *word >> offset : *word >> offset | word[1] << (64 - offset);
  }
  /// The active vertex that stands for v: the largest active id <= v.
  [[nodiscard]] VertexId active_predecessor(VertexId v) const;
  /// The active vertex with so many below it. Precondition: there is one. Cost: O(words of bits).
  [[nodiscard]] VertexId active_at(std::uint32_t index) const;
  /// The node that an active vertex stands for now.
  [[nodiscard]] NodeSpan current_node(VertexId v) const;
  /// Whether all three corners are resolved, so that the face is as in the full mesh.
  [[nodiscard]] bool is_exact(const SplitFace& face) const {
    return is_resolved(face.left) && is_resolved(face.right) && is_resolved(face.outside);
  }
  /// Whether the node is in the current front.
  [[nodiscard]] bool is_current(NodeSpan node) const;

  /// Local Vertex Split: does the split and, before it, all that it rests on. Appends to `delta`.
  /// False, with nothing changed, when the store lacks one of them. Cost: O(splits done).
  [[nodiscard]] bool split(VertexId u, RefineDelta& delta);
  /// Local Edge Collapse: makes `node` whole again. Appends to `delta`; nothing happens when it is
  /// whole or coarser.
  /// Cost: O(size / 64).
  void collapse(NodeSpan node, RefineDelta& delta);

  /// Takes a half-space of an unresolved node of the current front; it is gone when the node is
  /// split, or collapsed with one above. Appends to `delta`. False where nothing changed: see
  /// HalfSpaces. Precondition: is_current(node), of two vertices or more.
  bool add_half_space(NodeSpan node, const HalfSpace& half_space, RefineDelta& delta);
  /// Of the unresolved nodes.
  [[nodiscard]] const HalfSpaces& half_spaces() const { return half_spaces_; }

  /// Number of splits done.
  [[nodiscard]] std::uint32_t split_count() const { return split_count_; }
  /// Digest of the set of active vertices and of the half-spaces, a sum; equal sets have equal
  /// digests.
  [[nodiscard]] std::uint64_t state_hash() const { return hash_; }

 private:
  [[nodiscard]] std::uint64_t hash_of_half_spaces(VertexId first) const;
  void drop_half_spaces(VertexId first);

  const SplitStore* store_;
  // One past the last vertex is set, so that is_resolved needs no bound.
  LazyArray<std::uint64_t> bits_;
  std::vector<VertexId> stack_;
  std::uint32_t split_count_ = 0;
  std::uint64_t hash_ = 0;
  HalfSpaces half_spaces_;
};

/// The splits done, as one treelet on the base mesh: what would have to be sent to reach this
/// state.
[[nodiscard]] Treelet active_treelet(const ActiveMesh& mesh);
/// The first `count` splits of global progressive refinement: largest node first, ties to the lower
/// id. Parents come before children. Needs a complete store. Cost: O(n log n).
[[nodiscard]] std::vector<VertexId> global_order(const SplitStore& store, std::uint32_t count);

/// A face of the current mesh: original corners replaced by the active vertices that stand for
/// them.
struct ActiveFace {
  FaceKey key;
  std::array<VertexId, 3> corners;
};
/// The current mesh's faces: base faces, then by split, then index. O(vertices / 64 + faces).
[[nodiscard]] std::vector<ActiveFace> extract_faces(const ActiveMesh& mesh);

}  // namespace nearmesh
