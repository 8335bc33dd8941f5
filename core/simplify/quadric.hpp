// SPDX-License-Identifier: Apache-2.0
#pragma once
// Quadric error of a vertex (Garland and Heckbert 1997), kept about the vertex's own position.
// Departure: the origin travels with the vertex. Planes of its own faces then have no offset, so an
// untouched vertex has error exactly 0 and nothing cancels however far from the grid's corner the
// mesh lies.

#include <algorithm>
#include <array>

namespace nearmesh {

using Vec3 = std::array<double, 3>;

[[nodiscard]] inline Vec3 cross(const Vec3& a, const Vec3& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}
[[nodiscard]] inline double dot(const Vec3& a, const Vec3& b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/// error(d) = d'Ad + 2b'd + c, d measured from the vertex in grid units; unit of error: area *
/// length^2.
struct Quadric {
  double a00 = 0, a01 = 0, a02 = 0, a11 = 0, a12 = 0, a22 = 0;
  double b0 = 0, b1 = 0, b2 = 0;
  double c = 0;

  /// Adds weight * (n.d)^2: a plane through the vertex.
  void add_plane(const Vec3& n, double weight) {
    a00 += weight * n[0] * n[0];
    a01 += weight * n[0] * n[1];
    a02 += weight * n[0] * n[2];
    a11 += weight * n[1] * n[1];
    a12 += weight * n[1] * n[2];
    a22 += weight * n[2] * n[2];
  }
  /// Adds weight * (|e|^2 |d|^2 - (e.d)^2): a line through the vertex.
  void add_line(const Vec3& e, double weight) {
    const double squared = dot(e, e);
    add_plane(e, -weight);
    a00 += weight * squared;
    a11 += weight * squared;
    a22 += weight * squared;
  }
  /// Sum of the weights of the planes.
  [[nodiscard]] double total_weight() const { return a00 + a11 + a22; }

  [[nodiscard]] double error(const Vec3& d) const {
    const double x = a00 * d[0] + a01 * d[1] + a02 * d[2] + 2 * b0;
    const double y = a01 * d[0] + a11 * d[1] + a12 * d[2] + 2 * b1;
    const double z = a02 * d[0] + a12 * d[1] + a22 * d[2] + 2 * b2;
    return std::max(0.0, d[0] * x + d[1] * y + d[2] * z + c);
  }
  /// Adds another vertex's quadric; `d` leads from that vertex to this one.
  void add(const Quadric& other, const Vec3& d) {
    c += other.error(d);
    b0 += other.b0 + other.a00 * d[0] + other.a01 * d[1] + other.a02 * d[2];
    b1 += other.b1 + other.a01 * d[0] + other.a11 * d[1] + other.a12 * d[2];
    b2 += other.b2 + other.a02 * d[0] + other.a12 * d[1] + other.a22 * d[2];
    a00 += other.a00;
    a01 += other.a01;
    a02 += other.a02;
    a11 += other.a11;
    a12 += other.a12;
    a22 += other.a22;
  }
};

}  // namespace nearmesh
