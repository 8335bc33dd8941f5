// SPDX-License-Identifier: Apache-2.0
#pragma once
// A body cut by the plane y = y_m of the world: what of its faces and of its boxes lies in it.

#include "canvas.hpp"
#include "exchange.hpp"

namespace nearmesh::concepts {

/// Where a face meets the plane: x and z, metres.
struct CutFace {
  FaceKey key;
  std::array<Point, 2> line;
  bool is_exact = true;
};
[[nodiscard]] std::vector<CutFace> cut_faces(const Body& body, const std::vector<Face>& faces,
                                             double y_m);

/// Where a node's box meets the plane, and what its half-spaces leave of that: each a convex
/// polygon, perhaps empty.
struct CutNode {
  NodeSpan node;
  std::vector<Point> box, rest;
};
/// Only nodes whose box the plane meets.
[[nodiscard]] std::vector<CutNode> cut_nodes(const Body& body, const std::vector<Unresolved>& nodes,
                                             double y_m);

/// The part of a convex polygon for which normal . p <= bound.
[[nodiscard]] std::vector<Point> clip(const std::vector<Point>& polygon, const Point& normal,
                                      double bound);

}  // namespace nearmesh::concepts
