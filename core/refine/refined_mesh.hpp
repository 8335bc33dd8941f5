// SPDX-License-Identifier: Apache-2.0
#pragma once
// A peer's copy of one model: header, the splits it was sent, and which are active (takes
// SplitBatch, gives RefineDelta).

#include <bitset>
#include <memory>
#include <unordered_map>
#include <vector>

#include "nearmesh/core/refine/detail/active_mesh.hpp"

namespace nearmesh {

/// Who tells batches, as whoever hands them over numbers them.
using Teller = std::uint8_t;
/// More than one told of the split, one that came late among them, or they are too many to be
/// numbered.
inline constexpr Teller kManyTellers = 255;

class RefinedMesh {
 public:
  explicit RefinedMesh(SpmHeader header);

  [[nodiscard]] const SpmHeader& header() const { return header_; }
  [[nodiscard]] const SplitStore& store() const { return *store_; }
  [[nodiscard]] const ActiveMesh& mesh() const { return *mesh_; }

  /// Adds a batch and activates all of it that can be. Splits whose parent has not come are parked
  /// until it does, and so are half-spaces; those of a node that is split already do not count.
  /// Repeats are harmless; the result depends on the set of batches, not on their order.
  /// The delta is what was applied, also beside a status that is not ok: kCorrupt where a record
  /// contradicts the model; records before it stay applied, it and later ones are not. Cost:
  /// O(batch).
  struct Applied {
    Status status;
    RefineDelta delta;
  };
  [[nodiscard]] Applied apply_batch(const SplitBatch& batch, Teller teller = 0);
  /// Who told a known split. Meaningless of one that is not known.
  [[nodiscard]] Teller teller_of(VertexId split) const { return tellers_[split.value]; }
  /// Those who told of what is known, or is parked. Cost: O(known splits).
  [[nodiscard]] std::bitset<kManyTellers + 1> tellers() const;
  /// Makes a node whole; its splits stay known until `forget`. The AB-tree must see the delta
  /// before that.
  [[nodiscard]] RefineDelta collapse(NodeSpan node);
  /// Forgets all splits below a node that is whole. Cost: O(splits forgotten).
  void forget(NodeSpan node);

  /// Also of nodes that half-spaces wait for.
  [[nodiscard]] std::size_t parked_splits() const {
    return parked_.size() + parked_half_spaces_.size();
  }

 private:
  struct Parked {
    SplitRecord record;
    std::vector<SplitFace> faces;
    Teller teller = 0;
  };
  // Parked splits, by the node they divide; and as many nodes with parked half-spaces. Bounded, so
  // that a hostile publisher cannot fill memory; what does not fit is dropped, and asked for again
  // since it stays missing.
  static constexpr std::size_t kMaxParked = 65536;
  static std::uint64_t key(NodeSpan node) { return std::uint64_t{node.begin()} << 32 | node.size; }
  Status insert(const SplitRecord& record, std::span<const SplitFace> faces, Teller teller,
                RefineDelta& delta);
  [[nodiscard]] GridBox outside_of(std::span<const SplitFace> faces) const;
  void park(const SplitRecord& record, std::span<const SplitFace> faces, Teller teller);
  Status unpark(const SplitRecord& parent, RefineDelta& delta);
  [[nodiscard, gnu::noinline]] Status check_against_half_spaces(
      const SplitRecord& record, std::span<const SplitFace> faces) const;
  Status tell(const NodeHalfSpace& told, RefineDelta& delta);
  [[gnu::noinline]] Status tell_parked(const SplitRecord& maker, RefineDelta& delta);
  [[nodiscard]] Status check_faces(std::size_t count);
  [[nodiscard]] Status check_face(const SplitFace& face) const;

  SpmHeader header_;
  // Both behind pointers: ActiveMesh refers to the store when a RefinedMesh moves.
  std::unique_ptr<SplitStore> store_;
  std::unique_ptr<ActiveMesh> mesh_;
  SparseArray<Teller> tellers_;
  std::unordered_map<std::uint64_t, Parked> parked_;
  std::unordered_map<std::uint64_t, std::vector<HalfSpace>> parked_half_spaces_;  // by their node
  // Whose faces check_faces() looks at next: a base face, then an active vertex.
  std::size_t next_base_face_ = 0;
  VertexId next_vertex_{0};
};

}  // namespace nearmesh
