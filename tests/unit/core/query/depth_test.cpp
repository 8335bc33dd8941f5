// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/core/query/depth.hpp"

#include <bit>

#include "brute_force.hpp"
#include "contact_errors.hpp"
#include "model_pairs.hpp"
#include "rounds.hpp"

namespace nearmesh {
namespace {

using test::Point;

/// What a depth claims, against both full meshes.
class DepthClaims {
 public:
  DepthClaims(const BakedModel& a, const BakedModel& b, const Pose& pose_a, const Pose& pose_b)
      : a_(a), b_(b), pose_a_(pose_a), pose_b_(pose_b), posed_(pose_both(pose_b)) {}

  void check(const Depth& depth, Random& random) const {
    EXPECT_NEAR(test::norm3(depth.direction), 1, 1e-12);
    EXPECT_LE(depth.at_least_m, depth.at_most_m);
    const double cell_m = std::ldexp(1.0, posed_.a.lattice_exp);
    if (depth.at_most_m < std::numeric_limits<double>::infinity()) {
      Pose out = pose_b_;
      for (std::size_t k = 0; k < 3; ++k) {
        out.translation_m[k] += depth.separation_m[k];
        EXPECT_NEAR(depth.separation_m[k], depth.direction[k] * depth.at_most_m, cell_m);
      }
      EXPECT_EQ(pairs_at(pose_both(out)), 0U);
    }
    // Touches all the way until the bound below.
    for (int i = 0; i < 6; ++i) {
      const double way_m = depth.at_least_m * (i < 5 ? random.between(0, 1) : 1);
      EXPECT_TRUE(touches_near(way_m, depth.direction)) << way_m << " of " << depth.at_least_m;
    }
  }
  [[nodiscard]] const PosedPair& posed() const { return posed_; }

 private:
  [[nodiscard]] PosedPair pose_both(const Pose& pose_b) const {
    return pose_pair(a_.header.grid, pose_a_, "a", b_.header.grid, pose_b, "b").value();
  }
  [[nodiscard]] std::uint64_t pairs_at(const PosedPair& posed) const {
    return query(full_a_.tree.view(), posed.a, full_b_.tree.view(), posed.b, {.any = true})
        .pair_total;
  }
  /// The posed mesh of B as it is, moved by whole cells next to the point of the way: the claim is
  /// about a path within a cell.
  [[nodiscard]] bool touches_near(double way_m, const Point& direction) const {
    for (int corner = 0; corner < 8; ++corner) {
      PosedPair moved = posed_;
      for (std::size_t k = 0; k < 3; ++k)
        moved.b.translation[k] += static_cast<std::int64_t>(
            std::floor(std::ldexp(way_m * direction[k], -posed_.b.lattice_exp)) +
            (corner >> k & 1));
      if (pairs_at(moved) > 0) return true;
    }
    return false;
  }

  const BakedModel &a_, &b_;
  const test::FullModel full_a_{a_}, full_b_{b_};
  const Pose pose_a_, pose_b_;
  const PosedPair posed_;
};

/// A peer's view of two bodies.
struct Asked {
  LocalModel a, b;
  Answer answer;
  Contacts contacts;
};

class DepthOfPair : public test::ModelPair {};
INSTANTIATE_TEST_SUITE_P(Models, DepthOfPair, test::model_pairs(), test::name_of_pair);

TEST_P(DepthOfPair, BothBoundsHoldForTheFullMeshesInAnyState) {
  int bounded = 0, proved = 0;
  for (int seed = 0; seed < test::rounds(120) && bounded < test::rounds(20); ++seed) {
    SCOPED_TRACE(seed);
    State state(*this, static_cast<std::uint64_t>(seed));
    const test::PairOfPoses poses =
        test::near_poses(state.random, a_, test::radius_m(a_), b_, test::radius_m(b_));
    const DepthClaims claims(a_, b_, poses.a, poses.b);
    if (seed % 2 == 0) {
      const auto certified = certify(state.a, claims.posed().a, test::no_require, state.b,
                                     claims.posed().b, test::no_require, {});
      ASSERT_TRUE(certified.is_ok()) << certified.status().message();
    }
    const TreeView a = state.a.view(), b = state.b.view();
    const Answer answer = query(a, claims.posed().a, b, claims.posed().b);
    if (answer.pairs.empty()) continue;
    const Contacts contacts = find_contacts(a, claims.posed().a, b, claims.posed().b, answer);
    const Result<Depth> depth = find_depth(a, poses.a, "a", b, poses.b, "b", answer, contacts, {});
    ASSERT_TRUE(depth.is_ok()) << depth.status().message();
    claims.check(depth.value(), state.random);
    EXPECT_LT(depth.value().at_most_m, std::numeric_limits<double>::infinity());
    bounded += depth.value().at_most_m < std::numeric_limits<double>::infinity() ? 1 : 0;
    proved += depth.value().at_least_m > 0 ? 1 : 0;
  }
  EXPECT_GE(bounded, test::rounds(5));
  EXPECT_GE(2 * proved, bounded);
}

/// A scene of contact_errors.hpp with all its detail, asked.
class FullScene {
 public:
  explicit FullScene(test::ContactScene scene)
      : scene_(std::move(scene)), posed_(scene_.posed()), full_a_(scene_.a), full_b_(scene_.b) {
    answer_ = query(full_a_.tree.view(), posed_.a, full_b_.tree.view(), posed_.b);
    contacts_ =
        find_contacts(full_a_.tree.view(), posed_.a, full_b_.tree.view(), posed_.b, answer_);
  }
  [[nodiscard]] Result<Depth> depth(const DepthOptions& options) const {
    return find_depth(full_a_.tree.view(), scene_.pose_a, "a", full_b_.tree.view(), scene_.pose_b,
                      "b", answer_, contacts_, options);
  }
  [[nodiscard]] const test::ContactScene& scene() const { return scene_; }

 private:
  test::ContactScene scene_;
  PosedPair posed_;
  test::FullModel full_a_, full_b_;
  Answer answer_;
  Contacts contacts_;
};

// Of two small faces above a plate one touches it until step 36, the other from 32 to 56. At 9e8 m
// doubles are 64 steps apart: moved by 37 steps there, B is where step 64 would have it.
TEST(Depth, HoldsWhereDoublesAreCoarserThanTheLattice) {
  const Grid grid{.exponent = -27, .bits = 21};
  const std::int32_t plate = 1 << 20;
  const auto upright = [&](std::int32_t x, std::int32_t from, std::int32_t to) {
    return std::array<GridPoint, 3>{
        {{{x, x, plate + from}}, {{x + 9, x, plate + from}}, {{x, x, plate + to}}}};
  };
  const TriangleTree a = build_triangle_tree(
      grid, {{{{{{0, 0, plate}}, {{1 << 20, 0, plate}}, {{0, 1 << 20, plate}}}}, {{}, 0}}});
  const TriangleTree b =
      build_triangle_tree(grid, {{upright(100, -9, 1), {{}, 0}}, {upright(200, -14, -8), {{}, 1}}});
  for (const double far_m : {0.0, 9e8}) {
    const Pose pose{.translation_m = {0, 0, far_m}};
    const PosedPair posed = pose_pair(grid, pose, "a", grid, pose, "b").value();
    const Answer answer = query(a.view(), posed.a, b.view(), posed.b);
    const Depth depth = find_depth(a.view(), pose, "a", b.view(), pose, "b", answer, {},
                                   {.directions = {{0, 0, 1}}})
                            .value();
    EXPECT_LE(std::ldexp(depth.at_least_m, 29), 56) << far_m;
    EXPECT_EQ(std::ldexp(depth.at_most_m, 29), far_m > 0 ? 64 : 57);
  }
}

TEST(Depth, OfABallInAPlaneIsHowFarItHasSunk) {
  const FullScene full(test::sphere_in_plane());
  const Depth depth = full.depth({}).value();
  EXPECT_GT(depth.direction[2], 0.9999);
  EXPECT_NEAR(depth.at_most_m, 0.2, 0.004);  // the ball is a polyhedron
  EXPECT_LT(depth.at_most_m - depth.at_least_m, 1e-5);
  EXPECT_FALSE(depth.exhausted);
  const Depth again = full.depth({}).value();
  EXPECT_EQ(std::bit_cast<std::uint64_t>(depth.at_least_m),
            std::bit_cast<std::uint64_t>(again.at_least_m));
  EXPECT_EQ(depth.separation_m, again.separation_m);
}

TEST(Depth, IsThatOfTheDirectionAskedFor) {
  const FullScene full(test::sphere_in_plane());
  const Depth aslant = full.depth({.directions = {{1, 0, 1}}}).value();
  EXPECT_NEAR(aslant.at_most_m, 0.2 * std::sqrt(2), 0.006);
  EXPECT_LT(aslant.at_most_m - aslant.at_least_m, 1e-5);
  const Depth down = full.depth({.directions = {{0, 0, -3}}}).value();
  EXPECT_NEAR(down.at_most_m, 1.8, 0.004);
  const Depth best = full.depth({.directions = {{0, 0, -1}, {1, 0, 1}, {0, 0, 1}}}).value();
  EXPECT_EQ(best.direction, (Point{0, 0, 1}));
}

TEST(Depth, ASolidIsOutOnlyWhenNothingIsInside) {
  // A small ball through the wall of a large one: inwards its surface is soon clear, but it is
  // inside then.
  test::ContactScene scene = test::sphere_in_plane();
  scene.a = test::bake_mesh(generate_sphere(48, 0), 16);
  IndexedMesh small = generate_sphere(24, 0);
  for (auto& at : small.positions_m)
    for (double& x : at) x /= 8;
  scene.b = test::bake_mesh(small, 16);
  scene.pose_b = {.translation_m = {1, 0, 0}};
  const FullScene full(std::move(scene));
  const std::vector<Point> inward{{-1, 0, 0}};
  const Depth surfaces = full.depth({.directions = inward}).value();
  const Depth solids = full.depth({.directions = inward, .solid_a = true, .solid_b = true}).value();
  EXPECT_NEAR(surfaces.at_most_m, 0.125, 0.02);
  EXPECT_NEAR(solids.at_most_m, 2.125, 0.02);
  EXPECT_NEAR(solids.at_least_m, surfaces.at_least_m, 0.02);
}

TEST(Depth, AFewTestsLeaveAWiderBracketThatHolds) {
  const FullScene full(test::sphere_in_plane());
  const Depth depth = full.depth({.max_tests = 400}).value();
  EXPECT_TRUE(depth.exhausted);
  EXPECT_LE(depth.at_least_m, 0.2);
  EXPECT_GE(depth.at_most_m, 0.195);
}

TEST(Depth, ADirectionWithoutLengthIsRefused) {
  const FullScene full(test::sphere_in_plane());
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (const Point& direction : {Point{0, 0, 0}, Point{0, nan, 1}}) {
    const Result<Depth> depth = full.depth({.directions = {{0, 0, 1}, direction}});
    ASSERT_FALSE(depth.is_ok());
    EXPECT_EQ(depth.status().code(), StatusCode::kInvalidArgument);
    EXPECT_NE(depth.status().message().find("direction 1"), std::string::npos);
  }
}

}  // namespace
}  // namespace nearmesh
