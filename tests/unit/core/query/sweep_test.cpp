// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/core/query/sweep.hpp"

#include "swept.hpp"
#include "test_models.hpp"

namespace nearmesh {
namespace {

using test::kNever;
using test::status_at;
using test::swept;
using Vec3 = std::array<double, 3>;

// ---- solids by hand -----------------------------------------------------------------------------

/// 2^-16 m a cell, the model's origin in the middle of the grid.
const Grid kGrid{.origin_m = {-16, -16, -16}, .exponent = -16, .bits = 21};

GridPoint at_m(const Vec3& p) {
  GridPoint g;
  for (int k = 0; k < 3; ++k) g[k] = std::int32_t(std::lround((p[std::size_t(k)] + 16) * 0x1p16));
  return g;
}

void add_quad(std::vector<TreeFace>& faces, const Vec3& p, const Vec3& q, const Vec3& r,
              const Vec3& s) {
  const auto index = std::uint32_t(faces.size());
  faces.push_back({{at_m(p), at_m(q), at_m(r)}, {{}, index}});
  faces.push_back({{at_m(p), at_m(r), at_m(s)}, {{}, index + 1}});
}

/// In z = 0, of n x n quads, [-half, half] along x and y; tilted against the grid when asked.
TriangleTree make_plate(double half, int n, double tilt = 0) {
  std::vector<TreeFace> faces;
  const double step = 2 * half / n;
  const auto p = [&](int i, int j) -> Vec3 {
    const double x = -half + i * step, y = -half + j * step;
    return {x, y, tilt * x};
  };
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < n; ++j) add_quad(faces, p(i, j), p(i + 1, j), p(i + 1, j + 1), p(i, j + 1));
  return build_triangle_tree(kGrid, faces);
}

/// Axis-parallel box.
TriangleTree make_box(const Vec3& lo, const Vec3& hi) {
  std::vector<TreeFace> faces;
  const auto corner = [&](int i) -> Vec3 {
    return {(i & 1) != 0 ? hi[0] : lo[0], (i & 2) != 0 ? hi[1] : lo[1],
            (i & 4) != 0 ? hi[2] : lo[2]};
  };
  constexpr int kSides[6][4] = {{0, 1, 3, 2}, {4, 5, 7, 6}, {0, 1, 5, 4},
                                {2, 3, 7, 6}, {0, 2, 6, 4}, {1, 3, 7, 5}};
  for (const auto& side : kSides)
    add_quad(faces, corner(side[0]), corner(side[1]), corner(side[2]), corner(side[3]));
  return build_triangle_tree(kGrid, faces);
}

TriangleTree make_ball(double radius) {
  std::vector<TreeFace> faces;
  const IndexedMesh sphere = generate_sphere(12, 0);
  for (const auto& f : sphere.faces) {
    TreeFace face{{}, {{}, std::uint32_t(faces.size())}};
    for (std::size_t k = 0; k < 3; ++k) {
      Vec3 p = sphere.positions_m[f[k]];
      for (double& x : p) x *= radius;
      face.corners[k] = at_m(p);
    }
    faces.push_back(face);
  }
  return build_triangle_tree(kGrid, faces);
}

Motion moving(const Vec3& from, const Vec3& velocity) {
  Motion motion;
  motion.pose.translation_m = from;
  motion.linear_velocity_mps = velocity;
  return motion;
}

Motion spinning_z(double radps) { return {.angular_velocity_radps = {0, 0, radps}}; }

double lowest_z(const TriangleTree& tree) {
  return std::ldexp(tree.view().root().box.lo[2], -16) - 16;
}

// ---- F7: tunnelling -----------------------------------------------------------------------------

class FastBall : public ::testing::TestWithParam<int> {};
INSTANTIATE_TEST_SUITE_P(QuadsASide, FastBall, ::testing::Values(1, 64));

TEST_P(FastBall, HitsAThinPlateAtTheAnalyticTime) {
  const TriangleTree plate = make_plate(4, GetParam()), ball = make_ball(0.01);
  Random random(41);
  for (int i = 0; i < 20; ++i) {
    SCOPED_TRACE(i);
    // 10^4 radii within the interval, mostly along z.
    const double start = random.between(5, 95), duration = std::exp2(random.between(-8, 3));
    const Vec3 velocity{random.between(-2, 2) / duration, random.between(-2, 2) / duration,
                        -100 / duration};
    const Motion motion = moving({random.between(-1, 1), random.between(-1, 1), start}, velocity);
    const double impact = (start + lowest_z(ball)) / -velocity[2];
    const SweepOptions options{.duration_s = duration, .time_levels = 16};
    const SweptAnswer answer = swept(plate.view(), {}, ball.view(), motion, options);
    ASSERT_EQ(answer.status, AnswerStatus::kContact);
    EXPECT_LE(answer.free_until_s, impact);
    EXPECT_GE(answer.hit_s, impact * (1 - 1e-12));
    EXPECT_LE(answer.hit_s - answer.free_until_s, 3 * std::ldexp(duration, -16));
    EXPECT_EQ(status_at(plate.view(), {}, ball.view(), motion, answer.hit_s),
              AnswerStatus::kContact);
    // Fewer levels may miss the instants of contact, but never say free.
    for (int levels = 0; levels < 16; ++levels) {
      const SweptAnswer coarse = swept(plate.view(), {}, ball.view(), motion,
                                       {.duration_s = duration, .time_levels = levels});
      EXPECT_NE(coarse.status, AnswerStatus::kFree);
      EXPECT_LE(coarse.free_until_s, impact);
      EXPECT_GE(coarse.free_until_s, impact - 3 * std::ldexp(duration, -levels));
    }
  }
}

TEST_P(FastBall, IsFreeWhereItMissesThePlate) {
  const TriangleTree plate = make_plate(4, GetParam()), ball = make_ball(0.01);
  // Past the edge by a thousandth; stops a thousandth short; starts a thousandth behind.
  for (const auto& [from, velocity] : {std::pair(Vec3{4.011, 0, 50}, Vec3{0, 0, -100}),
                                       std::pair(Vec3{0, 0, 100.011}, Vec3{0, 0, -100}),
                                       std::pair(Vec3{0, 0, -0.011}, Vec3{0, 0, -100})}) {
    const SweptAnswer answer =
        swept(plate.view(), {}, ball.view(), moving(from, velocity), {.duration_s = 1});
    EXPECT_EQ(answer.status, AnswerStatus::kFree);
    EXPECT_EQ(answer.free_until_s, 1);
    EXPECT_EQ(answer.hit_s, kNever);
  }
}

TEST(Sweep, ThePlateMayBeTheOneThatMovesAndLieAskew) {
  const TriangleTree plate = make_plate(4, 8, 0.37), ball = make_ball(0.01);
  for (const double t : {0.1234, 0.5, 0.999}) {
    // A corner of the ball is taken through the plate's middle region at about t.
    const SweptAnswer answer = swept(plate.view(), moving({0, 0, 100 * t}, {0, 0, -100}),
                                     ball.view(), {}, {.duration_s = 1, .time_levels = 16});
    ASSERT_EQ(answer.status, AnswerStatus::kContact);
    EXPECT_LE(answer.free_until_s, t);
    EXPECT_GE(answer.hit_s, t - 0.011 * std::sqrt(1 + 0.37 * 0.37) / 100);
    EXPECT_LE(answer.hit_s - answer.free_until_s, 3 * 0x1p-16);
  }
}

TEST(Sweep, ARodThatTurnsThriceHitsAThinPost) {
  const TriangleTree rod = make_box({-5, -0.01, -0.01}, {5, 0.01, 0.01});
  const TriangleTree post = make_box({-0.01, -0.01, -3}, {0.01, 0.01, 3});
  const double turn = 2 * 3.14159265358979324;
  for (const double bearing : {0.3, 1.5, 2.9})
    for (const double distance : {0.5, 4.9, 4.999}) {
      SCOPED_TRACE(testing::Message() << bearing << " " << distance);
      const Motion at = moving({distance * std::cos(bearing), distance * std::sin(bearing), 0}, {});
      const SweptAnswer answer =
          swept(rod.view(), spinning_z(3 * turn), post.view(), at, {.duration_s = 1});
      ASSERT_EQ(answer.status, AnswerStatus::kContact);
      const double meets = bearing / (3 * turn);
      EXPECT_LE(answer.free_until_s, meets);
      EXPECT_NEAR(answer.hit_s, meets, (0.03 / distance) / (3 * turn) + 2 * 0x1p-12);
      // The whole face counts as fast as its tip.
      EXPECT_LE(answer.hit_s - answer.free_until_s, (2 + 5 / distance) * 0x1p-12);
    }
}

TEST(Sweep, ARodThatTurnsThriceIsFreeOfAPostJustBeyondReach) {
  const TriangleTree rod = make_box({-5, -0.01, -0.01}, {5, 0.01, 0.01});
  const TriangleTree post = make_box({-0.01, -0.01, -3}, {0.01, 0.01, 3});
  const double turn = 2 * 3.14159265358979324;
  for (const double bearing : {0.3, 1.5, 2.9})
    for (const double gap : {0.002, 0.1}) {
      const double distance = std::sqrt(25 + 1e-4) + 0.01 * std::sqrt(2) + gap;
      const Motion at = moving({distance * std::cos(bearing), distance * std::sin(bearing), 0}, {});
      // The tip passes at 94 m/s: a step of the default takes it farther than the gap.
      const SweptAnswer answer = swept(rod.view(), spinning_z(3 * turn), post.view(), at,
                                       {.duration_s = 1, .time_levels = 18});
      EXPECT_EQ(answer.status, AnswerStatus::kFree) << bearing << " " << gap;
    }
}

TEST(Sweep, BothMayTurn) {
  // Two rods whose centres are nine apart: their tips meet where both point at each other.
  const TriangleTree rod = make_box({-5, -0.01, -0.01}, {5, 0.01, 0.01});
  Motion other = spinning_z(-1);
  other.pose.translation_m = {9, 0, 0};
  other.pose.rotation = {0, -1, 0, 1, 0, 0, 0, 0, 1};  // at a right angle
  const double quarter = 1.5707963267948966;
  const Motion own{.pose = {.rotation = other.pose.rotation}, .angular_velocity_radps = {0, 0, 1}};
  const SweptAnswer answer = swept(rod.view(), own, rod.view(), other, {.duration_s = 2});
  ASSERT_EQ(answer.status, AnswerStatus::kContact);
  // Mirror images about x = 4.5: contact when the tips reach it, at cos(angle to x) = 4.5 / 5, up
  // to the thickness.
  const double meets = quarter - std::acos(0.9);
  EXPECT_NEAR(answer.hit_s, meets, 0.01);
  EXPECT_LE(answer.free_until_s, meets);
  EXPECT_LE(answer.hit_s - answer.free_until_s, 3 * std::ldexp(2, -12));
}

// ---- start, end, rest ---------------------------------------------------------------------------

TEST(Sweep, ContactAtTheStartIsAHitAtZero) {
  const TriangleTree plate = make_plate(4, 8), ball = make_ball(0.25);
  for (const double vz : {-1.0, 0.0, 1.0, 1e6}) {
    // Resting exactly on the plate.
    const SweptAnswer answer =
        swept(plate.view(), {}, ball.view(), moving({0.3, 0.2, -lowest_z(ball)}, {0, 0, vz}),
              {.duration_s = 1});
    EXPECT_EQ(answer.status, AnswerStatus::kContact);
    EXPECT_EQ(answer.hit_s, 0);
    EXPECT_EQ(answer.free_until_s, 0);
  }
}

TEST(Sweep, ContactAtTheVeryEndIsAHit) {
  const TriangleTree plate = make_plate(4, 8), ball = make_ball(0.25);
  const SweptAnswer answer =
      swept(plate.view(), {}, ball.view(), moving({0.3, 0.2, -lowest_z(ball) + 2}, {0, 0, -2}),
            {.duration_s = 1});
  EXPECT_EQ(answer.status, AnswerStatus::kContact);
  EXPECT_EQ(answer.hit_s, 1);
  EXPECT_LT(answer.free_until_s, 1);
  EXPECT_GT(answer.free_until_s, 1 - 0x1p-10);
}

TEST(Sweep, AtRestEvenALatticeCellIsAGap) {
  const TriangleTree plate = make_plate(4, 8), ball = make_ball(0.25);
  for (const double cells : {0.0, 1.0}) {
    const Motion above = moving({0.3, 0.2, cells * 0x1p-18 - lowest_z(ball)}, {});
    EXPECT_EQ(swept(plate.view(), {}, ball.view(), above, {.duration_s = 1}).status,
              cells > 0 ? AnswerStatus::kFree : AnswerStatus::kContact);
  }
}

TEST(Sweep, ASharedTranslationCostsNothing) {
  const TriangleTree plate = make_plate(4, 32), ball = make_ball(0.25);
  const Vec3 above{0.3, 0.2, -lowest_z(ball) + 0.001};
  const SweptAnswer answer = swept(plate.view(), moving({}, {1e5, -1e5, 3e4}), ball.view(),
                                   moving(above, {1e5, -1e5, 3e4}), {.duration_s = 10});
  EXPECT_EQ(answer.status, AnswerStatus::kFree);
  EXPECT_LT(answer.stats.box_tests, 500U);
}

TEST(Sweep, SlidingAlongAPlateNeedsNoSmallSteps) {
  const TriangleTree plate = make_plate(15, 32), ball = make_ball(0.25);
  const SweptAnswer answer =
      swept(plate.view(), {}, ball.view(), moving({-12, 0.2, -lowest_z(ball) + 0.001}, {24, 0, 0}),
            {.duration_s = 1});
  EXPECT_EQ(answer.status, AnswerStatus::kFree);
  EXPECT_LT(answer.stats.box_tests + answer.stats.triangle_tests, 5000U);
}

// ---- F19 ----------------------------------------------------------------------------------------

TEST(Sweep, TurnsFromFreeToContactOnceAtTheExactPlace) {
  // A ball of half a metre comes down to a plate and stops so many cells above it.
  const TriangleTree plate = make_plate(4, 8), ball = make_ball(0.5);
  const double cell = 0x1p-16;
  for (int cells = -4; cells <= 4; ++cells) {
    SCOPED_TRACE(cells);
    const Motion motion = moving({0.3, 0.2, 1 - lowest_z(ball)}, {0, 0, -(1 - cells * cell)});
    const SweptAnswer answer = swept(plate.view(), {}, ball.view(), motion, {.duration_s = 1});
    EXPECT_EQ(answer.status, cells > 0 ? AnswerStatus::kFree : AnswerStatus::kContact);
    EXPECT_EQ(answer.status, status_at(plate.view(), {}, ball.view(), motion, 1));
  }
}

TEST(Sweep, AOneCellGapIsFreeHoweverFastTheSlide) {
  const TriangleTree plate = make_plate(15, 8), ball = make_ball(0.5);
  const double cell = 0x1p-16;
  for (int cells = -1; cells <= 1; ++cells) {
    const Motion motion = moving({-13, 0.2, cells * cell - lowest_z(ball)}, {26e4, 0, 0});
    const SweptAnswer answer = swept(plate.view(), {}, ball.view(), motion, {.duration_s = 1e-4});
    EXPECT_EQ(answer.status, cells > 0 ? AnswerStatus::kFree : AnswerStatus::kContact);
  }
}

TEST(Sweep, ContactThatOnlyRoundingMakesIsNotOverlooked) {
  // A corner slides along a slope, a third of a lattice cell above it: posed corners touch at some
  // instants.
  const TriangleTree plate = make_plate(8, 1, 0.375);
  const TriangleTree corner = build_triangle_tree(
      kGrid, {{{at_m({0, 0, 0}), at_m({0, 0, 1}), at_m({0.5, 0, 1})}, {{}, 0}}});
  Random random(51);
  int touched_between = 0;
  for (int i = 0; i < 200; ++i) {
    const double x = random.between(-4, 0), way = 0x1p-18 * random.between(1, 4);
    const Motion motion = moving({x, 0, 0.375 * x + 0.3 * 0x1p-18}, {way, 0, 0.375 * way});
    const auto touches = [&](double t) {
      return status_at(plate.view(), {}, corner.view(), motion, t) == AnswerStatus::kContact;
    };
    bool some = false;
    for (int k = 0; k <= 64; ++k) some = some || touches(k / 64.0);
    if (!some || touches(0) || touches(1)) continue;
    ++touched_between;
    const SweptAnswer answer =
        swept(plate.view(), {}, corner.view(), motion, {.duration_s = 1, .time_levels = 0});
    EXPECT_NE(answer.status, AnswerStatus::kFree);
  }
  EXPECT_GT(touched_between, 5);
}

// ---- refusals -----------------------------------------------------------------------------------

TEST(Sweep, RefusesMotionsByTheBodysName) {
  const TriangleTree ball = make_ball(0.25);
  const auto refused = [&](const Motion& b, double duration_s) {
    const auto answer =
        sweep(ball.view(), {}, "tower", ball.view(), b, "crane", {.duration_s = duration_s});
    EXPECT_FALSE(answer.is_ok());
    return answer.is_ok() ? std::string() : answer.status().message();
  };
  for (const double bad : {double(NAN), double(INFINITY), 1e10}) {
    EXPECT_NE(refused(moving({9, 0, 0}, {0, bad, 0}), 1).find("crane"), std::string::npos);
    EXPECT_NE(refused(moving({9, 0, bad}, {}), 1).find("crane"), std::string::npos);
    Motion turning = moving({9, 0, 0}, {});
    turning.angular_velocity_radps[2] = bad;
    EXPECT_NE(refused(turning, 1).find("crane"), std::string::npos);
  }
  // Leaves the world, or turns too often, on the way.
  EXPECT_NE(refused(moving({9, 0, 0}, {0, 9e8, 0}), 10).find("crane"), std::string::npos);
  EXPECT_NE(refused(spinning_z(1e6), 10).find("crane"), std::string::npos);
  for (const double bad : {0.0, -1.0, double(NAN), double(INFINITY), 1e10})
    EXPECT_NE(refused({}, bad).find("duration"), std::string::npos);
}

TEST(SafeHorizon, IsTheTimeOfAStraightApproachAndForEverAtRest) {
  const TriangleTree plate = make_plate(4, 8), ball = make_ball(0.5);
  const Motion above = moving({0, 0, 3 - lowest_z(ball)}, {0, 0, -2});
  const double horizon = safe_horizon_s(plate.view(), {}, ball.view(), above, 3);
  EXPECT_LE(horizon, 1.5);
  EXPECT_GT(horizon, 1.4999);
  EXPECT_EQ(safe_horizon_s(plate.view(), {}, ball.view(), moving({0, 0, 9}, {}), 1e-3), kNever);
  // Turning in place takes the far corners along: 4 sqrt(2) metres from the middle.
  EXPECT_NEAR(safe_horizon_s(plate.view(), spinning_z(1), ball.view(), moving({0, 0, 9}, {}), 3),
              3 / std::sqrt(32), 1e-3);
  // A body may have gone on from its pose, one at rest has not.
  EXPECT_NEAR(safe_horizon_s(plate.view(), {}, ball.view(), above, 3, 7, 0.5), horizon - 0.5, 1e-9);
  EXPECT_NEAR(safe_horizon_s(plate.view(), {}, ball.view(), above, 3, 7, -0.5), horizon - 0.5,
              1e-9);
  EXPECT_EQ(safe_horizon_s(plate.view(), {}, ball.view(), above, 3, 0, 1.6), 0);
  EXPECT_EQ(safe_horizon_s(plate.view(), {}, ball.view(), above, 3, 0, kNever), 0);
  // Not even what rounding may bridge.
  EXPECT_EQ(safe_horizon_s(plate.view(), {}, ball.view(), above, 0x1p-19), 0);
}

}  // namespace
}  // namespace nearmesh
