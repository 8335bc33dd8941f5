// SPDX-License-Identifier: Apache-2.0
// What was free and has moved little is answered without the trees: as they would answer, and with
// bounds that hold.
#include <gtest/gtest.h>

#include "core/geometry/motion_bounds.hpp"
#include "core/query/answer.hpp"
#include "rounds.hpp"
#include "test_models.hpp"

namespace nearmesh {
namespace {

/// Turned by some radians about some axis.
std::array<double, 9> turned_about(Random& random, const std::array<double, 9>& rotation,
                                   double rad) {
  Motion motion{.pose = {rotation, {}}};
  for (double& w : motion.angular_velocity_radps) w = random.between(-1, 1);
  return pose_at(motion, rad).rotation;
}

/// A little farther, or turned, or both; `size` metres and, at a reach of `reach_m`, radians that
/// take as far.
Pose a_little_moved(Random& random, const Pose& pose, double size_m, double reach_m) {
  Pose out = pose;
  const std::uint32_t kind = random.below(3);
  if (kind != 0) out.rotation = turned_about(random, pose.rotation, size_m / reach_m);
  if (kind != 1)
    for (double& x : out.translation_m) x += random.between(-1, 1) * size_m;
  return out;
}

struct HeldPair {
  const BakedModel &model_a, &model_b;
  LocalModel a, b;
  TriangleTree all_a, all_b;

  HeldPair(const BakedModel& one, const BakedModel& two)
      : model_a(one),
        model_b(two),
        a(one.store, one.header.grid),
        b(two.store, two.header.grid),
        all_a(build_full_tree(one.header, one.store).value()),
        all_b(build_full_tree(two.header, two.store).value()) {}

  [[nodiscard]] PosedPair posed(const Pose& pose_a, const Pose& pose_b) const {
    return pose_pair(a.grid, pose_a, "a", b.grid, pose_b, "b").value();
  }
  [[nodiscard]] Answer ask(const Pose& pose_a, const Pose& pose_b, Clearance clearance) const {
    const PosedPair at = posed(pose_a, pose_b);
    return query(a.view(), at.a, b.view(), at.b, {.clearance = clearance});
  }
  /// Of the full meshes, to the end.
  [[nodiscard]] Answer truth(const Pose& pose_a, const Pose& pose_b) const {
    const PosedPair at = posed(pose_a, pose_b);
    return query(all_a.view(), at.a, all_b.view(), at.b, {.clearance = Clearance::kExact});
  }
};

KeptFree kept_of(const Answer& base, const Pose& then_a, const Pose& then_b) {
  return {base.clearance_m,
          base.clearance_share,
          base.clearance_by_larger_m,
          base.distance_at_most_m,
          base.nearest_a_m,
          base.nearest_b_m,
          then_a,
          then_b};
}

struct StillCounts {
  int kept = 0, near_limit = 0, by_larger = 0, left = 0;
};

/// Base poses, then motions of all sizes, up to the largest that is still accepted.
void check_still(HeldPair& pair, Random& random, const AnswerOptions& options,
                 StillCounts& counts) {
  const test::PairOfPoses poses =
      test::near_poses(random, pair.model_a, test::radius_m(pair.model_a), pair.model_b,
                       test::radius_m(pair.model_b));
  Pose then_a = poses.a, then_b = poses.b;
  for (double& x : then_b.translation_m) x *= random.between(1, 1.5);
  const Answer base = pair.ask(then_a, then_b, Clearance::kBound);
  if (base.status != AnswerStatus::kFree || !(base.clearance_m > 0)) return;
  const KeptFree kept = kept_of(base, then_a, then_b);
  const int lattice = lattice_exponent(pair.a.grid, pair.b.grid);
  double size_m = 2 * base.clearance_m;
  for (int i = 0; i < 12; ++i, size_m *= random.between(0.4, 0.9)) {
    const std::array<double, 3> common{random.between(-9, 9), random.between(-9, 9), 0};
    Motion now_a{.pose = a_little_moved(random, then_a, size_m, test::radius_m(pair.model_a))},
        now_b{.pose = a_little_moved(random, then_b, size_m, test::radius_m(pair.model_b))};
    if (random.below(2) == 0)
      for (std::size_t k = 0; k < 3; ++k) {
        now_a.pose.translation_m[k] += common[k];
        now_b.pose.translation_m[k] += common[k];
      }
    const BodyReach reach_a = reach_of(pair.a.view(), now_a),
                    reach_b = reach_of(pair.b.view(), now_b);
    const ClearanceLeft left = clearance_left(
        {reach_a, then_a, now_a.pose}, {reach_b, then_b, now_b.pose}, lattice, base.clearance_m);
    const Answer truth = pair.truth(now_a.pose, now_b.pose);
    ASSERT_LE(left.clearance_m, truth.distance_at_most_m);
    counts.left += left.clearance_m > 0 ? 1 : 0;
    const AskedBody a{pair.a.view(), now_a, "a"}, b{pair.b.view(), now_b, "b"};
    const std::optional<Answered> still = still_free(a, b, kept, left, options);
    if (!still) continue;
    ++counts.kept;
    counts.near_limit += 4 * left.boxes_moved_m > 0.5 * base.clearance_m ? 1 : 0;
    counts.by_larger += 4 * left.boxes_moved_m > base.clearance_m ? 1 : 0;
    const Answer asked = pair.ask(now_a.pose, now_b.pose, Clearance::kExact);
    ASSERT_EQ(asked.status, AnswerStatus::kFree);
    ASSERT_EQ(digest(still->answer), digest(asked));
    // What verify proves of a recorded bound, and what the bracket is of.
    ASSERT_LE(still->answer.clearance_m, asked.clearance_m);
    ASSERT_GE(still->answer.clearance_m,
              std::min(0.75 * base.clearance_m, 0.5 * base.clearance_by_larger_m));
    ASSERT_GE(still->answer.distance_at_most_m, truth.clearance_m);
    ASSERT_GE(still->answer.clearance_m, still->answer.clearance_share * asked.clearance_m);
  }
}

/// `use(pair, i)` of pairs of models of which neither, one or both hold some detail, `count` of
/// each two models, until one has failed.
template <class Use>
void for_each_held_pair(Random& random, int count, const Use& use) {
  const BakedModel terrain = test::bake_named("terrain"), aircraft = test::bake_named("aircraft"),
                   sphere = test::bake_named("sphere"), soup = test::bake_named("soup");
  for (const auto& [one, two] : {std::pair(&terrain, &aircraft), std::pair(&aircraft, &aircraft),
                                 std::pair(&sphere, &soup), std::pair(&soup, &terrain)}) {
    for (int i = 0; i < count && !testing::Test::HasFatalFailure(); ++i) {
      HeldPair pair(*one, *two);
      if (i % 3 > 0) test::refine_at_random(pair.a, random);
      if (i % 3 > 1) test::refine_at_random(pair.b, random);
      use(pair, i);
    }
  }
}

TEST(StillFree, SaysWhatTheTreesSayAndBoundsThatHold) {
  Random random(3);
  StillCounts counts;
  for_each_held_pair(random, test::rounds(60),
                     [&](HeldPair& pair, int) { check_still(pair, random, {}, counts); });
  EXPECT_GT(counts.kept, test::rounds(200));
  EXPECT_GT(counts.near_limit, test::rounds(20));
  EXPECT_GT(counts.by_larger, test::rounds(20));
  EXPECT_GT(counts.left, counts.kept);
}

// Between exact faces it is all the same whose axis shows the gap; boxes of unresolved nodes are
// parted along axes that turn with a body.
TEST(StillFree, OnlyWhereNodesAreUnresolvedTheLargerBodyTellsLess) {
  const BakedModel terrain = test::bake_named("terrain"), aircraft = test::bake_named("aircraft");
  const HeldPair pair(terrain, aircraft);
  Random random(4);
  int all = 0, less = 0;
  for (int i = 0; i < test::rounds(300); ++i) {
    const test::PairOfPoses poses = test::near_poses(random, terrain, test::radius_m(terrain),
                                                     aircraft, test::radius_m(aircraft));
    const PosedPair at = pair.posed(poses.a, poses.b);
    const Answer full = query(pair.all_a.view(), at.a, pair.all_b.view(), at.b,
                              {.clearance = Clearance::kBound}),
                 held = pair.ask(poses.a, poses.b, Clearance::kBound);
    if (full.status != AnswerStatus::kFree || held.status != AnswerStatus::kFree) continue;
    ++all;
    ASSERT_EQ(full.clearance_by_larger_m, full.clearance_m);
    ASSERT_LE(held.clearance_by_larger_m, held.clearance_m);
    less += held.clearance_by_larger_m < held.clearance_m ? 1 : 0;
  }
  EXPECT_GT(all, test::rounds(10));
  EXPECT_GT(less, all / 4);
}

// The walk is spared where the search for the clearance shows that it would find nothing.
TEST(WasFree, ChangesNothingOfAnAnswer) {
  Random random(7);
  int spared = 0, near = 0, found = 0;
  for_each_held_pair(random, test::rounds(200), [&](HeldPair& pair, int i) {
    const double radius_m = test::radius_m(pair.model_a);
    test::PairOfPoses poses = test::near_poses(random, pair.model_a, radius_m, pair.model_b,
                                               test::radius_m(pair.model_b));
    if (i % 2 == 0)
      for (double& x : poses.b.translation_m) x *= random.between(1, 1.5);
    const PosedPair at = pair.posed(poses.a, poses.b);
    QueryOptions options{.clearance = i % 5 == 0 ? Clearance::kExact : Clearance::kBound};
    const Answer before = query(pair.a.view(), at.a, pair.b.view(), at.b, options);
    options.was_free = true;
    const Answer after = query(pair.a.view(), at.a, pair.b.view(), at.b, options);
    ASSERT_EQ(digest(after), digest(before));
    ASSERT_EQ(after.pairs, before.pairs);
    ASSERT_EQ(after.clearance_m, before.clearance_m);
    ASSERT_EQ(after.clearance_share, before.clearance_share);
    ASSERT_EQ(after.clearance_by_larger_m, before.clearance_by_larger_m);
    ASSERT_EQ(after.distance_at_most_m, before.distance_at_most_m);
    ASSERT_EQ(after.nearest_a_m, before.nearest_a_m);
    ASSERT_EQ(after.nearest_b_m, before.nearest_b_m);
    const bool is_spared = tests_of(after.stats) < tests_of(before.stats);
    spared += is_spared ? 1 : 0;
    near += is_spared && before.clearance_m < 0.05 * radius_m ? 1 : 0;
    found += is_certified(before.status) && before.pair_total == 0 ? 0 : 1;
  });
  EXPECT_GT(spared, test::rounds(150));
  EXPECT_GT(near, test::rounds(10));
  EXPECT_GT(found, test::rounds(100));
}

// What other movers say is a rotation but for 1e-5: here all is larger by half of that.
TEST(StillFree, BracketsTheDistanceWhereAPoseStretches) {
  const BakedModel sphere = test::bake_named("sphere");
  const HeldPair pair(sphere, sphere);
  Pose then_a, then_b{.translation_m = {5, 0, 0}};
  for (const std::size_t i : {0U, 4U, 8U}) then_a.rotation[i] = then_b.rotation[i] = 1 + 4.9e-6;
  const Answer base = pair.truth(then_a, then_b);
  ASSERT_EQ(base.status, AnswerStatus::kFree);
  const KeptFree kept = kept_of(base, then_a, then_b);
  const Motion now_a{.pose = then_a}, now_b{.pose = {then_b.rotation, {5.001, 0, 0}}};
  const BodyReach reach_a = reach_of(pair.all_a.view(), now_a),
                  reach_b = reach_of(pair.all_b.view(), now_b);
  const ClearanceLeft left =
      clearance_left({reach_a, then_a, now_a.pose}, {reach_b, then_b, now_b.pose},
                     lattice_exponent(pair.a.grid, pair.b.grid), base.clearance_m);
  const auto still =
      still_free({pair.all_a.view(), now_a, "a"}, {pair.all_b.view(), now_b, "b"}, kept, left, {});
  ASSERT_TRUE(still);
  // The balls of radius 1 have corners that face each other.
  EXPECT_GE(still->answer.distance_at_most_m, 5.001 - 2 * (1 + 4.9e-6) - 1e-6);
}

TEST(StillFree, AsksWhereMoreIsWanted) {
  const BakedModel sphere = test::bake_named("sphere");
  HeldPair pair(sphere, sphere);
  const Pose then_a, then_b{.translation_m = {5, 0, 0}};
  const Answer base = pair.ask(then_a, then_b, Clearance::kBound);
  ASSERT_EQ(base.status, AnswerStatus::kFree);
  const KeptFree kept = kept_of(base, then_a, then_b);
  const Motion now_a,
      now_b{.pose = {.translation_m = {5.1, 0, 0}}, .linear_velocity_mps = {-9, 0, 0}};
  const BodyReach reach_a = reach_of(pair.a.view(), now_a),
                  reach_b = reach_of(pair.b.view(), now_b);
  const ClearanceLeft left =
      clearance_left({reach_a, then_a, now_a.pose}, {reach_b, then_b, now_b.pose},
                     lattice_exponent(pair.a.grid, pair.b.grid), base.clearance_m);
  const AskedBody a{pair.a.view(), now_a, "a"}, b{pair.b.view(), now_b, "b"};
  EXPECT_TRUE(still_free(a, b, kept, left, {}));
  EXPECT_FALSE(still_free(a, b, kept, left, {.clearance = Clearance::kExact}));
  EXPECT_FALSE(still_free(a, b, kept, left, {.clearance = Clearance::kNone}));
  EXPECT_FALSE(still_free(a, b, kept, left, {.max_tests = 1000}));
  const auto swept = still_free(a, b, kept, left, {.sweep_s = 0.01});
  ASSERT_TRUE(swept && swept->swept && swept->swept->is_ok());
  EXPECT_EQ(swept->swept->value().free_until_s, 0.01);
  EXPECT_FALSE(still_free(a, b, kept, left, {.sweep_s = 1}));  // it may come as far in that time
}

}  // namespace
}  // namespace nearmesh
