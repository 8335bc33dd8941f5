// SPDX-License-Identifier: Apache-2.0
#pragma once
// Arithmetic of lattice points, and the lattice planes and lines that lie nearest to a given one:
// what lies there is as close as two things can be without touching.

#include <gmpxx.h>

#include <numeric>

#include "core/base/random.hpp"
#include "exact_overlap.hpp"

namespace nearmesh::soak {

inline LatticePoint operator+(const LatticePoint& p, const LatticePoint& q) {
  return {{p[0] + q[0], p[1] + q[1], p[2] + q[2]}};
}
inline LatticePoint operator-(const LatticePoint& p, const LatticePoint& q) {
  return {{p[0] - q[0], p[1] - q[1], p[2] - q[2]}};
}
inline LatticePoint operator*(std::int64_t s, const LatticePoint& p) {
  return {{s * p[0], s * p[1], s * p[2]}};
}

/// Uniform in [lo, hi].
inline std::int64_t whole(Random& random, std::int64_t lo, std::int64_t hi) {
  return lo + static_cast<std::int64_t>(random.next() % (static_cast<std::uint64_t>(hi - lo) + 1));
}

/// In [0, top]^3; a quarter of the coordinates lie at its ends.
inline LatticePoint point(Random& random, std::int64_t top) {
  LatticePoint p;
  for (int k = 0; k < 3; ++k) {
    p[k] = whole(random, 0, top);
    if (random.below(4) == 0) p[k] = random.below(2) ? p[k] % 2 : top - p[k] % 2;
  }
  return p;
}

/// In [-reach, reach]^3.
inline LatticePoint offset(Random& random, std::int64_t reach) {
  return {
      {whole(random, -reach, reach), whole(random, -reach, reach), whole(random, -reach, reach)}};
}

/// i u + j v, i and j in [lo, hi]. (Compilers differ in which operand of a sum they draw first.)
inline LatticePoint combination(Random& random, std::int64_t lo, std::int64_t hi,
                                const LatticePoint& u, const LatticePoint& v) {
  const std::int64_t i = whole(random, lo, hi);
  const std::int64_t j = whole(random, lo, hi);
  return i * u + j * v;
}

/// One of the six neighbours of the origin.
inline LatticePoint unit_step(Random& random) {
  LatticePoint p;
  p[static_cast<int>(random.below(3))] = random.below(2) ? 1 : -1;
  return p;
}

/// The direction's first lattice point, and how many of them it has. (0 for the zero vector.)
struct Primitive {
  LatticePoint step;
  std::int64_t count;
};
inline Primitive primitive(const LatticePoint& p) {
  const std::int64_t count = std::gcd(std::gcd(p[0], p[1]), p[2]);
  if (count == 0) return {p, 0};
  return {{{p[0] / count, p[1] / count, p[2] / count}}, count};
}

inline test::exact::Vec big(const LatticePoint& p) { return {p[0], p[1], p[2]}; }

/// Sign of (u x v) . w.
inline int side(const LatticePoint& u, const LatticePoint& v, const LatticePoint& w) {
  using namespace test::exact;
  return sgn(dot(cross(big(u), big(v)), big(w)));
}

inline bool parallel(const LatticePoint& u, const LatticePoint& v) {
  using namespace test::exact;
  return is_zero(cross(big(u), big(v)));
}

/// The lattice point w of the lattice plane next to that of u and v, on the side of u x v, which
/// lies above s u + t v with s and t in [0, 1). u and v are not parallel.
inline LatticePoint above_plane(const LatticePoint& u, const LatticePoint& v) {
  using namespace test::exact;
  Vec n = cross(big(u), big(v));
  const mpz_class index = gcd(gcd(n[0], n[1]), n[2]);
  for (mpz_class& x : n) x /= index;
  // Bezout: n . w = 1.
  mpz_class g01, x, y, s, z, one;
  mpz_gcdext(g01.get_mpz_t(), x.get_mpz_t(), y.get_mpz_t(), n[0].get_mpz_t(), n[1].get_mpz_t());
  mpz_gcdext(one.get_mpz_t(), s.get_mpz_t(), z.get_mpz_t(), g01.get_mpz_t(), n[2].get_mpz_t());
  Vec w{x * s, y * s, z};
  const mpz_class scale = index * dot(n, n);
  mpz_class along_u, along_v;
  mpz_fdiv_q(along_u.get_mpz_t(), mpz_class(dot(cross(w, big(v)), n)).get_mpz_t(),
             scale.get_mpz_t());
  mpz_fdiv_q(along_v.get_mpz_t(), mpz_class(dot(cross(big(u), w), n)).get_mpz_t(),
             scale.get_mpz_t());
  LatticePoint out;
  for (std::size_t k = 0; k < 3; ++k) {
    const auto axis = static_cast<int>(k);
    w[k] -= along_u * u[axis] + along_v * v[axis];
    out.v[k] = w[k].get_si();
  }
  return out;
}

/// The same in the plane of the first two coordinates: next to the line of e, to its left, above
/// s e with s in [0, 1).
inline LatticePoint left_of_line(const LatticePoint& e) { return above_plane({{0, 0, 1}}, e); }

}  // namespace nearmesh::soak
