// SPDX-License-Identifier: Apache-2.0
#pragma once
// Closed test surfaces, and an exact winding number that shares nothing with the code under test.

#include <map>
#include <numeric>

#include "brute_force.hpp"
#include "shapes.hpp"

namespace nearmesh::test {

// ---- meshes -------------------------------------------------------------------------------------

using Point = std::array<double, 3>;

inline void append(IndexedMesh& mesh, const IndexedMesh& more, const Point& at = {},
                   double scale = 1) {
  const auto first = static_cast<std::uint32_t>(mesh.positions_m.size());
  for (const Point& p : more.positions_m)
    mesh.positions_m.push_back({at[0] + scale * p[0], at[1] + scale * p[1], at[2] + scale * p[2]});
  for (const auto& f : more.faces) mesh.faces.push_back({f[0] + first, f[1] + first, f[2] + first});
}

/// Inside out.
inline IndexedMesh turned_over(IndexedMesh mesh) {
  for (auto& f : mesh.faces) std::swap(f[1], f[2]);
  return mesh;
}

/// The cube [-half, half]^3 with n x n squares a side, oriented outward.
inline IndexedMesh make_cube(double half, std::uint32_t n) {
  return make_box({half, half, half}, n);
}

/// Base of radius 3 at z = -1, apex at z = 5: encloses the unit sphere. Oriented outward.
inline IndexedMesh make_cone(std::uint32_t slices, std::uint32_t rings) {
  IndexedMesh mesh{{{0, 0, 5}}, {}};
  for (std::uint32_t ring = 1; ring <= rings; ++ring)
    for (std::uint32_t s = 0; s < slices; ++s) {
      const double a = 6.283185307179586 * s / slices, t = double(ring) / rings;
      mesh.positions_m.push_back({3 * t * std::cos(a), 3 * t * std::sin(a), 5 - 6 * t});
    }
  const auto middle = static_cast<std::uint32_t>(mesh.positions_m.size());
  mesh.positions_m.push_back({0, 0, -1});
  for (std::uint32_t s = 0; s < slices; ++s) {
    const std::uint32_t next = (s + 1) % slices, last = 1 + (rings - 1) * slices;
    mesh.faces.push_back({0, 1 + s, 1 + next});
    mesh.faces.push_back({middle, last + next, last + s});
    for (std::uint32_t ring = 0; ring + 1 < rings; ++ring) {
      const std::uint32_t a = 1 + ring * slices + s, b = 1 + ring * slices + next;
      mesh.faces.push_back({a, a + slices, b + slices});
      mesh.faces.push_back({a, b + slices, b});
    }
  }
  return mesh;
}

/// A sphere of radius 4 with a cavity of radius 3, in which a sphere of radius 1 is.
inline IndexedMesh make_nested() {
  const IndexedMesh sphere = generate_sphere(16, 0);
  IndexedMesh mesh;
  append(mesh, sphere, {}, 4);
  append(mesh, turned_over(sphere), {}, 3);
  append(mesh, sphere);
  return mesh;
}

inline IndexedMesh make_closed_terrain(std::uint32_t size, std::uint64_t seed, double floor_m) {
  IndexedMesh mesh = generate_terrain(size, seed);
  EXPECT_TRUE(close_terrain(mesh, size, floor_m).is_ok());
  return mesh;
}

/// Random unit cubes of a block of n^3, at whole numbers: edges with four faces, walls and edges
/// along every axis ray.
struct Voxels {
  Voxels(int side, Random& random) : n(side), filled(static_cast<std::size_t>(n * n * n)) {
    for (std::size_t i = 0; i < filled.size(); ++i) filled[i] = random.below(2) == 0;
  }
  [[nodiscard]] bool at(int x, int y, int z) const {
    if (std::min({x, y, z}) < 0 || std::max({x, y, z}) >= n) return false;
    return filled[static_cast<std::size_t>((x * n + y) * n + z)];
  }
  [[nodiscard]] IndexedMesh mesh() const {
    IndexedMesh mesh;
    const auto wall = [&](int axis, std::array<int, 3> corner, bool up) {
      const auto first = static_cast<std::uint32_t>(mesh.positions_m.size());
      const auto u = static_cast<std::size_t>((axis + 1) % 3),
                 v = static_cast<std::size_t>((axis + 2) % 3);
      for (const auto& [i, j] : {std::pair(0, 0), {1, 0}, {1, 1}, {0, 1}}) {
        std::array<int, 3> p = corner;
        p[u] += i;
        p[v] += j;
        mesh.positions_m.push_back({double(p[0]), double(p[1]), double(p[2])});
      }
      for (std::array<std::uint32_t, 3> f :
           {std::array{first, first + 1, first + 2}, {first, first + 2, first + 3}}) {
        if (!up) std::swap(f[1], f[2]);
        mesh.faces.push_back(f);
      }
    };
    for (int x = 0; x <= n; ++x)
      for (int y = 0; y <= n; ++y)
        for (int z = 0; z <= n; ++z) {
          const bool here = at(x, y, z);
          if (here != at(x - 1, y, z)) wall(0, {x, y, z}, !here);
          if (here != at(x, y - 1, z)) wall(1, {x, y, z}, !here);
          if (here != at(x, y, z - 1)) wall(2, {x, y, z}, !here);
        }
    return mesh;
  }
  int n;
  std::vector<bool> filled;
};

// ---- posed solids -------------------------------------------------------------------------------

/// A model with its full mesh.
struct Solid {
  explicit Solid(const IndexedMesh& mesh) : model(bake_mesh(mesh, 16)), full(model) {}
  BakedModel model;
  FullModel full;
};

inline PosedPair pose_at(const Solid& a, const Pose& pose_a, const Solid& b, const Pose& pose_b) {
  const auto posed = pose_pair(a.model.header.grid, pose_a, "a", b.model.header.grid, pose_b, "b");
  if (!posed.is_ok()) ADD_FAILURE() << posed.status().message();
  return posed.value();
}

/// The 24 rotations that map the axes onto each other.
inline const std::vector<std::array<double, 9>>& quarter_turns() {
  static const std::vector<std::array<double, 9>> turns = [] {
    std::vector<std::array<double, 9>> all;
    for (const std::array<std::size_t, 3>& axes : {std::array<std::size_t, 3>{0, 1, 2},
                                                   {1, 2, 0},
                                                   {2, 0, 1},
                                                   {0, 2, 1},
                                                   {2, 1, 0},
                                                   {1, 0, 2}})
      for (int signs = 0; signs < 8; ++signs) {
        std::array<double, 9> r{};
        for (std::size_t k = 0; k < 3; ++k) r[3 * k + axes[k]] = (signs >> k & 1) != 0 ? -1 : 1;
        const double det = r[0] * (r[4] * r[8] - r[5] * r[7]) - r[1] * (r[3] * r[8] - r[5] * r[6]) +
                           r[2] * (r[3] * r[7] - r[4] * r[6]);
        if (det > 0) all.push_back(r);
      }
    return all;
  }();
  return turns;
}

// ---- the truth ----------------------------------------------------------------------------------

__extension__ typedef __int128 Int128;

/// Winding number of the full mesh about a point off it: a ray in a random direction that meets no
/// edge.
inline int winding_number(const std::vector<LatticeTriangle>& faces, const LatticePoint& point) {
  using Vector = std::array<Int128, 3>;
  const auto det = [](const Vector& a, const Vector& b, const Vector& c) {
    const Int128 d = a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) +
                     a[2] * (b[0] * c[1] - b[1] * c[0]);
    return (d > 0) - (d < 0);
  };
  Random random(17);
  while (true) {
    Vector direction{};
    for (Int128& x : direction) x = Int128{random.below(2001)} - 1000;
    int winding = 0;
    bool meets_edge = false;
    for (const LatticeTriangle& face : faces) {
      std::array<Vector, 3> p;
      for (std::size_t i = 0; i < 3; ++i)
        for (int k = 0; k < 3; ++k) p[i][static_cast<std::size_t>(k)] = face[i][k] - point[k];
      const int s[3] = {det(direction, p[0], p[1]), det(direction, p[1], p[2]),
                        det(direction, p[2], p[0])};
      if (s[0] == 0 || s[1] == 0 || s[2] == 0) {
        // Of no consequence where the other two already part.
        meets_edge =
            meets_edge || !(std::min({s[0], s[1], s[2]}) < 0 && std::max({s[0], s[1], s[2]}) > 0);
        continue;
      }
      if (s[0] == s[1] && s[1] == s[2] && det(p[0], p[1], p[2]) == s[0]) winding += s[0];
    }
    if (!meets_edge) return winding;
  }
}

/// All faces posed, and a few vertices of each connected part.
struct PosedSolid {
  PosedSolid(const BakedModel& model, const PosedFrame& frame) {
    std::vector<std::uint32_t> part(model.header.vertex_count);
    std::iota(part.begin(), part.end(), 0U);
    const auto root = [&part](std::uint32_t v) {
      while (part[v] != v) v = part[v] = part[part[v]];
      return v;
    };
    for (const KeyedFace& keyed : all_faces(model.store)) {
      faces.push_back(posed(model.store, frame, keyed.face));
      const auto corners = keyed.face.corners();
      part[root(corners[0].value)] = root(corners[1].value);
      part[root(corners[1].value)] = root(corners[2].value);
    }
    // The highest vertex of each part: the header names the lowest.
    std::map<std::uint32_t, std::uint32_t> highest;
    for (std::uint32_t v = 0; v < part.size(); ++v) highest[root(v)] = v;
    for (const auto& [r, v] : highest)
      points.push_back(pose_point(frame, model.store.position({v})));
  }
  [[nodiscard]] bool has_part_in(const PosedSolid& solid) const {
    return std::any_of(points.begin(), points.end(),
                       [&](const LatticePoint& p) { return winding_number(solid.faces, p) != 0; });
  }
  std::vector<LatticeTriangle> faces;
  std::vector<LatticePoint> points;
};

/// What a certified answer has to say, by the full meshes.
inline Answer true_answer(const BakedModel& a, const TreeView& full_a, const BakedModel& b,
                          const TreeView& full_b, const PosedPair& posed,
                          const QueryOptions& options) {
  Answer truth = query(full_a, posed.a, full_b, posed.b, {.clearance = Clearance::kNone});
  if (truth.status != AnswerStatus::kFree) return truth;
  const PosedSolid solid_a(a, posed.a), solid_b(b, posed.b);
  const int contained = (options.solid_b && solid_a.has_part_in(solid_b) ? 1 : 0) +
                        (options.solid_a && solid_b.has_part_in(solid_a) ? 2 : 0);
  truth.contained = static_cast<Containment>(contained);
  if (contained != 0) truth.status = AnswerStatus::kContained;
  return truth;
}

}  // namespace nearmesh::test
