// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

namespace nearmesh {

/// "1 peer", "2 peers": for what people read. In: a word that takes an s.
[[nodiscard]] inline std::string counted(std::uint64_t count, std::string_view one) {
  std::string text = std::to_string(count) + " ";
  text += one;
  if (count != 1) text += "s";
  return text;
}

}  // namespace nearmesh
