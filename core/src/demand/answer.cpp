// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/core/demand/answer.hpp"

#include <algorithm>
#include <utility>

namespace nearmesh {

Result<std::vector<std::vector<std::uint8_t>>> answer_request(
    const SpmHeader& header, const SplitStore& store, const RegionRequest& request,
    const std::function<Status(NodeSpan)>& require) {
  const Result<Demand> demand = collect(store, request, require, AttachRule::kAlways);
  if (!demand.is_ok()) return demand.status();
  return encode_batches(header, store, demand.value().treelet, BoxPolicy::kCutNodes);
}

AnswerMaker::AnswerMaker(const SpmHeader& header, const SplitStore& store, RegionRequest request,
                         std::function<Status(NodeSpan)> require)
    : header_(header),
      store_(store),
      collector_(std::in_place, store, std::move(request), std::move(require),
                 AttachRule::kAlways) {}

Result<std::vector<std::vector<std::uint8_t>>> AnswerMaker::next() {
  using Batches = std::vector<std::vector<std::uint8_t>>;
  if (collector_) {
    const Result<bool> done = collector_->advance(kPartNodes);
    if (!done.is_ok()) {
      collector_.reset();
      return done.status();
    }
    if (!done.value()) return Batches{};
    treelet_ = collector_->take().treelet;
    collector_.reset();
    // Small answers are whole at once.
    if (treelet_.size() > kPartNodes) return Batches{};
  }
  const auto begin = treelet_.begin() + static_cast<std::ptrdiff_t>(encoded_);
  const std::size_t count = std::min(kPartSplits, treelet_.size() - encoded_);
  encoded_ += count;
  return encode_batches(header_, store_, Treelet(begin, begin + static_cast<std::ptrdiff_t>(count)),
                        BoxPolicy::kCutNodes);
}

}  // namespace nearmesh
