// SPDX-License-Identifier: Apache-2.0
// Separation of boxes and triangles of two posed models, in doubles, on the safe side.
//
// The slack. All lengths in A's grid units; u = 2^-53; s = scale of B's unit (2^(exp_b - exp_a)).
// 1. pose_point rounds each coordinate of a posed corner by at most half a lattice cell, so a posed
//    corner, hence any point of a posed triangle, lies within sqrt(3)/2 cells of the frame's affine
//    image. Of both models: sqrt(3) cells. A's inverse stretches by less than 1.0001 (check_pose:
//    |R^T R - I| <= 1e-5 an entry, plus 2^-30 rounding). Together 1.7322 c, c = the cell's length.
// 2. Doubles. Centres and corners are exact (int32). rotation carries an error of at most 30u s,
//    translation 30u |t| and, with remainders of both frames, 2u c more, and a mapped point 4u more
//    of its terms; in all less than 64u M (c <= 2^31 (1 + s) where there are remainders), where M =
//    |t|_1 + 2^33 (1 + s) bounds the sum of all magnitudes (int32 points, three axes).
// 3. Any vector n may serve as an axis, so an axis needs no error bound: n is taken as the exact
// double
//    computed. What must hold is that projections on n are honest. Every projection below is a sum
//    of products of n's components (or of the very factors that are n's components: an axis e_i x
//    r_j consists of entries of r_j) with coordinates, so its error is at most 64u M |n|,
//    near-parallel edges included. The edge r_j itself projects on e_i x r_j to at most its own
//    rounding.
// 4. A drift moves projections on n by at most |n . along| + around |n|; what doubles add to that
//    is below 128u (|along|_1 + around) |n|, and `reach` puts it into `around`.
// 5. A half-space of A's is an axis n with a bound of A's side along it, a whole number below 2^9
//    M: the other side is projected as above, and 8u (|n|_1 M + |bound|) for the last sums is
//    inside, since |n|_1 >= 127.
// Hence slack = 1.7322 c + 128u M, and growing A's half extents by the slack on each axis grows the
// projection by slack |n|_1 >= slack |n|_2: enough for every axis, with no further constants.
#include "nearmesh/core/geometry/detail/box_overlap.hpp"

#include <algorithm>
#include <cmath>

#include "slack.hpp"

namespace nearmesh {
namespace {

/// v + t d
Vec3 along(const Vec3& v, double t, const Vec3& d) {
  return {v[0] + t * d[0], v[1] + t * d[1], v[2] + t * d[2]};
}

/// Box a grown by the slack, box b, and the vector from a's centre to b's.
struct BoxPair {
  Vec3 between;
  Vec3 ha;
  const Vec3& hb;
};

BoxPair pair_up(const RelativeFrame& f, const CenteredBox& a, const CenteredBox& b, double grow) {
  const Vec3 mapped = turn(f.rotation, b.center);
  BoxPair pair{{}, {}, b.half};
  for (std::size_t k = 0; k < 3; ++k) {
    pair.between[k] = mapped[k] + f.translation[k] - a.center[k];
    pair.ha[k] = a.half[k] + grow;
  }
  return pair;
}

/// Gap along a's axis i, in A's units; not positive when the boxes overlap there.
double gap_on_a(const RelativeFrame& f, const BoxPair& p, std::size_t i) {
  const double* row = f.abs_rotation.data() + 3 * i;
  return std::abs(p.between[i]) -
         (p.ha[i] + (row[0] * p.hb[0] + row[1] * p.hb[1] + row[2] * p.hb[2]));
}

/// Gap along the normal of b's face pair i, in B's units.
double gap_on_b(const RelativeFrame& f, const BoxPair& p, std::size_t i) {
  const double* n = f.inverse.data() + 3 * i;
  const double* abs_n = f.abs_inverse.data() + 3 * i;
  return std::abs(n[0] * p.between[0] + n[1] * p.between[1] + n[2] * p.between[2]) -
         (p.hb[i] + (abs_n[0] * p.ha[0] + abs_n[1] * p.ha[1] + abs_n[2] * p.ha[2]));
}

/// Gap along e_i x r_j, times that vector's length.
double gap_on_edges(const RelativeFrame& f, const BoxPair& p, std::size_t i, std::size_t j) {
  const std::size_t i1 = (i + 1) % 3;
  const std::size_t i2 = (i + 2) % 3;
  const std::size_t j1 = (j + 1) % 3;
  const std::size_t j2 = (j + 2) % 3;
  const double n1 = f.rotation[3 * i2 + j];  // the axis is (0, -n1, n2) on (i, i1, i2)
  const double n2 = f.rotation[3 * i1 + j];
  return std::abs(n2 * p.between[i2] - n1 * p.between[i1]) -
         (p.ha[i1] * f.abs_rotation[3 * i2 + j] + p.ha[i2] * f.abs_rotation[3 * i1 + j] +
          (p.hb[j1] * f.abs_cofactor[3 * i + j2] + p.hb[j2] * f.abs_cofactor[3 * i + j1]));
}

double edge_axis_length_squared(const RelativeFrame& f, std::size_t i, std::size_t j) {
  const double n1 = f.rotation[3 * ((i + 2) % 3) + j];
  const double n2 = f.rotation[3 * ((i + 1) % 3) + j];
  return n1 * n1 + n2 * n2;
}

double positive(double x) { return x > 0 ? x : 0; }

double clamp01(double x) { return x < 0 ? 0 : x > 1 ? 1 : x; }

double ratio(double numerator, double denominator) {
  return denominator > 0 ? clamp01(numerator / denominator) : 0;
}

/// Shortest vector found so far from a's triangle to b's.
struct Shortest {
  Vec3 vector{};
  double squared = -1;
  void offer(const Vec3& v) {
    const double length = dot(v, v);
    if (squared < 0 || length < squared) {
      squared = length;
      vector = v;
    }
  }
};

/// Source: Ericson, Real-Time Collision Detection, 2005, section 5.1.9. Approximate: the caller
/// projects honestly on the direction found.
void offer_edges(const Vec3& p, const Vec3& u, const Vec3& q, const Vec3& v, Shortest& best) {
  const Vec3 r = minus(p, q);
  const double a = dot(u, u);
  const double e = dot(v, v);
  const double b = dot(u, v);
  const double c = dot(u, r);
  const double g = dot(v, r);
  double s = ratio(b * g - c * e, a * e - b * b);
  double t = e > 0 ? (b * s + g) / e : 0;
  if (!(t >= 0 && t <= 1)) {
    t = clamp01(t);
    s = ratio(b * t - c, a);
  } else if (e <= 0) {
    s = ratio(-c, a);
  }
  best.offer(minus(along(q, t, v), along(p, s, u)));
}

/// Corners of `from` above the face of `to`: the vector from corner to face, times `direction`.
void offer_corner_faces(const DoubleTriangle& from, const DoubleTriangle& to, double direction,
                        Shortest& best) {
  const Vec3 u = minus(to[1], to[0]);
  const Vec3 v = minus(to[2], to[0]);
  const Vec3 n = cross(u, v);
  const double n2 = dot(n, n);
  if (!(n2 > 0)) return;
  for (const Vec3& corner : from) {
    const Vec3 w = minus(corner, to[0]);
    const double x = dot(cross(w, v), n);
    const double y = dot(cross(u, w), n);
    if (x < 0 || y < 0 || x + y > n2) continue;
    const double height = -direction * dot(w, n) / n2;
    best.offer({height * n[0], height * n[1], height * n[2]});
  }
}

/// The direction between the closest edges, or corner and face, as well as doubles find it.
Shortest shortest_between(const DoubleTriangle& a, const DoubleTriangle& b) {
  Shortest best;
  for (std::size_t i = 0; i < 3; ++i) {
    const Vec3 u = minus(a[(i + 1) % 3], a[i]);
    for (std::size_t j = 0; j < 3; ++j)
      offer_edges(a[i], u, b[j], minus(b[(j + 1) % 3], b[j]), best);
  }
  offer_corner_faces(a, b, 1, best);
  offer_corner_faces(b, a, -1, best);
  return best;
}

/// From the end of a to the start of b on the axis n, times its length.
double gap_along(const Vec3& n, const DoubleTriangle& a, const DoubleTriangle& b) {
  double a_end = dot(n, minus(a[0], a[0]));
  double b_start = dot(n, minus(b[0], a[0]));
  for (std::size_t i = 1; i < 3; ++i) {
    a_end = std::max(a_end, dot(n, minus(a[i], a[0])));
    b_start = std::min(b_start, dot(n, minus(b[i], a[0])));
  }
  return b_start - a_end;
}

}  // namespace

double reach(const Drift& drift) {
  const double along =
      std::abs(drift.along[0]) + std::abs(drift.along[1]) + std::abs(drift.along[2]);
  return drift.around + kDoubleRounding * (drift.around + along);
}

CenteredBox centered(const GridBox& box) {
  CenteredBox out;
  for (int k = 0; k < 3; ++k) {
    const double lo = box.lo[k];
    const double hi = box.hi[k];
    out.center[static_cast<std::size_t>(k)] = 0.5 * (lo + hi);
    out.half[static_cast<std::size_t>(k)] = 0.5 * (hi - lo);
  }
  return out;
}

bool boxes_apart(const RelativeFrame& f, const CenteredBox& a, const CenteredBox& b) {
  const BoxPair pair = pair_up(f, a, b, f.slack);
  for (std::size_t i = 0; i < 3; ++i)
    if (gap_on_a(f, pair, i) > 0) return true;
  for (std::size_t i = 0; i < 3; ++i)
    if (gap_on_b(f, pair, i) > 0) return true;
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t j = 0; j < 3; ++j)
      if (gap_on_edges(f, pair, i, j) > 0) return true;
  return false;
}

bool boxes_stay_apart(const RelativeFrame& f, const Drift& drift, const CenteredBox& a,
                      const CenteredBox& b) {
  const BoxPair pair = pair_up(f, a, b, f.slack + reach(drift));
  const Vec3& d = drift.along;
  for (std::size_t i = 0; i < 3; ++i)
    if (gap_on_a(f, pair, i) > std::abs(d[i])) return true;
  for (std::size_t i = 0; i < 3; ++i) {
    const double* n = f.inverse.data() + 3 * i;
    if (gap_on_b(f, pair, i) > std::abs(n[0] * d[0] + n[1] * d[1] + n[2] * d[2])) return true;
  }
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t j = 0; j < 3; ++j) {
      const std::size_t i1 = (i + 1) % 3;
      const std::size_t i2 = (i + 2) % 3;
      const double moved = f.rotation[3 * i1 + j] * d[i2] - f.rotation[3 * i2 + j] * d[i1];
      if (gap_on_edges(f, pair, i, j) > std::abs(moved)) return true;
    }
  return false;
}

double boxes_gap_m(const RelativeFrame& f, const CenteredBox& a, const CenteredBox& b,
                   double enough_m) {
  const BoxPair pair = pair_up(f, a, b, f.slack);
  // a's axes are orthonormal in A's units, b's normals in B's, so gaps along them add as squares.
  const auto along = [](const auto& gap_on) {
    double squares = 0;
    for (std::size_t i = 0; i < 3; ++i) {
      const double gap = positive(gap_on(i));
      squares += gap * gap;
    }
    return std::sqrt(squares);
  };
  double gap_m = along([&](std::size_t i) { return gap_on_a(f, pair, i); }) *
                 f.least_metres_per_unit * kGapShrink;
  if (gap_m > 0 && gap_m >= enough_m) return gap_m;
  gap_m = std::max(gap_m, along([&](std::size_t i) { return gap_on_b(f, pair, i); }) *
                              f.least_metres_per_b_unit * kGapShrink);
  if (gap_m > 0 && gap_m >= enough_m) return gap_m;
  double on_edges = 0;
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t j = 0; j < 3; ++j) {
      const double gap = gap_on_edges(f, pair, i, j);
      if (gap > 0)
        on_edges = std::max(on_edges, gap / std::sqrt(edge_axis_length_squared(f, i, j)));
    }
  return std::max(gap_m, on_edges * f.least_metres_per_unit * kGapShrink);
}

Extent extent_in_a(const RelativeFrame& f, const CenteredBox& b) {
  Extent extent{.metres_per_unit = f.least_metres_per_unit * kGapShrink};
  const Vec3 mapped = turn(f.rotation, b.center);
  for (std::size_t k = 0; k < 3; ++k) {
    const double* row = f.abs_rotation.data() + 3 * k;
    const double center = mapped[k] + f.translation[k],
                 half = f.slack + (row[0] * b.half[0] + row[1] * b.half[1] + row[2] * b.half[2]);
    extent.lo[k] = center - half;
    extent.hi[k] = center + half;
  }
  return extent;
}

DoubleTriangle to_a_units(const RelativeFrame& f, const std::array<GridPoint, 3>& b) {
  DoubleTriangle out;
  for (std::size_t i = 0; i < 3; ++i) {
    const Vec3 mapped = turn(
        f.rotation,
        {static_cast<double>(b[i][0]), static_cast<double>(b[i][1]), static_cast<double>(b[i][2])});
    for (std::size_t k = 0; k < 3; ++k) out[i][k] = mapped[k] + f.translation[k];
  }
  return out;
}

DoubleTriangle as_doubles(const std::array<GridPoint, 3>& a) {
  DoubleTriangle out;
  for (std::size_t i = 0; i < 3; ++i)
    for (int k = 0; k < 3; ++k) out[i][static_cast<std::size_t>(k)] = a[i][k];
  return out;
}

bool box_triangle_apart(const RelativeFrame& f, const CenteredBox& a, const DoubleTriangle& t) {
  const Vec3 half{a.half[0] + f.slack, a.half[1] + f.slack, a.half[2] + f.slack};
  const DoubleTriangle v{minus(t[0], a.center), minus(t[1], a.center), minus(t[2], a.center)};
  for (std::size_t k = 0; k < 3; ++k) {
    const double lo = std::min(std::min(v[0][k], v[1][k]), v[2][k]);
    const double hi = std::max(std::max(v[0][k], v[1][k]), v[2][k]);
    if (lo > half[k] || hi < -half[k]) return true;
  }
  const DoubleTriangle edges{minus(v[1], v[0]), minus(v[2], v[1]), minus(v[0], v[2])};
  {
    const Vec3 n = cross(edges[0], edges[1]);
    const double radius =
        std::abs(n[0]) * half[0] + std::abs(n[1]) * half[1] + std::abs(n[2]) * half[2];
    const Vec3 d{dot(n, v[0]), dot(n, v[1]), dot(n, v[2])};
    if (std::min(std::min(d[0], d[1]), d[2]) > radius ||
        std::max(std::max(d[0], d[1]), d[2]) < -radius)
      return true;
  }
  for (std::size_t j = 0; j < 3; ++j) {
    const Vec3& e = edges[j];
    const Vec3& on_edge = v[j];  // both ends of the edge project alike
    const Vec3& opposite = v[(j + 2) % 3];
    for (std::size_t i = 0; i < 3; ++i) {
      const std::size_t i1 = (i + 1) % 3;
      const std::size_t i2 = (i + 2) % 3;
      const double d0 = e[i1] * on_edge[i2] - e[i2] * on_edge[i1];
      const double d1 = e[i1] * opposite[i2] - e[i2] * opposite[i1];
      const double radius = std::abs(e[i2]) * half[i1] + std::abs(e[i1]) * half[i2];
      if (std::min(d0, d1) > radius || std::max(d0, d1) < -radius) return true;
    }
  }
  return false;
}

std::array<double, 3> shortest_way(const DoubleTriangle& a, const DoubleTriangle& b) {
  return shortest_between(a, b).vector;
}

double triangles_gap_m(const RelativeFrame& f, const DoubleTriangle& a, const DoubleTriangle& b) {
  const Shortest best = shortest_between(a, b);
  if (!(best.squared > 0)) return 0;
  const double gap = gap_along(best.vector, a, b) / std::sqrt(best.squared) - f.slack;
  return positive(gap) * f.least_metres_per_unit * kGapShrink;
}

bool box_triangle_stay_apart(const RelativeFrame& f, const Drift& drift, const CenteredBox& a,
                             const DoubleTriangle& t) {
  CenteredBox grown = a;
  for (std::size_t k = 0; k < 3; ++k) grown.half[k] += reach(drift) + std::abs(drift.along[k]);
  return box_triangle_apart(f, grown, t);
}

bool triangles_stay_apart(const RelativeFrame& f, const Drift& drift, const DoubleTriangle& a,
                          const DoubleTriangle& b) {
  const Vec3& d = drift.along;
  const double grow = f.slack + reach(drift);
  for (std::size_t k = 0; k < 3; ++k) {
    const double needed = grow + std::abs(d[k]);
    const double lo_a = std::min(std::min(a[0][k], a[1][k]), a[2][k]);
    const double hi_a = std::max(std::max(a[0][k], a[1][k]), a[2][k]);
    const double lo_b = std::min(std::min(b[0][k], b[1][k]), b[2][k]);
    const double hi_b = std::max(std::max(b[0][k], b[1][k]), b[2][k]);
    if (lo_b - hi_a > needed || lo_a - hi_b > needed) return true;
  }
  const Shortest best = shortest_between(a, b);
  if (!(best.squared > 0)) return false;
  const double gap = gap_along(best.vector, a, b) - std::abs(dot(best.vector, d));
  return gap / std::sqrt(best.squared) * kGapShrink > grow;
}

namespace {

/// What the other body must be beyond the half-space's plane: for rounding, of posed corners too,
/// and for the drift.
double room_on(const RelativeFrame& f, const Drift& drift, const Vec3& normal) {
  const double length = std::abs(normal[0]) + std::abs(normal[1]) + std::abs(normal[2]);
  return (f.slack + reach(drift)) * length + std::abs(dot(normal, drift.along));
}

}  // namespace

bool half_space_box_stay_apart(const RelativeFrame& f, const Drift& drift, const BoundedPart& a,
                               const CenteredBox& b) {
  const Vec3 mapped = turn(f.rotation, b.center);
  double least = 0;
  for (std::size_t k = 0; k < 3; ++k) least += a.normal[k] * (mapped[k] + f.translation[k]);
  for (std::size_t j = 0; j < 3; ++j)
    least -=
        std::abs(dot(a.normal, {f.rotation[j], f.rotation[3 + j], f.rotation[6 + j]})) * b.half[j];
  return least > a.bound + room_on(f, drift, a.normal);
}

bool half_space_triangle_stay_apart(const RelativeFrame& f, const Drift& drift,
                                    const BoundedPart& a, const DoubleTriangle& t) {
  const double least =
      std::min(std::min(dot(a.normal, t[0]), dot(a.normal, t[1])), dot(a.normal, t[2]));
  return least > a.bound + room_on(f, drift, a.normal);
}

}  // namespace nearmesh
