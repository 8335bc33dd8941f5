// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/core/simplify/detail/simplify.hpp"

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
  using namespace simplification;
  CollapseLog log;
  log.collapses.reserve(mesh.positions.size());
  Patch patch = simplify_cells(place_mesh(mesh), options, log);
  const double done = log.collapses.empty() ? 0 : kShareOfCells;
  const std::size_t vertices = patch.vertices.size();
  Simplifier simplifier(std::move(patch), vertices, options.base_faces);
  if (options.on_progress)
    simplifier.on_progress([&](double share) { options.on_progress(done + (1 - done) * share); });
  if (!simplifier.is_done()) log.stop = StopReason::kReachedTarget;
  simplifier.start_phase(kFineErrorWeight, mesh.faces.size() / kCoarseShare);
  simplifier.collapse_edges(Rule::kAll);
  simplifier.start_phase(kCoarseErrorWeight, 0);
  for (const Rule rule : kRules)
    if (!simplifier.is_done()) simplifier.collapse_edges(rule);
  if (!simplifier.is_done()) simplifier.collapse_crowded();
  log.clustered = simplifier.merge_isolated();
  if (log.clustered > 0 && log.stop == StopReason::kReachedTarget)
    log.stop = StopReason::kClustered;
  log.collapses.insert(log.collapses.end(), simplifier.collapses().begin(),
                       simplifier.collapses().end());
  log.edge_collapses = log.collapses.size() - log.clustered;
  log.base_faces = simplifier.faces_left();
  log.work += simplifier.work();
  if (options.on_progress) options.on_progress(1.0);
  return log;
}

}  // namespace nearmesh
