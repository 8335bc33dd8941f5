// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/core/geometry/motion.hpp"

#include "core/geometry/motion_bounds.hpp"
#include "test_models.hpp"

namespace nearmesh {
namespace {

using Vec3 = std::array<double, 3>;
using Long3 = std::array<long double, 3>;

Vec3 random_vector(Random& random, double length) {
  Vec3 v;
  double square = 0;
  do {
    square = 0;
    for (double& x : v) {
      x = random.between(-1, 1);
      square += x * x;
    }
  } while (square > 1 || square < 0.01);
  for (double& x : v) x *= length / std::sqrt(square);
  return v;
}

/// exp([w] dt) x by Rodrigues' formula and the library's long double functions.
Long3 turned(const Vec3& w, double dt, const Long3& x) {
  Long3 phi, out;
  long double angle = 0, along = 0;
  for (std::size_t k = 0; k < 3; ++k) {
    phi[k] = static_cast<long double>(w[k]) * dt;
    angle += phi[k] * phi[k];
  }
  angle = std::sqrt(angle);
  if (angle == 0) return x;
  for (std::size_t k = 0; k < 3; ++k) along += phi[k] / angle * x[k];
  const long double c = std::cos(angle), s = std::sin(angle);
  for (std::size_t k = 0; k < 3; ++k) {
    const std::size_t i = (k + 1) % 3, j = (k + 2) % 3;
    out[k] =
        c * x[k] + s * (phi[i] * x[j] - phi[j] * x[i]) / angle + (1 - c) * along * phi[k] / angle;
  }
  return out;
}

Motion random_motion(Random& random, double speed_mps, double turn_radps) {
  Motion motion{.pose = {.rotation = test::random_rotation(random)}};
  motion.pose.translation_m = random_vector(random, std::exp2(random.between(-3, 20)));
  motion.linear_velocity_mps = random_vector(random, speed_mps);
  motion.angular_velocity_radps = random_vector(random, turn_radps);
  return motion;
}

TEST(PoseAt, IsTheGivenPoseAtTheStartBitForBit) {
  Random random(1);
  for (int i = 0; i < 100; ++i) {
    const Motion motion = random_motion(random, 100, 10);
    const Pose pose = pose_at(motion, 0);
    EXPECT_EQ(pose.rotation, motion.pose.rotation);
    EXPECT_EQ(pose.translation_m, motion.pose.translation_m);
  }
}

TEST(PoseAt, KeepsTheRotationOfABodyThatDoesNotTurn) {
  Random random(2);
  Motion motion = random_motion(random, 100, 0);
  motion.angular_velocity_radps = {};
  const Pose pose = pose_at(motion, 3);
  EXPECT_EQ(pose.rotation, motion.pose.rotation);
  for (std::size_t k = 0; k < 3; ++k)
    EXPECT_EQ(pose.translation_m[k],
              motion.pose.translation_m[k] + motion.linear_velocity_mps[k] * 3);
}

TEST(PoseAt, StaysWithinTheStatedErrorAtEveryTurn) {
  Random random(3);
  double worst = 0;
  for (int i = 0; i < 20000; ++i) {
    const double turn = std::exp2(random.between(-30, 20));
    const double dt = std::exp2(random.between(-10, 4)) * (i % 2 == 0 ? 1 : -1);
    const Motion motion = random_motion(random, 0, turn / std::abs(dt) * 0.999);
    const Pose pose = pose_at(motion, dt);
    for (std::size_t j = 0; j < 3; ++j) {
      const auto& from = motion.pose.rotation;
      const Long3 expected =
          turned(motion.angular_velocity_radps, dt, {from[j], from[3 + j], from[6 + j]});
      long double square = 0;
      for (std::size_t k = 0; k < 3; ++k)
        square += std::pow(pose.rotation[3 * k + j] - expected[k], 2);
      const double share = double(std::sqrt(square)) / pose_rotation_error(turn);
      worst = std::max(worst, share);
    }
  }
  EXPECT_LT(worst, 1);
  EXPECT_GT(worst, 0.01);  // a bound that means something
}

TEST(PoseAt, SmallTurnsAreRightToTheLastBits) {
  Random random(7);
  for (int i = 0; i < 20000; ++i) {
    const Vec3 w = random_vector(random, random.between(0.2, 0.25));
    const Pose pose = pose_at({.angular_velocity_radps = w}, 1);
    for (std::size_t j = 0; j < 3; ++j) {
      Long3 axis{};
      axis[j] = 1;
      const Long3 expected = turned(w, 1, axis);
      for (std::size_t k = 0; k < 3; ++k)
        EXPECT_NEAR(pose.rotation[3 * k + j], double(expected[k]), 4 * 0x1p-53);
    }
  }
}

TEST(PoseAt, TurnsCounterClockwiseAboutTheAngularVelocity) {
  // A quarter turn about z takes x to y, and the body's origin along.
  const double quarter = 1.5707963267948966;
  const Motion motion{.linear_velocity_mps = {1, 0, 0}, .angular_velocity_radps = {0, 0, quarter}};
  const Pose pose = pose_at(motion, 1);
  EXPECT_NEAR(pose.rotation[3], 1, 1e-15);
  EXPECT_NEAR(pose.rotation[0], 0, 1e-15);
  EXPECT_EQ(pose.translation_m, (Vec3{1, 0, 0}));
}

// Also of turns that are nearly half a turn, whose sine is that of small ones.
TEST(MotionBetween, TakesAPoseToTheOther) {
  constexpr double kHalfTurn = 3.141592653589793;
  Random random(11);
  for (const double turn : {0.0, 1e-12, 1e-3, 0.3, 1.5, 1.6, 3.0, kHalfTurn - 1e-9, kHalfTurn})
    for (int i = 0; i < 200; ++i) {
      const double dt_s = random.between(0.01, 1);
      Motion motion = random_motion(random, 100, 1);
      if (turn == 0) motion.angular_velocity_radps = {};
      if (turn > 0) motion.angular_velocity_radps = random_vector(random, turn / dt_s);
      const Pose to = pose_at(motion, dt_s);
      const Motion found = motion_between(motion.pose, to, dt_s);
      EXPECT_EQ(found.pose.rotation, motion.pose.rotation);
      const Pose there = pose_at(found, dt_s);
      for (std::size_t k = 0; k < 9; ++k) EXPECT_NEAR(there.rotation[k], to.rotation[k], 1e-14);
      for (std::size_t k = 0; k < 3; ++k)
        EXPECT_NEAR(there.translation_m[k], to.translation_m[k], 1e-8);
      if (turn < 3) {
        for (std::size_t k = 0; k < 3; ++k)
          EXPECT_NEAR(found.angular_velocity_radps[k] * dt_s,
                      motion.angular_velocity_radps[k] * dt_s, 1e-14);
      }
      if (turn == 0) {
        EXPECT_EQ(found.angular_velocity_radps, (Vec3{}));
      }
    }
}

TEST(PoseAt, RotationsAreOrthonormalToTheLastBitsAfterThousandsOfTurns) {
  Random random(4);
  for (int i = 0; i < 1000; ++i) {
    const auto r =
        pose_at({.angular_velocity_radps = random_vector(random, 1e5)}, random.between(-10, 10))
            .rotation;
    for (std::size_t p = 0; p < 3; ++p)
      for (std::size_t q = 0; q < 3; ++q)
        EXPECT_NEAR(r[p] * r[q] + r[3 + p] * r[3 + q] + r[6 + p] * r[6 + q], p == q ? 1 : 0, 2e-15);
  }
}

TEST(CheckMotion, RefusesByNameWhatIsNotFiniteOrHuge) {
  for (const double bad : {double(NAN), double(INFINITY), -double(INFINITY), 1e10, -1e308}) {
    for (std::size_t k = 0; k < 3; ++k) {
      Motion motion;
      motion.linear_velocity_mps[k] = bad;
      EXPECT_EQ(check_motion(motion, "rotor").code(), StatusCode::kInvalidArgument);
      EXPECT_NE(check_motion(motion, "rotor").message().find("rotor"), std::string::npos);
      motion = {};
      motion.angular_velocity_radps[k] = bad;
      EXPECT_EQ(check_motion(motion, "rotor").code(), StatusCode::kInvalidArgument);
      motion = {};
      motion.pose.rotation[k] = bad;
      EXPECT_EQ(check_motion(motion, "rotor").code(), StatusCode::kInvalidArgument);
    }
  }
  EXPECT_TRUE(check_motion({}, "rotor").is_ok());
}

// ---- bounds -------------------------------------------------------------------------------------

Grid random_grid(Random& random) {
  Grid grid{.exponent = -int(random.below(20)), .bits = 21};
  for (double& x : grid.origin_m)
    x = std::ldexp(std::floor(random.between(-0x1p21, 0x1p21)), grid.exponent);
  return grid;
}
GridPoint random_point(Random& random) {
  GridPoint p;
  for (int k = 0; k < 3; ++k) p[k] = std::int32_t(random.below(1U << 21));
  return p;
}
Long3 model_point(const Grid& grid, const GridPoint& p) {
  Long3 x;
  for (int k = 0; k < 3; ++k)
    x[std::size_t(k)] =
        grid.origin_m[std::size_t(k)] + std::ldexp((long double)p[k], grid.exponent);
  return x;
}
/// Where the motion truly takes a model's point.
Long3 true_place(const Motion& motion, double t, const Long3& x) {
  Long3 from{}, out;
  for (std::size_t r = 0; r < 3; ++r)
    for (std::size_t c = 0; c < 3; ++c)
      from[r] += (long double)motion.pose.rotation[3 * r + c] * x[c];
  out = turned(motion.angular_velocity_radps, t, from);
  for (std::size_t k = 0; k < 3; ++k)
    out[k] += motion.pose.translation_m[k] + (long double)motion.linear_velocity_mps[k] * t;
  return out;
}
long double distance(const Long3& x, const Long3& y) {
  long double square = 0;
  for (std::size_t k = 0; k < 3; ++k) square += (x[k] - y[k]) * (x[k] - y[k]);
  return std::sqrt(square);
}

TEST(SpeedBound, NoPointOfTheBoxIsFaster) {
  Random random(5);
  double closest = 0;
  for (int i = 0; i < 2000; ++i) {
    const Grid grid = random_grid(random);
    GridBox box;
    box.add(random_point(random));
    box.add(random_point(random));
    const Motion motion = random_motion(random, i % 3 == 0 ? 0 : 10, i % 3 == 1 ? 0 : 5);
    const double bound = speed_bound_mps(motion, reach_m(grid, box));
    GridPoint corner;
    for (int k = 0; k < 3; ++k) corner[k] = random.below(2) == 0 ? box.lo[k] : box.hi[k];
    const Long3 x = model_point(grid, corner);
    const double t = random.between(0, 1), step = 1e-3;
    const long double way =
        distance(true_place(motion, t, x), true_place(motion, t + step, x)) / step;
    EXPECT_LE(way, bound * (1 + 1e-9));
    closest = std::max(closest, double(way) / bound);
  }
  EXPECT_GT(closest, 0.99);
}

TEST(PosingError, PosedVerticesStayWithinItOfTheTrueMotion) {
  Random random(6);
  double closest = 0;
  for (int i = 0; i < 20000; ++i) {
    Grid grid = random_grid(random);
    if (i % 2 != 0)  // it shares a lattice
      for (std::int64_t& cells : grid.lattice_cells)
        cells = std::int64_t(random.below(1U << 31)) >> random.below(20);
    Motion motion = random_motion(random, 10, std::exp2(random.between(-3, 12)));
    const double scale = std::ldexp(1.0, grid.exponent + 21);
    motion.pose.translation_m = random_vector(random, scale * std::exp2(random.between(-3, 3)));
    const GridPoint p = random_point(random);
    GridBox box;
    box.add(p);
    const double duration = random.between(0.1, 10), t = random.between(0, duration);
    const int lattice = grid.exponent - 2;
    const PosedFrame frame = make_posed_frame(grid, pose_at(motion, t), lattice).value();
    Long3 posed;
    for (int k = 0; k < 3; ++k)
      posed[std::size_t(k)] = std::ldexp((long double)pose_point(frame, p)[k], lattice);
    const double bound = posing_error_m(motion, reach_m(grid, box), duration, grid, lattice);
    const double share =
        double(distance(posed, true_place(motion, t, model_point(grid, p)))) / bound;
    EXPECT_LE(share, 1);
    closest = std::max(closest, share);
  }
  EXPECT_GT(closest, 0.6);
}

}  // namespace
}  // namespace nearmesh
