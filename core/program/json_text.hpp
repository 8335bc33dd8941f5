// SPDX-License-Identifier: Apache-2.0
#pragma once
// What the commands print with --json.

#include <nlohmann/json.hpp>
#include <string>

namespace nearmesh::program {

/// On one line. Paths, and what stands in files, need not be UTF-8, as JSON must be: other bytes are replaced.
[[nodiscard]] inline std::string text_of(const nlohmann::ordered_json& json) {
  return json.dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace);
}

}  // namespace nearmesh::program
