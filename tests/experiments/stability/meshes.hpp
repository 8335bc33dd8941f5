// SPDX-License-Identifier: Apache-2.0
#pragma once
// Meshes of the scenes, beside tests/support/shapes.hpp. Coordinates are multiples of a power of
// two that the grid of clean_mesh (21 bits) keeps, so that what nearmesh holds is what the others
// are given.

#include <cmath>

#include "case.hpp"
#include "core/base/random.hpp"
#include "shapes.hpp"

namespace nearmesh::stability {

/// Rounded to multiples of 2^exponent.
inline IndexedMesh snapped(IndexedMesh mesh, int exponent) {
  for (auto& p : mesh.positions_m)
    for (double& x : p) x = std::ldexp(std::floor(std::ldexp(x, -exponent) + 0.5), exponent);
  return mesh;
}

inline IndexedMesh shifted(IndexedMesh mesh, const std::array<double, 3>& by_m) {
  for (auto& p : mesh.positions_m)
    for (std::size_t i = 0; i < 3; ++i) p[i] += by_m[i];
  return mesh;
}

inline IndexedMesh stretched(IndexedMesh mesh, double factor) {
  for (auto& p : mesh.positions_m)
    for (double& x : p) x *= factor;
  return mesh;
}

inline IndexedMesh joined(IndexedMesh mesh, const IndexedMesh& more) {
  const auto first = static_cast<std::uint32_t>(mesh.positions_m.size());
  mesh.positions_m.insert(mesh.positions_m.end(), more.positions_m.begin(), more.positions_m.end());
  for (const auto& f : more.faces) mesh.faces.push_back({f[0] + first, f[1] + first, f[2] + first});
  return mesh;
}

/// Each face with three vertices of its own.
inline IndexedMesh unwelded(const IndexedMesh& mesh) {
  IndexedMesh out;
  for (const auto& f : mesh.faces) {
    const auto first = static_cast<std::uint32_t>(out.positions_m.size());
    for (const std::uint32_t corner : f) out.positions_m.push_back(mesh.positions_m[corner]);
    out.faces.push_back({first, first + 1, first + 2});
  }
  return out;
}

/// One face of three vertices.
inline IndexedMesh one_triangle(const std::array<double, 3>& p, const std::array<double, 3>& q,
                                const std::array<double, 3>& r) {
  return {{p, q, r}, {{0, 1, 2}}};
}

inline MeshPtr share(IndexedMesh mesh) { return std::make_shared<IndexedMesh>(std::move(mesh)); }

/// A cube about the origin, of so many quads along each edge.
inline MeshPtr box(double half_m, std::uint32_t quads) {
  return share(test::make_box({half_m, half_m, half_m}, quads));
}

inline Pose at(double x, double y, double z) { return {.translation_m = {x, y, z}}; }

}  // namespace nearmesh::stability
