// SPDX-License-Identifier: Apache-2.0
#pragma once
// Whether contact points lie where they should: distance of each from both posed meshes, angle of each normal to the
// truth.

#include <algorithm>
#include <cmath>
#include <vector>

#include "case.hpp"

namespace nearmesh::stability {

using Point = std::array<double, 3>;

inline Point minus(const Point& a, const Point& b) {
  return {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
}
inline double dot(const Point& a, const Point& b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}
inline Point along(const Point& p, const Point& d, double t) {
  return {p[0] + t * d[0], p[1] + t * d[1], p[2] + t * d[2]};
}

inline double segment_distance_m(const Point& x, const Point& p, const Point& q) {
  const Point d = minus(q, p);
  const double square = dot(d, d);
  const double t = square > 0 ? std::clamp(dot(minus(x, p), d) / square, 0.0, 1.0) : 0;
  const Point off = minus(x, along(p, d, t));
  return std::sqrt(dot(off, off));
}

/// In doubles: good to some 2^-50 of the coordinates.
inline double triangle_distance_m(const Point& x, const Point& p, const Point& q, const Point& r) {
  const Point u = minus(q, p), v = minus(r, p), w = minus(x, p);
  const double uu = dot(u, u), uv = dot(u, v), vv = dot(v, v), wu = dot(w, u), wv = dot(w, v);
  const double area = uu * vv - uv * uv;
  if (area > 0) {
    const double s = (wu * vv - wv * uv) / area, t = (wv * uu - wu * uv) / area;
    if (s >= 0 && t >= 0 && s + t <= 1) {
      const Point off = minus(w, along(along({}, u, s), v, t));
      return std::sqrt(dot(off, off));
    }
  }
  return std::min(
      {segment_distance_m(x, p, q), segment_distance_m(x, q, r), segment_distance_m(x, r, p)});
}

inline double distance_m(const Point& x, const Body& body) {
  std::vector<Point> placed;
  const auto& m = body.pose.rotation;
  for (const Point& p : body.mesh->positions_m)
    placed.push_back({m[0] * p[0] + m[1] * p[1] + m[2] * p[2] + body.pose.translation_m[0],
                      m[3] * p[0] + m[4] * p[1] + m[5] * p[2] + body.pose.translation_m[1],
                      m[6] * p[0] + m[7] * p[1] + m[8] * p[2] + body.pose.translation_m[2]});
  double least = 1e300;
  for (const auto& f : body.mesh->faces)
    least = std::min(least, triangle_distance_m(x, placed[f[0]], placed[f[1]], placed[f[2]]));
  return least;
}

struct ContactPoint {
  Point at_m{}, normal{};  ///< world; the normal of any length, from a to b
};

/// The verdict of a system that found these. Points beyond the first 400 are skipped evenly.
inline Verdict judge_contacts(const Case& asked, const std::vector<ContactPoint>& contacts) {
  Verdict verdict{.kind = contacts.empty() ? Verdict::Kind::kFree : Verdict::Kind::kTouches};
  const std::size_t stride = contacts.size() / 400 + 1;
  for (std::size_t i = 0; i < contacts.size(); i += stride) {
    const ContactPoint& c = contacts[i];
    verdict.position_error_m = std::max(
        {verdict.position_error_m, distance_m(c.at_m, asked.a), distance_m(c.at_m, asked.b)});
    const double length = std::sqrt(dot(c.normal, c.normal));
    // atan2 is good at small angles, where acos is not. No normal at all counts as the opposite one.
    const Point n = length > 0 ? along({}, c.normal, 1 / length) : along({}, asked.normal, -1);
    const Point less = minus(n, asked.normal), more = along(n, asked.normal, 1);
    verdict.normal_error_rad =
        std::max(verdict.normal_error_rad,
                 2 * std::atan2(std::sqrt(dot(less, less)), std::sqrt(dot(more, more))));
  }
  return verdict;
}

}  // namespace nearmesh::stability
