// SPDX-License-Identifier: Apache-2.0
#pragma once
// What a recording knows of one model: every split that any peer was sent, and since when. Takes
// recorded batches, answers region requests as the publisher did, as far as the recording goes:
// what it lacks is not sent, and stays missing at the peer that asked.

#include <cstdint>
#include <map>
#include <memory>
#include <span>
#include <vector>

#include "core/refine/refined_mesh.hpp"

namespace nearmesh::publisher {

/// Threads: one at a time.
class RecordedDetail {
 public:
  /// May throw std::bad_alloc: arrays span all ids that a header announces.
  explicit RecordedDetail(SpmHeader header);

  /// A batch that some peer was sent as message `id`; ids do not descend. Out: what is wrong with
  /// it; what was right before the fault is kept.
  [[nodiscard]] Status add(std::int64_t id, std::span<const std::uint8_t> batch);

  /// The splits below the request's attach nodes that matter to its region and were delivered
  /// before message `end`, with the half-spaces of nodes that these leave unresolved, in batches as
  /// the publisher encodes them; none when there are none. Attach nodes that were not known then
  /// are left out. Boxes are those of the whole recording, or an ancestor's where every batch had
  /// split the node: both enclose the faces.
  /// Errors: kInvalidArgument, as check_request. Cost: O(splits looked at); going back in time
  /// forgets what was looked at.
  [[nodiscard]] Result<std::vector<std::vector<std::uint8_t>>> answer(const RegionRequest& request,
                                                                      std::int64_t end);

  [[nodiscard]] std::uint32_t known_splits() const { return all_.store().known_splits(); }

 private:
  void rewind(std::int64_t end);
  /// Makes the split of a node of `now_` known to it, if it was delivered by then.
  [[nodiscard]] Status require(NodeSpan node);
  [[nodiscard]] bool reach(NodeSpan node);
  /// What was told of a node before end_. Valid until the next call.
  [[nodiscard]] std::span<const HalfSpace> half_spaces_of(NodeSpan node);

  RefinedMesh all_;                    ///< everything, of all times
  LazyArray<std::int64_t> delivered_;  ///< by split: the first message after which it was whole
  struct Told {
    std::int64_t id;  ///< of the message
    HalfSpace half_space;
  };
  std::map<NodeSpan, std::vector<Told>> told_;  ///< half-spaces, as they came
  std::vector<HalfSpace> told_by_then_;         ///< of the node that was asked for last
  /// Of what was delivered before end_, that which was asked for.
  std::unique_ptr<SplitStore> now_;
  std::int64_t end_ = 0;
};

}  // namespace nearmesh::publisher
