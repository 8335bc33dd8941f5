// SPDX-License-Identifier: Apache-2.0
#pragma once
// What a peer is sent for a request: the walk and the encoding that every server of detail shares.

#include <cstdint>
#include <functional>
#include <vector>

#include "nearmesh/core/demand/collect.hpp"

namespace nearmesh {

/// The splits below the request's attach nodes that matter to its region, in batches as they travel: attach nodes are always
/// split, boxes are those of cut nodes. None where nothing is to be sent. In: a request that check_request() passed, but for
/// attach nodes that were left out. Errors: those of `require`, see collect().
[[nodiscard]] Result<std::vector<std::vector<std::uint8_t>>> answer_request(
    const SpmHeader& header, const SplitStore& store, const RegionRequest& request,
    const std::function<Status(NodeSpan)>& require);

}  // namespace nearmesh
