// SPDX-License-Identifier: Apache-2.0
#pragma once
// Distance of two triangles by trying every corner against every face and every pair of edges, in
// long double.

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "nearmesh/core/geometry/pose.hpp"

namespace nearmesh::test {

using Vec = std::array<long double, 3>;
inline Vec operator-(const Vec& a, const Vec& b) { return {a[0] - b[0], a[1] - b[1], a[2] - b[2]}; }
inline Vec along(const Vec& p, const Vec& d, long double t) {
  return {p[0] + d[0] * t, p[1] + d[1] * t, p[2] + d[2] * t};
}
inline long double dot(const Vec& a, const Vec& b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}
inline Vec cross(const Vec& a, const Vec& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}
inline long double length(const Vec& a) { return std::sqrt(dot(a, a)); }

inline long double point_segment(const Vec& p, const Vec& a, const Vec& b) {
  const Vec d = b - a;
  const long double square = dot(d, d);
  const long double t = square > 0 ? std::clamp<long double>(dot(p - a, d) / square, 0, 1) : 0;
  return length(p - along(a, d, t));
}

/// Closest points of segments: the ends against the other, and the inner solution where there is
/// one.
inline long double segment_segment(const Vec& p, const Vec& q, const Vec& r, const Vec& s) {
  long double least = std::min({point_segment(p, r, s), point_segment(q, r, s),
                                point_segment(r, p, q), point_segment(s, p, q)});
  const Vec u = q - p, v = s - r, w = p - r;
  const long double a = dot(u, u), b = dot(u, v), c = dot(v, v), d = dot(u, w), e = dot(v, w);
  const long double determinant = a * c - b * b;
  if (determinant > 0) {
    const long double x = (b * e - c * d) / determinant, y = (a * e - b * d) / determinant;
    if (x >= 0 && x <= 1 && y >= 0 && y <= 1)
      least = std::min(least, length(along(p, u, x) - along(r, v, y)));
  }
  return least;
}

/// Infinite where p's foot lies outside the triangle: then an edge is nearer.
inline long double point_face(const Vec& p, const std::array<Vec, 3>& t) {
  const Vec n = cross(t[1] - t[0], t[2] - t[0]);
  const long double area = length(n);
  if (area == 0) return std::numeric_limits<long double>::infinity();
  for (std::size_t k = 0; k < 3; ++k)
    if (dot(cross(t[(k + 1) % 3] - t[k], p - t[k]), n) < 0)
      return std::numeric_limits<long double>::infinity();
  return std::abs(dot(p - t[0], n)) / area;
}

inline long double point_triangle(const Vec& p, const std::array<Vec, 3>& t) {
  return std::min({point_face(p, t), point_segment(p, t[0], t[1]), point_segment(p, t[1], t[2]),
                   point_segment(p, t[2], t[0])});
}

/// Of triangles that do not meet, metres.
inline double distance_m(const LatticeTriangle& a, const LatticeTriangle& b, int lattice_exp) {
  std::array<Vec, 3> x, y;
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t k = 0; k < 3; ++k) {
      // Differences first, so that nothing is lost.
      x[i][k] = static_cast<long double>(a[i].v[k] - a[0].v[k]);
      y[i][k] = static_cast<long double>(b[i].v[k] - a[0].v[k]);
    }
  long double least = std::numeric_limits<long double>::infinity();
  for (std::size_t i = 0; i < 3; ++i) {
    least = std::min({least, point_face(x[i], y), point_face(y[i], x)});
    for (std::size_t j = 0; j < 3; ++j)
      least = std::min(least, segment_segment(x[i], x[(i + 1) % 3], y[j], y[(j + 1) % 3]));
  }
  return static_cast<double>(std::ldexp(least, lattice_exp));
}

}  // namespace nearmesh::test
