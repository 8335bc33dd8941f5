// SPDX-License-Identifier: Apache-2.0
// Why one ray proves a side. The posed surface is a closed 2-cycle, since posed corners are a function of grid points; so
// every point off it has a winding number, which is the signed number of faces that a ray from it crosses. A face that is
// not exact lies inside the box of an unresolved node (query.hpp); when the ray meets no such box, it crosses exact faces
// only, and all of them are seen.
//
// Ties. The ray goes along axis w; u and v are the next two axes, in right-handed order. Instead of the point p we look
// at p' = p + (du, dv) with infinitely small 0 < dv << du << 1. p is off the surface, hence p' is on the same side, and
// the ray from p' meets no edge and no face that stands upright, so that rays through corners and edges need no case of
// their own. In the plane (u, v) an edge counts by half-open intervals of v, which is dv > 0, and a point on an edge as
// lying to the right of it, which is du >> dv.
#include "containment.hpp"

#include <algorithm>
#include <array>

namespace nearmesh {
namespace {

using Kind = TreeNode::Kind;
__extension__ typedef __int128 Int128;

template <class Int>
int sign(Int x) {
  return (x > 0) - (x < 0);
}

struct Ray {
  LatticePoint from;
  int axis = 0;
  bool upward = true;
};

/// Whether the ray from p' may meet the closed box: exact, but that p' counts as p.
bool meets(const Ray& ray, const LatticeBox& box) {
  for (int k = 0; k < 3; ++k) {
    if (ray.from[k] > box.hi[k] && (k != ray.axis || ray.upward)) return false;
    if (ray.from[k] < box.lo[k] && (k != ray.axis || !ray.upward)) return false;
  }
  return true;
}

/// How often the triangle's outline, seen against axis w, runs round p': 1, 0 or -1.
/// Differences stay below 2^40 (both lie in the posed model's box), products below 2^81.
int turns_round(const LatticeTriangle& t, const LatticePoint& p, int u, int v) {
  int turns = 0;
  for (std::size_t i = 0; i < 3; ++i) {
    const LatticePoint &a = t[i], &b = t[(i + 1) % 3];
    const bool a_below = a[v] <= p[v], b_below = b[v] <= p[v];
    if (a_below == b_below) continue;
    const Int128 left_of =
        Int128{b[u] - a[u]} * (p[v] - a[v]) - Int128{b[v] - a[v]} * (p[u] - a[u]);
    if (a_below && left_of > 0) ++turns;
    if (b_below && left_of < 0) --turns;
  }
  return turns;
}

/// On which side of the triangle's plane the point lies: 1 where the corners run counter-clockwise as seen from it.
/// At most 6 * 2^120, within 128 bits.
int side_of_plane(const LatticeTriangle& t, const LatticePoint& p) {
  std::array<std::array<Int128, 3>, 3> d;
  for (int k = 0; k < 3; ++k) {
    const auto i = static_cast<std::size_t>(k);
    d[0][i] = t[1][k] - t[0][k];
    d[1][i] = t[2][k] - t[0][k];
    d[2][i] = p[k] - t[0][k];
  }
  Int128 volume = 0;
  for (std::size_t i = 0; i < 3; ++i) {
    const std::size_t j = (i + 1) % 3, k = (i + 2) % 3;
    volume += (d[0][j] * d[1][k] - d[0][k] * d[1][j]) * d[2][i];
  }
  return sign(volume);
}

/// The triangle's share of the winding number.
int signed_crossing(const Ray& ray, const LatticeTriangle& t) {
  const int turns = turns_round(t, ray.from, (ray.axis + 1) % 3, (ray.axis + 2) % 3);
  if (turns == 0) return 0;
  // turns > 0: the normal looks along +w. An upward ray leaves through it when the point is behind the plane.
  // Never 0, which would put the point on the face.
  const int side = side_of_plane(t, ray.from);
  if (ray.upward) return side == -turns ? turns : 0;
  return side == turns ? -turns : 0;
}

struct Crossings {
  int winding = 0;
  std::vector<const TreeNode*> missing;
  std::uint64_t missing_size = 0;  // vertices below them: a bound of the splits they take
};

class RayWalk {
 public:
  RayWalk(const TreeView& solid, const PosedFrame& frame, QueryStats& stats)
      : solid_(solid), frame_(frame), stats_(stats) {}

  Crossings run(const Ray& ray) {
    Crossings found;
    stack_.assign(1, solid_.root);
    while (!stack_.empty()) {
      const TreeNode& node = solid_.nodes[stack_.back()];
      stack_.pop_back();
      if (node.kind() == Kind::kEmpty) continue;
      ++stats_.box_tests;
      if (!meets(ray, pose_box(frame_, node.box))) continue;
      if (node.kind() == Kind::kInner) {
        stack_.push_back(node.first + 1);
        stack_.push_back(node.first);
      } else if (node.kind() == Kind::kFrontier) {
        found.missing.push_back(&node);
        found.missing_size += node.count();
      } else {
        count_faces(ray, node, found);
      }
    }
    return found;
  }

 private:
  void count_faces(const Ray& ray, const TreeNode& node, Crossings& found) {
    for (const TreeFace& face : solid_.faces.subspan(node.first, node.count())) {
      ++stats_.triangle_tests;
      found.winding += signed_crossing(
          ray, {pose_point(frame_, face.corners[0]), pose_point(frame_, face.corners[1]),
                pose_point(frame_, face.corners[2])});
    }
  }

  const TreeView& solid_;
  const PosedFrame& frame_;
  QueryStats& stats_;
  std::vector<std::uint32_t> stack_;
};

}  // namespace

Location locate(const TreeView& solid, const PosedFrame& frame, const LatticePoint& point,
                QueryStats& stats) {
  const TreeNode& root = solid.nodes[solid.root];
  if (root.kind() == Kind::kEmpty) return {Side::kOutside, {}};
  const LatticeBox bounds = pose_box(frame, root.box);
  for (int k = 0; k < 3; ++k)
    if (point[k] < bounds.lo[k] || point[k] > bounds.hi[k]) return {Side::kOutside, {}};

  // The nearest way out first: it is the likeliest to meet little.
  std::array<Ray, 6> rays;
  std::array<std::int64_t, 6> exit{};
  std::array<std::size_t, 6> order{0, 1, 2, 3, 4, 5};
  for (std::size_t i = 0; i < 6; ++i) {
    const int axis = static_cast<int>(i / 2);
    rays[i] = {point, axis, i % 2 == 0};
    exit[i] = rays[i].upward ? bounds.hi[axis] - point[axis] : point[axis] - bounds.lo[axis];
  }
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return exit[a] < exit[b]; });
  RayWalk walk(solid, frame, stats);
  Crossings least;
  for (std::size_t i = 0; i < 6; ++i) {
    Crossings found = walk.run(rays[order[i]]);
    if (found.missing.empty()) return {found.winding != 0 ? Side::kInside : Side::kOutside, {}};
    if (i == 0 || found.missing_size < least.missing_size) least = std::move(found);
  }
  return {Side::kOpen, std::move(least.missing)};
}

}  // namespace nearmesh
