// SPDX-License-Identifier: Apache-2.0
#pragma once
// What was heard of each peer, counted: of so many that were heard last, since in weeks many come and go.

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <map>

#include "nearmesh/subscriber/dds/dds_channel.hpp"

namespace nearmesh::subscriber {

/// Threads: one at a time.
class PoseTally {
 public:
  explicit PoseTally(std::size_t most) : most_(most) {}

  /// To count what came of it. Where there are too many peers, who was heard longest ago makes room.
  [[nodiscard]] PoseCounts& of(wire::SessionId peer) {
    if (counted_.size() >= most_ && !counted_.contains(peer))
      counted_.erase(std::min_element(counted_.begin(), counted_.end(),
                                      [](const auto& one, const auto& other) {
                                        return one.second.heard < other.second.heard;
                                      }));
    Counted& counted = counted_[peer];
    counted.heard = ++turns_;
    return counted.counts;
  }
  [[nodiscard]] std::map<wire::SessionId, PoseCounts> counts() const {
    std::map<wire::SessionId, PoseCounts> counts;
    for (const auto& [peer, counted] : counted_) counts.emplace(peer, counted.counts);
    return counts;
  }

 private:
  struct Counted {
    PoseCounts counts;
    std::uint64_t heard = 0;  ///< in this turn, the last time
  };
  const std::size_t most_;
  std::map<wire::SessionId, Counted> counted_;
  std::uint64_t turns_ = 0;
};

}  // namespace nearmesh::subscriber
