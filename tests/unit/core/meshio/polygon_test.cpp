// SPDX-License-Identifier: Apache-2.0
#include "core/meshio/polygon.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numeric>

namespace nearmesh::meshio {
namespace {

using Triple = std::array<std::uint32_t, 3>;

IndexedMesh cut(std::vector<std::array<double, 3>> positions_m) {
  IndexedMesh mesh{std::move(positions_m), {}};
  std::vector<std::uint32_t> corners(mesh.positions_m.size());
  std::iota(corners.begin(), corners.end(), 0U);
  EXPECT_TRUE(append_polygon(corners, mesh).is_ok());
  return mesh;
}

/// Areas of the triangles, seen from above.
std::vector<double> areas(const IndexedMesh& mesh) {
  std::vector<double> result;
  for (const Triple& f : mesh.faces) {
    const auto &a = mesh.positions_m[f[0]], &b = mesh.positions_m[f[1]],
               &c = mesh.positions_m[f[2]];
    result.push_back(((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])) / 2);
  }
  return result;
}

TEST(AppendPolygon, FansConvexPolygonFromItsFirstCorner) {
  const IndexedMesh mesh = cut({{0, 0, 0}, {2, 0, 0}, {3, 2, 0}, {1, 3, 0}, {-1, 2, 0}});

  EXPECT_EQ(mesh.faces, (std::vector<Triple>{{0, 1, 2}, {0, 2, 3}, {0, 3, 4}}));
}

TEST(AppendPolygon, CutsConcaveQuadInside) {
  // The notch is at corner 1: a fan from corner 0 would cover what lies outside.
  const IndexedMesh mesh = cut({{0, 0, 0}, {1, 1, 0}, {2, 0, 0}, {1, 3, 0}});

  const std::vector<double> found = areas(mesh);
  ASSERT_EQ(found.size(), 2U);
  EXPECT_GT(found[0], 0);
  EXPECT_GT(found[1], 0);
  EXPECT_EQ(found[0] + found[1], 2);
}

TEST(AppendPolygon, CutsCombInsideFromEitherSide) {
  std::vector<std::array<double, 3>> comb{{20, -1, 5}, {0, -1, 5}};
  for (int tooth = 0; tooth < 10; ++tooth) {
    comb.push_back({2.0 * tooth, 4, 5});
    comb.push_back({2.0 * tooth + 1, 0, 5});
  }
  comb.push_back({20, 4, 5});
  double whole = 0;
  for (std::size_t i = 0; i < comb.size(); ++i) {
    const auto &p = comb[i], &q = comb[(i + 1) % comb.size()];
    whole += (p[0] * q[1] - p[1] * q[0]) / 2;
  }
  for (const double side : {1.0, -1.0}) {
    if (side < 0) std::reverse(comb.begin(), comb.end());
    const std::vector<double> found = areas(cut(comb));

    ASSERT_EQ(found.size(), comb.size() - 2);
    for (const double area : found) EXPECT_GE(area * side * whole, 0);
    EXPECT_NEAR(std::accumulate(found.begin(), found.end(), 0.0), whole * side, 1e-12);
  }
}

TEST(AppendPolygon, SeesPolygonAlongItsOwnNormal) {
  // Standing upright, the concave quad is a line when seen from above.
  const IndexedMesh mesh = cut({{5, 0, 0}, {5, 1, 1}, {5, 2, 0}, {5, 1, 3}});

  ASSERT_EQ(mesh.faces.size(), 2U);
  for (const Triple& f : mesh.faces)  // both cut from the notch
    EXPECT_TRUE(f[0] == 1 || f[1] == 1 || f[2] == 1);
}

TEST(AppendPolygon, LeavesOutPointsAndEdges) {
  EXPECT_TRUE(cut({}).faces.empty());
  EXPECT_TRUE(cut({{0, 0, 0}}).faces.empty());
  EXPECT_TRUE(cut({{0, 0, 0}, {1, 0, 0}}).faces.empty());
}

TEST(AppendPolygon, KeepsCountOfPolygonWithoutArea) {
  EXPECT_EQ(cut({{0, 0, 0}, {1, 0, 0}, {2, 0, 0}, {1, 0, 0}, {0.5, 0, 0}}).faces.size(), 3U);
}

TEST(AppendPolygon, KeepsCountOfPolygonThatCrossesItself) {
  // At some point none of the corners left is an ear.
  EXPECT_EQ(cut({{3, 4, 0}, {2, 2, 0}, {0, 3, 0}, {0, 2, 0}, {3, 2, 0}, {0, 2, 0}}).faces.size(),
            4U);
}

TEST(AppendPolygon, RefusesConcavePolygonOfTooManyCorners) {
  IndexedMesh mesh;
  std::vector<std::uint32_t> corners;
  for (std::uint32_t i = 0; i < kMostConcaveCorners + 2; ++i) {
    const double angle = i * 6.28 / (kMostConcaveCorners + 2), radius = i % 2 == 0 ? 1 : 2;
    mesh.positions_m.push_back({radius * std::cos(angle), radius * std::sin(angle), 0});
    corners.push_back(i);
  }

  EXPECT_EQ(append_polygon(corners, mesh).code(), StatusCode::kUnsupported);
  corners.resize(kMostConcaveCorners);
  EXPECT_TRUE(append_polygon(corners, mesh).is_ok());
}

}  // namespace
}  // namespace nearmesh::meshio
