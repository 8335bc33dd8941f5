// SPDX-License-Identifier: Apache-2.0
#pragma once
// Rays through one tree: the first exact face that each meets, and the unresolved nodes whose boxes
// it may meet up to there.

#include <span>
#include <vector>

#include "lattice_probes.hpp"
#include "nearmesh/core/query/probe.hpp"

namespace nearmesh {

/// A ray on a lattice: what is left of it in some bounds.
struct CutRay {
  LatticeRay ray;
  double begin_m = 0, end_m = 0;  ///< where it begins and ends, from the probe's origin
  bool is_empty = true;           ///< nothing is left

  [[nodiscard]] double at_m(double t) const { return begin_m + t * (end_m - begin_m); }
};
/// `bounds` may be grown by a cell, and by what doubles tell at such a place. Preconditions: the
/// ray is finite but for its range, which is not negative; its direction is not 0.
[[nodiscard]] CutRay cut_ray(const RayProbe& ray, const LatticeBox& bounds, int lattice_exp);
/// Holds every posed vertex of any model in the frame's grid: so how a ray is cut follows from grid
/// and pose alone.
[[nodiscard]] LatticeBox bounds_of(const PosedFrame& frame);

/// An unresolved node that a ray may meet, no earlier than `enter`.
struct NodeOnRay {
  TreePlace place = 0;
  double enter = 0;
};
struct RayFound {
  bool has_face = false;
  RayHit hit;
  FaceKey key;
  LatticeTriangle face;
  std::uint32_t first_node = 0, nodes = 0;  ///< among the nodes found

  /// From there on nothing matters any more.
  [[nodiscard]] double limit() const { return has_face ? hit.t + hit.error : 1; }
};
/// Whether a hit of the ray comes before another: earlier, or at the same point with the lesser
/// key.
[[nodiscard]] bool comes_before(const LatticeRay& ray, const RayFound& one, const RayFound& other);

/// Lattice points in units of a body's grid, in doubles, with what that and the posing of vertices
/// leave open.
struct GridView {
  explicit GridView(const PosedFrame& frame);
  [[nodiscard]] std::array<double, 3> point(const LatticePoint& at) const;

  /// A posed face whose corners' grid points lie in a box lies, as seen here, within this of the
  /// box, a ray's rounding included (ray_walk.cpp).
  std::array<double, 3> margin{};

 private:
  std::array<double, 9> inverse_{};
  std::array<std::int64_t, 3> origin_{};
  std::array<double, 3> beyond_{};
};

/// Adds to `nodes` those that each ray may meet before its hit, in the order of the tree.
void walk_rays(const TreeView& tree, const PosedFrame& frame, std::span<const CutRay> rays,
               std::span<RayFound> found, std::vector<NodeOnRay>& nodes, QueryStats& stats);

}  // namespace nearmesh
