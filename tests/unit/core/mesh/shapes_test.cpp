// SPDX-License-Identifier: Apache-2.0
#include "shapes.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <set>
#include <string>

namespace nearmesh {
namespace {

constexpr double kPi = 3.14159265358979323846;

// Every directed edge once, and its reverse too where the mesh is closed.
void expect_oriented(const IndexedMesh& mesh, bool closed) {
  std::set<std::pair<std::uint32_t, std::uint32_t>> edges;
  for (const auto& face : mesh.faces)
    for (std::size_t k = 0; k < 3; ++k)
      EXPECT_TRUE(edges.insert({face[k], face[(k + 1) % 3]}).second);
  bool all_paired = true;
  for (const auto& [from, to] : edges) all_paired = all_paired && edges.contains({to, from});
  EXPECT_EQ(all_paired, closed);
}

double volume(const IndexedMesh& mesh) {
  double six = 0;
  for (const auto& face : mesh.faces) {
    const auto &a = mesh.positions_m[face[0]], &b = mesh.positions_m[face[1]],
               &c = mesh.positions_m[face[2]];
    six += a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) +
           a[2] * (b[0] * c[1] - b[1] * c[0]);
  }
  return six / 6;
}

TEST(Shapes, ClosedOnesAreClosedAndOrientedOutward) {
  const struct {
    const char* name;
    IndexedMesh mesh;
    double volume_m3, tolerance;
  } cases[] = {
      {"box", test::make_box({1, 2, 0.5}, 3), 8, 1e-12},
      {"plate", test::make_plate(3, 0.25, 4), 2.25, 1e-12},
      {"torus", test::make_torus(2, 0.5, 96, 48), 2 * kPi * kPi * 2 * 0.25, 0.1},
      {"cone", test::make_cone(1, 2, 96, 5), kPi * 2 / 3, 0.01},
  };
  for (const auto& c : cases) {
    SCOPED_TRACE(c.name);
    expect_oriented(c.mesh, true);
    EXPECT_NEAR(volume(c.mesh), c.volume_m3, c.tolerance);
  }
}

TEST(Shapes, OpenOnesFaceUp) {
  for (const IndexedMesh& mesh : {test::make_plane(2, 3), test::make_valley(0.75, 2, 4)}) {
    expect_oriented(mesh, false);
    for (const auto& face : mesh.faces) {
      const auto &a = mesh.positions_m[face[0]], &b = mesh.positions_m[face[1]],
                 &c = mesh.positions_m[face[2]];
      EXPECT_GT((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]), 0);
    }
  }
}

TEST(Shapes, TheUnitCircleIsTheUnitCircle) {
  for (const std::uint32_t steps : {3U, 8U, 12U, 97U})
    for (std::uint32_t i = 0; i < 2 * steps; ++i) {
      const auto [c, s] = test::unit_circle(i, steps);
      EXPECT_NEAR(c, std::cos(2 * kPi * i / steps), 1e-14);
      EXPECT_NEAR(s, std::sin(2 * kPi * i / steps), 1e-14);
    }
  EXPECT_EQ(test::unit_circle(1, 4), (std::array<double, 2>{0, 1}));
}

}  // namespace
}  // namespace nearmesh
