// SPDX-License-Identifier: Apache-2.0
// Scenes of bodies in and on each other and in motion: F2, F7, F8, F9, F10.
#include <cmath>

#include "meshes.hpp"
#include "nearmesh/core/mesh/generate.hpp"
#include "nearmesh_system.hpp"
#include "oracle.hpp"
#include "scenes.hpp"
#include "shapes.hpp"
#include "variants.hpp"

namespace nearmesh::stability {
namespace {

MeshPtr ball(std::uint32_t slices, double radius_m) {
  return share(snapped(stretched(generate_sphere(slices, 0), radius_m), -12));
}

IndexedMesh turned_inside_out(IndexedMesh mesh) {
  for (auto& f : mesh.faces) std::swap(f[1], f[2]);
  return mesh;
}

std::string place_name(const char* what, double x, double y, double z) {
  char text[128];
  std::snprintf(text, sizeof text, "%s at (%g, %g, %g)", what, x, y, z);
  return text;
}

}  // namespace

std::vector<Case> solid_cases() {
  std::vector<Case> cases;
  const auto add = [&cases](const std::string& name, const Body& a, const Body& b) {
    for (const bool swap : {false, true}) {
      Case c{.name = name + (swap ? ", swapped" : ""),
             .question = Question::kSolids,
             .a = swap ? b : a,
             .b = swap ? a : b,
             .solid_a = true,
             .solid_b = true};
      c.touches = solids_meet(c.a, true, c.b, true);
      for (const std::uint32_t turn : {0U, 5U, 10U, 15U, 20U}) cases.push_back(turned(c, turn));
    }
  };
  const MeshPtr large = box(2, 4), small = box(.5, 2);
  add("cube in a cube", {large, {}}, {small, {}});
  add("cube in a corner of a cube", {large, {}}, {small, at(1.25, 1.25, -1.25)});
  add("cube touching a cube from inside", {large, {}}, {small, at(1.5, 0, 0)});
  add("cube beside a cube", {large, {}}, {small, at(3, 0, 0)});
  const MeshPtr cone = share(snapped(test::make_cone(4, 8, 16, 3), -12)), sphere = ball(16, 1);
  add("sphere in a cone", {cone, {}}, {sphere, at(0, 0, 2)});
  add("cube in the sphere", {sphere, at(0, 0, 2)}, {box(.25, 2), at(0, 0, 2)});
  add("cube in the cone", {cone, {}}, {box(.25, 2), at(0, 0, 2)});
  add("cube beside the cone's tip", {cone, {}}, {box(.25, 2), at(2, 0, 6)});
  const MeshPtr shell =
      share(joined(test::make_box({2, 2, 2}, 2), turned_inside_out(test::make_box({1, 1, 1}, 2))));
  add("cube in the hollow of a shell", {shell, {}}, {small, {}});
  add("cube in the wall of a shell", {shell, {}}, {box(.25, 1), at(1.5, 0, 0)});
  const MeshPtr torus = share(snapped(test::make_torus(2, .75, 24, 12), -12));
  add("cube in the hole of a torus", {torus, {}}, {small, {}});
  add("cube in the tube of a torus", {torus, {}}, {box(.25, 1), at(2, 0, 0)});
  IndexedMesh ground = generate_terrain(24, 7);
  const bool closed = close_terrain(ground, 24, -3000).is_ok();
  NEARMESH_ASSERT(closed);
  const MeshPtr terrain = share(closed ? ground : IndexedMesh{});
  const MeshPtr aircraft = share(generate_aircraft(1000, 7));
  for (const double z : {-2500.0, 2500.0}) {
    Case c{.name = z < 0 ? "aircraft under the ground" : "aircraft above the ground",
           .question = Question::kSolids,
           .a = {terrain, {}},
           .b = {aircraft, at(16, 48, z)},
           .solid_a = true};
    c.touches = solids_meet(c.a, true, c.b, false);
    cases.push_back(c);
  }
  return cases;
}

std::vector<Case> sweep_cases() {
  std::vector<Case> cases;
  const auto add = [&cases](const std::string& name, const MeshPtr& a, const MeshPtr& b,
                            const Pose& from, const Pose& to, bool half_turn) {
    Case c{.name = name,
           .question = Question::kSweep,
           .a = {a, {}},
           .b = {b, from},
           .end_b = to,
           .half_turn = half_turn};
    // Half-way is an exact pose; the scenes are such that b hits then or never.
    Pose middle = from;
    for (std::size_t k = 0; k < 3; ++k)
      middle.translation_m[k] = (from.translation_m[k] + to.translation_m[k]) / 2;
    if (half_turn) middle.rotation = {0, -1, 0, 1, 0, 0, 0, 0, 1};
    c.touches = touches(c.a, {b, middle});
    cases.push_back(c);
  };
  const MeshPtr sheet = share(test::make_plane(4, 4)),
                plate = share(test::make_plate(4, 0x1p-10, 4));
  const MeshPtr shot = ball(12, .25), grain = ball(12, 0x1p-7);
  for (const auto& [name, target] : {std::pair{"sheet", sheet}, {"plate of 1 mm", plate}})
    for (const double reach : {1.0, 16.0, 256.0, 4096.0, 65536.0}) {
      const std::string speed =
          std::string(name) + ", " + std::to_string(static_cast<int>(2 * reach)) + " m/s, ";
      add(speed + "ball through the middle", target, shot, at(.125, .25, reach),
          at(.125, .25, -reach), false);
      add(speed + "grain of 8 mm through the middle", target, grain, at(.125, .25, reach),
          at(.125, .25, -reach), false);
      add(speed + "ball across", target, shot, at(reach, .25, reach), at(-reach, .25, -reach),
          false);
      // Past the rim by 1 mm: the ball's widest place is at x = 2 + 1 mm all the way.
      add(speed + "ball past the rim", target, shot, at(2.25 + 0x1p-10, .25, reach),
          at(2.25 + 0x1p-10, .25, -reach), false);
      add(speed + "ball's widest place along the rim", target, shot, at(2.25, 0, reach),
          at(2.25, 0, -reach), false);
    }
  // The hole's faces are at least 0.7 from the axis, the ball's within 0.5.
  const MeshPtr torus = share(snapped(test::make_torus(1, .25, 24, 12), -12));
  for (const double reach : {1.0, 64.0, 4096.0})
    add("ball of 0.5 through a torus of hole 0.7, " + std::to_string(static_cast<int>(2 * reach)) +
            " m/s",
        torus, ball(16, .5), at(0, 0, reach), at(0, 0, -reach), false);
  const MeshPtr rod = share(test::make_box({2, 0x1p-4, 0x1p-4}, 4));
  const auto post = [](double y, double half_m) {
    return share(shifted(test::make_box({half_m, half_m, 1}, 1), {0, y, 0}));
  };
  for (const double half_m : {0x1p-4, 0x1p-8, 0x1p-12}) {
    add("rod turning through a post of half width " + std::to_string(half_m), post(1.5, half_m),
        rod, {}, {}, true);
    add("rod's tip turning through a post", post(2, half_m), rod, {}, {}, true);
    // The rod reaches 2.002 m.
    add("rod turning short of a post", post(2.125, half_m), rod, {}, {}, true);
  }
  add("rod turning and flying through a post", post(1.5, 0x1p-6), rod, at(0, 0, 8), at(0, 0, -8),
      true);
  return cases;
}

std::vector<Case> contact_cases() {
  std::vector<Case> cases;
  // Sets a plane under b, faces up: the true normal is the plane's. Sunk only so far that b's faces
  // there nearly face it.
  const MeshPtr plane = share(test::make_plane(4, 7));
  const auto add = [&](const std::string& name, const MeshPtr& b, double x, double y, double z,
                       double sunk_m) {
    Case c{.name = place_name(name.c_str(), x, y, z),
           .question = Question::kContacts,
           .a = {plane, {}},
           .b = {b, at(x, y, z)},
           .normal = {0, 0, 1},
           .position_tolerance_m = sunk_m + 0x1p-16,
           .normal_tolerance_rad = .15};  // facets next to a ball's pole tilt by 0.1
    c.touches = touches(c.a, c.b);
    for (const std::uint32_t turn : {0U, 4U, 9U, 14U, 19U, 23U}) {
      Case varied = turned(c, turn);
      const auto q = quarter_turn(turn);
      varied.normal = {q[2], q[5], q[8]};
      cases.push_back(varied);
    }
  };
  const MeshPtr sphere = ball(32, 1), cube = box(.5, 3);
  const MeshPtr torus = share(snapped(test::make_torus(1, .25, 32, 16), -12));
  IndexedMesh tip = snapped(test::make_cone(.5, 1, 16, 3), -12);
  for (auto& p : tip.positions_m) p[2] = -p[2];
  const MeshPtr cone = share(turned_inside_out(tip));
  for (const auto& [x, y] : {std::pair{0.0, 0.0}, {.125, .25}, {-.5, .375}, {.25, -.25}}) {
    add("sphere", sphere, x, y, 1 - 0x1p-7, 0x1p-7);
    add("sphere just touching", sphere, x, y, 1, 0);
    add("box resting", cube, x, y, .5, 0);
    add("box sunk", cube, x, y, .375, .125);
    add("torus lying", torus, x, y, .25 - 0x1p-8, 0x1p-8);
    add("cone's tip", cone, x, y, 1 - 0x1p-6, 0x1p-6);
  }
  return cases;
}

std::vector<Case> rolling_cases() {
  std::vector<Case> cases;
  const MeshPtr plate = share(test::make_plate(8, .25, 16));
  const auto model = build_model(*plate, 16);
  NEARMESH_ASSERT(model.is_ok());
  const std::vector<VertexId> order = every_split(model.value()->baked.store);
  const MeshPtr sphere = ball(32, 1);
  const MeshPtr cube = box(.5, 3);
  for (int step = 0; step < 60; ++step) {
    const double x = (step - 30) * .09375, y = step * .03125 - 1;
    const bool is_ball = step % 2 == 0;
    const double sunk_m = is_ball ? 0x1p-7 : 0, z = is_ball ? 1 - sunk_m : .5;
    Case c{.name = place_name(is_ball ? "ball" : "box", x, y, z),
           .question = Question::kContacts,
           .a = {plate, {}},
           .b = {is_ball ? sphere : cube, at(x, y, z)},
           .base_faces = 16,
           .model_a = model.value(),
           .normal = {0, 0, 1},
           .position_tolerance_m = sunk_m + 0x1p-16,
           .normal_tolerance_rad = 1e-6};
    c.touches = touches(c.a, c.b);
    // Every mixture: each step holds another random half of the plate's splits; every third all of
    // them.
    Random random(static_cast<std::uint64_t>(step));
    for (const VertexId u : order)
      if (step % 3 == 0 || random.below(2) == 0) c.held_a.push_back(u);
    cases.push_back(c);
  }
  return cases;
}

std::vector<Case> resting_cases() {
  std::vector<Case> cases;
  const MeshPtr terrain = share(generate_terrain(24, 7));
  const auto model = build_model(*terrain, 16);
  NEARMESH_ASSERT(model.is_ok());
  const std::vector<VertexId> order = every_split(model.value()->baked.store);
  const MeshPtr sphere = ball(16, 8);
  Random random(5);
  for (int place = 0; place < 4; ++place) {
    // The ball's lowest vertex stands on one of the ground's.
    const auto& p =
        terrain->positions_m[random.below(static_cast<std::uint32_t>(terrain->positions_m.size()))];
    Case c{.question = Question::kStream,
           .a = {terrain, {}},
           .b = {sphere, at(p[0], p[1], p[2] + 8)},
           .base_faces = 16,
           .model_a = model.value()};
    c.touches = touches(c.a, c.b);
    // Refines to the end and coarsens again.
    for (int step = 0; step <= 40; ++step) {
      const std::size_t count =
          order.size() * static_cast<std::size_t>(step <= 20 ? step : 40 - step) / 20;
      Case now = c;
      now.held_a.assign(order.begin(), order.begin() + static_cast<std::ptrdiff_t>(count));
      now.name = place_name("ball", p[0], p[1], p[2]) + ", " + std::to_string(count) +
                 " splits, step " + std::to_string(step);
      cases.push_back(now);
    }
  }
  return cases;
}

}  // namespace nearmesh::stability
