// SPDX-License-Identifier: Apache-2.0
#pragma once
// What probes of one body, or of a world's tiles, have in common inside: how a ray is checked, cut,
// told and what it lacks collected.

#include <map>

#include "nearmesh/core/query/probe.hpp"
#include "ray_walk.hpp"

namespace nearmesh {

/// On the lattice of a body's own. Errors: those of check_pose and make_posed_frame.
[[nodiscard]] Result<PosedFrame> probe_frame(const Grid& grid, const Pose& pose);
/// Whether a probe is one. Errors: kInvalidArgument naming it by its place.
[[nodiscard]] Status check_ray(const RayProbe& ray, std::size_t place);
[[nodiscard]] Status check_ball(const BallProbe& ball, std::size_t place, int lattice_exp);
[[nodiscard]] Status check_box(const BoxProbe& box, std::size_t place);

/// Collects nodes, each with a box around the parts of it that matter.
class NeedsMaker {
 public:
  void add(const TreeEntry& node, const GridBox& where) { add(node.unresolved_node(), where); }
  void add(NodeSpan node, const GridBox& where);
  [[nodiscard]] ProbeNeeds take(const QueryStats& stats);

 private:
  struct Part {
    NodeSpan node;
    GridBox where;
  };
  std::map<std::uint32_t, Part> parts_;  // by first vertex
};
void add_node_on_ray(const TreeView& tree, const GridView& view, const CutRay& cut,
                     const NodeOnRay& node, double limit, NeedsMaker& needs);
/// Face, place and normal of what a ray hits first, as far as is known.
void tell_hit(const CutRay& cut, const RayFound& found, int lattice_exp, RayAnswer& answer);

}  // namespace nearmesh
