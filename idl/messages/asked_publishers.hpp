// SPDX-License-Identifier: Apache-2.0
#pragma once
// Whom a peer has asked for anything: it takes in no batches of others, whatever they say that they
// answer. Anybody can write into a peer's partition; what nobody asked for must neither wait before
// what was asked, nor count as taken in. One rule for peers and for who lives through a recording
// of them, so both take in the same.

#include <vector>

#include "core/base/lru_map.hpp"
#include "nearmesh/idl/messages/messages.hpp"

namespace nearmesh::wire {

/// Those that were asked last, as many as a HeldDetail lists. Threads: one at a time.
class AskedPublishers {
 public:
  /// A request goes to it. Out: it is new here.
  bool note(SessionId publisher) {
    if (last_.use(publisher) != nullptr) return false;
    last_.put(publisher, 0);
    return true;
  }
  [[nodiscard]] bool has(SessionId publisher) const { return last_.find(publisher) != nullptr; }
  /// A batch has come. The last counts, not the highest: a publisher that lost the peer for a while
  /// counts from 1 again.
  void hear(const SplitBatchMessage& batch) {
    if (std::uint32_t* const last = last_.use(batch.publisher)) *last = batch.sequence;
  }
  /// By publisher; 0: nothing has come of it.
  [[nodiscard]] std::vector<HeldDetail::Heard> heard() const {
    std::vector<HeldDetail::Heard> heard;
    last_.for_each([&](SessionId publisher, std::uint32_t sequence) {
      heard.push_back({publisher, sequence});
    });
    return heard;
  }

 private:
  LruMap<SessionId, std::uint32_t> last_{kMaxHeardPublishers};
};

}  // namespace nearmesh::wire
