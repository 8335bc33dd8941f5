// SPDX-License-Identifier: Apache-2.0
// Why one ray proves a side. The posed surface is a closed 2-cycle, since posed corners are a
// function of grid points; so every point off it has a winding number, which is the signed number
// of faces that a ray from it crosses. A face that is not exact lies inside the box of an
// unresolved node (core/THEOREM.md); when the ray meets no such box, it crosses exact faces only,
// and all of them are seen.
//
// Ties. The ray goes along axis w; u and v are the next two axes, in right-handed order. Instead of
// the point p we look at p' = p + (du, dv) with infinitely small 0 < dv << du << 1. p is off the
// surface, hence p' is on the same side, and the ray from p' meets no edge and no face that stands
// upright, so that rays through corners and edges need no case of their own. In the plane (u, v) an
// edge counts by half-open intervals of v, which is dv > 0, and a point on an edge as lying to the
// right of it, which is du >> dv.
#include "containment.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "core/geometry/exact.hpp"
#include "nearmesh/core/geometry/detail/box_overlap.hpp"

namespace nearmesh {
namespace {

using Kind = TreeEntry::Kind;

template <class Int>
int sign(Int x) {
  return (x > 0) - (x < 0);
}

/// Conservative tests of one ray against boxes in the solid's grid.
///
/// First the box along the lattice's axes, exact. Then, for turned solids, in doubles along six
/// axes n: the normals of the sides of the box's shadow on the plane (u, v), a hexagon whose sides
/// run along the shadows of the grid's axes; and the grid's axes themselves, along each of which
/// the ray goes one way for ever.
/// In lattice cells relative to the frame's translation all magnitudes are below 2^41: positions in
/// the grid span at most sqrt(3) 2^38 cells, the ray starts within the solid's box, and |n| <
/// 1.00002 (check_pose). Fewer than 64 roundings of values below 2^41 err by less than 2^-6 in all,
/// and pose_point moves a corner by at most half a cell on each axis, that is kError and kReach.
/// Coordinates of boxes and differences of positions are exact, and so is the way that the ray
/// goes, an integer's sign.
class RayTest {
 public:
  RayTest(const PosedFrame& frame, const Ray& ray) : frame_(frame), ray_(ray) {
    for (std::size_t k = 0; k < 3; ++k) {
      from_[k] =
          static_cast<double>(ray.from.v[k] - frame.translation[k]) - beyond_translation(frame, k);
      for (std::size_t j = 0; j < 3; ++j)
        step_[k][j] = std::ldexp(static_cast<double>(frame.rotation[3 * k + j]), -frame.shift);
    }
    const auto w = static_cast<std::size_t>(ray.axis), u = (w + 1) % 3, v = (w + 2) % 3;
    const auto unit = [&frame](std::size_t k, std::size_t i) {
      return static_cast<double>(frame.rotation[3 * k + i]) * 0x1p-30;
    };
    for (std::size_t i = 0; i < 3; ++i) {
      Axis& side = axes_[i];
      side.normal[u] = -unit(v, i);
      side.normal[v] = unit(u, i);
      Axis& own = axes_[3 + i];
      for (std::size_t k = 0; k < 3; ++k) own.normal[k] = unit(k, i);
      own.goes_up = ray.upward == (own.normal[w] > 0) && own.normal[w] != 0;
      own.goes_down = ray.upward == (own.normal[w] < 0) && own.normal[w] != 0;
    }
    for (Axis& axis : axes_)
      for (std::size_t j = 0; j < 3; ++j) {
        axis.spread[j] = std::abs(axis.normal[0] * step_[0][j] + axis.normal[1] * step_[1][j] +
                                  axis.normal[2] * step_[2][j]);
        axis.room += kReach * std::abs(axis.normal[j]);
      }
  }

  /// False: no posed triangle with corners in the box meets the ray from p'.
  [[nodiscard]] bool may_meet(const GridBox& box) const {
    const LatticeBox bounds = pose_box(frame_, box);
    for (int k = 0; k < 3; ++k) {
      if (ray_.from[k] > bounds.hi[k] && (k != ray_.axis || ray_.upward)) return false;
      if (ray_.from[k] < bounds.lo[k] && (k != ray_.axis || !ray_.upward)) return false;
    }
    const CenteredBox b = centered(box);
    std::array<double, 3> between{};  // from the box's centre to where the ray starts
    for (std::size_t k = 0; k < 3; ++k)
      between[k] = from_[k] - (step_[k][0] * b.center[0] + step_[k][1] * b.center[1] +
                               step_[k][2] * b.center[2]);
    return std::none_of(axes_.begin(), axes_.end(), [&](const Axis& axis) {
      const auto& n = axis.normal;
      const double along = n[0] * between[0] + n[1] * between[1] + n[2] * between[2];
      const double reach = axis.spread[0] * b.half[0] + axis.spread[1] * b.half[1] +
                           axis.spread[2] * b.half[2] + axis.room;
      return (along > reach && !axis.goes_down) || (-along > reach && !axis.goes_up);
    });
  }

 private:
  static constexpr double kReach = 0.5, kError = 0x1p-6;
  struct Axis {
    std::array<double, 3> normal{}, spread{};  // spread: a step of each of the grid's axes along it
    double room = kError;
    bool goes_up = false, goes_down = false;  // the ray, along it; neither: it stays where it is
  };

  const PosedFrame& frame_;
  const Ray& ray_;
  std::array<double, 3> from_{};                 // of the ray
  std::array<std::array<double, 3>, 3> step_{};  // [k][j]: of grid axis j along lattice axis k
  std::array<Axis, 6> axes_{};
};

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

/// On which side of the triangle's plane the point lies: 1 where the corners run counter-clockwise
/// as seen from it. At most 6 * 2^120, within 128 bits.
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
  // turns > 0: the normal looks along +w. An upward ray leaves through it when the point is behind
  // the plane. Never 0, which would put the point on the face.
  const int side = side_of_plane(t, ray.from);
  if (ray.upward) return side == -turns ? turns : 0;
  return side == turns ? -turns : 0;
}

struct Crossings {
  int winding = 0;
  std::vector<TreeEntry> missing;
  std::uint64_t missing_size = 0;  // vertices below them: a bound of the splits they take
};

class RayWalk {
 public:
  RayWalk(const TreeView& solid, const PosedFrame& frame, QueryStats& stats)
      : solid_(solid), frame_(frame), stats_(stats) {}

  Crossings run(const Ray& ray) {
    Crossings found;
    const RayTest test(frame_, ray);
    const auto offer = [&](const TreeEntry& part) {
      ++stats_.box_tests;
      if (test.may_meet(part.box)) stack_.push_back(part);
    };
    if (solid_.root().kind() != Kind::kEmpty) offer(solid_.root());
    while (!stack_.empty()) {
      const TreeEntry part = stack_.back();
      stack_.pop_back();
      if (part.kind() == Kind::kInner) {
        solid_.for_each_child(part, offer);
      } else if (part.kind() == Kind::kUnresolved) {
        found.missing.push_back(part);
        found.missing_size += part.count();
      } else {
        count_faces(ray, part, found);
      }
    }
    return found;
  }

 private:
  void count_faces(const Ray& ray, const TreeEntry& faces, Crossings& found) {
    solid_.for_each_face(faces, [&](const TreeFace& face) {
      ++stats_.triangle_tests;
      found.winding += signed_crossing(ray, pose_triangle(frame_, face.corners));
    });
  }

  const TreeView& solid_;
  const PosedFrame& frame_;
  QueryStats& stats_;
  std::vector<TreeEntry> stack_;
};

}  // namespace

Location locate(const TreeView& solid, const PosedFrame& frame, const LatticePoint& point,
                QueryStats& stats) {
  const TreeEntry root = solid.root();
  if (root.kind() == Kind::kEmpty) return {Side::kOutside, {}, {}};
  const LatticeBox bounds = pose_box(frame, root.box);
  for (int k = 0; k < 3; ++k)
    if (point[k] < bounds.lo[k] || point[k] > bounds.hi[k]) return {Side::kOutside, {}, {}};

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
  std::size_t best = 0;
  for (std::size_t i = 0; i < 6; ++i) {
    Crossings found = walk.run(rays[order[i]]);
    if (found.missing.empty()) return {found.winding != 0 ? Side::kInside : Side::kOutside, {}, {}};
    if (i > 0 && found.missing_size >= least.missing_size) continue;
    least = std::move(found);
    best = order[i];
  }
  return {Side::kUndecided, std::move(least.missing), rays[best]};
}

void add_ray_boxes(const PosedFrame& solid, const Ray& ray, const GridBox& box,
                   std::vector<GridBox>& boxes) {
  constexpr double kMargin = 2;
  const double cells = std::ldexp(1.0, solid.shift - 30);  // a lattice cell in grid units
  const CenteredBox b = centered(box);
  std::array<double, 3> from{}, along{};
  double enter = 0, leave = std::numeric_limits<double>::infinity();
  int slanted = 0;
  for (std::size_t i = 0; i < 3; ++i) {
    for (std::size_t k = 0; k < 3; ++k) {
      const double r = static_cast<double>(solid.rotation[3 * k + i]) * 0x1p-30;
      from[i] += r *
                 (static_cast<double>(ray.from.v[k] - solid.translation[k]) -
                  beyond_translation(solid, k)) *
                 cells;
      if (k == static_cast<std::size_t>(ray.axis)) along[i] = ray.upward ? r : -r;
    }
    if (along[i] == 0) continue;
    ++slanted;
    const double middle = (b.center[i] - from[i]) / along[i];
    const double reach = (b.half[i] + kMargin) / std::abs(along[i]);
    enter = std::max(enter, middle - reach);
    leave = std::min(leave, middle + reach);
  }
  if (!(enter <= leave)) {  // only rounding parts them: the ray met the box
    boxes.push_back(box);
    return;
  }
  // The box of a slanted piece is much larger than the piece.
  const int pieces = slanted > 1 ? 8 : 1;
  for (int piece = 0; piece < pieces; ++piece) {
    const double t0 = enter + (leave - enter) * piece / pieces;
    const double t1 = enter + (leave - enter) * (piece + 1) / pieces;
    GridBox covered;
    for (int k = 0; k < 3; ++k) {
      const auto i = static_cast<std::size_t>(k);
      const auto [lo, hi] = std::minmax({from[i] + t0 * along[i], from[i] + t1 * along[i]});
      covered.lo[k] = static_cast<std::int32_t>(
          std::clamp<double>(std::floor(lo - kMargin), box.lo[k], box.hi[k]));
      covered.hi[k] = static_cast<std::int32_t>(
          std::clamp<double>(std::ceil(hi + kMargin), box.lo[k], box.hi[k]));
    }
    boxes.push_back(covered);
  }
}

}  // namespace nearmesh
