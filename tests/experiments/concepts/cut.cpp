// SPDX-License-Identifier: Apache-2.0
#include "cut.hpp"

#include <cmath>

namespace nearmesh::concepts {

std::vector<CutFace> cut_faces(const Body& body, const std::vector<Face>& faces, double y_m) {
  std::vector<CutFace> out;
  for (const Face& face : faces) {
    std::vector<Point> ends;
    for (std::size_t i = 0; i < 3; ++i) {
      Place p = body.place(face.corners[i]), q = body.place(face.corners[(i + 1) % 3]);
      if ((p[1] < y_m) == (q[1] < y_m)) continue;
      if (q < p) std::swap(p, q);  // an edge of two faces gives one point
      const double share = (y_m - p[1]) / (q[1] - p[1]);
      ends.push_back({p[0] + share * (q[0] - p[0]), p[2] + share * (q[2] - p[2])});
    }
    if (ends.size() == 2) out.push_back({face.key, {ends[0], ends[1]}, face.is_exact});
  }
  return out;
}

std::vector<Point> clip(const std::vector<Point>& polygon, const Point& normal, double bound) {
  std::vector<Point> out;
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const Point &p = polygon[i], &q = polygon[(i + 1) % polygon.size()];
    const double at_p = normal[0] * p[0] + normal[1] * p[1] - bound,
                 at_q = normal[0] * q[0] + normal[1] * q[1] - bound;
    if (at_p <= 0) out.push_back(p);
    if ((at_p <= 0) != (at_q <= 0)) {
      const double share = at_p / (at_p - at_q);
      out.push_back({p[0] + share * (q[0] - p[0]), p[1] + share * (q[1] - p[1])});
    }
  }
  return out;
}

std::vector<CutNode> cut_nodes(const Body& body, const std::vector<Unresolved>& nodes, double y_m) {
  std::vector<CutNode> out;
  const double cell_m = std::ldexp(1.0, body.grid().exponent);
  for (const Unresolved& node : nodes) {
    const Place lo = body.place(node.box.lo), hi = body.place(node.box.hi);
    if (lo[1] > y_m || hi[1] < y_m) continue;
    CutNode cut{node.node, {{lo[0], lo[2]}, {hi[0], lo[2]}, {hi[0], hi[2]}, {lo[0], hi[2]}}, {}};
    cut.rest = cut.box;
    const Place from = body.place(node.node.first);
    for (const HalfSpace& half_space : node.half_spaces) {
      const auto& n = half_space_normal(half_space.direction);
      const double reach_m = double(half_space_reach(half_space.reach)) * cell_m;
      cut.rest = clip(cut.rest, {double(n[0]), double(n[2])},
                      reach_m + n[0] * from[0] + n[2] * from[2] - n[1] * (y_m - from[1]));
    }
    out.push_back(std::move(cut));
  }
  return out;
}

}  // namespace nearmesh::concepts
