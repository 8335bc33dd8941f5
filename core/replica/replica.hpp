// SPDX-License-Identifier: Apache-2.0
#pragma once
// One model as far as it is here: header, known splits, active mesh and tree, and the order in
// which they change. Takes batches, gives what a query walks. A peer's session and the proof of its
// recording live by this one class.

#include <cstdint>
#include <map>
#include <set>
#include <span>
#include <vector>

#include "core/refine/refined_mesh.hpp"
#include "core/spm/audit.hpp"
#include "nearmesh/core/abtree/detail/ab_tree.hpp"

namespace nearmesh {

/// Threads: one at a time; views of a replica that does not change may be shared.
class Replica {
 public:
  /// The base mesh. May throw std::bad_alloc: arrays span all ids that a header announces.
  explicit Replica(SpmHeader header);
  /// The same of a header from outside. Errors: those of decode_header; kIo where there is no
  /// address space. `shared`: as for decode_header().
  [[nodiscard]] static Result<Replica> from_header(std::span<const std::uint8_t> bytes,
                                                   SharedTables* shared = nullptr);

  /// Where the time went, seconds of wall clock.
  struct Times {
    double load_s = 0;    ///< T_L: decoding
    double refine_s = 0;  ///< T_R: splits and collapses
    double tree_s = 0;    ///< T_B: the tree
  };
  struct Taken {
    Status status;
    Times times;
    /// The status is of what was said of the model, not of what befell the batch on its way: by
    /// `liar`; 0: by one of several.
    bool contradicts = false;
    std::uint64_t liar = 0;
    bool rests_on_kept = false;  ///< take_kept() brought some of what is here, or this batch
    /// An audit ended with this: what is here of a block was held against the block, which has
    /// these nodes. Else empty.
    std::vector<NodeSpan> audited;
  };
  /// Takes in a batch under its seal. The result depends on the set of batches, not on their order;
  /// repeats are harmless.
  /// Errors: those of decode_sealed, with nothing changed; kCorrupt where a record contradicts the
  /// model or what came before. Then all detail is forgotten, since nobody can tell which part of
  /// it is wrong, and what the same sender sends from there on is counted and dropped. Pieces of an
  /// audit are batches too: the block that they make is held against what is known of it, and
  /// kCorrupt says what was told otherwise, with the hash of both.
  /// Cost: O(batch and the slots that it changes).
  [[nodiscard]] Taken take(std::span<const std::uint8_t> bytes, std::uint64_t sender = 0);
  /// The same of a batch that was kept since an earlier session. Where such detail is held nobody
  /// is to blame for what contradicts it. From the first of these on batches count from
  /// kKeptBatches, so that nobody takes what is here for what was sent since the base mesh.
  [[nodiscard]] Taken take_kept(std::span<const std::uint8_t> bytes);
  static constexpr std::uint32_t kKeptBatches = 1U << 31;
  /// The same of a batch that was decoded elsewhere, with this model's header.
  [[nodiscard]] Taken take(const SplitBatch& batch, std::uint64_t sender = 0);
  /// What this sender sends counts no more, and all detail is forgotten, also what waits for its
  /// parents: nobody proves it.
  void distrust(std::uint64_t sender);
  /// Whether what this sender sent contradicted the model.
  [[nodiscard]] bool distrusts(std::uint64_t sender) const { return distrusted_.contains(sender); }
  [[nodiscard]] const std::set<std::uint64_t>& distrusted() const { return distrusted_; }
  /// Gives up and forgets all detail below the nodes that meet no part of `keep` (the model's
  /// grid).
  /// Cost: O(known nodes that meet `keep`, and what is given up).
  Times give_up(std::span<const RegionPart> keep);

  [[nodiscard]] const SpmHeader& header() const { return refined_.header(); }
  [[nodiscard]] const SplitStore& store() const { return refined_.store(); }
  [[nodiscard]] const ActiveMesh& mesh() const { return refined_.mesh(); }
  [[nodiscard]] const AbTree& tree() const { return tree_; }
  /// Valid until the next change.
  [[nodiscard]] TreeView view() const { return tree_.view(header().grid); }
  /// How many batches came, also of those that were wrong.
  [[nodiscard]] std::uint32_t taken_batches() const { return taken_batches_; }
  /// Splits that came and wait for their parents, and nodes that half-spaces came of and wait for.
  [[nodiscard]] std::size_t parked_splits() const { return refined_.parked_splits(); }
  /// How often detail was given up: from then on what is held is less than what came.
  [[nodiscard]] std::uint32_t give_ups() const { return give_ups_; }

 private:
  [[nodiscard]] Status refine(const SplitBatch& batch, Teller teller, Times& times);
  [[nodiscard]] Teller teller_of(std::uint64_t sender);
  void audit(std::span<const std::uint8_t> piece, std::uint64_t sender, Taken& taken);
  void forget_all();

  RefinedMesh refined_;
  AbTree tree_;  // refers to the mesh, which stays in its place when a Replica moves
  std::set<std::uint64_t> distrusted_;
  std::vector<std::uint64_t> tellers_;           // by number
  bool has_no_spare_teller_ = false;             // since something was given up last
  std::map<std::uint64_t, AuditReader> audits_;  // by sender
  std::uint32_t taken_batches_ = 0;
  std::uint32_t give_ups_ = 0;
  bool has_kept_ = false;
};

}  // namespace nearmesh
