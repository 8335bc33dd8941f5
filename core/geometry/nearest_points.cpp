// SPDX-License-Identifier: Apache-2.0
// Nearest points of two triangles: each corner against the other's edges and face, each edge
// against each.
//
// Error. A point is x + s u + t v with s, t >= 0, s + t <= 1 and edges u, v from x, all exact
// integers. With the roundings of both products and both sums it is off its triangle by less than 6
// * 2^-53 E a coordinate, hence 11 * 2^-53 E in length, E being the greatest difference of two of
// the six corners' coordinates along an axis. The distance of two such points errs by 22 * 2^-53 E
// and its own rounding, which 2^-48 E and 2^-50 of it cover. Whether the points are the nearest
// ones does not count for that.
#include "nearest_points.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "vec3.hpp"

namespace nearmesh {
namespace {

using Corners = std::array<Vec3, 3>;

/// x + s u.
Vec3 on_line(const Vec3& x, const Vec3& u, double s) {
  return {x[0] + s * u[0], x[1] + s * u[1], x[2] + s * u[2]};
}

struct Nearest {
  double square = std::numeric_limits<double>::infinity();
  Vec3 on_a{}, on_b{};

  void offer(const Vec3& a, const Vec3& b) {
    const Vec3 way = minus(a, b);
    const double d = dot(way, way);
    if (d < square) *this = {d, a, b};
  }
};

/// Calls offer(point of the triangle) for the nearest one on each of its edges, and for the foot of
/// p where it is in the face.
template <class Offer>
void for_nearest(const Vec3& p, const Corners& t, const Offer& offer) {
  for (std::size_t i = 0; i < 3; ++i) {
    const Vec3 u = minus(t[(i + 1) % 3], t[i]);
    const double square = dot(u, u);
    const double s = square > 0 ? std::clamp(dot(minus(p, t[i]), u) / square, 0.0, 1.0) : 0;
    offer(on_line(t[i], u, s));
  }
  const Vec3 u = minus(t[1], t[0]), v = minus(t[2], t[0]), w = minus(p, t[0]);
  const Vec3 n = cross(u, v);
  const double area = dot(n, n);
  if (!(area > 0)) return;
  const double along_u = dot(cross(w, v), n) / area, along_v = dot(cross(u, w), n) / area;
  if (along_u >= 0 && along_v >= 0 && along_u + along_v <= 1)
    offer(on_line(on_line(t[0], u, along_u), v, along_v));
}

/// Where both lines' nearest points lie on the edges.
void offer_edges(const Vec3& p, const Vec3& u, const Vec3& r, const Vec3& v, Nearest& nearest) {
  const Vec3 w = minus(p, r);
  const double a = dot(u, u), b = dot(u, v), c = dot(v, v), d = dot(u, w), e = dot(v, w);
  const double determinant = a * c - b * b;
  if (!(determinant > 0)) return;
  const double s = (b * e - c * d) / determinant, t = (a * e - b * d) / determinant;
  if (s >= 0 && s <= 1 && t >= 0 && t <= 1) nearest.offer(on_line(p, u, s), on_line(r, v, t));
}

}  // namespace

NearestPoints nearest_points(const LatticeTriangle& a, const LatticeTriangle& b) {
  Corners x, y;
  double extent = 0;
  for (std::size_t k = 0; k < 3; ++k) {
    double lo = 0, hi = 0;
    for (std::size_t i = 0; i < 3; ++i) {
      x[i][k] = static_cast<double>(a[i].v[k] - a[0].v[k]);
      y[i][k] = static_cast<double>(b[i].v[k] - a[0].v[k]);
      lo = std::min({lo, x[i][k], y[i][k]});
      hi = std::max({hi, x[i][k], y[i][k]});
    }
    extent = std::max(extent, hi - lo);
  }
  Nearest nearest;
  for (std::size_t i = 0; i < 3; ++i) {
    for_nearest(x[i], y, [&](const Vec3& point) { nearest.offer(x[i], point); });
    for_nearest(y[i], x, [&](const Vec3& point) { nearest.offer(point, y[i]); });
    const Vec3 u = minus(x[(i + 1) % 3], x[i]);
    for (std::size_t j = 0; j < 3; ++j)
      offer_edges(x[i], u, y[j], minus(y[(j + 1) % 3], y[j]), nearest);
  }
  return {nearest.on_a, nearest.on_b, std::sqrt(nearest.square) * (1 + 0x1p-50) + 0x1p-48 * extent};
}

double distance_to_triangle(const Vec3& p, const Corners& triangle) {
  Nearest nearest;
  for_nearest(p, triangle, [&](const Vec3& point) { nearest.offer(p, point); });
  return std::sqrt(nearest.square);
}

}  // namespace nearmesh
