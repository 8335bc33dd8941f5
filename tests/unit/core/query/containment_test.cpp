// SPDX-License-Identifier: Apache-2.0
// Solid bodies: is one inside the other? F2 and F15 of the list of failures, and every state of
// refinement.
#include "core/query/containment.hpp"

#include "core/demand/collect.hpp"
#include "fault_of.hpp"
#include "solids.hpp"

namespace nearmesh {
namespace {

using test::append;
using test::make_cube;
using test::pose_at;
using test::quarter_turns;
using test::Solid;

constexpr QueryOptions kBothSolid{.clearance = Clearance::kNone, .solid_a = true, .solid_b = true};
constexpr std::array<double, 9> kNoTurn{1, 0, 0, 0, 1, 0, 0, 0, 1};

/// The answer of full meshes and of certify() from the bases, which must be one.
Answer answer_at(const Solid& a, const Solid& b, const Pose& pose_b, const Pose& pose_a = {},
                 const QueryOptions& options = kBothSolid) {
  const PosedPair posed = pose_at(a, pose_a, b, pose_b);
  LocalModel local_a(a.model.store, a.model.header.grid),
      local_b(b.model.store, b.model.header.grid);
  const Result<Answer> certified =
      certify(local_a, posed.a, test::no_require, local_b, posed.b, test::no_require, options);
  if (!certified.is_ok()) {
    ADD_FAILURE() << certified.status().message();
    return {};
  }
  const Answer full = query(a.full.tree.view(), posed.a, b.full.tree.view(), posed.b, options);
  EXPECT_EQ(certified.value().status, full.status);
  EXPECT_EQ(test::fault_of(certified.value(), full), "");
  return full;
}

Pose moved(double x, double y, double z) {
  return {.rotation = kNoTurn, .translation_m = {x, y, z}};
}

void expect_contained(const Answer& answer, Containment contained) {
  EXPECT_STREQ(to_string(answer.status), "contained");
  EXPECT_STREQ(to_string(answer.contained), to_string(contained));
}
void expect_free(const Answer& answer) {
  EXPECT_STREQ(to_string(answer.status), "free");
  EXPECT_EQ(answer.contained, Containment::kNone);
}

// ---- scenes -------------------------------------------------------------------------------------

TEST(Containment, SmallCubeInCubeFourTimesItsSize) {
  const Solid small(make_cube(1, 4)), large(make_cube(4, 4));
  expect_contained(answer_at(small, large, {}), Containment::kAInB);
  expect_contained(answer_at(large, small, {}), Containment::kBInA);
  expect_contained(answer_at(small, large, moved(0.25, -2.5, 1)), Containment::kAInB);
  expect_free(answer_at(small, large, moved(6, 0, 0)));
}

TEST(Containment, ConeAroundSphereAroundCube) {
  const Solid cone(test::make_cone(48, 16)), sphere(generate_sphere(24, 0)),
      cube(make_cube(0.5, 4));
  expect_contained(answer_at(cone, sphere, moved(0, 0, 0.25)), Containment::kBInA);
  expect_contained(answer_at(sphere, cube, {}), Containment::kBInA);
  expect_contained(answer_at(cube, cone, moved(0, 0, -0.25)), Containment::kAInB);
}

TEST(Containment, SurfaceBodiesHaveNoInside) {
  const Solid small(make_cube(1, 4)), large(make_cube(4, 4));
  expect_free(answer_at(small, large, {}, {}, {}));
  expect_free(answer_at(small, large, {}, {}, {.solid_a = true}));
  expect_contained(answer_at(small, large, {}, {}, {.solid_b = true}), Containment::kAInB);
}

TEST(Containment, TheHoleOfATorusIsOutside) {
  const Solid torus(test::make_torus(3, 1, 32, 16)), ball(generate_sphere(16, 0));
  const Solid grain(make_cube(0.25, 2));
  expect_free(answer_at(torus, ball, {}));
  expect_free(answer_at(torus, grain, {}));
  expect_contained(answer_at(torus, grain, moved(3, 0, 0)), Containment::kBInA);
  expect_contained(answer_at(torus, grain, moved(0, -3, 0.25)), Containment::kBInA);
}

TEST(Containment, TheRoomBetweenNestedShellsIsOutside) {
  const Solid nested(test::make_nested()), grain(make_cube(0.25, 2)), world(make_cube(8, 2));
  expect_contained(answer_at(grain, nested, {}), Containment::kAInB);  // innermost ball
  expect_free(answer_at(grain, nested, moved(2, 0, 0)));               // cavity
  expect_contained(answer_at(grain, nested, moved(0, 3.5, 0)), Containment::kAInB);  // shell
  expect_contained(answer_at(nested, world, {}), Containment::kAInB);
}

TEST(Containment, ASurfaceTurnedOverHasTheSameInside) {
  const Solid inverted(test::turned_over(make_cube(4, 2))), grain(make_cube(0.25, 2));
  expect_contained(answer_at(grain, inverted, {}), Containment::kAInB);
  expect_free(answer_at(grain, inverted, moved(5, 0, 0)));
}

TEST(Containment, WhatOverlappingShellsShareIsInside) {
  IndexedMesh mesh = make_cube(2, 4);
  append(mesh, make_cube(2, 4), {1, 1, 1});
  const Solid overlapping(mesh), grain(make_cube(0.25, 2));
  for (const double x : {-1.5, 0.5, 2.5})
    expect_contained(answer_at(overlapping, grain, moved(x, x, x)), Containment::kBInA);
  expect_free(answer_at(overlapping, grain, moved(-1.5, 2.5, 2.5)));
}

TEST(Containment, OneOfManyPartsInsideIsEnough) {
  IndexedMesh mesh;
  for (int i = 0; i < 20; ++i) append(mesh, make_cube(0.25, 2), {4.0 * i, 0.5, 0}, 1);
  const Solid beads(mesh), box(make_cube(1, 4));
  expect_contained(answer_at(beads, box, moved(76, 0, 0)), Containment::kAInB);
  expect_contained(answer_at(beads, box, moved(36, 0.5, 0.5)), Containment::kAInB);
  expect_free(answer_at(beads, box, moved(38, 0, 0)));
}

TEST(Containment, EachMayHoldAPartOfTheOther) {
  IndexedMesh mesh = make_cube(2, 4);
  append(mesh, make_cube(0.25, 2), {10, 0, 0});
  const Solid one(mesh);
  // The other one turned by half a turn about z: its small cube comes to the first one's large one.
  const Pose turned{.rotation = {-1, 0, 0, 0, -1, 0, 0, 0, 1}, .translation_m = {10, 0, 0}};
  expect_contained(answer_at(one, one, turned), Containment::kBoth);
}

TEST(Containment, WhoeverHoldsAPartOfTheOtherIsToldToTheEnd) {
  // A certified answer must not depend on what came first, so one inside found early does not
  // settle the other question.
  IndexedMesh mesh = make_cube(2, 8);
  append(mesh, make_cube(0.25, 4), {10, 0, 0});
  const Solid one(mesh);
  const Pose turned{.rotation = {-1, 0, 0, 0, -1, 0, 0, 0, 1}, .translation_m = {10, 0, 0}};
  const PosedPair posed = pose_at(one, {}, one, turned);
  std::size_t open = 0;
  for (std::uint64_t seed = 0; seed < 60; ++seed) {
    Random random(seed);
    LocalModel a(one.model.store, one.model.header.grid), b(one.model.store, one.model.header.grid);
    ASSERT_TRUE(certify(a, posed.a, test::no_require, b, posed.b, test::no_require, {}).is_ok());
    test::refine_at_random(random.below(2) == 0 ? a : b, random);
    const Answer answer = query(a.view(), posed.a, b.view(), posed.b, kBothSolid);
    open += answer.status == AnswerStatus::kUncertain ? 1 : 0;
    if (is_certified(answer.status)) expect_contained(answer, Containment::kBoth);
  }
  EXPECT_GT(open, 10U);
}

TEST(Containment, TouchingWallsAreContact) {
  const Solid small(make_cube(1, 4)), large(make_cube(4, 4));
  EXPECT_EQ(answer_at(small, large, moved(3, 0, 0)).status, AnswerStatus::kContact);
  EXPECT_EQ(answer_at(small, large, moved(3, 3, 3)).status, AnswerStatus::kContact);
  const double cell = std::ldexp(1.0, small.model.header.grid.exponent);
  expect_contained(answer_at(small, large, moved(3 - 4 * cell, 0, 0)), Containment::kAInB);
}

TEST(Containment, AircraftUnderGround) {
  const Solid land(test::make_closed_terrain(24, 7, -3000)), aircraft(generate_aircraft(1000, 7));
  double lowest = 1e9, highest = -1e9;
  for (const auto& p : generate_terrain(24, 7).positions_m) {
    lowest = std::min(lowest, p[2]);
    highest = std::max(highest, p[2]);
  }
  expect_contained(answer_at(land, aircraft, moved(100, 50, lowest - 200)), Containment::kBInA);
  expect_free(answer_at(land, aircraft, moved(100, 50, highest + 100)));
  expect_free(answer_at(land, aircraft, moved(100, 50, -3100)));
}

TEST(Containment, ClearanceIsThatOfTheSurfaces) {
  const Solid small(make_cube(1, 4)), large(make_cube(4, 4));
  QueryOptions options = kBothSolid;
  options.clearance = Clearance::kExact;
  const Answer answer = answer_at(small, large, moved(1, 0, 0), {}, options);
  EXPECT_GT(answer.clearance_m, 1.5);
  EXPECT_LE(answer.clearance_m, 2);
}

TEST(Containment, AnyLooksForItToo) {
  const Solid small(make_cube(1, 4)), large(make_cube(4, 4));
  QueryOptions options = kBothSolid;
  options.any = true;
  expect_contained(answer_at(small, large, {}, {}, options), Containment::kAInB);
}

// ---- open models --------------------------------------------------------------------------------

TEST(CheckSolid, RefusesASheetWithTheReason) {
  const Status status = check_solid(test::bake_named("terrain").header.surface, "land");
  ASSERT_FALSE(status.is_ok());
  EXPECT_NE(status.message().find("land"), std::string::npos) << status.message();
  EXPECT_NE(status.message().find("96 boundary edges"), std::string::npos) << status.message();
}

TEST(CheckSolid, RefusesFacesThatDisagree) {
  IndexedMesh cube = make_cube(1, 2);
  std::swap(cube.faces[0][0], cube.faces[0][1]);
  const Status status = check_solid(test::bake_mesh(cube, 16).header.surface, "box");
  ASSERT_FALSE(status.is_ok());
  EXPECT_NE(status.message().find("3 edges whose faces disagree"), std::string::npos)
      << status.message();
}

TEST(CheckSolid, TakesWhatTheGeneratorsMake) {
  EXPECT_TRUE(check_solid(test::bake_mesh(generate_aircraft(4000, 1)).header.surface, "x").is_ok());
  EXPECT_TRUE(check_solid(test::bake_mesh(generate_sphere(64, 1)).header.surface, "x").is_ok());
  EXPECT_TRUE(
      check_solid(test::bake_mesh(test::make_closed_terrain(33, 1, -2500)).header.surface, "x")
          .is_ok());
}

TEST(ContainmentDeathTest, QueryAssertsThatASolidIsClosed) {
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  const Solid sheet(generate_terrain(4, 1)), box(make_cube(1, 2));
  const PosedPair posed = pose_at(sheet, {}, box, {});
  EXPECT_DEATH(static_cast<void>(query(sheet.full.tree.view(), posed.a, box.full.tree.view(),
                                       posed.b, {.solid_a = true})),
               "is_closed");
}

// ---- too many parts -----------------------------------------------------------------------------

class ManyParts : public ::testing::Test {
 protected:
  static IndexedMesh dust() {
    IndexedMesh mesh;
    for (std::uint32_t i = 0; i <= kMaxComponentSeeds; ++i)
      append(mesh, make_cube(0.125, 1), {1.0 * i, 0, 0});
    return mesh;
  }
  const Solid dust_{dust()}, box_{make_cube(1, 2)}, grain_{make_cube(0.0625, 1)};
};

TEST_F(ManyParts, MayHoldOthers) {
  expect_contained(answer_at(dust_, grain_, moved(17, 0, 0), {}, {.solid_a = true}),
                   Containment::kBInA);
  expect_free(answer_at(dust_, grain_, moved(17.5, 0, 0), {}, {.solid_a = true}));
}

TEST_F(ManyParts, CannotBeProvedOutsideWhatIsNear) {
  LocalModel dust(dust_.model.store, dust_.model.header.grid),
      box(box_.model.store, box_.model.header.grid);
  const PosedPair posed = pose_at(dust_, {}, box_, moved(17, 0, 5));
  const Answer far = query(dust.view(), posed.a, box.view(), posed.b, kBothSolid);
  EXPECT_EQ(far.status, AnswerStatus::kFree);
  const PosedPair inside = pose_at(dust_, {}, box_, moved(17.5, 0, 0));
  const Result<Answer> near =
      certify(dust, inside.a, test::no_require, box, inside.b, test::no_require, kBothSolid);
  ASSERT_TRUE(near.is_ok()) << near.status().message();
  EXPECT_TRUE(is_beyond_detail(near.value()));
  const Answer open = query(dust.view(), inside.a, box.view(), inside.b, kBothSolid);
  EXPECT_EQ(open.status, AnswerStatus::kUncertain);
  EXPECT_TRUE(open.missing_a.empty() && open.missing_b.empty());
  EXPECT_TRUE(std::isinf(open.uncertainty_m));
}

// ---- rays through corners, along walls and edges ------------------------------------------------

/// Locates a point of `solid`'s own frame given in quarters.
Side locate_quarters(const Solid& solid, const Pose& pose, const std::array<int, 3>& quarters) {
  const PosedFrame frame =
      make_posed_frame(solid.model.header.grid, pose, solid.model.header.grid.exponent - 2).value();
  GridPoint p;
  for (int k = 0; k < 3; ++k)
    p[k] = static_cast<std::int32_t>(
        std::ldexp(0.25 * quarters[static_cast<std::size_t>(k)] -
                       solid.model.header.grid.origin_m[static_cast<std::size_t>(k)],
                   -solid.model.header.grid.exponent));
  QueryStats stats;
  return locate(solid.full.tree.view(), frame, pose_point(frame, p), stats).side;
}

TEST(Locate, EveryPointOfAVoxelBlockInEveryQuarterTurn) {
  ASSERT_EQ(quarter_turns().size(), 24U);
  Random random(9);
  std::size_t inside = 0, outside = 0;
  for (std::size_t round = 0; round < 24; ++round) {
    const test::Voxels voxels(3, random);
    const Solid solid(voxels.mesh());
    ASSERT_TRUE(check_solid(solid.model.header.surface, "voxels").is_ok());
    // Points at whole, half and other numbers: on edges and walls of the lattice that are not walls
    // of the surface.
    for (int x = 0; x <= 12; ++x)
      for (int y = 0; y <= 12; ++y)
        for (int z = 0; z <= 12; ++z) {
          int cells = 0, filled = 0;
          for (int corner = 0; corner < 8; ++corner) {
            const auto cell = [corner](int q, int k) {
              return (q - ((corner >> k & 1) != 0 && q % 4 == 0 ? 1 : 0) + 4) / 4 - 1;
            };
            ++cells;
            filled += voxels.at(cell(x, 0), cell(y, 1), cell(z, 2)) ? 1 : 0;
          }
          if (filled != 0 && filled != cells) continue;  // on the surface
          ++(filled != 0 ? inside : outside);
          ASSERT_EQ(locate_quarters(solid, {.rotation = quarter_turns()[round]}, {x, y, z}),
                    filled != 0 ? Side::kInside : Side::kOutside)
              << round << ": " << x << " " << y << " " << z;
        }
  }
  EXPECT_GT(inside, 1000U);
  EXPECT_GT(outside, 1000U);
}

TEST(Locate, EveryLatticePointAboutATurnedBlockOfFewCells) {
  // On a lattice much coarser than the block's grid, rounding of corners moves walls by half a
  // cell.
  Random random(4);
  std::size_t inside = 0, outside = 0;
  for (int round = 0; round < 40; ++round) {
    const Solid solid(test::Voxels(3, random).mesh());
    const Grid& grid = solid.model.header.grid;
    const Pose pose{.rotation = test::random_rotation(random)};
    const PosedFrame frame = make_posed_frame(grid, pose, -2).value();
    const test::PosedSolid posed(solid.model, frame);
    LatticePoint lo = posed.faces[0][0], hi = lo;
    for (const LatticeTriangle& face : posed.faces)
      for (const LatticePoint& p : face)
        for (int k = 0; k < 3; ++k) {
          lo[k] = std::min(lo[k], p[k] - 1);
          hi[k] = std::max(hi[k], p[k] + 1);
        }
    for (int i = 0; i < 300; ++i) {
      LatticePoint p;
      for (int k = 0; k < 3; ++k)
        p[k] = lo[k] + random.below(static_cast<std::uint32_t>(hi[k] - lo[k] + 1));
      if (std::any_of(posed.faces.begin(), posed.faces.end(), [&](const LatticeTriangle& face) {
            return triangles_overlap(face, {p, p, p});
          }))
        continue;
      const bool is_inside = test::winding_number(posed.faces, p) != 0;
      ++(is_inside ? inside : outside);
      QueryStats stats;
      ASSERT_EQ(locate(solid.full.tree.view(), frame, p, stats).side,
                is_inside ? Side::kInside : Side::kOutside)
          << round << ": " << p[0] << " " << p[1] << " " << p[2];
    }
  }
  EXPECT_GT(inside, 300U);
  EXPECT_GT(outside, 300U);
}

TEST(Containment, SeedsOnEveryLineOfTheOtherCube) {
  // Rays from the small cube's corners run through corners and along edges of the large one's
  // squares.
  const Solid small(make_cube(2, 2)), large(make_cube(8, 8));
  for (const auto& turn : quarter_turns())
    for (const double x : {-4.0, 0.0, 5.0})
      expect_contained(answer_at(small, large, {.rotation = turn, .translation_m = {x, -5, 2}}),
                       Containment::kAInB);
  expect_free(answer_at(small, large, moved(12, 2, 4)));
}

TEST(Containment, TakesFewSplitsFarInsideHoweverTheGroundIsTurned) {
  const Solid land(test::make_closed_terrain(64, 7, -3000)), aircraft(generate_aircraft(1000, 7));
  for (const std::array<double, 9>& turn :
       {kNoTurn, {0.8, -0.6, 0, 0.6, 0.8, 0, 0, 0, 1}, {0.8, 0, 0.6, 0, 1, 0, -0.6, 0, 0.8}}) {
    Pose pose_b;
    pose_b.translation_m = test::place({.rotation = turn}, {100, 50, -2400});
    const PosedPair posed = pose_at(land, {.rotation = turn}, aircraft, pose_b);
    LocalModel a(land.model.store, land.model.header.grid),
        b(aircraft.model.store, aircraft.model.header.grid);
    const Result<Answer> answer =
        certify(a, posed.a, test::no_require, b, posed.b, test::no_require, kBothSolid);
    ASSERT_TRUE(answer.is_ok());
    expect_contained(answer.value(), Containment::kBInA);
    EXPECT_LT(a.mesh.split_count(), 40U) << "of " << land.model.header.split_count();
    EXPECT_EQ(b.mesh.split_count(), 0U);
  }
}

TEST(Containment, OneRequestAlongTheRaysSettlesIt) {
  const Solid ball(generate_sphere(128, 0)), grain(make_cube(0.0625, 1));
  for (const std::array<double, 9>& turn :
       {kNoTurn, {0.36, 0.48, -0.8, -0.8, 0.6, 0, 0.48, 0.64, 0.6}}) {
    const PosedPair posed = pose_at(ball, {.rotation = turn}, grain, moved(0.1, 0.07, 0.04));
    LocalModel a(ball.model.store, ball.model.header.grid),
        b(grain.model.store, grain.model.header.grid);
    ASSERT_TRUE(certify(a, posed.a, test::no_require, b, posed.b, test::no_require, {}).is_ok());
    const std::uint32_t apart = a.mesh.split_count();
    Answer answer = query(a.view(), posed.a, b.view(), posed.b, {.solid_a = true});
    EXPECT_EQ(answer.status, AnswerStatus::kUncertain);
    int requests = 0;
    for (; !is_certified(answer.status) && requests < 99; ++requests) {
      ASSERT_FALSE(answer.rays_a.empty());
      EXPECT_TRUE(answer.rays_b.empty());
      const RegionRequest request{.attach = answer.missing_a,
                                  .region = {answer.rays_a.begin(), answer.rays_a.end()},
                                  .max_splits = 4096};
      const Result<Demand> demand =
          collect(ball.model.store, request, nullptr, AttachRule::kAlways);
      ASSERT_TRUE(demand.is_ok());
      RefineDelta delta;
      for (const TreeletSplit& split : demand.value().treelet)
        ASSERT_TRUE(a.mesh.split(split.split, delta));
      a.tree.update(delta);
      answer = query(a.view(), posed.a, b.view(), posed.b, {.solid_a = true});
    }
    expect_contained(answer, Containment::kBInA);
    EXPECT_TRUE(answer.rays_a.empty());
    EXPECT_LE(requests, 2);
    EXPECT_LT(a.mesh.split_count() - apart, 60U) << "of " << ball.model.header.split_count();
  }
}

TEST(Digest, CoversContainment) {
  Answer one, other;
  one.status = other.status = AnswerStatus::kContained;
  one.contained = Containment::kAInB;
  other.contained = Containment::kBInA;
  EXPECT_NE(digest(one), digest(other));
}

}  // namespace
}  // namespace nearmesh
