// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/core/query/sweep.hpp"

#include "brute_force.hpp"

namespace nearmesh {
namespace {

using Vec3 = std::array<double, 3>;
constexpr double kNever = std::numeric_limits<double>::infinity();

SweptAnswer swept(const TreeView& a, const Motion& motion_a, const TreeView& b,
                  const Motion& motion_b, const SweepOptions& options) {
  const Result<SweptAnswer> answer = sweep(a, motion_a, "a", b, motion_b, "b", options);
  if (!answer.is_ok()) ADD_FAILURE() << answer.status().message();
  return answer.value();
}

/// query() at an instant of the motions.
AnswerStatus status_at(const TreeView& a, const Motion& motion_a, const TreeView& b,
                       const Motion& motion_b, double t) {
  const PosedPair posed =
      pose_pair(*a.grid, pose_at(motion_a, t), "a", *b.grid, pose_at(motion_b, t), "b").value();
  return query(a, posed.a, b, posed.b, {.any = true, .clearance = false}).status;
}

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
  return build_triangle_tree(kGrid, std::move(faces));
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
  return build_triangle_tree(kGrid, std::move(faces));
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
  return build_triangle_tree(kGrid, std::move(faces));
}

Motion moving(const Vec3& from, const Vec3& velocity) {
  Motion motion;
  motion.pose.translation_m = from;
  motion.linear_velocity_mps = velocity;
  return motion;
}

Motion spinning_z(double radps) { return {.angular_velocity_radps = {0, 0, radps}}; }

double lowest_z(const TriangleTree& tree) { return std::ldexp(tree.nodes[0].box.lo[2], -16) - 16; }

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
  // Mirror images about x = 4.5: contact when the tips reach it, at cos(angle to x) = 4.5 / 5, up to the thickness.
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

// ---- random models and motions ------------------------------------------------------------------

struct Motions {
  Motion a, b;
};

/// At some instant of the second to come (or before, or after), a vertex of b is near one of a; both move and turn.
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

using Names = std::pair<const char*, const char*>;
class SweepPair : public ::testing::TestWithParam<Names> {
 protected:
  BakedModel a_ = test::bake_named(GetParam().first), b_ = test::bake_named(GetParam().second);
};
INSTANTIATE_TEST_SUITE_P(Models, SweepPair,
                         ::testing::Values(Names{"terrain", "aircraft"}, Names{"sphere", "sphere"},
                                           Names{"soup", "degenerate"}, Names{"book", "components"},
                                           Names{"one_face", "sphere"}),
                         [](const auto& names) {
                           return std::string(names.param.first) + "_" + names.param.second;
                         });

constexpr SweepOptions kSecond{.duration_s = 1, .time_levels = 8, .max_tests = 100'000};

TEST_P(SweepPair, IsNeverContradictedByTheFullMeshes) {
  const test::FullModel full_a(a_), full_b(b_);
  std::array<int, 4> seen{};
  for (std::uint64_t seed = 0; seed < 40; ++seed) {
    SCOPED_TRACE(seed);
    Random random(seed);
    LocalModel a(a_.store, a_.header.grid), b(b_.store, b_.header.grid);
    test::refine_at_random(a, random);
    test::refine_at_random(b, random);
    const Motions m = random_motions(random, a_, b_);
    const bool whole = random.below(2) == 0;
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
  for (std::uint64_t seed = 100; seed < 115; ++seed) {
    SCOPED_TRACE(seed);
    Random random(seed);
    LocalModel a(a_.store, a_.header.grid), b(b_.store, b_.header.grid);
    test::refine_at_random(a, random);
    test::refine_at_random(b, random);
    const Motions m = random_motions(random, a_, b_);
    const SweptAnswer answer = swept(a.view(), m.a, b.view(), m.b, kSecond);
    if (answer.exhausted) continue;
    double first = kNever;
    for (int k = 0; k <= 512 && first == kNever; ++k)
      if (status_at(a.view(), m.a, b.view(), m.b, k / 512.0) == AnswerStatus::kContact)
        first = k / 512.0;
    EXPECT_EQ(answer.hit_s, first);
    EXPECT_EQ(swept(b.view(), m.b, a.view(), m.a, kSecond).hit_s, first);
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
      // From one round to the next it may fall: a child's quantised box can reach beyond its parent's.
      longest_free_s = std::max(longest_free_s, answer.free_until_s);
      EXPECT_TRUE(std::is_sorted(answer.missing_a.begin(), answer.missing_a.end()));
      EXPECT_TRUE(std::is_sorted(answer.missing_b.begin(), answer.missing_b.end()));
      EXPECT_LE(longest_free_s, whole.free_until_s + 1.0 / 256);
      if (answer.missing_a.empty() && answer.missing_b.empty()) {
        EXPECT_EQ(answer.status, whole.status);
        EXPECT_EQ(answer.hit_s, whole.hit_s);
        EXPECT_NEAR(answer.free_until_s, whole.free_until_s, 1.0 / 256);
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
    Random random(seed);
    LocalModel a(a_.store, a_.header.grid), b(b_.store, b_.header.grid);
    test::refine_at_random(a, random);
    test::refine_at_random(b, random);
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

TEST(Sweep, ASpentBudgetIsHonest) {
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
