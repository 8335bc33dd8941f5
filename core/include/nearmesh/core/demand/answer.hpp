// SPDX-License-Identifier: Apache-2.0
#pragma once
// What a peer is sent for a request: the walk and the encoding that every server of detail shares.

#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

#include "nearmesh/core/demand/collect.hpp"

namespace nearmesh {

/// The splits below the request's attach nodes that matter to its region, in batches as they travel: attach nodes are always
/// split, boxes are those of cut nodes. None where nothing is to be sent. In: a request that check_request() passed, but for
/// attach nodes that were left out. Errors: those of `require`, see collect().
[[nodiscard]] Result<std::vector<std::vector<std::uint8_t>>> answer_request(
    const SpmHeader& header, const SplitStore& store, const RegionRequest& request,
    const std::function<Status(NodeSpan)>& require);

/// The same, part by part: many can be served in turns, and nothing is made that is not yet wanted. Threads: one at a time.
class AnswerMaker {
 public:
  /// Some 0.3 ms each: nodes looked at, splits encoded. Answers up to the latter are made of the same batches as
  /// answer_request()'s; larger ones have a batch that is not full at the end of each part.
  static constexpr std::size_t kPartNodes = 768, kPartSplits = 2048;

  /// Header and store must outlive it; the store as in Collector.
  AnswerMaker(const SpmHeader& header, const SplitStore& store, RegionRequest request,
              std::function<Status(NodeSpan)> require);

  /// Batches that are made now, in order; perhaps none yet. Errors: those of `require`; nothing follows then.
  [[nodiscard]] Result<std::vector<std::vector<std::uint8_t>>> next();
  /// All were given.
  [[nodiscard]] bool is_done() const { return !collector_ && encoded_ == treelet_.size(); }

 private:
  const SpmHeader& header_;
  const SplitStore& store_;
  std::optional<Collector> collector_;  ///< until the walk is over
  Treelet treelet_;
  std::size_t encoded_ = 0;  ///< so many of its splits
};

}  // namespace nearmesh
