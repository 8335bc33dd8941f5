// SPDX-License-Identifier: Apache-2.0
#pragma once
// What a peer says that holds all of a model (core/replica/held_nodes.hpp).

#include <cstdint>
#include <vector>

#include "nearmesh/core/spm/detail/header.hpp"

namespace nearmesh::test {

inline std::vector<std::uint8_t> held_whole(const SpmHeader& header) {
  std::vector<std::uint8_t> bytes(1);
  std::size_t bits = 1;  // the first: no half-spaces
  for (const BaseRoot& root : header.roots)
    for (int i = 0; root.node.size > 1 && i < 2; ++i, ++bits) {  // split, and all below
      bytes.resize(bits / 8 + 1);
      bytes[bits / 8] |= static_cast<std::uint8_t>(1U << bits % 8);
    }
  return bytes;
}

}  // namespace nearmesh::test
