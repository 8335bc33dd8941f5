// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdio>
#include <nlohmann/json.hpp>

namespace nearmesh::program {

/// On standard output; main says where that failed. Names of files may be of any bytes, but JSON is UTF-8: what is none becomes U+FFFD.
inline void print_line(const nlohmann::ordered_json& json) {
  std::printf("%s\n",
              json.dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace).c_str());
}

}  // namespace nearmesh::program
