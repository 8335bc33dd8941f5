// SPDX-License-Identifier: Apache-2.0
#pragma once
// How large a node of a tree is, for walks of two trees that open the larger of two first.

#include <cmath>

#include "nearmesh/core/abtree/tree.hpp"

namespace nearmesh {

/// The sum of the box's sides, metres.
[[nodiscard]] inline double size_m(const TreeView& tree, const TreeNode& node) {
  std::int64_t sum = 0;
  for (int k = 0; k < 3; ++k) sum += std::int64_t{node.box.hi[k]} - node.box.lo[k];
  return std::ldexp(static_cast<double>(sum), tree.grid->exponent);
}

}  // namespace nearmesh
