// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/core/simplify/simplify.hpp"

#include "simplifier.hpp"

namespace nearmesh {

const char* to_string(StopReason reason) {
  switch (reason) {
    case StopReason::kReachedTarget:
      return "reached target";
    case StopReason::kClustered:
      return "clustered";
    case StopReason::kNothingToDo:
      return "nothing to do";
  }
  return "unknown";
}

CollapseLog simplify(const GridMesh& mesh, const SimplifyOptions& options) {
  NEARMESH_ASSERT(options.base_faces >= 1);
  NEARMESH_ASSERT(mesh.positions.size() <= simplification::kMaxVertices);
  simplification::Simplifier simplifier(mesh, options);
  for (const simplification::Rule rule : simplification::kRules)
    if (!simplifier.is_done()) simplifier.collapse_edges(rule);
  simplifier.merge_isolated();
  if (options.on_progress) options.on_progress(1.0);
  return simplifier.take_log();
}

}  // namespace nearmesh
