// SPDX-License-Identifier: Apache-2.0
#pragma once
// The faces that pairs name, in their places.

#include <cstdint>
#include <vector>

#include "nearmesh/core/query/query.hpp"

namespace nearmesh {

/// The faces of one body that touch.
struct TouchingFaces {
  std::vector<FaceKey> keys;                      // ascending
  std::vector<std::array<GridPoint, 3>> corners;  // of each
  std::vector<LatticeTriangle> posed;
  std::vector<double> uncertainty_m;   // of each; empty: all exact
  std::vector<std::uint32_t> of_pair;  // place in keys, by pair

  [[nodiscard]] double uncertainty(std::uint32_t face) const {
    return uncertainty_m.empty() ? 0 : uncertainty_m[face];
  }
};

/// Those of one side of the pairs. Preconditions (asserted): the tree holds them.
/// Cost: O(pairs log pairs); a tree without a store is searched for them, O(its faces).
[[nodiscard]] TouchingFaces collect_faces(const TreeView& tree, const PosedFrame& frame,
                                          const std::vector<FacePair>& pairs,
                                          FaceKey FacePair::*side);

}  // namespace nearmesh
