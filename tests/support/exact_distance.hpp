// SPDX-License-Identifier: Apache-2.0
#pragma once
// Distance of a point from a lattice triangle in 113-bit arithmetic: differences of doubles and
// lattice coordinates below 2^60 cells are exact to 2^-50 cells, far below the errors that tests
// look for.

#include <algorithm>
#include <array>

#include "nearmesh/core/geometry/pose.hpp"

namespace nearmesh::test {

__extension__ typedef __float128 Quad;
using QuadVec = std::array<Quad, 3>;

inline Quad dot(const QuadVec& a, const QuadVec& b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}
inline QuadVec minus(const QuadVec& a, const QuadVec& b) {
  return {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
}
inline QuadVec cross_product(const QuadVec& a, const QuadVec& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}

/// Square of the distance, cells.
inline Quad point_segment_square(const QuadVec& p, const QuadVec& a, const QuadVec& b) {
  const QuadVec d = minus(b, a), w = minus(p, a);
  const Quad square = dot(d, d);
  const Quad t = square > 0 ? std::clamp<Quad>(dot(w, d) / square, 0, 1) : 0;
  const QuadVec rest{w[0] - t * d[0], w[1] - t * d[1], w[2] - t * d[2]};
  return dot(rest, rest);
}

/// Square of the distance, cells, of a point in lattice coordinates.
inline Quad point_triangle_square(const QuadVec& p, const LatticeTriangle& triangle) {
  std::array<QuadVec, 3> c;
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t k = 0; k < 3; ++k) c[i][k] = static_cast<Quad>(triangle[i].v[k]);
  Quad least = std::min({point_segment_square(p, c[0], c[1]), point_segment_square(p, c[1], c[2]),
                         point_segment_square(p, c[2], c[0])});
  const QuadVec n = cross_product(minus(c[1], c[0]), minus(c[2], c[0]));
  const Quad square = dot(n, n);
  if (square == 0) return least;
  for (std::size_t i = 0; i < 3; ++i)
    if (dot(cross_product(minus(c[(i + 1) % 3], c[i]), minus(p, c[i])), n) < 0) return least;
  const Quad height = dot(minus(p, c[0]), n);
  return std::min(least, height * height / square);
}

}  // namespace nearmesh::test
