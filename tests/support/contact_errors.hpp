// SPDX-License-Identifier: Apache-2.0
#pragma once
// How far contacts of coarser levels are from the truth: scenes of known surfaces, and the errors
// of approximate_contacts against them at several shares of the splits.

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>

#include "brute_force.hpp"
#include "distance.hpp"
#include "nearmesh/core/query/contacts.hpp"
#include "shapes.hpp"

namespace nearmesh::test {

using Point = std::array<double, 3>;

inline double dot3(const Point& a, const Point& b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}
inline double norm3(const Point& a) { return std::sqrt(dot3(a, a)); }
/// Angle between two directions; good near 0, where an acos is not.
inline double angle_rad(const Point& a, const Point& b) {
  const double u = norm3(a), v = norm3(b);
  Point sum, difference;
  for (std::size_t k = 0; k < 3; ++k) {
    sum[k] = a[k] / u + b[k] / v;
    difference[k] = a[k] / u - b[k] / v;
  }
  return 2 * std::atan2(norm3(difference), norm3(sum));
}

/// Two bodies that touch, in world metres. b is above a.
struct ContactScene {
  std::string name;
  BakedModel a, b;
  Pose pose_a, pose_b;
  std::function<double(const Point&)> off_a, off_b;  ///< distance from the true surface
  std::function<Point(const Point&)> normal;         ///< true one, from a to b

  [[nodiscard]] PosedPair posed() const {
    return pose_pair(a.header.grid, pose_a, "a", b.header.grid, pose_b, "b").value();
  }
};

inline ContactScene sphere_in_plane() {
  const Point center{0.037, -0.021, 0.8};  // sunk by 0.2: a circle of radius 0.6
  return {"sphere sunk into a plane",
          bake_mesh(make_plane(4, 24), 16),
          bake_mesh(generate_sphere(48, 0), 16),
          {},
          {.translation_m = center},
          [](const Point& p) { return std::abs(p[2]); },
          [=](const Point& p) {
            return std::abs(norm3({p[0] - center[0], p[1] - center[1], p[2] - center[2]}) - 1);
          },
          [](const Point&) {
            return Point{0, 0, 1};
          }};
}

inline double off_torus(const Point& p, double ring_m, double tube_m) {
  const double from_ring = std::sqrt(p[0] * p[0] + p[1] * p[1]) - ring_m;
  return std::abs(std::sqrt(from_ring * from_ring + p[2] * p[2]) - tube_m);
}

inline ContactScene torus_on_plane() {
  return {"torus lying on a plane",
          bake_mesh(make_plane(4, 24), 16),
          bake_mesh(make_torus(1, 0.4, 64, 32), 16),
          {},
          {.translation_m = {0, 0, 0.3}},
          [](const Point& p) { return std::abs(p[2]); },
          [](const Point& p) {
            return off_torus({p[0], p[1], p[2] - 0.3}, 1, 0.4);
          },
          [](const Point&) {
            return Point{0, 0, 1};
          }};
}

inline ContactScene torus_in_valley() {
  // Touches each wall in the outer half of its tube: the middle of the tube is 0.35 from the wall.
  const double slope = 0.75, height = slope + 0.35 * 1.25;
  return {"torus in a valley",
          bake_mesh(make_valley(slope, 4, 24), 16),
          bake_mesh(make_torus(1, 0.4, 64, 32), 16),
          {},
          {.translation_m = {0, 0, height}},
          [=](const Point& p) { return std::abs(p[2] - slope * std::abs(p[0])) / 1.25; },
          [=](const Point& p) {
            return off_torus({p[0], p[1], p[2] - height}, 1, 0.4);
          },
          [](const Point& p) {
            return Point{p[0] > 0 ? -0.6 : 0.6, 0, 0.8};
          }};
}

inline ContactScene box_corner_in_sphere() {
  // Stands on its corner: the box's (-1, -1, -1) points down.
  const double r2 = std::sqrt(0.5), r3 = std::sqrt(1.0 / 3), r6 = std::sqrt(1.0 / 6);
  const std::array<double, 9> turn{r2, -r2, 0, r6, r6, -2 * r6, r3, r3, r3};
  const Point center{0, 0, 0.9 + 0.5 / r3};
  return {"box corner sunk into a sphere",
          bake_mesh(generate_sphere(48, 0), 16),
          bake_mesh(make_box({0.5, 0.5, 0.5}, 12), 16),
          {},
          {turn, center},
          [](const Point& p) { return std::abs(norm3(p) - 1); },
          [=](const Point& p) {
            double greatest = 0;
            for (std::size_t k = 0; k < 3; ++k) {
              double along = 0;
              for (std::size_t r = 0; r < 3; ++r) along += turn[3 * r + k] * (p[r] - center[r]);
              greatest = std::max(greatest, std::abs(along));
            }
            return std::abs(greatest - 0.5);
          },
          [](const Point&) {
            return Point{0, 0, 1};
          }};
}

inline std::vector<ContactScene> contact_scenes() {
  std::vector<ContactScene> scenes;
  for (const auto make : {sphere_in_plane, torus_on_plane, torus_in_valley, box_corner_in_sphere})
    scenes.push_back(make());
  return scenes;
}

struct ContactErrors {
  int percent = 0;  ///< of the splits of each model, global order
  std::size_t patches = 0, segments = 0;
  double length_m = 0;
  double position_mean_m = 0,
         position_max_m = 0;  ///< of segment ends from the farther true surface
  double normal_max_rad = 0;  ///< between a patch's normal and the true one at its centroid
  double uncertainty_m = 0;   ///< greatest stated
  /// Greatest distance of a segment's ends from a full mesh, as a share of what is stated for it:
  /// at most 1.
  double bound_use = 0;
  bool approximate = false;
};

/// A model at a share of its splits.
inline ActiveMesh at_percent(const BakedModel& model, int percent) {
  ActiveMesh mesh(model.store);
  RefineDelta delta;
  const std::vector<VertexId> all = all_splits(model.store);
  for (std::size_t i = 0; i < all.size() * static_cast<std::size_t>(percent) / 100; ++i)
    EXPECT_TRUE(mesh.split(all[i], delta));
  return mesh;
}

/// The full mesh, posed, in metres.
class FullSurface {
 public:
  FullSurface(const SplitStore& store, const PosedFrame& frame) {
    for (const KeyedFace& keyed : all_faces(store)) {
      const LatticeTriangle t = posed(store, frame, keyed.face);
      faces_.emplace_back();
      for (std::size_t i = 0; i < 3; ++i)
        for (std::size_t k = 0; k < 3; ++k)
          faces_.back()[i][k] = std::ldexp(static_cast<long double>(t[i].v[k]), frame.lattice_exp);
    }
  }
  [[nodiscard]] long double distance(const Point& at) const {
    const Vec p{at[0], at[1], at[2]};
    long double least = std::numeric_limits<long double>::infinity();
    for (const auto& t : faces_) least = std::min(least, point_triangle(p, t));
    return least;
  }

 private:
  std::vector<std::array<Vec, 3>> faces_;
};

/// See ContactErrors::bound_use. Looks at some 60 ends, evenly chosen.
inline double bound_use(const Contacts& contacts, const FullSurface& a, const FullSurface& b) {
  double greatest = 0;
  const std::size_t step = 1 + contacts.segments.size() / 60;
  for (const ContactPatch& patch : contacts.patches) {
    const long double stated = patch.uncertainty_m + contacts.position_error_m;
    for (std::size_t i = patch.first; i < patch.first + patch.count; ++i) {
      if (i % step != 0) continue;
      const Point& p = contacts.segments[i].p_m;
      greatest =
          std::max(greatest, static_cast<double>(std::max(a.distance(p), b.distance(p)) / stated));
    }
  }
  return greatest;
}

inline std::vector<ContactErrors> contact_errors(const ContactScene& scene) {
  const PosedPair posed = scene.posed();
  const FullSurface surface_a(scene.a.store, posed.a), surface_b(scene.b.store, posed.b);
  std::vector<ContactErrors> rows;
  for (const int percent : {5, 10, 25, 50, 100}) {
    const ActiveMesh a = at_percent(scene.a, percent), b = at_percent(scene.b, percent);
    const Contacts contacts = approximate_contacts(a, posed.a, b, posed.b);
    ContactErrors row{.percent = percent,
                      .patches = contacts.patches.size(),
                      .segments = contacts.segments.size()};
    for (const ContactSegment& segment : contacts.segments) {
      for (const Point& p : {segment.p_m, segment.q_m}) {
        const double off = std::max(scene.off_a(p), scene.off_b(p));
        row.position_mean_m += off / (2.0 * static_cast<double>(contacts.segments.size()));
        row.position_max_m = std::max(row.position_max_m, off);
      }
      row.approximate = row.approximate || segment.approximate;
    }
    for (const ContactPatch& patch : contacts.patches) {
      row.length_m += patch.length_m;
      row.normal_max_rad =
          std::max(row.normal_max_rad, angle_rad(patch.normal, scene.normal(patch.centroid_m)));
      row.uncertainty_m = std::max(row.uncertainty_m, patch.uncertainty_m);
    }
    row.bound_use = bound_use(contacts, surface_a, surface_b);
    rows.push_back(row);
  }
  return rows;
}

inline void print_contact_errors(const ContactScene& scene,
                                 const std::vector<ContactErrors>& rows) {
  std::printf("%s\n%8s %8s %9s %9s %12s %12s %12s %12s %9s\n", scene.name.c_str(), "splits %",
              "patches", "segments", "length m", "mean off m", "max off m", "normal rad",
              "stated m", "used");
  for (const ContactErrors& row : rows)
    std::printf("%8d %8zu %9zu %9.4f %12.3g %12.3g %12.3g %12.3g %9.3f\n", row.percent, row.patches,
                row.segments, row.length_m, row.position_mean_m, row.position_max_m,
                row.normal_max_rad, row.uncertainty_m, row.bound_use);
}

}  // namespace nearmesh::test
