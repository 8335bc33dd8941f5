// SPDX-License-Identifier: Apache-2.0
#pragma once
// Half-edge collapses by quadric error down to a small base (takes GridMesh, gives CollapseLog).
// Sources: Garland and Heckbert 1997 (quadrics), Hoppe 1996 (progressive meshes), Liu, Georganas,
// Roth 2006, section 3.3. Departures: the kept vertex stays where it is, so every vertex of every
// level is an original vertex; flips are tested against the original normals too (small turns would
// add up); the topology may break, at a price, so that debris goes before what matters; parts that
// vanish whole are merged into near ones.

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
  kReachedTarget,  ///< by edge collapses alone
  kClustered,      ///< whole parts vanished; their last vertices were merged into near ones
  kNothingToDo,    ///< the input was already small enough
};
[[nodiscard]] const char* to_string(StopReason reason);

struct SimplifyOptions {
  std::uint32_t base_faces = 6;             ///< stop at or below this many faces; at least 1
  unsigned threads = 0;                     ///< 0: one for each core; no influence on the result
  std::function<void(double)> on_progress;  ///< called with a share in [0, 1] by the caller's
                                            ///< thread; may be empty
};

struct CollapseLog {
  /// In order; each `removed` occurs once and never again as `kept`.
  std::vector<Collapse> collapses;
  std::uint64_t edge_collapses = 0;  ///< the first ones in the log
  std::uint64_t clustered = 0;       ///< the rest: vertices without faces, by nearness
  std::uint64_t base_faces = 0;      ///< faces of three distinct vertices after all collapses
  std::uint64_t work = 0;            ///< faces looked at, each as often as it was
  StopReason stop = StopReason::kNothingToDo;
};

/// Simplifies to at most options.base_faces faces, always.
/// In: what clean_mesh gives (non-manifold edges, many components, duplicate positions are legal);
/// at most 2^30 vertices. Out: only the corners of the base's faces are left, or one vertex if no
/// face is left (a small target can make the last component vanish whole). Two base faces may have
/// the same corners. A manifold mesh stays manifold unless keeping it so costs 64 times the error;
/// no face turns by more than 60 degrees from its input normal until nothing else can collapse.
/// Deterministic: costs are compared to 7 bits of mantissa, ties go to the shallower subtrees (the
/// forest stays balanced: a flat 256 x 256 grid gives 12 levels), then to the place in Morton
/// order. Of a mesh of more than some 50,000 vertices, cells of 16,384 are simplified apart as far
/// as a cost that samples suggest, on several threads, before the whole is: the error stays that of
/// the whole alone. Cost: O(n log n) time (1 M faces of terrain in 0.9 s on one core), also where
/// all faces share one vertex, about 140 bytes a vertex (230 of a small mesh). Throws nothing but
/// bad_alloc.
[[nodiscard]] CollapseLog simplify(const GridMesh& mesh, const SimplifyOptions& options);

}  // namespace nearmesh
