// SPDX-License-Identifier: Apache-2.0
// Scenes about states of a progressive model: F11, F12.
#include "meshes.hpp"
#include "nearmesh/core/mesh/generate.hpp"
#include "scenes.hpp"
#include "shapes.hpp"
#include "soup.hpp"

namespace nearmesh::stability {
namespace {

/// Many faces on one edge.
IndexedMesh book(std::uint32_t pages) {
  IndexedMesh mesh = test::make_soup(pages + 2, 1, 7);
  for (std::uint32_t i = 2; i < pages + 2; ++i) mesh.faces.push_back({0, 1, i});
  return mesh;
}

/// A sphere, a segment and a point.
IndexedMesh whiskers() {
  return joined(generate_sphere(12, 0),
                {{{0, 0, 1}, {0, 0, 3}, {2, 2, 2}}, {{0, 1, 1}, {2, 2, 2}}});
}

struct Named {
  const char* name;
  MeshPtr mesh;
};

std::vector<Named> varied_meshes() {
  return {{"terrain", share(generate_terrain(24, 7))},
          {"aircraft", share(generate_aircraft(1000, 7))},
          {"sphere", share(generate_sphere(24, 0))},
          {"soup", share(test::make_soup(300, 1200, 7))},
          {"book", share(book(118))},
          {"box", share(test::make_box({.5, .5, .5}, 6))},
          {"plane", share(test::make_plane(4, 16))},
          {"plate", share(test::make_plate(4, .25, 12))},
          {"torus", share(test::make_torus(1, .25, 32, 16))},
          {"cone", share(test::make_cone(.5, 1, 24, 6))},
          {"valley", share(test::make_valley(.75, 4, 16))},
          {"whiskers", share(whiskers())}};
}

}  // namespace

std::vector<Case> bound_cases() {
  std::vector<Case> cases;
  for (const Named& named : varied_meshes())
    for (const std::uint32_t base_faces : {1U, 16U, 256U})
      cases.push_back({.name = std::string(named.name) + ", base of " + std::to_string(base_faces),
                       .question = Question::kBounds,
                       .a = {named.mesh, {}},
                       .b = {named.mesh, {}},
                       .base_faces = base_faces});
  return cases;
}

std::vector<Case> incremental_cases() {
  std::vector<Case> cases;
  const std::vector<Named> meshes = varied_meshes();
  for (std::size_t i = 0; i + 1 < meshes.size(); ++i)
    for (int seed = 0; seed < 3; ++seed)
      cases.push_back({.name = std::string(meshes[i].name) + " and " + meshes[i + 1].name +
                               ", seed " + std::to_string(seed),
                       .question = Question::kIncremental,
                       .a = {meshes[i].mesh, {}},
                       .b = {meshes[i + 1].mesh, at(.25 * seed, .125, -.25)}});
  return cases;
}

}  // namespace nearmesh::stability
