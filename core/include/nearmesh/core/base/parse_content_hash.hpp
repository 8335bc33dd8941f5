// SPDX-License-Identifier: Apache-2.0
#pragma once
// API (docs/api.md).
// A content from the digits that people paste, for pins.

#include <string_view>

#include "nearmesh/core/base/content_hash.hpp"
#include "nearmesh/core/base/status.hpp"

namespace nearmesh {

/// From what `nearmesh-model info` and to_hex() give. Errors: kInvalidArgument for anything else,
/// also for the one that names none.
[[nodiscard]] Result<ContentHash> parse_content_hash(std::string_view text);

}  // namespace nearmesh
