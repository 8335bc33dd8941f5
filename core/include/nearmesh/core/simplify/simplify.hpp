// SPDX-License-Identifier: Apache-2.0
#pragma once
// Half-edge collapses by quadric error down to a small base (takes GridMesh, gives CollapseLog).
// Sources: Garland and Heckbert 1997 (quadrics), Hoppe 1996 (progressive meshes), the paper section 3.3.
// Departures: the kept vertex stays where it is, so every vertex of every level is an original vertex; flips are
// tested against the original normals too (small turns would add up); what cannot collapse by edges is clustered.

#include <cstdint>
#include <functional>
#include <vector>

#include "nearmesh/core/mesh/clean.hpp"

namespace nearmesh {

/// `removed` merges into `kept`; both are indices into GridMesh::positions.
struct Collapse {
  std::uint32_t removed = 0;
  std::uint32_t kept = 0;
};

enum class StopReason : std::uint8_t {
  kReachedTarget,   ///< by edge collapses alone
  kClustered,       ///< edge collapses ran out (topology); the rest was merged by nearness
  kNothingToDo,     ///< the input was already small enough
};
[[nodiscard]] const char* to_string(StopReason reason);

struct SimplifyOptions {
  std::uint32_t base_faces = 256;                  ///< stop at or below this many faces; at least 1
  std::function<void(double)> on_progress;         ///< called with a share in [0, 1]; may be empty
};

struct CollapseLog {
  std::vector<Collapse> collapses;  ///< in order; each `removed` occurs once and never again as `kept`
  std::uint64_t edge_collapses = 0, clustered = 0;
  std::uint64_t base_faces = 0;     ///< faces of three distinct vertices after all collapses
  StopReason stop = StopReason::kNothingToDo;
};

/// Simplifies to at most options.base_faces faces, always.
/// In: what clean_mesh gives (non-manifold edges, many components, duplicate positions are legal).
/// Deterministic: ties in cost are broken by vertex index. Cost: O(n log n) time, about 200 bytes a vertex.
[[nodiscard]] CollapseLog simplify(const GridMesh& mesh, const SimplifyOptions& options);

}  // namespace nearmesh
