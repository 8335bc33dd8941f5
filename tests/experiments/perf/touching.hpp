// SPDX-License-Identifier: Apache-2.0
#pragma once
// A ball that is set down on a model until it touches: the poses by which bytes and answers are
// measured. Metres; the same bits on every machine.

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <utility>
#include <vector>

#include "core/base/random.hpp"
#include "full_tree.hpp"
#include "nearmesh/core/query/query.hpp"
#include "random_rotation.hpp"

namespace nearmesh::perf {

// ---- body ---------------------------------------------------------------------------------------

/// An icosahedron, each face cut in four three times over, on the unit sphere.
inline IndexedMesh make_ball(double radius_m) {
  IndexedMesh mesh;
  const double g = (1 + std::sqrt(5.0)) / 2;
  mesh.positions_m = {{-1, g, 0},  {1, g, 0},  {-1, -g, 0}, {1, -g, 0}, {0, -1, g},  {0, 1, g},
                      {0, -1, -g}, {0, 1, -g}, {g, 0, -1},  {g, 0, 1},  {-g, 0, -1}, {-g, 0, 1}};
  mesh.faces = {{0, 11, 5},  {0, 5, 1},  {0, 1, 7},  {0, 7, 10}, {0, 10, 11}, {1, 5, 9}, {5, 11, 4},
                {11, 10, 2}, {10, 7, 6}, {7, 1, 8},  {3, 9, 4},  {3, 4, 2},   {3, 2, 6}, {3, 6, 8},
                {3, 8, 9},   {4, 9, 5},  {2, 4, 11}, {6, 2, 10}, {8, 6, 7},   {9, 8, 1}};
  for (int level = 0; level < 3; ++level) {
    std::map<std::pair<std::uint32_t, std::uint32_t>, std::uint32_t> middle;
    const auto between = [&](std::uint32_t a, std::uint32_t b) {
      const auto [at, added] = middle.try_emplace(
          std::minmax(a, b), static_cast<std::uint32_t>(mesh.positions_m.size()));
      if (added) {
        auto p = mesh.positions_m[a];
        for (std::size_t k = 0; k < 3; ++k) p[k] = (p[k] + mesh.positions_m[b][k]) / 2;
        mesh.positions_m.push_back(p);
      }
      return at->second;
    };
    std::vector<std::array<std::uint32_t, 3>> faces;
    for (const auto& [a, b, c] : mesh.faces) {
      const std::uint32_t ab = between(a, b), bc = between(b, c), ca = between(c, a);
      faces.insert(faces.end(), {{a, ab, ca}, {ab, b, bc}, {ca, bc, c}, {ab, bc, ca}});
    }
    mesh.faces = std::move(faces);
  }
  for (auto& p : mesh.positions_m) {
    const double length = std::sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]);
    for (double& x : p) x *= radius_m / length;
  }
  return mesh;
}

inline TriangleTree body_tree(double radius_m) { return full_tree(make_ball(radius_m)); }

// ---- poses --------------------------------------------------------------------------------------

using Vector = std::array<double, 3>;

inline Vector in_metres(const Grid& grid, const GridPoint& p) {
  Vector at;
  for (std::size_t k = 0; k < 3; ++k) at[k] = grid.origin_m[k] + std::ldexp(p.v[k], grid.exponent);
  return at;
}

/// Of a complete store: boxes of nodes are rounded outward, the more the fewer roots there are.
inline double largest_side_m(const SpmHeader& header, const SplitStore& store) {
  GridBox box;
  for (std::uint32_t v = 0; v < header.vertex_count; ++v) box.add(store.position({v}));
  std::int32_t side = 0;
  for (int k = 0; k < 3; ++k) side = std::max(side, box.hi[k] - box.lo[k]);
  return std::ldexp(side, header.grid.exponent);
}

inline PosedPair posed(const Grid& model, const Grid& body, const Pose& pose) {
  return pose_pair(model, {}, "model", body, pose, "body").value();
}

/// Sets the body down from outside along a line through `at`: within a thousandth of its radius of
/// letting go.
inline Pose touching_pose(const TreeView& model, const TreeView& body, const Vector& at,
                          const Vector& away, double radius_m, Pose pose = {}) {
  double in = 0.9 * radius_m, out = 4 * radius_m;  // the point is inside the body, then it is not
  const auto touches = [&](double distance_m) {
    for (std::size_t k = 0; k < 3; ++k) pose.translation_m[k] = at[k] + distance_m * away[k];
    const PosedPair frames = posed(*model.grid, *body.grid, pose);
    return !query(model, frames.a, body, frames.b, {.any = true, .clearance = Clearance::kNone})
                .pairs.empty();
  };
  for (; touches(out); out += radius_m) in = out;
  while (out - in > 1e-3 * radius_m) {
    const double middle = (in + out) / 2;
    (touches(middle) ? in : out) = middle;
  }
  touches(in);
  return pose;
}

struct TouchingPlace {
  Pose pose;
  Vector away;  ///< where the body was set down from
};
/// The body set down in `count` random places, from random sides and turned at random.
inline std::vector<TouchingPlace> touching_poses(const TreeView& model, const TreeView& body,
                                                 const SplitStore& store, double radius_m,
                                                 std::size_t count) {
  Random random(11);
  std::vector<TouchingPlace> poses;
  const auto full = [&](const Pose& pose) {
    const PosedPair frames = posed(*model.grid, *body.grid, pose);
    return query(model, frames.a, body, frames.b, {.any = true, .clearance = Clearance::kNone});
  };
  while (poses.size() < count) {
    const Vector at = in_metres(*model.grid, store.position({random.below(store.vertex_count())}));
    Vector away{random.between(-1, 1), random.between(-1, 1), random.between(-1, 1)};
    const double length = std::sqrt(away[0] * away[0] + away[1] * away[1] + away[2] * away[2]);
    if (length > 1 || length < 0.1) continue;
    for (double& x : away) x /= length;
    const Pose pose =
        touching_pose(model, body, at, away, radius_m, {.rotation = test::random_rotation(random)});
    if (full(pose).status == AnswerStatus::kContact) poses.push_back({pose, away});
  }
  return poses;
}

/// Along a straight line over a ground whose z is up, set down anew in each frame on the nearest
/// vertex.
inline std::vector<Pose> flight_poses(const TreeView& model, const TreeView& body,
                                      const SplitStore& store, double radius_m, int frames) {
  std::vector<Pose> poses;
  const double length_m = 0.2 * radius_m * frames;
  for (int i = 0; i < frames; ++i) {
    const double x = (static_cast<double>(i) / frames - 0.5) * length_m, y = 0.3 * x;
    Vector nearest{1e300, 1e300, 0};
    for (std::uint32_t v = 0; v < store.vertex_count(); ++v) {
      const Vector at = in_metres(*model.grid, store.position({v}));
      if (std::hypot(at[0] - x, at[1] - y) < std::hypot(nearest[0] - x, nearest[1] - y))
        nearest = at;
    }
    poses.push_back(touching_pose(model, body, nearest, {0, 0, 1}, radius_m));
  }
  return poses;
}

}  // namespace nearmesh::perf
