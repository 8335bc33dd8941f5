// SPDX-License-Identifier: Apache-2.0
#pragma once
// API (docs/api.md).
// What a model is called by those who must not mistake it for another.

#include <cstdint>
#include <string_view>

#include "nearmesh/core/base/status.hpp"

namespace nearmesh {

/// Of all that peers may get of a model; zero names none.
using ContentHash = std::uint64_t;

/// From the digits that `nearmesh-model info` prints. Errors: kInvalidArgument for anything else, also for the one that names none.
[[nodiscard]] Result<ContentHash> parse_content_hash(std::string_view text);

}  // namespace nearmesh
