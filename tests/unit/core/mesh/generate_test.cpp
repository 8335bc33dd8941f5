// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/core/mesh/generate.hpp"

#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <map>
#include <numeric>

namespace nearmesh {
namespace {

/// FNV-1a over the bits of all coordinates and indices.
std::uint64_t hash_of(const IndexedMesh& mesh) {
  std::uint64_t hash = 0xcbf29ce484222325ULL;
  const auto add = [&hash](std::uint64_t value) {
    for (int k = 0; k < 8; ++k) hash = (hash ^ ((value >> (8 * k)) & 0xff)) * 0x100000001b3ULL;
  };
  for (const auto& p : mesh.positions_m)
    for (const double x : p) add(std::bit_cast<std::uint64_t>(x == 0 ? 0.0 : x));
  for (const auto& f : mesh.faces)
    for (const std::uint32_t v : f) add(v);
  return hash;
}

void expect_multiples(const IndexedMesh& mesh, int exponent) {
  for (const auto& p : mesh.positions_m)
    for (const double x : p) {
      ASSERT_EQ(std::ldexp(x, -exponent), std::floor(std::ldexp(x, -exponent)));
      ASSERT_EQ(static_cast<double>(static_cast<float>(x)), x);
    }
}

/// Signed volume of each connected surface; empty where an edge lacks its one opposite.
std::vector<double> closed_volumes_m3(const IndexedMesh& mesh) {
  std::vector<std::uint32_t> root(mesh.positions_m.size());
  std::iota(root.begin(), root.end(), 0U);
  const auto find = [&root](std::uint32_t v) {
    while (root[v] != v) v = root[v] = root[root[v]];
    return v;
  };
  std::map<std::pair<std::uint32_t, std::uint32_t>, int> edges;
  for (const auto& f : mesh.faces)
    for (std::size_t k = 0; k < 3; ++k) {
      ++edges[{f[k], f[(k + 1) % 3]}];
      root[find(f[k])] = find(f[(k + 1) % 3]);
    }
  for (const auto& [edge, count] : edges) {
    const auto opposite = edges.find({edge.second, edge.first});
    if (count != 1 || opposite == edges.end() || opposite->second != 1) return {};
  }
  std::map<std::uint32_t, double> volumes;
  for (const auto& f : mesh.faces) {
    const auto &a = mesh.positions_m[f[0]], &b = mesh.positions_m[f[1]],
               &c = mesh.positions_m[f[2]];
    volumes[find(f[0])] +=
        (a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) +
         a[2] * (b[0] * c[1] - b[1] * c[0])) /
        6;
  }
  std::vector<double> result;
  for (const auto& [v, volume] : volumes) result.push_back(volume);
  return result;
}

TEST(GenerateTerrain, HasSizeByContract) {
  const IndexedMesh mesh = generate_terrain(10, 1);

  EXPECT_EQ(mesh.positions_m.size(), 121U);
  EXPECT_EQ(mesh.faces.size(), 200U);
}

TEST(GenerateTerrain, GivesGoldenBits) {
  EXPECT_EQ(hash_of(generate_terrain(64, 1)), 0xe51b13a8c2c61be1ULL);
}

TEST(GenerateTerrain, LiesOnItsRaster) {
  const IndexedMesh mesh = generate_terrain(65, 2);

  expect_multiples(mesh, -4);
  for (const auto& p : mesh.positions_m) {
    ASSERT_EQ(std::fmod(p[0], 32), 0);
    ASSERT_EQ(std::fmod(p[1], 32), 0);
  }
}

TEST(GenerateTerrain, StaysWithinHeights) {
  for (std::uint64_t seed = 0; seed < 4; ++seed)
    for (const auto& p : generate_terrain(300, seed).positions_m)
      ASSERT_LE(std::fabs(p[2]), 2000) << "seed " << seed;
}

TEST(GenerateTerrain, HasMountainsAndRoughness) {
  const IndexedMesh mesh = generate_terrain(512, 1);

  double lowest = 1e9, highest = -1e9, roughness = 0;
  for (std::size_t v = 0; v < mesh.positions_m.size(); ++v) {
    lowest = std::min(lowest, mesh.positions_m[v][2]);
    highest = std::max(highest, mesh.positions_m[v][2]);
    if (v > 0) roughness += std::fabs(mesh.positions_m[v][2] - mesh.positions_m[v - 1][2]);
  }
  EXPECT_GT(highest - lowest, 800);
  const double mean_slope = roughness / static_cast<double>(mesh.positions_m.size()) / 32;
  EXPECT_GT(mean_slope, 0.1);
  EXPECT_LT(mean_slope, 0.6);
}

TEST(GenerateTerrain, FacesUp) {
  const IndexedMesh mesh = generate_terrain(16, 1);

  for (const auto& f : mesh.faces) {
    const auto &a = mesh.positions_m[f[0]], &b = mesh.positions_m[f[1]],
               &c = mesh.positions_m[f[2]];
    ASSERT_GT((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]), 0);
  }
}

TEST(GenerateTerrain, ContinuesASmallerOneOfTheSameSeed) {
  const IndexedMesh small = generate_terrain(8, 5), large = generate_terrain(16, 5);

  for (std::size_t row = 0; row <= 8; ++row)
    for (std::size_t column = 0; column <= 8; ++column)
      ASSERT_EQ(small.positions_m[row * 9 + column],
                large.positions_m[(row + 4) * 17 + column + 4]);
}

TEST(GenerateTerrain, DependsOnSeed) {
  EXPECT_NE(hash_of(generate_terrain(16, 1)), hash_of(generate_terrain(16, 2)));
}

TEST(CloseTerrain, EnclosesWhatIsBelowTheGround) {
  for (const std::uint32_t size : {2U, 3U, 8U, 33U}) {
    IndexedMesh mesh = generate_terrain(size, 1);
    const std::size_t faces = mesh.faces.size();
    double below = 0;  // under the sheet, by its triangles
    for (const auto& f : mesh.faces)
      for (const std::uint32_t v : f) below += (mesh.positions_m[v][2] + 4000) * 512 / 3;
    ASSERT_TRUE(close_terrain(mesh, size, -4000).is_ok());
    EXPECT_EQ(mesh.faces.size() - faces, 12 * size - 2);
    const std::vector<double> volumes = closed_volumes_m3(mesh);
    ASSERT_EQ(volumes.size(), 1U) << size;
    EXPECT_NEAR(volumes[0], below, 1e-9 * below) << size;
  }
}

TEST(CloseTerrain, RefusesAFloorAboveTheValleys) {
  IndexedMesh mesh = generate_terrain(8, 1);
  double lowest = 1e9;
  for (const auto& p : mesh.positions_m) lowest = std::min(lowest, p[2]);
  for (const double floor_m : {lowest, 5000.0, -1e6, std::nan("")}) {
    EXPECT_EQ(close_terrain(mesh, 8, floor_m).code(), StatusCode::kInvalidArgument) << floor_m;
    EXPECT_EQ(mesh.faces.size(), 128U);
    EXPECT_EQ(mesh.positions_m.size(), 81U);
  }
  EXPECT_TRUE(close_terrain(mesh, 8, lowest - 0.01).is_ok());
  expect_multiples(mesh, -4);
}

TEST(GenerateAircraft, GivesGoldenBits) {
  EXPECT_EQ(hash_of(generate_aircraft(5000, 1)), 0xe187bacbdf544b58ULL);
}

class GenerateAircraftSize : public testing::TestWithParam<std::uint32_t> {};

TEST_P(GenerateAircraftSize, HasAboutTheTrianglesAskedFor) {
  const double asked = GetParam();

  EXPECT_NEAR(static_cast<double>(generate_aircraft(GetParam(), 1).faces.size()), asked,
              0.1 * asked);
}

TEST_P(GenerateAircraftSize, IsEightClosedSurfacesFacingOutward) {
  const std::vector<double> volumes = closed_volumes_m3(generate_aircraft(GetParam(), GetParam()));

  EXPECT_EQ(volumes.size(), 8U);
  for (const double volume : volumes) EXPECT_GT(volume, 1);
}

INSTANTIATE_TEST_SUITE_P(Sizes, GenerateAircraftSize,
                         testing::Values(200, 203, 250, 333, 500, 1000, 4000, 20000, 200000));

TEST(GenerateAircraft, LiesOnItsRaster) { expect_multiples(generate_aircraft(3000, 1), -12); }

TEST(GenerateAircraft, IsAboutSixtyMetresLong) {
  double lowest = 0, highest = 0;
  for (const auto& p : generate_aircraft(1000, 9).positions_m) {
    lowest = std::min(lowest, p[0]);
    highest = std::max(highest, p[0]);
  }
  EXPECT_EQ(highest, 30);
  EXPECT_EQ(lowest, -30);
}

TEST(GenerateSphere, GivesGoldenBits) {
  EXPECT_EQ(hash_of(generate_sphere(64, 0)), 0x4c569904ca103761ULL);
}

TEST(GenerateSphere, HasSizeByContract) {
  EXPECT_EQ(generate_sphere(64, 0).faces.size(), 3968U);
  EXPECT_EQ(generate_sphere(64, 0).positions_m.size(), 2U + 64 * 31);
  EXPECT_EQ(generate_sphere(4, 0).faces.size(), 8U);
}

TEST(GenerateSphere, IsClosedFacingOutward) {
  const std::vector<double> volumes = closed_volumes_m3(generate_sphere(64, 0));

  ASSERT_EQ(volumes.size(), 1U);
  EXPECT_NEAR(volumes[0], 4.18879, 0.02);
}

TEST(GenerateSphere, HasUnitRadius) {
  for (const auto& p : generate_sphere(100, 0).positions_m)
    ASSERT_NEAR(p[0] * p[0] + p[1] * p[1] + p[2] * p[2], 1, 1e-6);
}

TEST(GenerateSphere, MirrorsExactly) {
  const IndexedMesh mesh = generate_sphere(16, 0);

  const auto& north = mesh.positions_m[1 + 2];           // ring 1, an eighth of a turn
  const auto& south = mesh.positions_m[1 + 6 * 16 + 2];  // ring 7
  EXPECT_EQ(north[0], south[0]);
  EXPECT_EQ(north[0], north[1]);
  EXPECT_EQ(north[2], -south[2]);
}

TEST(GenerateSphere, LiesOnItsRaster) { expect_multiples(generate_sphere(64, 0), -22); }

}  // namespace
}  // namespace nearmesh
