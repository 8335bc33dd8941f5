// SPDX-License-Identifier: Apache-2.0
#include "answer.hpp"

#include <algorithm>
#include <utility>

namespace nearmesh {

Result<std::vector<std::vector<std::uint8_t>>> answer_request(
    const SpmHeader& header, const SplitStore& store, const RegionRequest& request,
    const std::function<Status(NodeSpan)>& require,
    const std::function<std::span<const HalfSpace>(NodeSpan)>& half_spaces_of) {
  const Result<Demand> demand = collect(store, request, require, AttachRule::kAlways);
  NEARMESH_RETURN_IF_ERROR(demand);
  const Treelet& treelet = demand.value().treelet;
  std::vector<NodeHalfSpace> told;
  const auto tell = [&](NodeSpan node, bool is_split) {
    if (is_split || node.size < 2) return;
    for (const HalfSpace& half_space : half_spaces_of(node)) told.push_back({node, half_space});
  };
  if (half_spaces_of) {
    for (const TreeletSplit& split : treelet) {
      tell(split.node.left_of(split.split), split.left_included);
      tell(split.node.right_of(split.split), split.right_included);
    }
    for (const NodeSpan& node : request.attach)
      tell(node, std::any_of(treelet.begin(), treelet.end(),
                             [&](const TreeletSplit& split) { return split.node == node; }));
  }
  std::sort(told.begin(), told.end());
  return encode_batches(header, store, treelet, BoxPolicy::kCutNodes, kMaxBatchBytes, told);
}

AnswerMaker::AnswerMaker(const SpmHeader& header, const SplitStore& store, RegionRequest request,
                         std::function<Status(NodeSpan)> require)
    : header_(header),
      store_(store),
      collector_(std::in_place, store, std::move(request), std::move(require),
                 AttachRule::kAlways) {}

Result<std::vector<std::vector<std::uint8_t>>> AnswerMaker::next() {
  using Batches = std::vector<std::vector<std::uint8_t>>;
  const auto is_later = [](const TreeletSplit& a, const TreeletSplit& b) {
    return b.node < a.node;
  };
  if (collector_) {
    const Result<bool> done = collector_->advance(kPartNodes);
    if (!done.is_ok()) {
      collector_.reset();
      return done.status();
    }
    if (!done.value()) return Batches{};
    unordered_ = collector_->take().treelet;
    collector_.reset();
    std::make_heap(unordered_.begin(), unordered_.end(), is_later);
    if (unordered_.size() > kPartNodes) return Batches{};  // small answers are whole at once
  }
  next_.erase(next_.begin(), next_.begin() + static_cast<std::ptrdiff_t>(encoded_));
  while (next_.size() < kPartSplits && !unordered_.empty()) {
    std::pop_heap(unordered_.begin(), unordered_.end(), is_later);
    next_.push_back(unordered_.back());
    unordered_.pop_back();
  }
  Batches batches = encode_batches(header_, store_, next_, BoxPolicy::kCutNodes);
  encoded_ = next_.size();
  if (!unordered_.empty() && batches.size() > 1) {  // the last is not full: again, with the next
    encoded_ -= decode_batch(header_, batches.back()).value().splits.size();
    batches.pop_back();
  }
  return batches;
}

}  // namespace nearmesh
