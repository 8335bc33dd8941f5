// SPDX-License-Identifier: Apache-2.0
// A ray p + t d against a face with the corners p + v_i. For a face with a plane that the ray
// crosses:
//   the line of the ray passes on one side of all three edges:  s_i = d . (v_i x (v_(i+1) - v_i))
//   have no two signs; it meets the plane at t = (n . v_0) / (n . d), n the plane's normal.
// In doubles first. Differences of lattice points are exact there. Each of these numbers is a
// triple product, off by less than 2^-47 of the product of its factors' greatest components
// (triangle_overlap.cpp). What that leaves open, and all that has no plane or lies in it, is
// decided on integers: whether they meet by triangles_overlap(), where by exact_hit().
#include "lattice_probes.hpp"

#include <algorithm>
#include <cmath>

#include "core/geometry/triangle_overlap.hpp"

namespace nearmesh {
namespace {

__extension__ typedef unsigned __int128 Uint128;

/// 256 bits.
struct Wide {
  Uint128 high = 0, low = 0;
  bool operator==(const Wide&) const = default;
  auto operator<=>(const Wide&) const = default;

  Wide& operator+=(const Wide& other) {
    low += other.low;
    high += other.high + (low < other.low ? 1 : 0);
    return *this;
  }
};

Uint128 magnitude(Int128 x) { return x < 0 ? -static_cast<Uint128>(x) : static_cast<Uint128>(x); }

Wide product(Uint128 a, Uint128 b) {
  constexpr Uint128 kLow = ~std::uint64_t{0};
  const Uint128 a0 = a & kLow, a1 = a >> 64, b0 = b & kLow, b1 = b >> 64;
  const Uint128 low = a0 * b0, middle_a = a1 * b0, middle_b = a0 * b1, high = a1 * b1;
  const Uint128 carry = (low >> 64) + (middle_a & kLow) + (middle_b & kLow);
  return {high + (middle_a >> 64) + (middle_b >> 64) + (carry >> 64), (carry << 64) | (low & kLow)};
}

constexpr double kFilter = 0x1p-47;
/// A hit whose t doubles tell no better than this is worked out exactly.
constexpr double kFineTime = 0x1p-40;
/// Of an exact t, rounded: numerator, denominator and quotient.
constexpr double kRoundedTime = 0x1p-51;

Double3 difference(const LatticePoint& p, const LatticePoint& q) {
  return subtract<double>(p.v, q.v);
}
double greatest(const Double3& v) {
  return std::max(std::max(std::abs(v[0]), std::abs(v[1])), std::abs(v[2]));
}

ExactTime make_time(Int128 over, Int128 under) {
  return under < 0 ? ExactTime{-over, -under} : ExactTime{over, under};
}
bool is_on_ray(const ExactTime& t) { return t.over >= 0 && t.over <= t.under; }

/// The first common point with a segment or point from a to b, where the ray has a length and does
/// not start on it.
std::optional<ExactTime> first_on_segment(const LatticeRay& ray, const LatticePoint& a,
                                          const LatticePoint& b) {
  const Wide3 d = subtract<Int128>(ray.to.v, ray.from.v), e = subtract<Int128>(b.v, a.v),
              w = subtract<Int128>(a.v, ray.from.v);
  const Wide3 across = cross(d, e);
  if (!is_zero(across)) {
    if (dot(w, across) != 0) return std::nullopt;
    const std::size_t k = nonzero_axis(across);
    const ExactTime on_ray = make_time(cross(w, e)[k], across[k]),
                    on_edge = make_time(cross(w, d)[k], across[k]);
    if (is_on_ray(on_ray) && is_on_ray(on_edge)) return on_ray;
    return std::nullopt;
  }
  if (!is_zero(cross(w, d))) return std::nullopt;  // beside it
  const std::size_t k = nonzero_axis(d);
  const ExactTime at_a = make_time(w[k], d[k]), at_b = make_time(w[k] + e[k], d[k]);
  const ExactTime first = std::min(at_a, at_b);
  if (is_on_ray(first)) return first;
  return std::nullopt;
}

/// A sum of squares of a ordered against one of b; each of the numbers is below 2^126.
std::strong_ordering compare_squares(const Wide3& a, const Wide3& b) {
  Wide left, right;
  for (const Int128 x : a) left += product(magnitude(x), magnitude(x));
  for (const Int128 x : b) right += product(magnitude(x), magnitude(x));
  return left <=> right;
}

/// The sign of a . b.
int sign_of_product(const Wide3& a, const Wide3& b) {
  Wide up, down;
  for (std::size_t k = 0; k < 3; ++k)
    ((a[k] < 0) == (b[k] < 0) ? up : down) += product(magnitude(a[k]), magnitude(b[k]));
  return up > down ? 1 : up < down ? -1 : 0;
}

}  // namespace

std::strong_ordering operator<=>(const ExactTime& a, const ExactTime& b) {
  if ((a.over < 0) != (b.over < 0))
    return a.over < 0 ? std::strong_ordering::less : std::strong_ordering::greater;
  const Wide left = product(magnitude(a.over), magnitude(b.under)),
             right = product(magnitude(b.over), magnitude(a.under));
  return a.over < 0 ? right <=> left : left <=> right;
}

ExactTime exact_hit(const LatticeRay& ray, const LatticeTriangle& face) {
  const Wide3 d = subtract<Int128>(ray.to.v, ray.from.v);
  const Wide3 normal =
      cross(subtract<Int128>(face[1].v, face[0].v), subtract<Int128>(face[2].v, face[0].v));
  if (const Int128 towards = dot(normal, d); towards != 0)
    return make_time(dot(normal, subtract<Int128>(face[0].v, ray.from.v)), towards);
  // In the face's plane, or the face has none. The ray starts in the face, or comes into it over an
  // edge.
  if (is_zero(d) || triangles_overlap({ray.from, ray.from, ray.from}, face)) return {};
  std::optional<ExactTime> first;
  for (std::size_t i = 0; i < 3; ++i)
    if (const auto at = first_on_segment(ray, face[i], face[(i + 1) % 3]);
        at && (!first || *at < *first))
      first = at;
  NEARMESH_ASSERT(first.has_value());
  return first.value_or(ExactTime{});
}

std::optional<RayHit> first_hit(const LatticeRay& ray, const LatticeTriangle& face) {
  const Double3 d = difference(ray.to, ray.from);
  const std::array<Double3, 3> v{difference(face[0], ray.from), difference(face[1], ray.from),
                                 difference(face[2], ray.from)};
  const std::array<Double3, 3> e{subtract<double>(v[1], v[0]), subtract<double>(v[2], v[1]),
                                 subtract<double>(v[0], v[2])};
  const double reach = std::max(std::max(greatest(v[0]), greatest(v[1])), greatest(v[2]));
  const double side = std::max(std::max(greatest(e[0]), greatest(e[1])), greatest(e[2]));
  const double length = greatest(d);
  const Double3 s{dot(d, cross(v[0], e[0])), dot(d, cross(v[1], e[1])), dot(d, cross(v[2], e[2]))};
  const double side_bound = kFilter * length * reach * side;
  const double least = std::min(std::min(s[0], s[1]), s[2]),
               most = std::max(std::max(s[0], s[1]), s[2]);
  if (least < -side_bound && most > side_bound) return std::nullopt;
  if (least > side_bound || most < -side_bound) {
    const Double3 normal = cross(e[0], e[1]);
    const double towards = dot(normal, d), towards_bound = kFilter * side * side * length;
    const double way = dot(normal, v[0]), way_bound = kFilter * side * side * reach;
    const double under = std::abs(towards), over = towards < 0 ? -way : way;
    if (under > towards_bound) {
      if (over < -way_bound || over > under + way_bound + towards_bound) return std::nullopt;
      const double error = 2 * (way_bound + towards_bound) / under + kRoundedTime;
      if (over > way_bound && over < under - way_bound - towards_bound && error <= kFineTime)
        return RayHit{over / under, error};
    }
  }
  if (!triangles_overlap({ray.from, ray.to, ray.to}, face)) return std::nullopt;
  const ExactTime exact = exact_hit(ray, face);
  return RayHit{static_cast<double>(exact.over) / static_cast<double>(exact.under), kRoundedTime};
}

/// The point of a triangle next to the centre is a corner, on an edge, or in its plane right below
/// the centre.
bool ball_meets(const LatticeBall& ball, const LatticeTriangle& face) {
  const Int128 radius = ball.radius;
  const auto times_radius = [&](const Wide3& v) {
    return Wide3{radius * v[0], radius * v[1], radius * v[2]};
  };
  std::array<Wide3, 3> v;
  for (std::size_t i = 0; i < 3; ++i) {
    v[i] = subtract<Int128>(face[i].v, ball.center.v);
    if (dot(v[i], v[i]) <= radius * radius) return true;
  }
  const Wide3 normal =
      cross(subtract<Int128>(face[1].v, face[0].v), subtract<Int128>(face[2].v, face[0].v));
  bool is_over_face = !is_zero(normal);
  for (std::size_t i = 0; i < 3; ++i) {
    const Wide3 edge = subtract<Int128>(face[(i + 1) % 3].v, face[i].v);
    const Wide3 across = cross(v[i], edge);
    const Int128 along = -dot(v[i], edge);
    if (!is_zero(edge) && along >= 0 && along <= dot(edge, edge) &&
        compare_squares(across, times_radius(edge)) <= 0)
      return true;
    is_over_face = is_over_face && sign_of_product(normal, across) >= 0;
  }
  return is_over_face && compare_squares({dot(normal, v[0]), 0, 0}, times_radius(normal)) <= 0;
}

}  // namespace nearmesh
