// SPDX-License-Identifier: Apache-2.0
// Sweeps of random models, states and motions, held against the full meshes.
#include "brute_force.hpp"
#include "model_pairs.hpp"
#include "nearmesh/core/query/sweep.hpp"
#include "swept.hpp"

namespace nearmesh {
namespace {

using test::kNever;
using test::status_at;
using test::swept;
using Vec3 = std::array<double, 3>;

struct Motions {
  Motion a, b;
};

/// At some instant of the second to come (or before, or after), a vertex of b is near one of a;
/// both move and turn.
Motions random_motions(Random& random, const BakedModel& a, const BakedModel& b) {
  const double size = std::min(test::radius_m(a), test::radius_m(b));
  const auto vector = [&](double length) {
    Vec3 v;
    for (double& x : v) x = random.between(-1, 1) * length;
    return v;
  };
  Motions m;
  for (Motion* motion : {&m.a, &m.b}) {
    motion->pose.rotation = test::random_rotation(random);
    if (random.below(3) > 0)
      motion->linear_velocity_mps = vector(size * std::exp2(random.between(-6, 5)));
    if (random.below(3) > 0)
      motion->angular_velocity_radps = vector(std::exp2(random.between(-6, 4)));
  }
  const auto va = test::position_m(a.header, a.store, {random.below(a.header.vertex_count)});
  const auto vb = test::position_m(b.header, b.store, {random.below(b.header.vertex_count)});
  const Vec3 at = test::place(m.a.pose, va), turned = test::place(m.b.pose, vb);
  const Vec3 off = vector(size * std::exp2(random.between(-12, 1)));
  for (std::size_t k = 0; k < 3; ++k) m.b.pose.translation_m[k] = at[k] - turned[k] + off[k];
  const double then = random.between(-0.2, 1.2);
  m.a.pose = pose_at(m.a, -then);
  m.b.pose = pose_at(m.b, -then);
  return m;
}

class SweepPair : public test::ModelPair {};
INSTANTIATE_TEST_SUITE_P(Models, SweepPair, test::model_pairs(), test::name_of_pair);

constexpr SweepOptions kSecond{.duration_s = 1, .time_levels = 8, .max_tests = 100'000};

TEST_P(SweepPair, IsNeverContradictedByTheFullMeshes) {
  const test::FullModel full_a(a_), full_b(b_);
  std::array<int, 4> seen{};
  for (std::uint64_t seed = 0; seed < 40; ++seed) {
    SCOPED_TRACE(seed);
    State state(*this, seed);
    auto& [random, a, b] = state;
    const Motions m = random_motions(random, a_, b_);
    const bool whole = random.below(2) == 0;
    if (seed % 4 > 0) {
      // Half-spaces that look to where the other body will be.
      const double then = random.unit();
      const PosedPair posed = pose_pair(a_.header.grid, pose_at(m.a, then), "a", b_.header.grid,
                                        pose_at(m.b, then), "b")
                                  .value();
      for (int i = 0; i < 3; ++i) {
        tell_half_spaces(a, half_spaces_a_, random,
                         test::random_target(posed.a, posed.b, b_.store, random));
        tell_half_spaces(b, half_spaces_b_, random,
                         test::random_target(posed.b, posed.a, a_.store, random));
      }
    }
    const TreeView view_a = whole ? full_a.tree.view() : a.view(),
                   view_b = whole ? full_b.tree.view() : b.view();
    const SweptAnswer answer = swept(view_a, m.a, view_b, m.b, kSecond);
    ++seen[std::size_t(answer.status)];
    const auto full_at = [&](double t) {
      return status_at(full_a.tree.view(), m.a, full_b.tree.view(), m.b, t);
    };
    EXPECT_EQ(answer.status == AnswerStatus::kFree,
              answer.free_until_s == 1 && answer.hit_s == kNever);
    for (int i = 0; i < 200 && answer.free_until_s > 0; ++i) {
      // Most just before the end.
      const double back = i % 2 == 0 ? random.unit() : std::exp2(random.between(-50, 0));
      const double t = answer.free_until_s * (1 - back);
      ASSERT_EQ(full_at(t), AnswerStatus::kFree) << t << " of " << answer.free_until_s;
    }
    if (answer.status == AnswerStatus::kFree) {
      EXPECT_EQ(full_at(1), AnswerStatus::kFree);
    }
    EXPECT_EQ(answer.hit_s < kNever,
              answer.status == AnswerStatus::kContact || answer.status == AnswerStatus::kPartial);
    if (answer.hit_s < kNever) {
      EXPECT_GE(answer.hit_s, answer.free_until_s);
      EXPECT_EQ(full_at(answer.hit_s), AnswerStatus::kContact);
    }
    if (is_certified(answer.status) || whole) {
      EXPECT_TRUE(answer.missing_a.empty() && answer.missing_b.empty());
    }
  }
  for (const AnswerStatus status :
       {AnswerStatus::kFree, AnswerStatus::kContact, AnswerStatus::kUncertain})
    EXPECT_GT(seen[std::size_t(status)], 0) << to_string(status);
}

TEST_P(SweepPair, HitsAtTheFirstInstantAtWhichExactFacesTouch) {
  for (std::uint64_t seed = 100; seed < 160; ++seed) {
    SCOPED_TRACE(seed);
    State state(*this, seed);
    auto& [random, a, b] = state;
    const Motions m = random_motions(random, a_, b_);
    for (const int levels : {0, 1, 2, 4, seed < 115 ? 8 : 5}) {
      const SweepOptions options{.duration_s = 1, .time_levels = levels, .max_tests = 100'000};
      const SweptAnswer answer = swept(a.view(), m.a, b.view(), m.b, options);
      if (answer.exhausted) continue;
      double first = kNever;
      for (int k = 0; k <= 2 << levels && first == kNever; ++k) {
        const double t = std::ldexp(k, -levels - 1);
        if (status_at(a.view(), m.a, b.view(), m.b, t) == AnswerStatus::kContact) first = t;
      }
      EXPECT_EQ(answer.hit_s, first);
      EXPECT_EQ(swept(b.view(), m.b, a.view(), m.a, options).hit_s, first);
      if (answer.status == AnswerStatus::kPartial) {
        EXPECT_LT(answer.free_until_s, answer.hit_s);
      }
    }
  }
}

TEST_P(SweepPair, SwappedBodiesAgreeUpToTheFinestStep) {
  const test::FullModel full_a(a_), full_b(b_);
  for (std::uint64_t seed = 200; seed < 215; ++seed) {
    SCOPED_TRACE(seed);
    Random random(seed);
    const Motions m = random_motions(random, a_, b_);
    const SweptAnswer answer = swept(full_a.tree.view(), m.a, full_b.tree.view(), m.b, kSecond);
    const SweptAnswer mirrored = swept(full_b.tree.view(), m.b, full_a.tree.view(), m.a, kSecond);
    if (answer.exhausted || mirrored.exhausted) continue;
    EXPECT_EQ(answer.hit_s, mirrored.hit_s);
    EXPECT_EQ(answer.status, mirrored.status);
    EXPECT_NEAR(answer.free_until_s, mirrored.free_until_s, 2.0 / 256);
  }
}

TEST_P(SweepPair, RefiningWhatIsMissingNarrowsToTheAnswerOfTheWholeMeshes) {
  // Trees of other shapes prove other spans, some halvings from each other.
  constexpr double kOtherTree = 3.0 / 256;
  const test::FullModel full_a(a_), full_b(b_);
  for (std::uint64_t seed = 300; seed < 310; ++seed) {
    SCOPED_TRACE(seed);
    Random random(seed);
    LocalModel a(a_.store, a_.header.grid), b(b_.store, b_.header.grid);
    const Motions m = random_motions(random, a_, b_);
    const SweptAnswer whole = swept(full_a.tree.view(), m.a, full_b.tree.view(), m.b, kSecond);
    if (whole.exhausted) continue;
    double hit_s = kNever, longest_free_s = 0;
    while (true) {
      const SweptAnswer answer = swept(a.view(), m.a, b.view(), m.b, kSecond);
      if (answer.exhausted) break;
      EXPECT_LE(answer.hit_s, hit_s);
      hit_s = answer.hit_s;
      // From one round to the next it may fall: a child's quantised box can reach beyond its
      // parent's.
      longest_free_s = std::max(longest_free_s, answer.free_until_s);
      EXPECT_TRUE(std::is_sorted(answer.missing_a.begin(), answer.missing_a.end()));
      EXPECT_TRUE(std::is_sorted(answer.missing_b.begin(), answer.missing_b.end()));
      EXPECT_LE(longest_free_s, whole.free_until_s + kOtherTree);
      if (answer.missing_a.empty() && answer.missing_b.empty()) {
        EXPECT_EQ(answer.status, whole.status);
        EXPECT_EQ(answer.hit_s, whole.hit_s);
        EXPECT_NEAR(answer.free_until_s, whole.free_until_s, kOtherTree);
        break;
      }
      RefineDelta delta_a, delta_b;
      for (const NodeSpan& node : answer.missing_a)
        ASSERT_TRUE(a.mesh.split(a_.store.split_of(node), delta_a));
      for (const NodeSpan& node : answer.missing_b)
        ASSERT_TRUE(b.mesh.split(b_.store.split_of(node), delta_b));
      a.tree.update(delta_a);
      b.tree.update(delta_b);
    }
  }
}

TEST_P(SweepPair, AtRestIsTheQuery) {
  for (std::uint64_t seed = 400; seed < 430; ++seed) {
    SCOPED_TRACE(seed);
    State state(*this, seed);
    auto& [random, a, b] = state;
    Motions m = random_motions(random, a_, b_);
    for (Motion* motion : {&m.a, &m.b}) *motion = Motion{.pose = pose_at(*motion, 0.5)};
    const PosedPair posed =
        pose_pair(a_.header.grid, m.a.pose, "a", b_.header.grid, m.b.pose, "b").value();
    const Answer still = query(a.view(), posed.a, b.view(), posed.b, {.any = true});
    const SweptAnswer answer = swept(a.view(), m.a, b.view(), m.b, kSecond);
    EXPECT_EQ(answer.status, still.status);
    EXPECT_EQ(answer.missing_a, still.missing_a);
    EXPECT_EQ(answer.missing_b, still.missing_b);
    EXPECT_EQ(answer.free_until_s, still.status == AnswerStatus::kFree ? 1 : 0);
    EXPECT_EQ(answer.hit_s, still.status == AnswerStatus::kContact ? 0 : kNever);
  }
}

TEST_P(SweepPair, AHeadOnApproachIsBracketedNarrowly) {
  const test::FullModel full_a(a_), full_b(b_);
  int hits = 0;
  for (std::uint64_t seed = 500; seed < 515; ++seed) {
    SCOPED_TRACE(seed);
    Random random(seed);
    Motions m = random_motions(random, a_, b_);
    // From three radii away straight to where they meet; a still.
    const double speed = 4 * (test::radius_m(a_) + test::radius_m(b_));
    m.a = {.pose = pose_at(m.a, 0.5)};
    m.b = {.pose = pose_at(m.b, 0.5)};
    Vec3 way;
    double length = 0;
    for (double& x : way) {
      x = random.between(-1, 1);
      length += x * x;
    }
    for (std::size_t k = 0; k < 3; ++k) {
      m.b.linear_velocity_mps[k] = way[k] / std::sqrt(length) * speed;
      m.b.pose.translation_m[k] -= 0.75 * m.b.linear_velocity_mps[k];
    }
    const SweepOptions options{.duration_s = 1};
    const SweptAnswer answer = swept(full_a.tree.view(), m.a, full_b.tree.view(), m.b, options);
    if (answer.status != AnswerStatus::kContact) continue;
    ++hits;
    EXPECT_GT(answer.free_until_s, 0);
    EXPECT_LE(answer.hit_s - answer.free_until_s, 4 * 0x1p-12);
  }
  EXPECT_GT(hits, 0);
}

TEST_P(SweepPair, NothingTouchesWithinTheSafeHorizonWhicheverWayTheyGo) {
  const test::FullModel full_a(a_), full_b(b_);
  const TreeView a = full_a.tree.view(), b = full_b.tree.view();
  int checked = 0;
  for (std::uint64_t seed = 700; seed < 760; ++seed) {
    SCOPED_TRACE(seed);
    Random random(seed);
    Motions m = random_motions(random, a_, b_);
    const PosedPair posed = pose_pair(*a.grid, m.a.pose, "a", *b.grid, m.b.pose, "b").value();
    const Answer answer = query(a, posed.a, b, posed.b);
    if (answer.status != AnswerStatus::kFree) continue;
    const double horizon = safe_horizon_s(a, m.a, b, m.b, answer.clearance_m);
    ASSERT_GE(horizon, 0);
    // As fast or slower, another way.
    for (int way = 0; way < 10; ++way) {
      Motions other = m;
      for (Motion* motion : {&other.a, &other.b})
        for (auto* v : {&motion->linear_velocity_mps, &motion->angular_velocity_radps}) {
          const double speed =
              std::hypot((*v)[0], (*v)[1], (*v)[2]) * (random.below(2) == 0 ? 1 : random.unit());
          const auto direction = test::random_rotation(random);
          for (std::size_t k = 0; k < 3; ++k) (*v)[k] = direction[k] * speed;
        }
      const double t = std::min(horizon, 100.0) * (random.below(2) == 0 ? 1 : random.unit());
      EXPECT_EQ(status_at(a, other.a, b, other.b, t), AnswerStatus::kFree) << t;
      ++checked;
    }
  }
  EXPECT_GT(checked, 100);
}

TEST(SweepBudget, SpentItIsStillHonest) {
  const BakedModel model_a = test::bake_named("terrain"), model_b = test::bake_named("aircraft");
  const test::FullModel a(model_a), b(model_b);
  Random random(600);
  int spent = 0;
  for (int i = 0; i < 20; ++i) {
    const Motions m = random_motions(random, model_a, model_b);
    const SweptAnswer whole =
        swept(a.tree.view(), m.a, b.tree.view(), m.b, {.duration_s = 1, .time_levels = 8});
    for (const std::uint64_t budget : {1U, 10U, 100U, 1000U}) {
      const SweptAnswer cut = swept(a.tree.view(), m.a, b.tree.view(), m.b,
                                    {.duration_s = 1, .time_levels = 8, .max_tests = budget});
      EXPECT_LE(cut.free_until_s, whole.free_until_s);
      EXPECT_GE(cut.hit_s, whole.hit_s);
      if (!cut.exhausted) continue;
      EXPECT_EQ(cut.status, cut.hit_s < kNever ? AnswerStatus::kPartial : AnswerStatus::kUncertain);
      ++spent;
    }
  }
  EXPECT_GT(spent, 20);
}

}  // namespace
}  // namespace nearmesh
