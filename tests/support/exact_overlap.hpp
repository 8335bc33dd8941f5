// SPDX-License-Identifier: Apache-2.0
#pragma once
// Do two closed triangles share a point? In exact rationals (GMP), by construction: the first is a
// polygon that is cut by closed half-spaces whose common part is the second; what is left, if
// anything, is the common part of both. Any triangle may be a segment or a point.

#include <gmpxx.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <utility>
#include <vector>

#include "nearmesh/core/geometry/pose.hpp"

namespace nearmesh::test {

using ExactTriangle = std::array<std::array<mpq_class, 3>, 3>;
using DoubleTriangle = std::array<std::array<double, 3>, 3>;

namespace exact {

using Vec = std::array<mpz_class, 3>;
using Corners = std::array<Vec, 3>;

inline Vec minus(const Vec& a, const Vec& b) { return {a[0] - b[0], a[1] - b[1], a[2] - b[2]}; }
inline mpz_class dot(const Vec& a, const Vec& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
inline Vec cross(const Vec& a, const Vec& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}
inline bool is_zero(const Vec& a) { return a[0] == 0 && a[1] == 0 && a[2] == 0; }

/// The point x / w, w > 0.
struct Point {
  Vec x;
  mpz_class w;
};
using Polygon = std::vector<Point>;  ///< convex, corners in order; they may repeat

enum class Keep { kAbove, kOn };  ///< the closed half-space, or its border alone

/// What is left of a convex polygon where normal . x >= offset, or = offset (Sutherland and Hodgman
/// 1974).
inline Polygon cut(Polygon polygon, const Vec& normal, const mpz_class& offset,
                   Keep keep = Keep::kAbove) {
  std::vector<mpz_class> height;
  height.reserve(polygon.size());
  int above = 0, below = 0;
  for (const Point& p : polygon) {
    height.emplace_back(dot(normal, p.x) - offset * p.w);
    above += height.back() > 0;
    below += height.back() < 0;
  }
  if (below == 0 && (above == 0 || keep == Keep::kAbove)) return polygon;
  Polygon left;
  left.reserve(polygon.size() + 1);
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const std::size_t j = i + 1 == polygon.size() ? 0 : i + 1;
    const Point& p = polygon[i];
    const Point& q = polygon[j];
    if (height[i] == 0 || (height[i] > 0 && keep == Keep::kAbove)) left.push_back(p);
    if (sgn(height[i]) * sgn(height[j]) >= 0) continue;
    // p has the weight |height of q| and q that of p: the point between them at height 0.
    const mpz_class s = abs(height[j]);
    const mpz_class t = abs(height[i]);
    left.push_back({{s * p.x[0] + t * q.x[0], s * p.x[1] + t * q.x[1], s * p.x[2] + t * q.x[2]},
                    s * p.w + t * q.w});
  }
  return left;
}

/// The common part of a polygon and the triangle.
inline Polygon common_part(Polygon polygon, const Corners& triangle) {
  const Vec normal = cross(minus(triangle[1], triangle[0]), minus(triangle[2], triangle[0]));
  if (!is_zero(normal)) {
    polygon = cut(std::move(polygon), normal, dot(normal, triangle[0]), Keep::kOn);
    for (std::size_t i = 0; i < 3 && !polygon.empty(); ++i) {
      const Vec inward = cross(normal, minus(triangle[(i + 1) % 3], triangle[i]));
      polygon = cut(std::move(polygon), inward, dot(inward, triangle[i]));
    }
    return polygon;
  }
  // A segment or a point: its ends are the least and the greatest corner in lexical order. One
  // coordinate of a segment makes it a graph over that axis, of which the ends are known.
  const Vec& first = std::min({triangle[0], triangle[1], triangle[2]});
  const Vec& last = std::max({triangle[0], triangle[1], triangle[2]});
  const Vec along = minus(last, first);
  for (std::size_t k = 0; k < 3 && !polygon.empty(); ++k) {
    Vec axis{0, 0, 0};
    axis[k] = 1;
    // A line is where cross(along, x - first) is zero: three planes, each with such a normal.
    const Vec normal_k = is_zero(along) ? axis : cross(along, axis);
    polygon = cut(std::move(polygon), normal_k, dot(normal_k, first), Keep::kOn);
  }
  if (is_zero(along)) return polygon;
  polygon = cut(std::move(polygon), along, dot(along, first));
  return cut(std::move(polygon), {-along[0], -along[1], -along[2]}, -dot(along, last));
}

inline bool boxes_meet(const Corners& a, const Corners& b) {
  for (std::size_t k = 0; k < 3; ++k) {
    const auto range = [k](const Corners& t) { return std::minmax({t[0][k], t[1][k], t[2][k]}); };
    const auto [a_lo, a_hi] = range(a);
    const auto [b_lo, b_hi] = range(b);
    if (a_lo > b_hi || b_lo > a_hi) return false;
  }
  return true;
}

inline bool overlap(const Corners& a, const Corners& b) {
  if (!boxes_meet(a, b)) return false;
  Polygon polygon;
  for (const Vec& corner : a) polygon.push_back({corner, 1});
  return !common_part(std::move(polygon), b).empty();
}

inline ExactTriangle from_doubles(const DoubleTriangle& t) {
  ExactTriangle out;
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t k = 0; k < 3; ++k) out[i][k] = t[i][k];  // every finite double is a fraction
  return out;
}

}  // namespace exact

/// True iff the closed triangles share a point. Exact for all coordinates.
inline bool exact_overlap(const ExactTriangle& a, const ExactTriangle& b) {
  mpz_class scale = 1;  // makes every coordinate whole
  for (const ExactTriangle* t : {&a, &b})
    for (const auto& corner : *t)
      for (const mpq_class& x : corner) scale = lcm(scale, x.get_den());
  const auto whole = [&scale](const ExactTriangle& t) {
    exact::Corners out;
    for (std::size_t i = 0; i < 3; ++i)
      for (std::size_t k = 0; k < 3; ++k)
        out[i][k] = t[i][k].get_num() * (scale / t[i][k].get_den());
    return out;
  };
  return exact::overlap(whole(a), whole(b));
}

/// The same for finite doubles, each of which is a fraction.
inline bool exact_overlap(const DoubleTriangle& a, const DoubleTriangle& b) {
  return exact_overlap(exact::from_doubles(a), exact::from_doubles(b));
}

/// The same for lattice points, whatever their size. Some 5 us.
inline bool exact_overlap(const LatticeTriangle& a, const LatticeTriangle& b) {
  const auto whole = [&b](const LatticeTriangle& t) {
    exact::Corners out;
    for (int i = 0; i < 3; ++i)
      for (int k = 0; k < 3; ++k) {
        // Relative to a corner: shorter numbers.
        mpz_class& x = out[static_cast<std::size_t>(i)][static_cast<std::size_t>(k)];
        x = t[static_cast<std::size_t>(i)][k];
        x -= b[0][k];
      }
    return out;
  };
  return exact::overlap(whole(a), whole(b));
}

}  // namespace nearmesh::test
