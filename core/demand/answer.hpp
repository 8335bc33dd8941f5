// SPDX-License-Identifier: Apache-2.0
#pragma once
// What a peer is sent for a request: the walk and the encoding that every server of detail shares.

#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "collect.hpp"

namespace nearmesh {

/// The splits below the request's attach nodes that matter to its region, in batches as they
/// travel: attach nodes are always split, boxes are those of cut nodes. None where nothing is to be
/// sent. In: a request that check_request() passed, but for attach nodes that were left out.
/// Errors: those of `require`, see collect(). `half_spaces_of`, where given: what is told of a node
/// that the answer makes, or attaches to, and does not split.
[[nodiscard]] Result<std::vector<std::vector<std::uint8_t>>> answer_request(
    const SpmHeader& header, const SplitStore& store, const RegionRequest& request,
    const std::function<Status(NodeSpan)>& require,
    const std::function<std::span<const HalfSpace>(NodeSpan)>& half_spaces_of = nullptr);

/// The same batches, part by part: many can be served in turns, and nothing is made that is not yet
/// wanted. Threads: one at a time.
class AnswerMaker {
 public:
  /// Nodes looked at, splits encoded: some 0.2 ms each.
  static constexpr std::size_t kPartNodes = 256, kPartSplits = 768;

  /// Header and store must outlive it; the store as in Collector.
  AnswerMaker(const SpmHeader& header, const SplitStore& store, RegionRequest request,
              std::function<Status(NodeSpan)> require);

  /// Batches that are made now, in order; perhaps none yet. Errors: those of `require`; nothing
  /// follows then.
  [[nodiscard]] Result<std::vector<std::vector<std::uint8_t>>> next();
  /// All were given.
  [[nodiscard]] bool is_done() const {
    return !collector_ && unordered_.empty() && encoded_ == next_.size();
  }

 private:
  const SpmHeader& header_;
  const SplitStore& store_;
  std::optional<Collector> collector_;  ///< until the walk is over
  /// A heap, the first in preorder on top: sorting all at once takes a millisecond.
  Treelet unordered_;
  Treelet next_;  ///< in preorder, of which the first encoded_ were given
  std::size_t encoded_ = 0;
};

}  // namespace nearmesh
