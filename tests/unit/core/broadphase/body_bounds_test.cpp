// SPDX-License-Identifier: Apache-2.0
#include "core/broadphase/body_bounds.hpp"
#include "core/broadphase/free_pairs.hpp"

#include "test_models.hpp"

namespace nearmesh {
namespace {

struct Body {
  const BakedModel* model;
  ModelBounds bounds;
  Motion motion;
};

/// The corners of the boxes that the header gives its roots: no face reaches farther.
std::vector<GridPoint> corners_of_roots(const SplitStore& store) {
  std::vector<GridPoint> corners;
  for (const BaseRoot& root : store.roots()) {
    const GridBox box = store.box(root.node);
    for (int corner = 0; corner < 8; ++corner) {
      GridPoint& at = corners.emplace_back();
      for (int k = 0; k < 3; ++k) at[k] = (corner >> k & 1) != 0 ? box.hi[k] : box.lo[k];
    }
  }
  return corners;
}

// What may be a vertex, as it is posed on the lattice that the body has with another, metres.
void expect_holds(const WorldBox& box, const BakedModel& model, const Pose& pose, int lattice,
                  double least_room_m) {
  const Result<PosedFrame> frame = make_posed_frame(model.header.grid, pose, lattice);
  ASSERT_TRUE(frame.is_ok()) << frame.status().message();
  for (const GridPoint& point : corners_of_roots(model.store)) {
    const LatticePoint at = pose_point(frame.value(), point);
    for (std::size_t k = 0; k < 3; ++k) {
      const double x = std::ldexp(static_cast<double>(at.v[k]), lattice);
      ASSERT_GE(x - box.lo_m[k], least_room_m);
      ASSERT_GE(box.hi_m[k] - x, least_room_m);
    }
  }
}

Motion random_motion(Random& random) {
  Motion motion;
  motion.pose.rotation = test::random_rotation(random);
  const double far_m = std::ldexp(1.0, static_cast<int>(random.below(24)));
  for (std::size_t k = 0; k < 3; ++k) {
    motion.pose.translation_m[k] = random.between(-far_m, far_m);
    motion.linear_velocity_mps[k] = random.between(-30, 30);
    motion.angular_velocity_radps[k] = random.between(-2, 2);
  }
  return motion;
}

// Squares and sums of such sizes are beyond doubles. What a bound of it that is no number meets is
// nothing.
TEST(ModelBoundsOf, ModelsBeyondAllSizesMeetThemselvesAndWhatIsInThem) {
  constexpr std::int32_t kLast = (1 << 21) - 1;
  const GridBox whole{{{0, 0, 0}}, {{kLast, kLast, kLast}}};
  const ModelBounds small({.exponent = -20}, whole);
  std::vector<std::pair<Grid, bool>> grids;  // and whether the small one is in it
  for (const int exponent : {480, 491, kMaxGridExponent}) {
    const double half_m = std::ldexp(1.0, exponent + 20);
    grids.push_back({{.origin_m = {-half_m, -half_m, -half_m}, .exponent = exponent}, true});
  }
  for (const double far_m : {1e150, 1e160, 1.7e308})
    grids.push_back({{.origin_m = {far_m, -far_m, far_m}, .exponent = -20}, false});
  for (const auto& [grid, has_small] : grids) {
    SCOPED_TRACE(grid.origin_m[0]);
    const ModelBounds large(grid, whole);
    for (const double speed : {0.0, 1e9}) {
      const Motion motion{.pose = {},
                          .linear_velocity_mps = {speed, 0, 0},
                          .angular_velocity_radps = {0, speed, 0}};
      const WorldBox there = large.around({}, 2, 0);
      EXPECT_TRUE(large.around(motion, 2, 0).meets(there));
      EXPECT_TRUE(large.around_ball({}, speed, 0).meets(there));
      EXPECT_TRUE(!has_small || small.around(motion, 2, 0).meets(there));
      EXPECT_FALSE(std::isnan(large.way_m(motion, 2)));
      EXPECT_EQ(large.way_m(motion, 0), 0);
    }
  }
}

TEST(ModelBoundsOf, HoldAllPosedVerticesAtEachInstantOnTheLatticeOfAnyPair) {
  const BakedModel small = test::bake_mesh(generate_sphere(6, 0), 16);
  BakedModel large = test::bake_mesh(generate_terrain(12, 3), 16);
  BakedModel tile = test::bake_mesh(generate_terrain(12, 3), 16);
  tile.header.grid.lattice_cells = {-0x7000'1235, 0x123'4567, 1};
  Random random(5);
  for (int round = 0; round < 300; ++round) {
    const bool swap = random.below(2) == 0;
    if (round == 200) std::swap(large.header.grid, tile.header.grid);
    const BakedModel &model = swap ? small : large, &other = swap ? large : small;
    const ModelBounds bounds(model.header.grid, model.store);
    const Motion motion = random_motion(random);
    const double duration_s = random.between(0, 2), margin_m = random.between(0, 1);
    const WorldBox box = bounds.around(motion, duration_s, margin_m);
    const int lattice = lattice_exponent(model.header.grid, other.header.grid);
    // Two bodies share what the lattice takes: a body against a much larger one may take more than
    // its own half.
    const double lent_m = 1.8 * std::ldexp(1.0, lattice);
    expect_holds(box, model, motion.pose, lattice,
                 bounds.way_m(motion, duration_s) + margin_m - lent_m);
    for (int i = 0; i < 4; ++i)
      expect_holds(box, model, pose_at(motion, random.between(0, duration_s)), lattice,
                   margin_m - lent_m);
  }
}

// The rounding of both is covered by both: boxes that do not meet leave no way to meet for the
// posed vertices.
void expect_apart_where_boxes_part(const BakedModel& left, const BakedModel& right) {
  const ModelBounds a(left.header.grid, left.store), b(right.header.grid, right.store);
  const int lattice = lattice_exponent(left.header.grid, right.header.grid);
  Random random(6);
  for (int round = 0; round < 200; ++round) {
    Motion one = random_motion(random), two = random_motion(random);
    one.linear_velocity_mps = two.linear_velocity_mps = {};
    one.angular_velocity_radps = two.angular_velocity_radps = {};
    // Push the first along x until the boxes just part.
    const WorldBox still = b.around(two, 0, 0);
    one.pose.translation_m[0] += still.hi_m[0] - a.around(one, 0, 0).lo_m[0];
    double push_m = 0x1p-30;
    while (a.around(one, 0, 0).lo_m[0] <= still.hi_m[0]) {
      one.pose.translation_m[0] += push_m;
      push_m *= 2;
    }
    const auto frame_a = make_posed_frame(left.header.grid, one.pose, lattice);
    const auto frame_b = make_posed_frame(right.header.grid, two.pose, lattice);
    ASSERT_TRUE(frame_a.is_ok() && frame_b.is_ok());
    std::int64_t lowest = std::numeric_limits<std::int64_t>::max(), highest = -lowest;
    for (const GridPoint& point : corners_of_roots(left.store))
      lowest = std::min(lowest, pose_point(frame_a.value(), point).v[0]);
    for (const GridPoint& point : corners_of_roots(right.store))
      highest = std::max(highest, pose_point(frame_b.value(), point).v[0]);
    EXPECT_GT(lowest, highest);
  }
}

TEST(ModelBoundsOf, BoxesThatBarelyPartLeavePosedVerticesApart) {
  const BakedModel small = test::bake_mesh(generate_sphere(6, 0), 16);
  const BakedModel large = test::bake_mesh(generate_terrain(12, 3), 16);
  expect_apart_where_boxes_part(small, large);  // the rounding of rotations weighs most
  expect_apart_where_boxes_part(large, small);
  expect_apart_where_boxes_part(small, small);  // that of the lattice does
}

// Each body's box holds where it is for half a second before its pose's time and after it.
TEST(FreePairsOf, PosesOfAnotherTimeLeaveLessOfTheLookAhead) {
  const auto horizon_s = [](double way_m, double age_s) {
    FreePairs pairs;
    pairs.add(way_m, age_s);
    pairs.add(0, 0);
    return pairs.horizon_s(0.5);
  };
  EXPECT_EQ(horizon_s(150, 0), 0.5);
  EXPECT_EQ(horizon_s(150, 0.125), 0.375);
  EXPECT_EQ(horizon_s(150, 2), 0);
  EXPECT_EQ(horizon_s(150, -0.25), 0.5);
  EXPECT_EQ(horizon_s(150, -1.5), 0) << "a second before its pose's time it is outside of its box";
  EXPECT_EQ(horizon_s(0, -1.5), 0.5) << "it rests";
}

TEST(RoamSeconds, AreFourToEightAndSpreadOverTheBodies) {
  std::array<int, 4> by_second{};
  for (std::uint64_t number = 0; number < 1000; ++number) {
    const double s = roam_s(number);
    ASSERT_GE(s, 4);
    ASSERT_LT(s, 8);
    ++by_second[static_cast<std::size_t>(s) - 4];
  }
  for (const int bodies : by_second) EXPECT_NEAR(bodies, 250, 60);
}

TEST(RoamAlong, HoldsTheBoxOnAllItsWayAndAside) {
  const WorldBox box{{-1, 2, 5}, {0, 4, 9}};
  const std::array<double, 3> way_m{30, -20, 0};
  const WorldBox roam = roam_along(box, way_m, 2);
  EXPECT_EQ(roam, (WorldBox{{-3, -20, 3}, {32, 6, 11}}));
  for (const double share : {0.0, 0.5, 1.0}) {
    WorldBox later = box;
    for (std::size_t k = 0; k < 3; ++k) {
      later.lo_m[k] += share * way_m[k] - 2;
      later.hi_m[k] += share * way_m[k] + 2;
    }
    EXPECT_TRUE(roam.holds(later)) << share;
  }
}

}  // namespace
}  // namespace nearmesh
