// SPDX-License-Identifier: Apache-2.0
// Scenes whose truth is a matter of exact touching: F3, F15, F17, F19.
#include <set>

#include "meshes.hpp"
#include "nearmesh/core/mesh/generate.hpp"
#include "oracle.hpp"
#include "scenes.hpp"
#include "shapes.hpp"
#include "variants.hpp"

namespace nearmesh::stability {
namespace {

/// Asks the oracle.
void add(std::vector<Case>& cases, const std::string& name, const Body& a, const Body& b) {
  const std::uint64_t pairs = touching_pairs(a, b).size();
  cases.push_back({.name = name, .a = a, .b = b, .touches = pairs > 0, .pairs = pairs});
}

MeshPtr ball(std::uint32_t slices, double radius_m, int exponent) {
  return share(snapped(stretched(generate_sphere(slices, 0), radius_m), exponent));
}

std::string offset_name(const char* what, double x, double y, double z) {
  char text[96];
  std::snprintf(text, sizeof text, "%s at (%g, %g, %g)", what, x, y, z);
  return text;
}

constexpr double kCell = 0x1p-20;

}  // namespace

std::vector<Case> touching_cases() {
  std::vector<Case> cases;
  // Cubes of side 1 that share a face, half a face, an edge, a vertex, everything; and miss by one
  // cell.
  const double shifts[][3] = {{1, 0, 0},    {1, .5, .5},      {1, 1, 0},         {1, 1, 1},
                              {0, 0, 0},    {1, .25, 0},      {1 + kCell, 0, 0}, {1 - kCell, 0, 0},
                              {1, 1, .125}, {1, 1 + kCell, 0}};
  for (const std::uint32_t quads : {1U, 4U})
    for (const auto& s : shifts)
      add(cases, offset_name(quads == 1 ? "cubes" : "cubes of 192 triangles", s[0], s[1], s[2]),
          {box(.5, quads), {}}, {box(.5, quads), at(s[0], s[1], s[2])});
  for (const std::uint32_t turn : {1U, 5U, 8U, 14U}) {
    Pose pose = at(1, .5, 0);
    pose.rotation = quarter_turn(turn);
    add(cases, "cube and turned cube " + std::to_string(turn), {box(.5, 4), {}},
        {box(.5, 4), pose});
  }
  const MeshPtr sphere = ball(64, 1, -19);
  add(cases, "spheres pole on pole", {sphere, {}}, {sphere, at(0, 0, 2)});
  add(cases, "spheres pole to pole, one cell apart", {sphere, {}}, {sphere, at(0, 0, 2 + 0x1p-19)});
  add(cases, "spheres one cell into each other", {sphere, {}}, {sphere, at(0, 0, 2 - 0x1p-19)});
  const MeshPtr coarse = ball(64, 1, -9);
  add(cases, "spheres of few bits pole on pole", {coarse, {}}, {coarse, at(0, 0, 2)});
  add(cases, "sphere on itself", {ball(12, 1, -9), {}}, {ball(12, 1, -9), {}});
  const MeshPtr plane = share(test::make_plane(4, 4));
  const MeshPtr small = ball(16, .5, -9);
  add(cases, "sphere's pole inside a triangle", {plane, {}}, {small, at(.25, .125, .5)});
  add(cases, "sphere's pole on an edge", {plane, {}}, {small, at(.5, 0, .5)});
  add(cases, "sphere's pole on a vertex", {plane, {}}, {small, at(0, 0, .5)});
  add(cases, "sphere's pole on the border", {plane, {}}, {small, at(2, .5, .5)});
  add(cases, "sphere beyond the border", {plane, {}}, {small, at(2 + kCell, .5, .5)});
  add(cases, "plane on itself, half a cell along", {plane, {}}, {plane, at(.5, .5, 0)});
  add(cases, "plane beside itself", {plane, {}}, {plane, at(4, 0, 0)});
  return cases;
}

std::vector<Case> small_pair_cases() {
  std::vector<Case> cases;
  const auto pair = [&cases](const std::string& name, const IndexedMesh& a, const IndexedMesh& b) {
    add(cases, name, {share(a), {}}, {share(b), {}});
  };
  const IndexedMesh base = one_triangle({0, 0, 0}, {1, 0, 0}, {0, 1, 0});
  pair("equal triangles", base, base);
  pair("equal triangles, other side up", base, one_triangle({0, 0, 0}, {0, 1, 0}, {1, 0, 0}));
  pair("coplanar, one in the other", base, one_triangle({.25, .25, 0}, {.5, .25, 0}, {.25, .5, 0}));
  pair("coplanar, sharing an edge", base, one_triangle({1, 0, 0}, {0, 1, 0}, {1, 1, 0}));
  pair("coplanar, corner on an edge", base, one_triangle({.5, .5, 0}, {1, .5, 0}, {1, 1, 0}));
  pair("coplanar, one cell apart", base, one_triangle({.5 + kCell, .5, 0}, {1, .5, 0}, {1, 1, 0}));
  pair("corner on a face", base, one_triangle({.25, .25, 0}, {.25, .25, 1}, {1, 1, 1}));
  pair("corner one cell above a face", base,
       one_triangle({.25, .25, kCell}, {.25, .25, 1}, {1, 1, 1}));
  pair("edges that cross in a point", base, one_triangle({.5, 0, -1}, {.5, 0, 1}, {.5, -1, 0}));
  pair("corner on corner", base, one_triangle({0, 0, 0}, {-1, 0, 1}, {0, -1, 1}));
  pair("nearly coplanar, crossing", base,
       one_triangle({0, 0, -kCell}, {1, 0, kCell}, {0, 1, kCell}));
  pair("nearly coplanar, above", base,
       one_triangle({0, 0, kCell}, {1, 0, 2 * kCell}, {0, 1, kCell}));
  pair("edge lying in a face", base, one_triangle({.125, .25, 0}, {.5, .25, 0}, {.25, .25, 1}));
  // Corners on a coarse lattice: every second pair touches in some degenerate way.
  Random random(11);
  const auto corner = [&random] {
    return std::array{random.below(4) * .25, random.below(4) * .25, random.below(4) * .25};
  };
  const auto triangle = [&corner] {
    std::set<std::array<double, 3>> corners;
    while (corners.size() < 3) corners.insert(corner());
    const std::vector<std::array<double, 3>> list(corners.begin(), corners.end());
    return one_triangle(list[0], list[1], list[2]);
  };
  for (int i = 0; i < 60; ++i)
    pair("lattice triangles " + std::to_string(i), triangle(), triangle());
  const auto soup = [&triangle] {
    std::set<std::vector<std::array<double, 3>>> chosen;
    while (chosen.size() < 16) chosen.insert(triangle().positions_m);
    IndexedMesh mesh;
    for (const auto& t : chosen) mesh = joined(mesh, {t, {{0, 1, 2}}});
    return mesh;
  };
  for (int i = 0; i < 12; ++i) pair("lattice soups " + std::to_string(i), soup(), soup());
  return cases;
}

std::vector<Case> concave_cases() {
  std::vector<Case> cases;
  const MeshPtr torus = share(snapped(test::make_torus(1, .25, 24, 12), -9));
  add(cases, "ball in the hole of a torus", {torus, {}}, {ball(16, .5, -9), {}});
  add(cases, "ball beside the hole", {torus, {}}, {ball(16, .5, -9), at(.5, 0, 0)});
  add(cases, "ball in the hole, its equator on the tube", {torus, {}}, {ball(16, .75, -9), {}});
  Pose link = at(1, 0, 0);
  link.rotation = quarter_turn(4);
  add(cases, "linked tori", {torus, {}}, {torus, link});
  const MeshPtr valley = share(test::make_valley(1, 4, 8));
  add(cases, "box high in a valley", {valley, {}}, {box(.25, 2), at(0, 0, 1)});
  add(cases, "box's edges on the walls", {valley, {}}, {box(.25, 2), at(0, 0, .5)});
  add(cases, "box one cell above the walls", {valley, {}}, {box(.25, 2), at(0, 0, .5 + 0x1p-9)});
  add(cases, "box one cell into the walls", {valley, {}}, {box(.25, 2), at(0, 0, .5 - 0x1p-9)});
  // A cup: a box without its lid.
  IndexedMesh cup = test::make_box({.5, .5, .5}, 4);
  std::erase_if(cup.faces, [&cup](const auto& f) {
    return cup.positions_m[f[0]][2] == .5 && cup.positions_m[f[1]][2] == .5 &&
           cup.positions_m[f[2]][2] == .5;
  });
  const MeshPtr open = share(cup);
  add(cases, "ball hovering in a cup", {open, {}}, {ball(16, .25, -9), {}});
  add(cases, "ball on a cup's floor", {open, {}}, {ball(16, .25, -9), at(0, 0, -.25)});
  add(cases, "ball half out of a cup", {open, {}}, {ball(16, .25, -9), at(0, 0, .5)});
  return cases;
}

std::vector<Case> huge_triangle_cases() {
  std::vector<Case> cases;
  // 10,240 m; the ball is 1/64 m across. The pair's lattice is 2^-24 m.
  const MeshPtr flat = share(test::make_plane(10240, 1));
  IndexedMesh slope = test::make_plane(10240, 1);
  for (auto& p : slope.positions_m) p[2] = p[0] / 8;
  const MeshPtr tilted = share(slope);
  const MeshPtr pebble = ball(16, 0x1p-7, -16);
  const double r = 0x1p-7;
  for (const auto& [x, y] :
       {std::pair{0.0, 0.0}, {1000.0, -3000.5}, {5120.0, 17.0}, {5120.0, 5120.0}}) {
    add(cases, offset_name("pebble on", x, y, 0), {flat, {}}, {pebble, at(x, y, r)});
    add(cases, offset_name("pebble 60 nm above", x, y, 0), {flat, {}},
        {pebble, at(x, y, r + 0x1p-24)});
    add(cases, offset_name("pebble 60 nm into", x, y, 0), {flat, {}},
        {pebble, at(x, y, r - 0x1p-24)});
    add(cases, offset_name("pebble cut by the slope at", x, y, x / 8), {tilted, {}},
        {pebble, at(x, y, x / 8)});
    add(cases, offset_name("pebble well above the slope at", x, y, x / 8), {tilted, {}},
        {pebble, at(x, y, x / 8 + 2 * r)});
  }
  add(cases, "pebble beyond the edge", {flat, {}}, {pebble, at(5120 + r + 0x1p-24, 0, 0)});
  add(cases, "pebble's side on the edge", {flat, {}}, {pebble, at(5120 + r, 0, 0)});
  return cases;
}

std::vector<Case> gap_cases() {
  std::vector<Case> cases;
  struct Setting {
    const char* name;
    MeshPtr a, b;
    std::array<double, 3> contact_m, away;
  };
  const MeshPtr unit = box(.5, 2);
  const std::vector<Setting> settings{
      {"faces", unit, unit, {1, .25, .25}, {1, 0, 0}},
      {"edges", unit, unit, {1, 1, .25}, {1, 0, 0}},
      {"corners", unit, unit, {1, 1, 1}, {0, 0, 1}},
      {"pole and plane",
       share(test::make_plane(2, 3)),
       ball(16, .5, -19),
       {.25, .125, .5},
       {0, 0, 1}},
  };
  for (const Setting& s : settings)
    for (int k = 0; k <= 22; ++k)
      for (const double sign : {1.0, -1.0}) {
        if (k == 0 && sign < 0) continue;
        const double gap = sign * std::ldexp(1.0, -k);
        char name[64];
        std::snprintf(name, sizeof name, "%s, gap %s2^-%d m", s.name, sign < 0 ? "-" : "", k);
        add(cases, name, {s.a, {}},
            {s.b, at(s.contact_m[0] + gap * s.away[0], s.contact_m[1] + gap * s.away[1],
                     s.contact_m[2] + gap * s.away[2])});
      }
  return cases;
}

}  // namespace nearmesh::stability
