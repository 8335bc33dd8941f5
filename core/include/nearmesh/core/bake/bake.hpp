// SPDX-License-Identifier: Apache-2.0
#pragma once
// API (docs/api.md).
// From a cleaned mesh to a complete progressive model in memory: simplify, number the merge forest,
// bound every node, give each face to its split, train the coding tables. Takes GridMesh, gives
// what write_model_file writes.

#include <vector>

#include "nearmesh/core/mesh/clean.hpp"
#include "nearmesh/core/simplify/detail/simplify.hpp"
#include "nearmesh/core/spm/model_file.hpp"

namespace nearmesh {

struct BakedModel {
  SpmHeader header;
  SplitStore store;  ///< complete
  std::vector<FaceNumber> numbers;
  CollapseLog log;  ///< for the report
};

enum class TableChoice : std::uint8_t {
  kFewestBytes,  ///< a built-in set, or the model's own where that saves a peer bytes
  kBuiltIn,      ///< a built-in set: for many models of one kind
};

/// In: what clean_mesh gives, with its rounding error. Errors: kUnsupported from 2^30 vertices or
/// faces on, where hundreds of faces share one edge, so that their split does not fit a datagram,
/// or where the forest is deeper than kMaxForestDepth. Deterministic, on any number of threads.
/// Cost: O(n log n), about 250 bytes a vertex.
[[nodiscard]] Result<BakedModel> bake(const GridMesh& mesh, double rounding_error_m,
                                      const SimplifyOptions& options,
                                      TableChoice tables = TableChoice::kFewestBytes);

}  // namespace nearmesh
