// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/core/demand/answer.hpp"

namespace nearmesh {

Result<std::vector<std::vector<std::uint8_t>>> answer_request(
    const SpmHeader& header, const SplitStore& store, const RegionRequest& request,
    const std::function<Status(NodeSpan)>& require) {
  const Result<Demand> demand = collect(store, request, require, AttachRule::kAlways);
  if (!demand.is_ok()) return demand.status();
  return encode_batches(header, store, demand.value().treelet, BoxPolicy::kCutNodes);
}

}  // namespace nearmesh
