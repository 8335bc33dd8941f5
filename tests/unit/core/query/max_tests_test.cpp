// SPDX-License-Identifier: Apache-2.0
// A search that is ended early: what it says is true, and never certified.
#include <numbers>

#include "core/query/answer.hpp"
#include "core/query/find_missing.hpp"
#include "model_pairs.hpp"
#include "nearmesh/core/query/certify.hpp"
#include "rounds.hpp"
#include "solids.hpp"

namespace nearmesh {
namespace {

bool holds_all(const std::vector<FacePair>& all, const std::vector<FacePair>& some) {
  return std::includes(all.begin(), all.end(), some.begin(), some.end());
}

class MaxTests : public test::ModelPair {};
INSTANTIATE_TEST_SUITE_P(Models, MaxTests, test::model_pairs(), test::name_of_pair);

TEST_P(MaxTests, AnEarlyEndIsNeverCertifiedAndNeverWrong) {
  int ended = 0;
  for (std::uint64_t seed = 0; seed < 40; ++seed) {
    SCOPED_TRACE(seed);
    State state(*this, seed);
    auto& [random, a, b] = state;
    const PosedPair posed = test::near_pose(random, a_, b_);
    const Answer all = query(a.view(), posed.a, b.view(), posed.b);
    const std::uint64_t needed = tests_of(all.stats);
    for (int i = 0; i < test::rounds(30); ++i) {
      const std::uint64_t most = i == 0 ? 0 : random.below(static_cast<std::uint32_t>(needed) + 64);
      SCOPED_TRACE(most);
      const Answer some = query(a.view(), posed.a, b.view(), posed.b, {.max_tests = most});
      if (!some.exhausted) {
        EXPECT_EQ(digest(some), digest(all));
        EXPECT_EQ(some.clearance_m, all.clearance_m);
        continue;
      }
      ++ended;
      EXPECT_FALSE(is_certified(some.status));
      EXPECT_FALSE(is_beyond_detail(some));
      EXPECT_EQ(some.status,
                some.pairs.empty() ? AnswerStatus::kUncertain : AnswerStatus::kPartial);
      EXPECT_TRUE(holds_all(all.pairs, some.pairs));
      EXPECT_EQ(some.uncertainty_m, std::numeric_limits<double>::infinity());
      EXPECT_NE(digest(some), digest(all));
      const Answer any =
          query(a.view(), posed.a, b.view(), posed.b, {.any = true, .max_tests = most});
      EXPECT_EQ(any.status == AnswerStatus::kContact, any.pair_total > 0);
      EXPECT_TRUE(holds_all(all.pairs, any.pairs));
      EXPECT_TRUE(!any.exhausted || !is_certified(any.status));
    }
    const Answer whole = query(a.view(), posed.a, b.view(), posed.b, {.max_tests = needed + 1});
    EXPECT_FALSE(whole.exhausted);
  }
  EXPECT_GT(ended, test::kSanitized ? 0 : 40);
}

TEST_P(MaxTests, MissingIsFoundWithoutPairs) {
  int lacking = 0;
  for (std::uint64_t seed = 0; seed < 60; ++seed) {
    SCOPED_TRACE(seed);
    State state(*this, seed);
    auto& [random, a, b] = state;
    const PosedPair posed = test::near_pose(random, a_, b_);
    const Answer all = query(a.view(), posed.a, b.view(), posed.b);
    const Answer missing = find_missing(a.view(), posed.a, b.view(), posed.b);
    // Not always the same ones: of two that may meet either will do.
    const bool is_lacking = !all.missing_a.empty() || !all.missing_b.empty();
    EXPECT_EQ(!missing.missing_a.empty() || !missing.missing_b.empty(), is_lacking);
    for (const NodeSpan& node : missing.missing_a) EXPECT_TRUE(a.mesh.is_current(node));
    for (const NodeSpan& node : missing.missing_b) EXPECT_TRUE(b.mesh.is_current(node));
    EXPECT_TRUE(missing.pairs.empty());
    EXPECT_FALSE(is_certified(missing.status));
    lacking += is_lacking ? 1 : 0;
  }
  EXPECT_GT(lacking, 0);
}

/// So many faces that share their tip, which is at the origin; they open upwards, or downwards.
IndexedMesh make_fan(std::uint32_t faces, double height_m) {
  IndexedMesh fan;
  fan.positions_m.push_back({0, 0, 0});
  for (std::uint32_t i = 0; i < faces; ++i) {
    const double angle = 2 * std::numbers::pi * i / faces;
    fan.positions_m.push_back({std::cos(angle), std::sin(angle), height_m});
    fan.faces.push_back({0, 1 + i, 1 + (i + 1) % faces});
  }
  return fan;
}

/// Two fans tip to tip: each face touches each.
class Fans : public ::testing::Test {
 protected:
  static constexpr std::uint32_t kFaces = 300;
  BakedModel up_ = test::bake_mesh(make_fan(kFaces, 1)),
             down_ = test::bake_mesh(make_fan(kFaces, -1));
  LocalModel a_{up_.store, up_.header.grid}, b_{down_.store, down_.header.grid};

  [[nodiscard]] PosedPair posed() const {
    return pose_pair(a_.grid, {}, "a", b_.grid, {}, "b").value();
  }
  [[nodiscard]] Result<Answer> asked(const QueryOptions& options, CertifyTimes* times = nullptr) {
    const PosedPair at = posed();
    return certify(a_, at.a, test::no_require, b_, at.b, test::no_require, options, times);
  }
};

TEST_F(Fans, TheFirstPairsAreListedAndAllAreCounted) {
  const Answer all = asked({}).value();
  ASSERT_EQ(all.status, AnswerStatus::kContact);
  EXPECT_EQ(all.pair_total, std::uint64_t{kFaces} * kFaces);
  for (const std::size_t most : {std::size_t{0}, std::size_t{1}, std::size_t{5000}}) {
    const Answer some = asked({.max_pairs = most}).value();
    EXPECT_EQ(some.status, AnswerStatus::kContact);
    EXPECT_EQ(some.pair_total, all.pair_total);
    EXPECT_TRUE(some.truncated);
    EXPECT_EQ(some.pairs,
              std::vector<FacePair>(all.pairs.begin(),
                                    all.pairs.begin() + static_cast<std::ptrdiff_t>(most)));
  }
}

TEST_F(Fans, TestsBoundWhatIsFound) {
  CertifyTimes times;
  const Answer some = asked({.max_tests = 100'000}, &times).value();
  EXPECT_EQ(some.status, AnswerStatus::kPartial);
  EXPECT_TRUE(some.exhausted);
  EXPECT_LT(some.pairs.size(), 5000U);
  EXPECT_LT(tests_of(some.stats), 200'000U);
  EXPECT_GT(times.rounds, 1U);
}

// A clock that is over at its k-th look.
TEST_F(Fans, AnEndInTimeIsOneOfTests) {
  const Answer all = asked({}).value();
  const PosedPair at = posed();
  int ended = 0;
  for (int last = 0;; last += test::kSanitized ? 16 : 4) {
    int looks = 0;
    const IsOver is_over = [&] { return looks++ == last; };
    const Answer some = query(a_.view(), at.a, b_.view(), at.b, {.is_over = &is_over});
    if (looks <= last) {
      EXPECT_EQ(digest(some), digest(all));
      break;
    }
    ++ended;
    EXPECT_TRUE(some.exhausted);
    EXPECT_FALSE(is_certified(some.status));
    EXPECT_LT(tests_of(some.stats), tests_of(all.stats));
    EXPECT_TRUE(holds_all(all.pairs, some.pairs));
  }
  EXPECT_GT(ended, 5);
}

// 400 million pairs touch: what is listed stays below 20 MB.
TEST(LargeFans, TestsBoundTheLists) {
  if (test::kSanitized) GTEST_SKIP() << "the same as of small fans, but for what it counts";
  constexpr std::uint32_t kFaces = 20'000;
  constexpr std::uint64_t kTests = 2'000'000;  // a session's
  const BakedModel up = test::bake_mesh(make_fan(kFaces, 1)),
                   down = test::bake_mesh(make_fan(kFaces, -1));
  LocalModel a(up.store, up.header.grid), b(down.store, down.header.grid);
  const PosedPair at = pose_pair(a.grid, {}, "a", b.grid, {}, "b").value();
  const auto check = [&](const Answer& answer) {
    EXPECT_EQ(answer.status, AnswerStatus::kPartial);
    EXPECT_TRUE(answer.exhausted);
    EXPECT_GT(answer.pairs.size(), 1000U);
    EXPECT_LT(answer.pairs.capacity() * sizeof(FacePair), 15'000'000U);
    EXPECT_LT((answer.missing_a.capacity() + answer.missing_b.capacity()) * sizeof(NodeSpan),
              5'000'000U);
    EXPECT_LT(tests_of(answer.stats), kTests + 100'000);
  };
  check(
      certify(a, at.a, test::no_require, b, at.b, test::no_require, {.max_tests = kTests}).value());
  check(query(a.view(), at.a, b.view(), at.b, {.max_tests = kTests}));
  const Answer few = query(a.view(), at.a, b.view(), at.b, {.max_pairs = 10, .max_tests = kTests});
  EXPECT_EQ(few.pairs.size(), 10U);
  EXPECT_GT(few.pair_total, 1000U);
}

TEST_F(Fans, RoundsThatAreNotTheLastHoldNoFacesAgainstEachOther) {
  ASSERT_TRUE(asked({}).is_ok());
  const PosedPair at = posed();
  const Answer missing = find_missing(a_.view(), at.a, b_.view(), at.b);
  EXPECT_TRUE(missing.missing_a.empty() && missing.missing_b.empty());
  EXPECT_EQ(missing.stats.triangle_tests, 0U);
  EXPECT_LT(tests_of(missing.stats), 1000U);
}

TEST_F(Fans, ASweepIsEndedToo) {
  ASSERT_TRUE(asked({}).is_ok());
  for (const bool moves : {false, true}) {
    const Motion motion{.linear_velocity_mps = {moves ? 1.0 : 0.0, 0, 0}};
    const auto swept =
        sweep(a_.view(), {}, "a", b_.view(), motion, "b", {.duration_s = 1, .max_tests = 10});
    ASSERT_TRUE(swept.is_ok());
    EXPECT_FALSE(is_certified(swept.value().status));
    EXPECT_TRUE(swept.value().exhausted);
    EXPECT_EQ(swept.value().free_until_s, 0);
  }
}

TEST(MaxTestsOfSolids, AnInsideThatWasNotSeenToTheEndIsUncertain) {
  const BakedModel ball = test::bake_mesh(generate_sphere(24, 0));
  IndexedMesh small = generate_sphere(8, 0);
  for (auto& p : small.positions_m)
    for (double& x : p) x *= 0.1;
  const BakedModel grain = test::bake_mesh(small);
  LocalModel a(ball.store, ball.header.grid), b(grain.store, grain.header.grid);
  const PosedPair at = pose_pair(a.grid, {}, "a", b.grid, {}, "b").value();
  const Answer all =
      certify(a, at.a, test::no_require, b, at.b, test::no_require, {.solid_a = true}).value();
  ASSERT_EQ(all.status, AnswerStatus::kContained);
  int ended = 0;
  for (std::uint64_t most = 0; most <= tests_of(all.stats); ++most) {
    const Answer some = query(a.view(), at.a, b.view(), at.b, {.max_tests = most, .solid_a = true});
    EXPECT_EQ(some.status, some.exhausted ? AnswerStatus::kUncertain : AnswerStatus::kContained);
    ended += some.exhausted ? 1 : 0;
  }
  EXPECT_GT(ended, 0);
}

TEST(Cut, IsWhatTheOptionsMayHaveEnded) {
  Answer answer{.status = AnswerStatus::kContact, .pair_total = 3};
  EXPECT_FALSE(is_cut(answer, {}));
  EXPECT_TRUE(is_cut(answer, {.any = true}));
  answer.truncated = true;
  EXPECT_TRUE(is_cut(answer, {}));
  EXPECT_TRUE(is_cut({.exhausted = true}, {}));
  EXPECT_FALSE(is_cut({.status = AnswerStatus::kFree}, {.any = true}));
  EXPECT_FALSE(is_cut({.status = AnswerStatus::kContained}, {.any = true}));
  EXPECT_TRUE(is_cut({.status = AnswerStatus::kUncertain}, {.any = true})) << "of what is missing";
  EXPECT_FALSE(is_cut({.status = AnswerStatus::kUncertain}, {}));
}

}  // namespace
}  // namespace nearmesh
