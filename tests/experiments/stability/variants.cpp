// SPDX-License-Identifier: Apache-2.0
#include "variants.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <numeric>

#include "core/base/random.hpp"
#include "nearmesh/core/base/detail/assert.hpp"

namespace nearmesh::stability {
namespace {

constexpr double kFarthest_m = 5e8;

/// x + y, if a double holds it.
std::optional<double> exact_sum(double x, double y) {
  const double sum = x + y;
  // Knuth's two-sum: the error of the addition, exactly.
  const double y_part = sum - x;
  const double error = (x - (sum - y_part)) + (y - y_part);
  if (error != 0) return std::nullopt;
  return sum;
}

bool move_point(std::array<double, 3>& at, const std::array<double, 3>& by) {
  for (std::size_t i = 0; i < 3; ++i) {
    const auto sum = exact_sum(at[i], by[i]);
    if (!sum) return false;
    at[i] = *sum;
  }
  return true;
}

std::array<double, 3> offset_m(int k) {
  return {std::ldexp(1.0, k), -std::ldexp(1.0, k), std::ldexp(1.0, k)};
}

MeshPtr changed(const MeshPtr& mesh, const std::function<void(IndexedMesh&)>& change) {
  auto copy = std::make_shared<IndexedMesh>(*mesh);
  change(*copy);
  return copy;
}

/// One mesh of both bodies stays one mesh.
void change_meshes(Case& c, const std::function<void(IndexedMesh&)>& change) {
  const bool shared = c.a.mesh == c.b.mesh;
  c.a.mesh = changed(c.a.mesh, change);
  c.b.mesh = shared ? c.a.mesh : changed(c.b.mesh, change);
}

Pose turn_pose(const Pose& pose, const std::array<double, 9>& q) {
  Pose out{.rotation = {}, .translation_m = {}};
  // Each row of q has one entry that is not zero: sums are exact, and adding zeros keeps them so.
  for (std::size_t r = 0; r < 3; ++r)
    for (std::size_t k = 0; k < 3; ++k) {
      out.translation_m[r] += q[3 * r + k] * pose.translation_m[k];
      for (std::size_t c = 0; c < 3; ++c)
        out.rotation[3 * r + c] += q[3 * r + k] * pose.rotation[3 * k + c];
    }
  return out;
}

bool has_no_size(const IndexedMesh& mesh) {
  return std::all_of(mesh.positions_m.begin(), mesh.positions_m.end(),
                     [&mesh](const auto& p) { return p == mesh.positions_m.front(); });
}

constexpr int kCoarsest = 64;

/// Every coordinate is an integer of at most so many bits times 2^exponent.
struct Granularity {
  int exponent = kCoarsest, bits = 0;
};

Granularity granularity_of(const IndexedMesh& mesh) {
  Granularity g;
  double greatest = 0;
  for (const auto& p : mesh.positions_m)
    for (const double x : p) {
      greatest = std::max(greatest, std::abs(x));
      if (x == 0) continue;
      while (std::floor(std::ldexp(x, -g.exponent)) != std::ldexp(x, -g.exponent)) --g.exponent;
    }
  while (std::ldexp(greatest, -g.exponent) >= std::ldexp(1.0, g.bits)) ++g.bits;
  return g;
}

double determinant(const std::array<double, 9>& m) {
  return m[0] * (m[4] * m[8] - m[5] * m[7]) - m[1] * (m[3] * m[8] - m[5] * m[6]) +
         m[2] * (m[3] * m[7] - m[4] * m[6]);
}

void renumber(IndexedMesh& mesh, std::uint64_t seed) {
  Random random(seed);
  const auto shuffle = [&random](auto& items) {
    for (std::size_t i = items.size(); i > 1; --i)
      std::swap(items[i - 1], items[random.below(static_cast<std::uint32_t>(i))]);
  };
  std::vector<std::uint32_t> old_of(mesh.positions_m.size());
  std::iota(old_of.begin(), old_of.end(), 0U);
  shuffle(old_of);
  std::vector<std::uint32_t> new_of(old_of.size());
  std::vector<std::array<double, 3>> positions_m;
  for (std::uint32_t i = 0; i < old_of.size(); ++i) {
    new_of[old_of[i]] = i;
    positions_m.push_back(mesh.positions_m[old_of[i]]);
  }
  mesh.positions_m = std::move(positions_m);
  for (auto& face : mesh.faces) {
    for (std::uint32_t& corner : face) corner = new_of[corner];
    std::rotate(face.begin(), face.begin() + random.below(3), face.end());
  }
  shuffle(mesh.faces);
}

}  // namespace

std::array<double, 9> quarter_turn(std::uint32_t turn) {
  NEARMESH_ASSERT(turn < 24);
  constexpr std::size_t kOrders[6][3] = {{0, 1, 2}, {1, 2, 0}, {2, 0, 1},
                                         {1, 0, 2}, {0, 2, 1}, {2, 1, 0}};
  const std::uint32_t order = turn % 6, signs = turn / 6;
  const double x = (signs & 1U) != 0 ? -1 : 1, y = (signs & 2U) != 0 ? -1 : 1;
  const double parity = order < 3 ? 1 : -1;
  std::array<double, 9> q{};
  q[kOrders[order][0]] = x;
  q[3 + kOrders[order][1]] = y;
  q[6 + kOrders[order][2]] = x * y * parity;  // the determinant is 1
  return q;
}

Case turned(const Case& base, std::uint32_t turn) {
  Case c = base;
  const auto q = quarter_turn(turn);
  for (Pose* pose : {&c.a.pose, &c.b.pose, &c.end_b}) *pose = turn_pose(*pose, q);
  c.name += ", turn " + std::to_string(turn);
  return c;
}

Case swapped(const Case& base) {
  NEARMESH_ASSERT(base.held_a.empty() && base.question != Question::kSweep);
  Case c = base;
  std::swap(c.a, c.b);
  c.name += ", swapped";
  return c;
}

Case renumbered(const Case& base, std::uint64_t seed) {
  NEARMESH_ASSERT(base.held_a.empty());
  Case c = base;
  change_meshes(c, [seed](IndexedMesh& mesh) { renumber(mesh, seed); });
  c.name += ", renumbered " + std::to_string(seed);
  return c;
}

std::optional<Case> moved(const Case& base, int k) {
  Case c = base;
  for (Pose* pose : {&c.a.pose, &c.b.pose, &c.end_b})
    if (!move_point(pose->translation_m, offset_m(k))) return std::nullopt;
  c.name += ", moved 2^" + std::to_string(k) + " m";
  return c;
}

std::optional<Case> moved_vertices(const Case& base, int k) {
  Case c = base;
  bool is_exact = true;
  change_meshes(c, [&](IndexedMesh& mesh) {
    for (auto& p : mesh.positions_m) is_exact = is_exact && move_point(p, offset_m(k));
  });
  // Turned bodies would part: their poses make up for it. Exact, since quarter turns only change
  // signs.
  for (Pose* pose : {&c.a.pose, &c.b.pose, &c.end_b}) {
    for (const double entry : pose->rotation)
      is_exact = is_exact && (entry == 0 || std::abs(entry) == 1);
    const Pose turned_offset = turn_pose({.translation_m = offset_m(k)}, pose->rotation);
    std::array<double, 3> by = offset_m(k);
    for (std::size_t i = 0; i < 3; ++i) by[i] -= turned_offset.translation_m[i];
    is_exact = is_exact && move_point(pose->translation_m, by);
  }
  if (!is_exact) return std::nullopt;
  c.name += ", vertices moved 2^" + std::to_string(k) + " m";
  return c;
}

std::optional<Case> scaled(const Case& base, int k) {
  if (has_no_size(*base.a.mesh) && has_no_size(*base.b.mesh)) return std::nullopt;
  Case c = base;
  change_meshes(c, [k](IndexedMesh& mesh) {
    for (auto& p : mesh.positions_m)
      for (double& x : p) x = std::ldexp(x, k);
  });
  for (Pose* pose : {&c.a.pose, &c.b.pose, &c.end_b})
    for (double& x : pose->translation_m) {
      x = std::ldexp(x, k);
      if (std::abs(x) > kFarthest_m) return std::nullopt;
    }
  c.name += ", scaled 2^" + std::to_string(k);
  return c;
}

std::optional<Case> sheared(const Case& base, std::uint64_t seed) {
  for (const Pose* pose : {&base.a.pose, &base.b.pose})
    if (pose->rotation != Pose{}.rotation) return std::nullopt;
  int finest = kCoarsest, bits = 0, magnitude = -kCoarsest;
  for (const MeshPtr& mesh : {base.a.mesh, base.b.mesh}) {
    const Granularity g = granularity_of(*mesh);
    finest = std::min(finest, g.exponent);
    bits = std::max(bits, g.bits);
    magnitude = std::max(magnitude, g.exponent + g.bits);
  }
  // Three products are added, and there are two signs: 20 bits. And the pair's lattice is not below
  // 2^-38 of the larger model: a quarter of the finer cell must not be.
  const int room = std::min(18 - bits, finest + 32 - magnitude);
  if (room < 3) return std::nullopt;
  for (const Pose* pose : {&base.a.pose, &base.b.pose})  // must stay on the pair's lattice
    for (const double x : pose->translation_m)
      if (std::floor(std::ldexp(x, 2 - finest)) != std::ldexp(x, 2 - finest)) return std::nullopt;
  Random random(seed);
  std::array<double, 9> m{};
  do {
    for (double& entry : m)
      entry = static_cast<double>(random.below(1U << (room + 1))) - std::ldexp(1.0, room);
  } while (determinant(m) == 0);
  const auto apply = [&m](std::array<double, 3>& p) {
    // Sums of three products of integers below 2^40, by a power of two: exact.
    p = {m[0] * p[0] + m[1] * p[1] + m[2] * p[2], m[3] * p[0] + m[4] * p[1] + m[5] * p[2],
         m[6] * p[0] + m[7] * p[1] + m[8] * p[2]};
  };
  Case c = base;
  change_meshes(c, [&apply](IndexedMesh& mesh) {
    for (auto& p : mesh.positions_m) apply(p);
  });
  apply(c.a.pose.translation_m);
  apply(c.b.pose.translation_m);
  c.name += ", sheared " + std::to_string(seed);
  return c;
}

std::vector<Case> near_variants(const Case& base) {
  std::vector<Case> cases{base};
  for (std::uint32_t turn = 1; turn < 24; ++turn) cases.push_back(turned(base, turn));
  cases.push_back(swapped(base));
  cases.push_back(renumbered(base, 1));
  cases.push_back(swapped(turned(renumbered(base, 2), 7)));
  for (std::uint64_t seed = 1; seed <= 6; ++seed)
    if (const auto c = sheared(base, seed))
      cases.push_back(seed < 4 ? *c : turned(*c, static_cast<std::uint32_t>(5 * seed - 13)));
  return cases;
}

std::vector<Case> far_variants(const Case& base) {
  std::vector<Case> cases;
  const auto keep = [&cases](std::optional<Case> c) {
    if (c) cases.push_back(*std::move(c));
  };
  for (int k = 0; k <= 23; ++k) keep(moved(base, k));
  for (const int k : {8, 16, 23}) keep(moved_vertices(base, k));
  for (const int k : {4, 12, 20})
    if (const auto c = sheared(base, static_cast<std::uint64_t>(k))) keep(moved(*c, k));
  for (const int k : {-20, -15, -10, -5, 5, 10, 15, 20}) keep(scaled(base, k));
  return cases;
}

}  // namespace nearmesh::stability
