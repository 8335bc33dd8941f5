// SPDX-License-Identifier: Apache-2.0
#pragma once
// Shapes whose contacts are known in closed form. Metres; closed ones are oriented outward, open
// ones upward (+z). No library sin or cos: the same bits on every machine.

#include <array>
#include <cstdint>
#include <map>

#include "nearmesh/core/mesh/indexed_mesh.hpp"

namespace nearmesh::test {

/// Adds corners once: equal positions are one vertex.
class ShapeBuilder {
 public:
  using Point = std::array<double, 3>;
  void triangle(const Point& a, const Point& b, const Point& c) {
    mesh_.faces.push_back({vertex(a), vertex(b), vertex(c)});
  }
  /// Counter-clockwise seen from outside.
  void quad(const Point& a, const Point& b, const Point& c, const Point& d) {
    triangle(a, b, c);
    triangle(a, c, d);
  }
  [[nodiscard]] IndexedMesh take() { return std::move(mesh_); }

 private:
  std::uint32_t vertex(const Point& p) {
    const auto [at, is_new] =
        numbers_.try_emplace(p, static_cast<std::uint32_t>(mesh_.positions_m.size()));
    if (is_new) mesh_.positions_m.push_back(p);
    return at->second;
  }
  std::map<Point, std::uint32_t> numbers_;
  IndexedMesh mesh_;
};

/// Cosine and sine of `step` parts of a full turn cut into `steps`: by Taylor series in the first
/// octant, and by symmetry, so that quarter turns are exact and opposite points mirror each other.
inline std::array<double, 2> unit_circle(std::uint32_t step, std::uint32_t steps) {
  const std::uint64_t eighths = 8ULL * (step % steps), octant = eighths / steps;
  const std::uint64_t rest = octant % 2 == 0 ? eighths % steps : steps - eighths % steps;
  const double x = 0.78539816339744830962 * static_cast<double>(rest) / steps;
  double cosine = 1, sine = x, term = x;
  double even = 1;
  for (int k = 1; k < 10; ++k) {
    even *= -x * x / ((2 * k - 1) * (2 * k));
    term *= -x * x / ((2 * k) * (2 * k + 1));
    cosine += even;
    sine += term;
  }
  // Octants 1, 2, 5 and 6 lie nearer to the y axis.
  double c = cosine, s = sine;
  if ((octant + 1) % 4 >= 2) std::swap(c, s);
  if (octant >= 2 && octant < 6) c = -c;
  if (octant >= 4) s = -s;
  return {c, s};
}

/// `i` of `count` equal steps from -half to half, the same bits from either side.
inline double grid_step(double half, std::uint32_t i, std::uint32_t count) {
  return half * ((2.0 * i - count) / count);
}

/// A box about the origin, `quads` x `quads` cells of two triangles on each side.
inline IndexedMesh make_box(const std::array<double, 3>& half_m, std::uint32_t quads) {
  ShapeBuilder shape;
  for (std::size_t axis = 0; axis < 3; ++axis)
    for (const bool upper : {false, true})
      for (std::uint32_t i = 0; i < quads; ++i)
        for (std::uint32_t j = 0; j < quads; ++j) {
          const std::size_t u = (axis + 1) % 3, v = (axis + 2) % 3;
          const auto at = [&](std::uint32_t di, std::uint32_t dj) {
            std::array<double, 3> p;
            p[axis] = upper ? half_m[axis] : -half_m[axis];
            p[u] = grid_step(half_m[u], i + di, quads);
            p[v] = grid_step(half_m[v], j + dj, quads);
            return p;
          };
          upper ? shape.quad(at(0, 0), at(1, 0), at(1, 1), at(0, 1))
                : shape.quad(at(0, 0), at(0, 1), at(1, 1), at(1, 0));
        }
  return shape.take();
}

/// A square of side `size_m` in z = 0 about the origin, facing up; open.
inline IndexedMesh make_plane(double size_m, std::uint32_t quads) {
  ShapeBuilder shape;
  const auto at = [&](std::uint32_t i, std::uint32_t j) {
    return std::array{grid_step(size_m / 2, i, quads), grid_step(size_m / 2, j, quads), 0.0};
  };
  for (std::uint32_t i = 0; i < quads; ++i)
    for (std::uint32_t j = 0; j < quads; ++j)
      shape.quad(at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1));
  return shape.take();
}

/// A slab of side `size_m`: its top is make_plane's square, its bottom the same at -thickness_m.
/// Closed.
inline IndexedMesh make_plate(double size_m, double thickness_m, std::uint32_t quads) {
  ShapeBuilder shape;
  const auto at = [&](std::uint32_t i, std::uint32_t j, bool top) {
    return std::array{grid_step(size_m / 2, i, quads), grid_step(size_m / 2, j, quads),
                      top ? 0.0 : -thickness_m};
  };
  const std::uint32_t n = quads;
  for (std::uint32_t i = 0; i < n; ++i) {
    for (std::uint32_t j = 0; j < n; ++j) {
      shape.quad(at(i, j, true), at(i + 1, j, true), at(i + 1, j + 1, true), at(i, j + 1, true));
      shape.quad(at(i, j, false), at(i, j + 1, false), at(i + 1, j + 1, false),
                 at(i + 1, j, false));
    }
    shape.quad(at(i, 0, false), at(i + 1, 0, false), at(i + 1, 0, true), at(i, 0, true));
    shape.quad(at(i + 1, n, false), at(i, n, false), at(i, n, true), at(i + 1, n, true));
    shape.quad(at(0, i + 1, false), at(0, i, false), at(0, i, true), at(0, i + 1, true));
    shape.quad(at(n, i, false), at(n, i + 1, false), at(n, i + 1, true), at(n, i, true));
  }
  return shape.take();
}

/// A torus about the z axis: tube of radius `tube_m` around a circle of radius `ring_m` in z = 0;
/// `around` steps along the circle, `across` around the tube.
inline IndexedMesh make_torus(double ring_m, double tube_m, std::uint32_t around,
                              std::uint32_t across) {
  ShapeBuilder shape;
  const auto at = [&](std::uint32_t i, std::uint32_t j) {
    const auto [ci, si] = unit_circle(i, around);
    const auto [cj, sj] = unit_circle(j, across);
    const double from_axis = ring_m + tube_m * cj;
    return std::array{from_axis * ci, from_axis * si, tube_m * sj};
  };
  for (std::uint32_t i = 0; i < around; ++i)
    for (std::uint32_t j = 0; j < across; ++j)
      shape.quad(at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1));
  return shape.take();
}

/// A cone: base disc of radius `radius_m` in z = 0, apex at z = height_m. `around` steps about the
/// axis, `rings` along side and base. Closed.
inline IndexedMesh make_cone(double radius_m, double height_m, std::uint32_t around,
                             std::uint32_t rings) {
  ShapeBuilder shape;
  const auto at = [&](std::uint32_t ring, std::uint32_t i, bool side) {
    const auto [c, s] = unit_circle(i, around);
    const double r = radius_m * ring / rings;
    return std::array{r * c, r * s, side ? height_m * (rings - ring) / rings : 0.0};
  };
  for (std::uint32_t i = 0; i < around; ++i) {
    shape.triangle(at(0, 0, true), at(1, i, true), at(1, i + 1, true));
    shape.triangle(at(0, 0, false), at(1, i + 1, false), at(1, i, false));
    for (std::uint32_t ring = 1; ring < rings; ++ring) {
      shape.quad(at(ring, i, true), at(ring + 1, i, true), at(ring + 1, i + 1, true),
                 at(ring, i + 1, true));
      shape.quad(at(ring, i, false), at(ring, i + 1, false), at(ring + 1, i + 1, false),
                 at(ring + 1, i, false));
    }
  }
  return shape.take();
}

/// A V-shaped trough along the y axis, facing up: z = slope * |x| over a square of side `size_m`.
/// Slope is the tangent of each wall's angle with the ground. `quads` is even. Open.
inline IndexedMesh make_valley(double slope, double size_m, std::uint32_t quads) {
  IndexedMesh mesh = make_plane(size_m, quads);
  for (auto& p : mesh.positions_m) p[2] = slope * (p[0] < 0 ? -p[0] : p[0]);
  return mesh;
}

}  // namespace nearmesh::test
