// SPDX-License-Identifier: Apache-2.0
// F1: a needle that a client has not got yet, and a ball driven into it.
#include <algorithm>
#include <cmath>

#include "meshes.hpp"
#include "nearmesh/core/mesh/generate.hpp"
#include "nearmesh_system.hpp"
#include "oracle.hpp"
#include "scenes.hpp"
#include "shapes.hpp"

namespace nearmesh::stability {
namespace {

constexpr std::uint32_t kBaseFaces = 2;
constexpr double kNeedleX_m = 2.25, kNeedleY_m = -1.75, kNeedleHeight_m = 5;

/// A square of 16 m, cells of half a metre; in one of them stands a needle, 0.2 m about and 5 m
/// high. Conforming. Flat: the simplifier keeps the needle's tip nearly to the end. Rough (ground
/// within `roughness_m` of 0): it goes early.
IndexedMesh needle_plane(double roughness_m) {
  constexpr std::uint32_t kSides = 8, kRings = 5;
  test::ShapeBuilder shape;
  std::array<std::array<double, 33>, 33> ground_m{};
  Random random(3);
  for (int i = -16; i <= 16; ++i)
    for (int j = -16; j <= 16; ++j) {
      const bool is_foot = std::abs(i * .5 - kNeedleX_m) < .5 && std::abs(j * .5 - kNeedleY_m) < .5;
      const double z = random.between(-roughness_m, roughness_m);
      ground_m[static_cast<std::size_t>(i + 16)][static_cast<std::size_t>(j + 16)] =
          is_foot ? 0 : z;
    }
  const auto ground = [&ground_m](int i, int j) {
    return std::array{i * .5, j * .5,
                      ground_m[static_cast<std::size_t>(i + 16)][static_cast<std::size_t>(j + 16)]};
  };
  for (int i = -16; i < 16; ++i)
    for (int j = -16; j < 16; ++j) {
      const double x = i * .5, y = j * .5;
      if (x == kNeedleX_m - .25 && y == kNeedleY_m - .25) continue;
      shape.quad(ground(i, j), ground(i + 1, j), ground(i + 1, j + 1), ground(i, j + 1));
    }
  const auto around = [](std::uint32_t ring, std::uint32_t side) {
    const auto [c, s] = test::unit_circle(side % kSides, kSides);
    const double r = .2 * (kRings - ring) / kRings;
    return std::array{kNeedleX_m + r * c, kNeedleY_m + r * s, kNeedleHeight_m * ring / kRings};
  };
  const auto corner = [](std::uint32_t k) {  // of the cell, counter-clockwise from (+, +)
    const double x = k % 4 == 0 || k % 4 == 3 ? .25 : -.25, y = k % 4 < 2 ? .25 : -.25;
    return std::array{kNeedleX_m + x, kNeedleY_m + y, 0.0};
  };
  for (std::uint32_t k = 0; k < 4; ++k) {
    shape.triangle(corner(k), around(0, 2 * k + 1), around(0, 2 * k));
    shape.triangle(corner(k), around(0, 2 * k + 2), around(0, 2 * k + 1));
    shape.triangle(corner(k), corner(k + 1), around(0, 2 * k + 2));
  }
  for (std::uint32_t side = 0; side < kSides; ++side) {
    for (std::uint32_t ring = 0; ring + 1 < kRings; ++ring)
      shape.quad(around(ring, side), around(ring, side + 1), around(ring + 1, side + 1),
                 around(ring + 1, side));
    shape.triangle(around(kRings - 1, side), around(kRings - 1, side + 1), around(kRings, 0));
  }
  return snapped(shape.take(), -16);
}

bool is_near_needle(const GridPoint& p, const Grid& grid) {
  const double x = grid.origin_m[0] + std::ldexp(p[0], grid.exponent) - kNeedleX_m;
  const double y = grid.origin_m[1] + std::ldexp(p[1], grid.exponent) - kNeedleY_m;
  return std::abs(x) < 1 && std::abs(y) < 1;
}

/// What can be used of the splits that are received: one whose parents were lost waits for them.
template <class IsReceived>
std::vector<VertexId> usable(const SplitStore& store, const std::vector<VertexId>& order,
                             const IsReceived& is_received) {
  ActiveMesh mesh(store);
  RefineDelta delta;
  for (const VertexId u : order)
    if (is_received(u) && mesh.is_current(store.node_of(u)) && !mesh.split(u, delta)) return {};
  return delta.split;
}

std::vector<Case> needle_cases(const char* kind, double roughness_m, std::uint32_t every,
                               std::uint64_t seeds) {
  const MeshPtr plane = share(needle_plane(roughness_m));
  const MeshPtr ball = share(snapped(stretched(generate_sphere(12, 0), .3), -21));
  const auto model = build_model(*plane, kBaseFaces);
  NEARMESH_ASSERT(model.is_ok());
  const SplitStore& store = model.value()->baked.store;
  const Grid& grid = model.value()->baked.header.grid;
  const std::vector<VertexId> order = every_split(store);

  struct Held {
    std::string name;
    std::vector<VertexId> splits;
  };
  std::vector<Held> states;
  for (std::size_t count = 0; count <= order.size(); count += every)
    states.push_back({"first " + std::to_string(count) + " splits",
                      {order.begin(), order.begin() + static_cast<std::ptrdiff_t>(count)}});
  for (std::uint64_t seed = 0; seed < seeds; ++seed) {
    Random random(seed);
    const std::uint32_t kept = 1 + random.below(8);
    std::vector<bool> comes(store.vertex_count() / 32 + 1);
    for (std::size_t block = 0; block < comes.size(); ++block)
      comes[block] = random.below(9) < kept;
    const auto is_received = [&comes](VertexId u) { return comes[u.value / 32]; };
    states.push_back({"blocks of seed " + std::to_string(seed), usable(store, order, is_received)});
    states.push_back({"blocks of seed " + std::to_string(seed) + " but the needle's region",
                      usable(store, order, [&](VertexId u) {
                        return is_received(u) && !is_near_needle(store.position(u), grid);
                      })});
  }
  states.push_back({"all but the needle's region", usable(store, order, [&](VertexId u) {
                      return !is_near_needle(store.position(u), grid);
                    })});

  std::vector<Case> cases;
  // Driven into the needle from the side at two heights, from above, beside it, and down to the
  // plane.
  const double places[][3] = {{2, 0, 3}, {.5, 0, 3}, {.25, 0, 3}, {0, 0, 3},   {0, .25, 1},
                              {0, 0, 6}, {0, 0, 5},  {0, 0, 4.5}, {-4, 3, .5}, {-4, 3, .25}};
  for (const auto& p : places) {
    Case base{.question = Question::kStream,
              .a = {plane, {}},
              .b = {ball, at(kNeedleX_m + p[0], kNeedleY_m + p[1], p[2])},
              .base_faces = kBaseFaces,
              .model_a = model.value()};
    base.touches = touches(base.a, base.b);
    for (const Held& held : states) {
      Case c = base;
      char where[96];
      std::snprintf(where, sizeof where, "%s ground, ball at (%g, %g, %g) of the needle, ", kind,
                    p[0], p[1], p[2]);
      c.name = where + held.name;
      c.held_a = held.splits;
      cases.push_back(std::move(c));
    }
  }
  return cases;
}

}  // namespace

std::vector<Case> streamed_cases(std::uint32_t every, std::uint64_t seeds) {
  std::vector<Case> cases = needle_cases("flat", 0, every, seeds);
  const std::vector<Case> rough = needle_cases("rough", 1.5, every, seeds);
  cases.insert(cases.end(), rough.begin(), rough.end());
  return cases;
}

}  // namespace nearmesh::stability
