// SPDX-License-Identifier: Apache-2.0
// Rays and balls against single faces, held against exact rationals.
#include <gmpxx.h>
#include <gtest/gtest.h>

#include <optional>

#include "core/base/random.hpp"
#include "core/query/lattice_probes.hpp"
#include "exact_overlap.hpp"

namespace nearmesh::test {
namespace {

mpz_class whole(Int128 x) {
  const bool is_below = x < 0;
  mpz_class out = static_cast<unsigned long>(static_cast<std::uint64_t>((is_below ? -x : x) >> 64));
  out <<= 64;
  out += static_cast<unsigned long>(static_cast<std::uint64_t>(is_below ? -x : x));
  return is_below ? mpz_class(-out) : out;
}
exact::Vec as_exact(const LatticePoint& p) {
  exact::Vec out;
  for (std::size_t k = 0; k < 3; ++k) out[k] = static_cast<long>(p.v[k]);
  return out;
}

/// The least t at which the ray is in the triangle, by cutting the ray with it.
std::optional<mpq_class> true_time(const LatticeRay& ray, const LatticeTriangle& face) {
  const exact::Vec from = as_exact(ray.from), way = exact::minus(as_exact(ray.to), from);
  const exact::Polygon common =
      exact::common_part({{from, 1}, {as_exact(ray.to), 1}},
                         {as_exact(face[0]), as_exact(face[1]), as_exact(face[2])});
  std::optional<mpq_class> first;
  for (const exact::Point& p : common) {
    mpq_class t = 0;
    for (std::size_t k = 0; k < 3; ++k)
      if (way[k] != 0) {
        t = mpq_class(p.x[k] - from[k] * p.w, way[k] * p.w);
        t.canonicalize();
      }
    if (!first || t < *first) first = t;
  }
  return first;
}

/// Corners close together or far apart, often on one line or in a plane with the ray.
LatticePoint random_point(Random& random, std::int64_t reach) {
  LatticePoint p;
  for (std::int64_t& x : p.v)
    x = static_cast<std::int64_t>(random.between(-1, 1) * static_cast<double>(reach));
  return p;
}
LatticePoint between(const LatticePoint& a, const LatticePoint& b, std::int64_t over,
                     std::int64_t under) {
  LatticePoint p;
  for (std::size_t k = 0; k < 3; ++k) p.v[k] = a.v[k] + (b.v[k] - a.v[k]) / under * over;
  return p;
}
struct Scene {
  LatticeRay ray;
  LatticeTriangle face;
};
Scene random_scene(Random& random) {
  const std::int64_t reach = std::int64_t{3} << random.below(33);
  Scene scene;
  for (LatticePoint& corner : scene.face) corner = random_point(random, reach);
  switch (random.below(6)) {
    case 0:
      scene.face[2] = scene.face[random.below(2)];
      break;
    case 1:
      scene.face[1] = between(scene.face[0], scene.face[2], 1, 3);
      break;
    case 2:
      for (LatticePoint& corner : scene.face) corner[static_cast<int>(random.below(3))] = 0;
      break;
    case 3:
      for (LatticePoint& corner : scene.face) corner[2] = 1;
      break;
    default:
      break;
  }
  scene.ray = {random_point(random, reach), random_point(random, reach)};
  const auto& f = scene.face;
  switch (random.below(8)) {
    case 0:  // aimed at a corner, or through it
      scene.ray.to = f[random.below(3)];
      if (random.below(2) != 0) scene.ray.to = between(scene.ray.from, scene.ray.to, 2, 1);
      break;
    case 1:  // at an edge
      scene.ray.to = between(f[0], f[1], 1, 1 + random.below(4));
      break;
    case 2:  // into the face
      scene.ray.to = between(between(f[0], f[1], 1, 2), f[2], 1, 2);
      scene.ray.to = between(scene.ray.from, scene.ray.to, 3, 2);
      break;
    case 3:  // within its plane
      scene.ray = {between(f[0], f[1], static_cast<std::int64_t>(random.below(7)) - 3, 2),
                   between(f[0], f[2], static_cast<std::int64_t>(random.below(7)) - 3, 2)};
      break;
    case 4:  // along an axis
      scene.ray.to = scene.ray.from;
      scene.ray.from[2] = reach;
      scene.ray.to[2] = -reach;
      break;
    case 5:  // a point
      if (random.below(2) != 0) scene.ray.from = f[random.below(3)];
      scene.ray.to = scene.ray.from;
      break;
    case 6:  // along an edge
      scene.ray = {between(f[0], f[1], -1, 1), between(f[0], f[1], 2, 1)};
      break;
    default:
      break;
  }
  return scene;
}

TEST(RayHit, EqualsExactRationals) {
  Random random(11);
  int hits = 0;
  for (int i = 0; i < 60'000; ++i) {
    SCOPED_TRACE(i);
    const Scene scene = random_scene(random);
    const std::optional<mpq_class> truth = true_time(scene.ray, scene.face);
    const std::optional<RayHit> hit = first_hit(scene.ray, scene.face);
    ASSERT_EQ(hit.has_value(), truth.has_value());
    if (!hit) continue;
    ++hits;
    const ExactTime exact = exact_hit(scene.ray, scene.face);
    ASSERT_GT(whole(exact.under), 0);
    mpq_class time(whole(exact.over), whole(exact.under));
    time.canonicalize();
    EXPECT_EQ(time, *truth);
    EXPECT_LE(abs(*truth - mpq_class(hit->t)), mpq_class(hit->error));
    EXPECT_LE(hit->error, 0x1p-39);
  }
  EXPECT_GT(hits, 15'000);
}

TEST(ExactTime, IsOrderedAsRationalsAre) {
  Random random(12);
  const auto number = [&random] {
    const Int128 x = Int128{random.next() >> random.below(64)} << random.below(56);
    return random.below(2) != 0 ? -x : x;
  };
  for (int i = 0; i < 20'000; ++i) {
    ExactTime a{number(), number()}, b{number(), number()};
    a.under = a.under < 0 ? -a.under : a.under + 1;
    b.under = b.under < 0 ? -b.under : b.under + 1;
    if (random.below(4) == 0) b = {2 * a.over, 2 * a.under};
    const int truth =
        sgn(mpz_class(whole(a.over) * whole(b.under) - whole(b.over) * whole(a.under)));
    EXPECT_EQ(a < b, truth < 0);
    EXPECT_EQ(b<a, truth> 0);
  }
}

/// The square of the distance of a point from a triangle.
mpq_class square_to(const LatticePoint& center, const LatticeTriangle& face) {
  const auto at = as_exact(center);
  std::array<exact::Vec, 3> v;
  for (std::size_t i = 0; i < 3; ++i) v[i] = exact::minus(as_exact(face[i]), at);
  mpq_class least = exact::dot(v[0], v[0]);
  const auto offer = [&least](mpq_class square) {
    square.canonicalize();
    if (square < least) least = square;
  };
  const exact::Vec normal = exact::cross(exact::minus(v[1], v[0]), exact::minus(v[2], v[0]));
  bool is_inside = !exact::is_zero(normal);
  for (std::size_t i = 0; i < 3; ++i) {
    const exact::Vec& p = v[i];
    const exact::Vec edge = exact::minus(v[(i + 1) % 3], p);
    offer(exact::dot(p, p));
    const mpz_class length = exact::dot(edge, edge), along = -exact::dot(p, edge);
    if (length != 0 && along >= 0 && along <= length)
      offer(mpq_class(exact::dot(p, p)) - mpq_class(mpz_class(along * along), length));
    is_inside = is_inside && exact::dot(exact::cross(normal, edge), p) <= 0;
  }
  if (is_inside) {
    const mpz_class height = exact::dot(normal, v[0]), square = exact::dot(normal, normal);
    offer(mpq_class(mpz_class(height * height), square));
  }
  return least;
}

TEST(BallMeets, EqualsExactRationals) {
  Random random(13);
  int hits = 0;
  for (int i = 0; i < 40'000; ++i) {
    SCOPED_TRACE(i);
    const Scene scene = random_scene(random);
    LatticeBall ball{.center = random.below(3) == 0 ? scene.ray.to : scene.ray.from};
    const mpq_class square = square_to(ball.center, scene.face);
    // About the distance: the whole numbers on both sides of it, and sometimes just it.
    mpz_class root = sqrt(mpz_class(square.get_num() / square.get_den()));
    ball.radius = std::max(0L, root.get_si() + static_cast<long>(random.below(4)) - 1);
    const bool truth = mpq_class(mpz_class(ball.radius) * mpz_class(ball.radius)) >= square;
    EXPECT_EQ(ball_meets(ball, scene.face), truth);
    hits += truth ? 1 : 0;
  }
  EXPECT_GT(hits, 10'000);
  EXPECT_LT(hits, 35'000);
}

}  // namespace
}  // namespace nearmesh::test
