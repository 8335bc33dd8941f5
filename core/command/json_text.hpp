// SPDX-License-Identifier: Apache-2.0
#pragma once
// What programs print with --json.

#include <nlohmann/json.hpp>
#include <string>

namespace nearmesh {

/// On one line, or with so many blanks a level. Paths, and what stands in files, need not be UTF-8,
/// as JSON must be: other bytes are replaced.
template <class Json>
[[nodiscard]] std::string text_of(const Json& json, int indent = -1) {
  return json.dump(indent, ' ', false, Json::error_handler_t::replace);
}

}  // namespace nearmesh
