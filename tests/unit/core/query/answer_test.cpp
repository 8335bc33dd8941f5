// SPDX-License-Identifier: Apache-2.0
// One answer says what its parts say when they are asked one by one.
#include "core/query/answer.hpp"

#include "brute_force.hpp"
#include "random_policies.hpp"
#include "solids.hpp"
#include "test_models.hpp"

namespace nearmesh {
namespace {

constexpr double kSweep_s = 0.5;

void expect_same(const SweptAnswer& found, const SweptAnswer& expected) {
  EXPECT_EQ(found.status, expected.status);
  EXPECT_EQ(found.free_until_s, expected.free_until_s);
  EXPECT_EQ(found.hit_s, expected.hit_s);
  EXPECT_EQ(found.missing_a, expected.missing_a);
  EXPECT_EQ(found.missing_b, expected.missing_b);
  EXPECT_EQ(found.exhausted, expected.exhausted);
}

/// Gives the statuses of the answer and of the swept one.
std::pair<AnswerStatus, AnswerStatus> check(const AskedBody& a, const AskedBody& b) {
  const Result<PosedPair> posed =
      pose_pair(*a.view.grid, a.motion.pose, "a", *b.view.grid, b.motion.pose, "b");
  EXPECT_TRUE(posed.is_ok());
  const auto& [frame_a, frame_b] = posed.value();
  const Answer expected =
      query(a.view, frame_a, b.view, frame_b, {.solid_a = a.solid, .solid_b = b.solid});
  const Result<Answered> result = answer(a, b, {.contacts = true, .sweep_s = kSweep_s});
  EXPECT_TRUE(result.is_ok());
  const Answered& found = result.value();
  EXPECT_EQ(digest(found.answer), digest(expected));
  EXPECT_EQ(found.contacts.has_value(), !expected.pairs.empty());
  if (found.contacts) {
    const Contacts contacts = find_contacts(a.view, frame_a, b.view, frame_b, expected);
    EXPECT_EQ(found.contacts->segments.size(), contacts.segments.size());
    EXPECT_EQ(found.contacts->patches.size(), contacts.patches.size());
  }
  const bool is_apart = is_certified(expected.status) && expected.pairs.empty();
  EXPECT_EQ(
      found.safe_horizon_s,
      is_apart ? safe_horizon_s(a.view, a.motion, b.view, b.motion, expected.clearance_m) : 0);
  const Result<SweptAnswer> swept =
      sweep(a.view, a.motion, "a", b.view, b.motion, "b", {.duration_s = kSweep_s});
  EXPECT_TRUE(found.swept && found.swept->is_ok() && swept.is_ok());
  expect_same(found.swept->value(), swept.value());
  if (!expected.pairs.empty()) {  // known to touch now: nothing is tested again
    EXPECT_EQ(found.swept->value().stats.triangle_tests, 0U);
  }
  return {expected.status, swept.value().status};
}

/// A square of side 1 m at a height, about the model's origin; cells of 2^-30 m.
TriangleTree plate_at(std::int32_t height_cells) {
  const std::int32_t middle = 1 << 30, half = 1 << 29;
  const auto corner = [&](int x, int y) {
    return GridPoint{{middle + x * half, middle + y * half, middle + height_cells}};
  };
  return build_triangle_tree({.origin_m = {-1, -1, -1}, .exponent = -30, .bits = 31},
                             {{{corner(-1, -1), corner(1, -1), corner(1, 1)}, {{}, 0}},
                              {{corner(-1, -1), corner(1, 1), corner(-1, 1)}, {{}, 1}}});
}

// Above a plate that turns slowly there is one, nearer than where a turn of 10^6 radians is known
// to.
TEST(Answer, TheSweepCountsWhatAPosesAgeRounds) {
  const TriangleTree below = plate_at(0), above = plate_at(20);
  const auto ahead = [&](double age_s) {
    return answer({.view = below.view(),
                   .motion = {.angular_velocity_radps = {0, 0, 1e-3}},
                   .name = "below",
                   .age_s = age_s},
                  {.view = above.view(), .name = "above"}, {.sweep_s = 1e-3})
        .value()
        .swept->value()
        .status;
  };
  EXPECT_EQ(ahead(1e-3), AnswerStatus::kFree);
  EXPECT_EQ(ahead(1e9), AnswerStatus::kUncertain);
}

TEST(Answer, IsWhatItsPartsAreWhenAskedAlone) {
  const BakedModel model_a = test::bake_named("sphere"), model_b = test::bake_named("aircraft");
  Random random(7);
  std::set<std::pair<AnswerStatus, AnswerStatus>> seen;
  for (int i = 0; i < 200; ++i) {
    SCOPED_TRACE(i);
    LocalModel a(model_a.store, model_a.header.grid), b(model_b.store, model_b.header.grid);
    if (i % 3 > 0) test::refine_at_random(a, random);
    if (i % 3 > 1) test::refine_at_random(b, random);
    if (i % 20 == 0)
      for (LocalModel* model : {&a, &b}) test::split_all(*model);
    const test::PairOfPoses poses = test::near_poses(random, model_a, test::radius_m(model_a),
                                                     model_b, test::radius_m(model_b));
    AskedBody body_a{
        a.view(), {.pose = poses.a}, "a", model_a.header.surface.is_closed() && i % 2 > 0};
    AskedBody body_b{b.view(), {.pose = poses.b}, "b"};
    if (i % 5 > 0) body_b.motion.linear_velocity_mps = {random.between(-1, 1), 0.3, 0};
    seen.insert(check(body_a, body_b));
    if (HasFatalFailure()) return;
  }
  EXPECT_GT(seen.size(), 4U);
}

TEST(Answer, RefusesASolidWithAnOpenSurface) {
  const BakedModel model = test::bake_named("terrain");
  ASSERT_FALSE(model.header.surface.is_closed());
  const LocalModel local(model.store, model.header.grid);
  const Result<Answered> refused =
      answer({local.view(), {}, "ground", true}, {local.view(), {}, "other"});
  ASSERT_FALSE(refused.is_ok());
  EXPECT_EQ(refused.status().code(), StatusCode::kInvalidArgument);
  EXPECT_NE(refused.status().message().find("ground"), std::string::npos);
}

TEST(Answer, SaysNothingThatWasNotAskedFor) {
  const BakedModel model = test::bake_named("sphere");
  const LocalModel local(model.store, model.header.grid);
  const Result<Answered> plain = answer({local.view(), {}, "a"}, {local.view(), {}, "b"});
  ASSERT_TRUE(plain.is_ok());
  EXPECT_FALSE(plain.value().contacts.has_value());
  EXPECT_FALSE(plain.value().swept.has_value());
}

// All of it, or nothing: whenever the time is over, in whichever part.
TEST(Answer, IsWholeOrCutShort) {
  const BakedModel model = test::bake_named("sphere");
  const test::FullModel a(model), b(model);
  std::set<AnswerStatus> seen;
  int cut_short = 0;
  for (const double way_m : {0.7, 1.97, 2.0001}) {
    SCOPED_TRACE(way_m);
    Motion motion;
    motion.pose.translation_m = {way_m, 0.01, 0.02};
    motion.linear_velocity_mps = {-1, 0, 0};
    const AskedBody one{a.tree.view(), {}, "a"}, two{b.tree.view(), motion, "b"};
    AnswerOptions options{.contacts = true, .depth = true, .sweep_s = 1};
    const Answered all = answer(one, two, options).value();
    seen.insert(all.answer.status);
    EXPECT_FALSE(all.is_cut_short);
    for (int last = 0;; ++last) {
      int looks = 0;
      const IsOver is_over = [&] { return looks++ >= last; };
      options.is_over = &is_over;
      const Answered some = answer(one, two, options).value();
      if (some.is_cut_short) {
        ++cut_short;
        EXPECT_GT(looks, last);
        continue;
      }
      EXPECT_EQ(digest(some.answer), digest(all.answer));
      EXPECT_EQ(some.contacts.has_value(), all.contacts.has_value());
      if (all.contacts) {
        EXPECT_EQ(some.contacts->segments.size(), all.contacts->segments.size());
        EXPECT_EQ(some.contacts->patches.size(), all.contacts->patches.size());
      }
      EXPECT_EQ(some.depth.has_value(), all.depth.has_value());
      if (all.depth) {
        EXPECT_EQ(some.depth->at_least_m, all.depth->at_least_m);
        EXPECT_EQ(some.depth->separation_m, all.depth->separation_m);
      }
      expect_same(some.swept->value(), all.swept->value());
      if (looks <= last) break;
    }
  }
  EXPECT_EQ(seen, (std::set{AnswerStatus::kFree, AnswerStatus::kContact}));
  EXPECT_GT(cut_short, 20);
}

}  // namespace
}  // namespace nearmesh
