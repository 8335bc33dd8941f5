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

/// A square of 16 m, cells of half a metre; in one of them stands a needle, 0.2 m about and 5 m high. Conforming.
IndexedMesh needle_plane() {
  constexpr std::uint32_t kSides = 8, kRings = 5;
  test::ShapeBuilder shape;
  for (int i = -16; i < 16; ++i)
    for (int j = -16; j < 16; ++j) {
      const double x = i * .5, y = j * .5;
      if (x == kNeedleX_m - .25 && y == kNeedleY_m - .25) continue;
      shape.quad({x, y, 0}, {x + .5, y, 0}, {x + .5, y + .5, 0}, {x, y + .5, 0});
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

}  // namespace

std::vector<Case> streamed_cases(std::uint32_t every) {
  const MeshPtr plane = share(needle_plane());
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
  for (std::uint64_t seed = 0; seed < 40; ++seed) {
    Random random(seed);
    Held held{.name = "blocks of seed " + std::to_string(seed), .splits = {}};
    const std::uint32_t kept = 1 + random.below(8);
    for (std::uint32_t first = 0; first < store.vertex_count(); first += 32) {
      if (random.below(9) >= kept) continue;
      for (std::uint32_t u = first; u < std::min(first + 32, store.vertex_count()); ++u)
        if (!store.is_root({u})) held.splits.push_back({u});
    }
    states.push_back(std::move(held));
  }
  Held away{.name = "all but the needle's region", .splits = {}};
  for (const VertexId u : order)
    if (!is_near_needle(store.position(u), grid)) away.splits.push_back(u);
  states.push_back(std::move(away));

  std::vector<Case> cases;
  // Driven into the needle from the side at two heights, from above, beside it, and down to the plane.
  const double places[][3] = {{2, 0, 3}, {.5, 0, 3}, {.25, 0, 3}, {0, 0, 3},   {0, .25, 1},
                              {0, 0, 6}, {0, 0, 5},  {0, 0, 4.5}, {-4, 3, .5}, {-4, 3, .25}};
  for (const auto& p : places) {
    Case base{.question = Question::kStream,
              .a = {plane, {}},
              .b = {ball, at(kNeedleX_m + p[0], kNeedleY_m + p[1], p[2])},
              .base_faces = kBaseFaces};
    base.touches = touches(base.a, base.b);
    for (const Held& held : states) {
      Case c = base;
      char where[96];
      std::snprintf(where, sizeof where, "ball at (%g, %g, %g) of the needle, ", p[0], p[1], p[2]);
      c.name = where + held.name;
      c.held_a = held.splits;
      cases.push_back(std::move(c));
    }
  }
  return cases;
}

}  // namespace nearmesh::stability
