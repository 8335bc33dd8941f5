// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>

#include "core/base/random.hpp"
#include "nearmesh/core/mesh/clean.hpp"
#include "nearmesh/core/mesh/generate.hpp"

namespace nearmesh {
namespace {

using Triple = std::array<std::uint32_t, 3>;

CleanResult clean(const IndexedMesh& mesh, int bits = 21) {
  Result<CleanResult> result = clean_mesh(mesh, {.grid_bits = bits});
  EXPECT_TRUE(result.is_ok()) << result.status().message();
  return result.is_ok() ? std::move(result).value() : CleanResult{};
}

/// Two triangles that share an edge, on whole metres.
IndexedMesh square() {
  return {{{0, 0, 0}, {8, 0, 0}, {8, 8, 0}, {0, 8, 0}}, {{0, 1, 2}, {0, 2, 3}}};
}

std::array<double, 3> position_m(const GridMesh& mesh, std::uint32_t v) {
  std::array<double, 3> p{};
  for (std::size_t k = 0; k < 3; ++k)
    p[k] = mesh.grid.origin_m[k] + std::ldexp(mesh.positions[v].v[k], mesh.grid.exponent);
  return p;
}

TEST(CleanMesh, KeepsCleanMeshAsItIs) {
  const CleanResult result = clean(square());

  EXPECT_EQ(result.mesh.faces, square().faces);
  for (std::uint32_t v = 0; v < 4; ++v)
    EXPECT_EQ(position_m(result.mesh, v), square().positions_m[v]);
  EXPECT_EQ(result.report.rounding_error_m, 0);
}

TEST(CleanMesh, WeldsEqualGridPoints) {
  IndexedMesh mesh = square();
  mesh.positions_m.push_back({8, 8, 1e-9});
  mesh.faces[1] = {0, 4, 3};

  const CleanResult result = clean(mesh);

  EXPECT_EQ(result.mesh.faces, square().faces);
  EXPECT_EQ(result.report.vertices_welded, 1U);
  EXPECT_EQ(result.mesh.positions.size(), 4U);
}

TEST(CleanMesh, DropsUnreferencedVertices) {
  IndexedMesh mesh = square();
  mesh.positions_m.insert(mesh.positions_m.begin(), {-1e6, 5, 5});
  for (Triple& f : mesh.faces)
    for (std::uint32_t& v : f) ++v;

  const CleanResult result = clean(mesh);

  EXPECT_EQ(result.report.vertices_unreferenced, 1U);
  EXPECT_EQ(result.mesh.grid, clean(square()).mesh.grid);
  EXPECT_EQ(result.mesh.faces, square().faces);
}

TEST(CleanMesh, NumbersVerticesInInputOrder) {
  const IndexedMesh mesh{{{9, 0, 0}, {5, 0, 0}, {9, 0, 0}, {0, 7, 0}}, {{3, 2, 1}, {0, 1, 3}}};

  const CleanResult result = clean(mesh);

  ASSERT_EQ(result.mesh.positions.size(), 3U);
  EXPECT_EQ(position_m(result.mesh, 0), mesh.positions_m[0]);
  EXPECT_EQ(position_m(result.mesh, 1), mesh.positions_m[1]);
  EXPECT_EQ(position_m(result.mesh, 2), mesh.positions_m[3]);
}

TEST(CleanMesh, DropsDuplicateFaces) {
  IndexedMesh mesh = square();
  mesh.faces.push_back({1, 2, 0});

  const CleanResult result = clean(mesh);

  EXPECT_EQ(result.mesh.faces, square().faces);
  EXPECT_EQ(result.report.faces_duplicate, 1U);
}

TEST(CleanMesh, DropsDuplicateFacesOfOtherOrientation) {
  IndexedMesh mesh = square();
  mesh.faces.push_back({3, 2, 0});

  EXPECT_EQ(clean(mesh).mesh.faces, square().faces);
}

TEST(CleanMesh, KeepsTheFirstOfDuplicateFaces) {
  IndexedMesh mesh = square();
  mesh.faces = {{0, 2, 3}, {2, 1, 0}, {0, 1, 2}, {3, 0, 2}};

  const CleanResult result = clean(mesh);

  EXPECT_EQ(result.mesh.face_ids, (std::vector<FaceId>{{0}, {1}}));
  EXPECT_EQ(result.mesh.faces, (std::vector<Triple>{{0, 2, 3}, {2, 1, 0}}));
}

TEST(CleanMesh, KeepsInputNumbersOfFaces) {
  IndexedMesh mesh = square();
  mesh.faces = {{0, 1, 2}, {1, 1, 2}, {2, 1, 0}, {0, 2, 3}};

  EXPECT_EQ(clean(mesh).mesh.face_ids, (std::vector<FaceId>{{0}, {3}}));
}

TEST(CleanMesh, DropsSegmentOnEdgeOfKeptFace) {
  IndexedMesh mesh = square();
  mesh.faces.push_back({2, 0, 0});

  const CleanResult result = clean(mesh);

  EXPECT_EQ(result.mesh.faces, square().faces);
  EXPECT_EQ(result.report.faces_degenerate_dropped, 1U);
}

TEST(CleanMesh, KeepsSegmentThatNoFaceCovers) {
  IndexedMesh mesh = square();
  mesh.faces.push_back({1, 3, 3});  // the other diagonal

  const CleanResult result = clean(mesh);

  ASSERT_EQ(result.mesh.faces.size(), 3U);
  EXPECT_EQ(result.mesh.faces[2], (Triple{1, 3, 4}));
  EXPECT_EQ(result.mesh.positions[4], result.mesh.positions[3]);
  EXPECT_EQ(result.report.faces_degenerate_kept, 1U);
}

TEST(CleanMesh, KeepsEqualSegmentsOnce) {
  IndexedMesh mesh = square();
  mesh.faces.push_back({1, 3, 3});
  mesh.faces.push_back({3, 1, 1});

  const CleanResult result = clean(mesh);

  EXPECT_EQ(result.mesh.face_ids, (std::vector<FaceId>{{0}, {1}, {2}}));
  EXPECT_EQ(result.report.faces_degenerate_dropped, 1U);
}

TEST(CleanMesh, DropsPointAtCornerOfKeptFace) {
  IndexedMesh mesh = square();
  mesh.faces.push_back({3, 3, 3});

  EXPECT_EQ(clean(mesh).mesh.faces, square().faces);
}

TEST(CleanMesh, DropsPointAtEndOfKeptSegmentThatComesLater) {
  IndexedMesh mesh = square();
  mesh.positions_m.push_back({4, 4, 4});
  mesh.faces.insert(mesh.faces.begin(), {4, 4, 4});
  mesh.faces.push_back({4, 4, 0});

  EXPECT_EQ(clean(mesh).mesh.face_ids, (std::vector<FaceId>{{1}, {2}, {3}}));
}

TEST(CleanMesh, KeepsPointThatNothingCoversOnce) {
  IndexedMesh mesh = square();
  mesh.positions_m.push_back({4, 4, 4});
  mesh.faces.push_back({4, 4, 4});
  mesh.faces.push_back({4, 4, 4});

  const CleanResult result = clean(mesh);

  ASSERT_EQ(result.mesh.faces.size(), 3U);
  EXPECT_EQ(result.mesh.faces[2], (Triple{4, 5, 6}));
  EXPECT_EQ(result.mesh.positions[5], result.mesh.positions[4]);
  EXPECT_EQ(result.mesh.positions[6], result.mesh.positions[4]);
}

TEST(CleanMesh, FindsFacesThatFallTogetherOnlyOnTheGrid) {
  IndexedMesh mesh = square();
  mesh.positions_m.push_back({8, 1e-9, 0});
  mesh.faces.push_back({0, 1, 4});

  const CleanResult result = clean(mesh);

  EXPECT_EQ(result.mesh.faces, square().faces);
  EXPECT_EQ(result.report.faces_degenerate_dropped, 1U);
}

TEST(CleanMesh, KeepsCollinearFaces) {
  IndexedMesh mesh = square();
  mesh.positions_m.push_back({4, 0, 0});
  mesh.faces.push_back({0, 4, 1});

  EXPECT_EQ(clean(mesh).mesh.faces.size(), 3U);
}

TEST(CleanMesh, CountsBoundaryEdges) {
  EXPECT_EQ(clean(square()).report.edges_boundary, 4U);
  EXPECT_EQ(clean(generate_sphere(8, 0)).report.edges_boundary, 0U);
}

TEST(CleanMesh, CountsNonManifoldEdges) {
  IndexedMesh mesh = square();
  mesh.positions_m.push_back({4, 4, 4});
  mesh.faces.push_back({0, 2, 4});

  EXPECT_EQ(clean(mesh).report.edges_non_manifold, 1U);
  EXPECT_EQ(clean(square()).report.edges_non_manifold, 0U);
}

TEST(CleanMesh, CountsEdgesWhoseFacesDisagree) {
  IndexedMesh sphere = generate_sphere(8, 0);
  EXPECT_EQ(clean(sphere).report.edges_disagreeing, 0U);
  std::swap(sphere.faces[20][0], sphere.faces[20][1]);
  EXPECT_EQ(clean(sphere).report.edges_disagreeing, 3U);
  EXPECT_EQ(clean(sphere).report.edges_boundary, 0U);
}

TEST(CleanMesh, ThreeFacesOnAnEdgeNeverAgreeAndFourMay) {
  IndexedMesh pages{{{0, 0, 0}, {0, 0, 4}, {4, 0, 0}, {0, 4, 0}, {-4, 0, 0}, {0, -4, 0}},
                    {{0, 1, 2}, {1, 0, 3}, {0, 1, 4}}};
  EXPECT_EQ(clean(pages).report.edges_disagreeing, 1U);
  pages.faces.push_back({1, 0, 5});
  EXPECT_EQ(clean(pages).report.edges_disagreeing, 0U);
  EXPECT_EQ(clean(pages).report.edges_boundary, 8U);
}

TEST(CleanMesh, SegmentsAndPointsOpenNoEdge) {
  IndexedMesh sphere = generate_sphere(8, 0);
  sphere.positions_m.push_back({3, 0, 0});
  const auto far = static_cast<std::uint32_t>(sphere.positions_m.size() - 1);
  sphere.faces.push_back({0, far, far});
  const CleanReport report = clean(sphere).report;
  EXPECT_EQ(report.faces_degenerate_kept, 1U);
  EXPECT_EQ(report.edges_boundary, 0U);
  EXPECT_EQ(report.edges_disagreeing, 0U);
  EXPECT_EQ(report.components, 1U);
}

TEST(CleanMesh, CountsComponentsThroughSharedVertices) {
  IndexedMesh mesh{{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {4, 0, 0}, {5, 0, 0}, {4, 1, 0}, {0, 5, 0}},
                   {{0, 1, 2}, {3, 4, 5}}};
  EXPECT_EQ(clean(mesh).report.components, 2U);

  mesh.faces.push_back({2, 3, 6});
  EXPECT_EQ(clean(mesh).report.components, 1U);
}

TEST(CleanMesh, ChoosesSmallestCellThatFits) {
  // 15 cells of 1 m fit 4 bits exactly; 16 do not.
  IndexedMesh mesh{{{0, 0, 0}, {15, 0, 0}, {0, 3, 0}}, {{0, 1, 2}}};
  EXPECT_EQ(clean(mesh, 4).mesh.grid.exponent, 0);

  mesh.positions_m[1][0] = 16;
  EXPECT_EQ(clean(mesh, 4).mesh.grid.exponent, 1);
}

TEST(CleanMesh, PlacesOriginOnMultipleOfCell) {
  const IndexedMesh mesh{{{-7.3, 100.2, 0.9}, {5, 103, 1}, {0, 101, 3}}, {{0, 1, 2}}};

  const GridMesh cleaned = clean(mesh, 4).mesh;

  EXPECT_EQ(cleaned.grid.exponent, 0);
  EXPECT_EQ(cleaned.grid.origin_m, (std::array<double, 3>{-8, 100, 0}));
}

TEST(CleanMesh, RoundsHalvesUpOnBothSidesOfZero) {
  IndexedMesh mesh{{{-7, 0, 0}, {7, 0, 0}, {-2.5, 0, 0}, {2.5, 5, 0}}, {{0, 1, 2}, {0, 1, 3}}};

  const GridMesh cleaned = clean(mesh, 4).mesh;

  EXPECT_EQ(position_m(cleaned, 2)[0], -2);
  EXPECT_EQ(position_m(cleaned, 3)[0], 3);
}

TEST(CleanMesh, ReportsGreatestRoundingError) {
  const IndexedMesh mesh{{{0, 0, 0}, {15, 0, 0}, {5, 3.25, 0}}, {{0, 1, 2}}};

  EXPECT_EQ(clean(mesh, 4).report.rounding_error_m, 0.25);
}

TEST(CleanMesh, StaysWithinHalfACellOnEachAxis) {
  Random random(7);
  IndexedMesh mesh;
  for (std::uint32_t f = 0; f < 200; ++f) {
    for (int k = 0; k < 3; ++k)
      mesh.positions_m.push_back(
          {random.between(-3, 5), random.between(1e5, 1e5 + 1), random.unit()});
    mesh.faces.push_back({3 * f, 3 * f + 1, 3 * f + 2});
  }

  const GridMesh cleaned = clean(mesh, 31).mesh;

  ASSERT_EQ(cleaned.positions.size(), mesh.positions_m.size());
  for (std::uint32_t v = 0; v < mesh.positions_m.size(); ++v)
    for (std::size_t k = 0; k < 3; ++k)
      ASSERT_LE(std::fabs(position_m(cleaned, v)[k] - mesh.positions_m[v][k]),
                std::ldexp(0.5, cleaned.grid.exponent));
}

class CleanMeshBits : public testing::TestWithParam<int> {};

TEST_P(CleanMeshBits, KeepsCoordinatesInRange) {
  const GridMesh cleaned = clean(generate_aircraft(1000, 3), GetParam()).mesh;

  const auto limit = (std::int64_t{1} << GetParam()) - 1;
  std::int64_t greatest = 0;
  for (const GridPoint& p : cleaned.positions)
    for (int k = 0; k < 3; ++k) {
      ASSERT_GE(p[k], 0);
      ASSERT_LE(p[k], limit);
      greatest = std::max<std::int64_t>(greatest, p[k]);
    }
  EXPECT_GE(greatest, limit / 2 - 1);  // no coarser than needed
}

INSTANTIATE_TEST_SUITE_P(AllBits, CleanMeshBits, testing::Range(kMinGridBits, kMaxGridBits + 1));

class CleanMeshScale : public testing::TestWithParam<double> {};

TEST_P(CleanMeshScale, DoesNotChangeTheAnswer) {
  IndexedMesh mesh = generate_sphere(16, 0);
  const CleanResult expected = clean(mesh);
  for (auto& p : mesh.positions_m)
    for (double& x : p) x *= GetParam();

  const CleanResult result = clean(mesh);

  EXPECT_EQ(result.mesh.faces, expected.mesh.faces);
  if (std::exp2(std::round(std::log2(GetParam()))) == GetParam()) {
    EXPECT_EQ(result.mesh.positions, expected.mesh.positions);
  }
}

INSTANTIATE_TEST_SUITE_P(Scales, CleanMeshScale,
                         testing::Values(1e-140, 1e-12, 0x1p-20, 0x1p20, 1e30, 0x1p400));

TEST(CleanMesh, GivesSameAnswerWhereverTheModelLies) {
  IndexedMesh mesh = generate_sphere(16, 0);
  const CleanResult expected = clean(mesh, 16);
  for (int k = 0; k <= 23; ++k) {
    IndexedMesh moved = mesh;
    for (auto& p : moved.positions_m) p[0] += std::ldexp(1, k), p[1] -= std::ldexp(1, k);

    const CleanResult result = clean(moved, 16);

    ASSERT_EQ(result.mesh.faces, expected.mesh.faces) << "2^" << k;
    ASSERT_EQ(result.mesh.positions, expected.mesh.positions) << "2^" << k;
  }
}

TEST(CleanMesh, HandlesCoordinatesBeyondWholeNumbersOfCells) {
  // Neighbouring doubles near 1e30 are 2^47 m apart: the cell is far finer than any coordinate.
  const double x = 0x1p99, step = 0x1p47;
  const IndexedMesh mesh{{{x, 0, 0}, {x + step, 0, 0}, {x, step, 0}}, {{0, 1, 2}}};

  const GridMesh cleaned = clean(mesh).mesh;

  ASSERT_EQ(cleaned.faces.size(), 1U);
  for (std::uint32_t v = 0; v < 3; ++v) EXPECT_EQ(position_m(cleaned, v), mesh.positions_m[v]);
}

TEST(CleanMesh, GivesSinglePointAnExactCell) {
  const IndexedMesh mesh{{{0.1, -2e7, 3}, {0.1, -2e7, 3}, {0.1, -2e7, 3}}, {{0, 1, 2}}};

  const CleanResult result = clean(mesh);

  EXPECT_EQ(result.mesh.grid.exponent, 25 - 53);  // a unit in the last place of 2e7
  EXPECT_EQ(result.mesh.positions.size(), 3U);
  EXPECT_EQ(position_m(result.mesh, 0)[1], -2e7);
}

TEST(CleanMesh, GivesSinglePointAtZeroASensibleCell) {
  const IndexedMesh mesh{{{0, 0, 0}}, {{0, 0, 0}}};

  EXPECT_EQ(clean(mesh).mesh.grid.exponent, kPointCellExponent);
}

// The lattice of a pair is as fine as the larger grid allows: a point must not count as metres
// wide.
TEST(CleanMesh, GivesSinglePointNoRoomAroundIt) {
  const IndexedMesh at_zero{{{0, 0, 0}}, {{0, 0, 0}}}, elsewhere{{{1, 2, 3}}, {{0, 0, 0}}};
  EXPECT_EQ(clean(at_zero).mesh.grid.bits, kMinGridBits);
  EXPECT_EQ(clean(elsewhere).mesh.grid.bits, kMinGridBits);
}

TEST(CleanMesh, TurnsDenormalModelIntoAPoint) {
  const IndexedMesh mesh{{{0, 0, 0}, {1e-310, 0, 0}, {0, 1e-310, 0}}, {{0, 1, 2}}};

  const CleanResult result = clean(mesh);

  EXPECT_EQ(result.mesh.grid.exponent, kMinCellExponent);
  EXPECT_EQ(result.report.faces_degenerate_kept, 1U);
}

TEST(CleanMesh, RejectsNonFiniteReferencedVertex) {
  for (const double bad : {std::nan(""), std::numeric_limits<double>::infinity(), 1e200}) {
    IndexedMesh mesh = square();
    mesh.positions_m[2][1] = bad;

    const auto result = clean_mesh(mesh);

    ASSERT_FALSE(result.is_ok());
    EXPECT_EQ(result.status().code(), StatusCode::kInvalidArgument);
    EXPECT_NE(result.status().message().find("vertex 2"), std::string::npos);
  }
}

TEST(CleanMesh, IgnoresNonFiniteUnreferencedVertex) {
  IndexedMesh mesh = square();
  mesh.positions_m.push_back({std::nan(""), 0, 0});

  EXPECT_EQ(clean(mesh).mesh.faces, square().faces);
}

TEST(CleanMesh, RejectsIndexOutOfRange) {
  IndexedMesh mesh = square();
  mesh.faces[1][2] = 4;

  const auto result = clean_mesh(mesh);

  ASSERT_FALSE(result.is_ok());
  EXPECT_NE(result.status().message().find("face 1"), std::string::npos);
}

TEST(CleanMesh, RejectsMeshWithoutFaces) { EXPECT_FALSE(clean_mesh({{{0, 0, 0}}, {}}).is_ok()); }

TEST(CleanMesh, RejectsBitsOutOfRange) {
  EXPECT_FALSE(clean_mesh(square(), {.grid_bits = kMinGridBits - 1}).is_ok());
  EXPECT_FALSE(clean_mesh(square(), {.grid_bits = kMaxGridBits + 1}).is_ok());
}

/// What must hold for any result, whatever the input.
void expect_sound(const GridMesh& mesh, const CleanReport& report) {
  std::vector<bool> used(mesh.positions.size());
  std::set<std::array<GridPoint, 3>> seen;
  for (const Triple& f : mesh.faces) {
    ASSERT_TRUE(f[0] != f[1] && f[1] != f[2] && f[2] != f[0]);
    std::array<GridPoint, 3> corners;
    for (std::size_t k = 0; k < 3; ++k) {
      ASSERT_LT(f[k], used.size());
      used[f[k]] = true;
      corners[k] = mesh.positions[f[k]];
    }
    std::ranges::sort(corners);
    ASSERT_TRUE(seen.insert(corners).second);
  }
  ASSERT_TRUE(std::ranges::all_of(used, [](bool u) { return u; }));
  ASSERT_TRUE(std::ranges::is_sorted(mesh.face_ids));
  ASSERT_EQ(mesh.face_ids.size(), mesh.faces.size());
  ASSERT_EQ(mesh.faces.size() + report.faces_duplicate + report.faces_degenerate_dropped,
            report.faces_in);
}

TEST(CleanMesh, CoversEveryInputFaceOfRandomSoups) {
  for (std::uint64_t seed = 0; seed < 300; ++seed) {
    Random random(seed);
    IndexedMesh mesh;
    for (int v = 0; v < 40; ++v)
      mesh.positions_m.push_back({static_cast<double>(random.below(3)),
                                  static_cast<double>(random.below(3)),
                                  static_cast<double>(random.below(2))});
    for (std::uint32_t f = 0; f < 1 + random.below(30); ++f)
      mesh.faces.push_back({random.below(40), random.below(40), random.below(40)});

    const CleanResult result = clean(mesh);

    ASSERT_NO_FATAL_FAILURE(expect_sound(result.mesh, result.report)) << "seed " << seed;
    for (const Triple& f : mesh.faces) {
      const auto covers = [&](const Triple& kept) {
        return std::ranges::all_of(f, [&](std::uint32_t v) {
          return std::ranges::any_of(kept, [&](std::uint32_t k) {
            return position_m(result.mesh, k) == mesh.positions_m[v];
          });
        });
      };
      ASSERT_TRUE(std::ranges::any_of(result.mesh.faces, covers)) << "seed " << seed;
    }
  }
}

TEST(CleanMesh, OnACommonLatticeRoundsBordersAlike) {
  IndexedMesh left{{{0.1, 0.2, 0}, {4.4, 0.3, 1}, {4.4, 8.7, 2.3}}, {{0, 1, 2}}};
  IndexedMesh right{{{4.4, 0.3, 1}, {9.1, 5, 5}, {4.4, 8.7, 2.3}}, {{0, 1, 2}}};
  const CleanOptions options{.lattice = CommonLattice{{1, -1, 0}, -7}};
  const auto a = clean_mesh(left, options), b = clean_mesh(right, options);
  ASSERT_TRUE(a.is_ok() && b.is_ok());
  const GridMesh &p = a.value().mesh, &q = b.value().mesh;
  EXPECT_EQ(p.grid.exponent, -7);
  EXPECT_EQ(p.grid.lattice_origin_m(), (std::array<double, 3>{1, -1, 0}));
  EXPECT_EQ(q.grid.lattice_origin_m(), (std::array<double, 3>{1, -1, 0}));
  EXPECT_NE(p.grid.origin_m, q.grid.origin_m);
  for (const auto& [one, other] : {std::pair(1U, 0U), std::pair(2U, 2U)})
    for (std::size_t k = 0; k < 3; ++k)
      EXPECT_EQ(p.grid.lattice_cells[k] + p.positions[one].v[k],
                q.grid.lattice_cells[k] + q.positions[other].v[k]);
}

TEST(CleanMesh, RefusesALatticeOnWhichTheMeshDoesNotFit) {
  const auto refused = [](const IndexedMesh& mesh, const CommonLattice& lattice, int bits) {
    const auto result = clean_mesh(mesh, {.grid_bits = bits, .lattice = lattice});
    EXPECT_EQ(result.status().code(), StatusCode::kInvalidArgument);
    return result.status().message();
  };
  EXPECT_NE(refused(square(), {{}, -1}, 4).find("found 17 along x"), std::string::npos)
      << refused(square(), {{}, -1}, 4);
  EXPECT_TRUE(clean_mesh(square(), {.grid_bits = 5, .lattice = CommonLattice{{}, -1}}).is_ok());
  EXPECT_NE(refused(square(), {{0, 0.3, 0}, -1}, 21).find("0.29999"), std::string::npos);
  EXPECT_NE(refused(square(), {{0x1p31 + 1, 0, 0}, 0}, 21).find("within 2^31 cells"),
            std::string::npos);
  EXPECT_TRUE(clean_mesh(square(), {.lattice = CommonLattice{{0x1p31, 0, 0}, 0}}).is_ok());
  refused(square(), {{}, 501}, 21);
  refused(square(), {{std::numeric_limits<double>::quiet_NaN(), 0, 0}, 0}, 21);
}

}  // namespace
}  // namespace nearmesh
