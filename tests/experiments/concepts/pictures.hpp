// SPDX-License-Identifier: Apache-2.0
#pragma once
// The pictures of docs/concepts.md.

#include "exchange.hpp"

namespace nearmesh::concepts {

struct Picture {
  std::string name;  ///< of the file, without .svg
  std::string svg;
};
/// All of them. Errors: those of exchange().
[[nodiscard]] Result<std::vector<Picture>> draw_all();

[[nodiscard]] std::string draw_levels(const Exchange& hill);
[[nodiscard]] std::string draw_cut(const Exchange& hill);
[[nodiscard]] std::string draw_forest(const Exchange& patch);
[[nodiscard]] std::string draw_slot(const Exchange& hill);
[[nodiscard]] std::string draw_certificate(const Exchange& hill);

}  // namespace nearmesh::concepts
