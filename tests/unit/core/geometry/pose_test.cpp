// SPDX-License-Identifier: Apache-2.0
// The pose guard, the lattice of a pair, and the fixed-point posed vertex.
#include "nearmesh/core/geometry/pose.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "core/base/random.hpp"
#include "random_rotation.hpp"

namespace nearmesh {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInf = std::numeric_limits<double>::infinity();

using test::random_rotation;

GridPoint random_point(Random& random, int bits) {
  const auto bound = static_cast<std::uint32_t>(std::uint64_t{1} << bits);
  GridPoint p;
  for (int k = 0; k < 3; ++k) p[k] = static_cast<std::int32_t>(random.below(bound));
  return p;
}

PosedFrame frame_of(const Grid& grid, const Pose& pose, int lattice_exp) {
  Result<PosedFrame> frame = make_posed_frame(grid, pose, lattice_exp);
  EXPECT_TRUE(frame.is_ok()) << frame.status().message();
  return frame.is_ok() ? frame.value() : PosedFrame{};
}

void expect_refused(const Pose& pose, const std::string& reason) {
  const Status status = check_pose(pose, "excavator-7");
  EXPECT_EQ(status.code(), StatusCode::kInvalidArgument);
  EXPECT_NE(status.message().find("excavator-7"), std::string::npos) << status.message();
  EXPECT_NE(status.message().find(reason), std::string::npos) << status.message();
}

TEST(CheckPose, AcceptsRandomRotations) {
  Random random(1);
  for (int i = 0; i < 1000; ++i) {
    const Pose pose{random_rotation(random), {random.between(-1e8, 1e8), 0, 1}};
    EXPECT_TRUE(check_pose(pose, "body").is_ok()) << check_pose(pose, "body").message();
  }
}

TEST(CheckPose, AcceptsSinglePrecisionRotation) {
  Random random(2);
  Pose pose{random_rotation(random), {}};
  for (double& entry : pose.rotation) entry = static_cast<float>(entry);
  EXPECT_TRUE(check_pose(pose, "body").is_ok());
}

TEST(CheckPose, RefusesEveryNonFiniteRotationEntry) {
  for (std::size_t i = 0; i < 9; ++i)
    for (const double bad : {kNan, kInf, -kInf}) {
      Pose pose;
      pose.rotation[i] = bad;
      expect_refused(pose, "rotation[" + std::to_string(i) + "]");
    }
}

TEST(CheckPose, RefusesEveryNonFiniteTranslation) {
  for (std::size_t i = 0; i < 3; ++i)
    for (const double bad : {kNan, kInf, -kInf, 1e308, -1e308}) {
      Pose pose;
      pose.translation_m[i] = bad;
      expect_refused(pose, "translation_m[" + std::to_string(i) + "]");
    }
}

TEST(CheckPose, RefusesHugeRotationEntry) {
  for (std::size_t i = 0; i < 9; ++i) {
    Pose pose;
    pose.rotation[i] = 1e308;
    expect_refused(pose, "orthonormal");
  }
}

TEST(CheckPose, RefusesTranslationLongerThanTheLimit) {
  Pose pose;
  pose.translation_m = {6e8, 6e8, 6e8};  // each entry is within the limit, the length is not
  expect_refused(pose, "1e9");
}

TEST(CheckPose, AcceptsTranslationAtTheLimit) {
  EXPECT_TRUE(check_pose({.rotation = Pose{}.rotation, .translation_m = {1e9, 0, 0}}, "b").is_ok());
}

TEST(CheckPose, RefusesScale) {
  Pose pose;
  for (double& entry : pose.rotation) entry *= 1.0001;
  expect_refused(pose, "orthonormal");
}

TEST(CheckPose, RefusesShear) {
  Pose pose;
  pose.rotation[1] = 1e-4;
  expect_refused(pose, "orthonormal");
}

TEST(CheckPose, RefusesReflection) {
  Pose pose;
  pose.rotation[8] = -1;
  expect_refused(pose, "reflection");
}

TEST(CheckPose, RefusesZeroMatrix) {
  expect_refused({.rotation = {}, .translation_m = {}}, "orthonormal");
}

TEST(LatticeExponent, QuartersTheFinerCell) {
  EXPECT_EQ(lattice_exponent({{}, -20, 21}, {{}, -17, 21}), -22);
}

TEST(LatticeExponent, NeverLetsAModelSpanMoreThan2To38Cells) {
  EXPECT_EQ(lattice_exponent({{}, -20, 21}, {{}, 5, 31}), -2);
}

TEST(LatticeExponent, IsSymmetric) {
  Random random(3);
  for (int i = 0; i < 1000; ++i) {
    const Grid a{
        {}, static_cast<int>(random.below(80)) - 40, 4 + static_cast<int>(random.below(28))};
    const Grid b{
        {}, static_cast<int>(random.below(80)) - 40, 4 + static_cast<int>(random.below(28))};
    EXPECT_EQ(lattice_exponent(a, b), lattice_exponent(b, a));
  }
}

TEST(MakePosedFrame, RoundsRotationToTheNearest) {
  Random random(8);
  for (int i = 0; i < 100; ++i) {
    const Pose pose{random_rotation(random), {}};
    const PosedFrame frame = frame_of({{}, 0, 21}, pose, 0);
    for (std::size_t k = 0; k < 9; ++k)
      EXPECT_LE(std::abs(static_cast<double>(frame.rotation[k]) - pose.rotation[k] * 0x1p30), 0.5);
  }
}

TEST(MakePosedFrame, RoundsOriginAndTranslationTogether) {
  // Cells of 2 m. 3 + 2.2 = 5.2 m and -3 - 2.2 m: the nearest cells are 3 and -3. 1 m: half up.
  const Grid grid{{3, -3, 0}, 0, 21};
  const PosedFrame frame = frame_of(grid, {Pose{}.rotation, {2.2, -2.2, 1}}, 1);
  EXPECT_EQ(frame.translation, (std::array<std::int64_t, 3>{3, -3, 1}));
}

TEST(MakePosedFrame, RefusesTranslationBeyondTheLattice) {
  const Grid fine{{}, -60, 21};
  const Pose pose{Pose{}.rotation, {1e6, 0, 0}};
  EXPECT_EQ(make_posed_frame(fine, pose, -62).status().code(), StatusCode::kUnsupported);
}

TEST(MakePosedFrame, RefusesOriginBeyondTheLattice) {
  const Grid far{{1e300, -1e300, 1e300}, 0, 21};
  Random random(4);
  EXPECT_EQ(make_posed_frame(far, {random_rotation(random), {}}, -2).status().code(),
            StatusCode::kUnsupported);
}

TEST(MakePosedFrame, RefusesLatticeTooFineForTheModel) {
  EXPECT_EQ(make_posed_frame({{}, 0, 31}, {}, -8).status().code(), StatusCode::kUnsupported);
}

TEST(MakePosedFrame, RefusesAModelThatIsNothingBesideTheOther) {
  const Grid tiny{{}, -200, 21}, huge{{}, 12, 21};
  EXPECT_TRUE(make_posed_frame({{}, -105, 21}, {}, lattice_exponent({{}, -105, 21}, huge)).is_ok());
  const auto refused = make_posed_frame(tiny, {}, lattice_exponent(tiny, huge));
  EXPECT_EQ(refused.status().code(), StatusCode::kUnsupported);
  EXPECT_NE(refused.status().message().find("2^-200 m is too small"), std::string::npos)
      << refused.status().message();
}

TEST(PosePoint, IdentityScalesToTheLattice) {
  const PosedFrame frame = frame_of({{0.5, -0.25, 3}, -3, 10}, {}, -5);
  EXPECT_EQ(pose_point(frame, {{7, 0, 1}}), (LatticePoint{{16 + 28, -8, 96 + 4}}));
}

TEST(PosePoint, QuarterTurnsAreExact) {
  const Grid grid{{-2, 1, 0.5}, -10, 21};
  const Pose turn{{0, -1, 0, 1, 0, 0, 0, 0, 1}, {10, 20, 30}};
  const PosedFrame frame = frame_of(grid, turn, -12);
  Random random(5);
  for (int i = 0; i < 100; ++i) {
    const GridPoint p = random_point(random, 21);
    // x_world = (-y + 10, x + 20, z + 30), in cells of 2^-12 m
    EXPECT_EQ(pose_point(frame, p),
              (LatticePoint{{-(4096 + 4L * p[1]) + 40960, (-8192 + 4L * p[0]) + 81920,
                             (2048 + 4L * p[2]) + 122880}}));
  }
}

TEST(PosePoint, TranslationByWholeCellsShiftsExactly) {
  Random random(6);
  for (int i = 0; i < 2000; ++i) {
    const int exponent = -static_cast<int>(random.below(21));
    const Grid grid{
        {std::ldexp(random.below(1000), exponent), -3, std::ldexp(7, exponent)}, exponent, 21};
    Pose pose{random_rotation(random), {}};
    for (double& t : pose.translation_m)  // 20 bits below the lattice cell, 2^23 cells above
      t = std::ldexp(static_cast<double>(random.below(1U << 31)), exponent - 22);
    const int lattice_exp = lattice_exponent(grid, grid);
    const PosedFrame before = frame_of(grid, pose, lattice_exp);
    std::array<std::int64_t, 3> cells;
    for (std::size_t k = 0; k < 3; ++k) {
      cells[k] = static_cast<std::int64_t>(random.below(1U << 31)) - (1 << 30);
      pose.translation_m[k] += std::ldexp(static_cast<double>(cells[k]), lattice_exp);
    }
    const PosedFrame after = frame_of(grid, pose, lattice_exp);
    const GridPoint p = random_point(random, 21);
    LatticePoint expected = pose_point(before, p);
    for (std::size_t k = 0; k < 3; ++k) expected.v[k] += cells[k];
    EXPECT_EQ(pose_point(after, p), expected);
  }
}

TEST(PosePoint, StaysWithinHalfACellOfTheAffineImage) {
  Random random(7);
  for (int i = 0; i < 20000; ++i) {
    const int bits = 4 + static_cast<int>(random.below(28));
    const int gap = static_cast<int>(random.below(static_cast<std::uint32_t>(90 - bits))) - 50;
    const Grid grid{{}, 0, bits};
    const int lattice_exp = -std::min(gap, 38 - bits);
    const PosedFrame frame = frame_of(grid, {random_rotation(random), {}}, lattice_exp);
    const GridPoint p = random_point(random, bits);
    const LatticePoint posed = pose_point(frame, p);
    for (int k = 0; k < 3; ++k) {
      long double exact = 0;
      for (int j = 0; j < 3; ++j)
        exact +=
            static_cast<long double>(frame.rotation[static_cast<std::size_t>(3 * k + j)]) * p[j];
      exact = std::ldexp(exact, -frame.shift);
      EXPECT_LE(std::abs(static_cast<long double>(posed[k]) - exact), 0.5L)
          << "bits " << bits << " lattice_exp " << lattice_exp;
    }
  }
}

/// Two grids of one lattice that hold the same points, at different coordinates.
struct Neighbours {
  Grid one, other;
  // What a point's coordinates in `other` are less than in `one`.
  std::array<std::int32_t, 3> apart{};
};
Neighbours random_neighbours(Random& random, int exponent) {
  Neighbours out;
  std::array<double, 3> origin{};
  out.one = out.other = {.exponent = exponent, .bits = 21};
  const int far_bits = 1 + static_cast<int>(random.below(31));
  for (std::size_t k = 0; k < 3; ++k) {
    origin[k] = static_cast<double>(random.below(1U << 31)) * (random.below(3) - 1.0);
    std::int64_t& cells = out.one.lattice_cells[k];
    cells = random.below(1U << far_bits) - (std::int64_t{1} << (far_bits - 1));
    out.apart[k] = static_cast<std::int32_t>(random.below(1U << 20));
    out.other.lattice_cells[k] = cells + out.apart[k];
    const auto place = [&](Grid& grid) {
      grid.origin_m[k] =
          std::ldexp(origin[k] + static_cast<double>(grid.lattice_cells[k]), exponent);
    };
    place(out.one);
    place(out.other);
  }
  return out;
}

// The seam of two tiles: at rest, turned, geocentric, and beside other models of any size.
TEST(PosePoint, PlacesPointsOfOneLatticeAlikeWhoeverHoldsThem) {
  Random random(41);
  std::size_t alone_alike = 0;
  for (int i = 0; i < 20'000; ++i) {
    const int exponent = -static_cast<int>(random.below(15));
    const Neighbours n = random_neighbours(random, exponent);
    Pose pose{i % 10 == 0 ? Pose{}.rotation : random_rotation(random), {}};
    const double far_m = std::ldexp(1.0, static_cast<int>(random.below(24)));
    for (double& t : pose.translation_m) t = random.between(-far_m, far_m);
    const int finer = static_cast<int>(random.below(48)) - 17;  // the lattice than the cell
    const int lattice_exp = exponent - std::min(finer, 17);
    const PosedFrame a = frame_of(n.one, pose, lattice_exp),
                     b = frame_of(n.other, pose, lattice_exp);
    Grid own_a = n.one, own_b = n.other;
    own_a.lattice_cells = own_b.lattice_cells = {};
    const PosedFrame alone_a = frame_of(own_a, pose, lattice_exp),
                     alone_b = frame_of(own_b, pose, lattice_exp);
    GridPoint p = random_point(random, 20), q;
    for (int k = 0; k < 3; ++k) {
      p[k] += 1 << 20;  // both grids hold it
      q[k] = p[k] - n.apart[static_cast<std::size_t>(k)];
    }
    ASSERT_EQ(pose_point(a, p), pose_point(b, q));
    alone_alike += pose_point(alone_a, p) == pose_point(alone_b, q) ? 1 : 0;
    // In either frame within half a cell of its affine image.
    for (std::size_t k = 0; k < 3; ++k) {
      long double exact = static_cast<long double>(a.remainder[k]);
      for (std::size_t j = 0; j < 3; ++j)
        exact += static_cast<long double>(a.rotation[3 * k + j]) * p.v[j];
      exact = std::ldexp(exact, -a.shift) + static_cast<long double>(a.translation[k]);
      EXPECT_LE(std::abs(static_cast<long double>(pose_point(a, p).v[k]) - exact), 0.5L);
    }
  }
  EXPECT_LT(alone_alike, 20'000U / 3) << "without a common lattice, seams gape";
}

TEST(PosePoint, FarthestTilesDoNotOverflow) {
  const double a = 1 / std::sqrt(3.0), b = 1 / std::sqrt(2.0), c = 1 / std::sqrt(6.0);
  const Pose pose{{a, a, a, b, -b, 0, c, c, -2 * c}, {}};
  Grid far{.origin_m = {0x1p31, 0x1p31, 0x1p31}, .exponent = 0, .bits = 31};
  far.lattice_cells = {kMaxLatticeCells, kMaxLatticeCells, kMaxLatticeCells};
  const std::int32_t top = std::numeric_limits<std::int32_t>::max();
  for (const int lattice_exp : {-7, -2, 0, 1, 30, 31}) {
    const LatticePoint posed = pose_point(frame_of(far, pose, lattice_exp), {{top, top, top}});
    EXPECT_NEAR(std::ldexp(static_cast<double>(posed[0]), lattice_exp), std::sqrt(3.0) * 0x1p32,
                16 + std::ldexp(1.0, lattice_exp));
  }
  EXPECT_EQ(make_posed_frame(far, pose, 32).status().code(), StatusCode::kUnsupported);
}

TEST(PosePoint, RoundsHalfUp) {
  const PosedFrame frame = frame_of({{}, 0, 21}, {}, 1);  // the lattice cell is two grid cells
  EXPECT_EQ(pose_point(frame, {{1, 2, 3}}), (LatticePoint{{1, 1, 2}}));
  const PosedFrame turned = frame_of({{}, 0, 21}, {{-1, 0, 0, 0, -1, 0, 0, 0, 1}, {}}, 1);
  EXPECT_EQ(pose_point(turned, {{1, 3, 5}}), (LatticePoint{{0, -1, 3}}));
}

TEST(PosePoint, ModelFarFinerThanTheLatticeCollapsesToItsOrigin) {
  const PosedFrame frame = frame_of({{0, 0, 0}, -60, 21}, {Pose{}.rotation, {5, 6, 7}}, 0);
  EXPECT_EQ(pose_point(frame, {{1 << 20, 1 << 20, 1 << 20}}), (LatticePoint{{5, 6, 7}}));
}

TEST(PosePoint, LargestGridAtFullTiltDoesNotOverflow) {
  // Row 0 along (1,1,1): the largest sum of products there is.
  const double a = 1 / std::sqrt(3.0);
  const double b = 1 / std::sqrt(2.0);
  const double c = 1 / std::sqrt(6.0);
  const Pose pose{{a, a, a, b, -b, 0, c, c, -2 * c}, {}};
  ASSERT_TRUE(check_pose(pose, "body").is_ok());
  const std::int32_t top = std::numeric_limits<std::int32_t>::max();
  const LatticePoint posed = pose_point(frame_of({{}, 0, 31}, pose, -7), {{top, top, top}});
  EXPECT_NEAR(static_cast<double>(posed[0]), std::sqrt(3.0) * 0x1p38, 1e4);
}

TEST(PoseBox, IsTheTightestAroundEveryPosedPoint) {
  Random random(23);
  for (int round = 0; round < 200; ++round) {
    Grid grid{{random.between(-9, 9), 0, 0}, -4, 8};
    double turn[9];
    for (double& x : turn) x = random.between(-1, 1);
    PosedFrame frame = make_posed_frame(grid, {}, -5 + static_cast<int>(random.below(3))).value();
    for (std::size_t i = 0; i < 9; ++i)
      frame.rotation[i] = static_cast<std::int64_t>(turn[i] * 0x1p30);
    GridBox box;
    for (int i = 0; i < 2; ++i) {
      GridPoint p;
      for (int k = 0; k < 3; ++k) p[k] = static_cast<std::int32_t>(random.below(6));
      box.add(p);
    }
    const LatticeBox bounds = pose_box(frame, box);
    LatticePoint lo, hi;
    bool first = true;
    for (std::int32_t x = box.lo[0]; x <= box.hi[0]; ++x)
      for (std::int32_t y = box.lo[1]; y <= box.hi[1]; ++y)
        for (std::int32_t z = box.lo[2]; z <= box.hi[2]; ++z) {
          const LatticePoint p = pose_point(frame, {{x, y, z}});
          for (int k = 0; k < 3; ++k) {
            lo[k] = first ? p[k] : std::min(lo[k], p[k]);
            hi[k] = first ? p[k] : std::max(hi[k], p[k]);
          }
          first = false;
        }
    EXPECT_EQ(bounds.lo, lo);
    EXPECT_EQ(bounds.hi, hi);
  }
}

TEST(Orthonormal, IsARotationWithinItsBoundAndKeepsTheBitsOfOne) {
  Random random(21);
  for (int i = 0; i < 2'000; ++i) {
    SCOPED_TRACE(i);
    Pose pose;
    pose.rotation = test::random_rotation(random);
    EXPECT_EQ(orthonormal(pose).rotation, pose.rotation);
    const bool by_floats = i % 2 == 0;
    const double off = std::ldexp(1.5, -19 - static_cast<int>(random.below(20)));
    for (double& x : pose.rotation)
      x = by_floats ? static_cast<double>(static_cast<float>(x)) : x + random.between(-off, off);
    ASSERT_TRUE(check_pose(pose, "it").is_ok());
    const Pose tidy = orthonormal(pose);
    double error = 0, left = 0, moved = 0;
    for (std::size_t a = 0; a < 3; ++a)
      for (std::size_t b = 0; b < 3; ++b) {
        double before = a == b ? -1 : 0, after = before;
        for (std::size_t k = 0; k < 3; ++k) {
          before += pose.rotation[3 * k + a] * pose.rotation[3 * k + b];
          after += tidy.rotation[3 * k + a] * tidy.rotation[3 * k + b];
        }
        error += before * before;
        left = std::max(left, std::abs(after));
        const double change = tidy.rotation[3 * a + b] - pose.rotation[3 * a + b];
        moved += change * change;
      }
    EXPECT_LE(left, 0x1p-40);
    // The most that a point at distance 1 can move is the norm of the change: by a power step on
    // its square, at most its Frobenius norm.
    std::array<double, 3> x{random.between(-1, 1), random.between(-1, 1), random.between(-1, 1)};
    double most = 0;
    for (int step = 0; step < 40; ++step) {
      std::array<double, 3> y{}, z{};
      for (std::size_t a = 0; a < 3; ++a)
        for (std::size_t b = 0; b < 3; ++b)
          y[a] += (tidy.rotation[3 * a + b] - pose.rotation[3 * a + b]) * x[b];
      for (std::size_t a = 0; a < 3; ++a)
        for (std::size_t b = 0; b < 3; ++b)
          z[b] += (tidy.rotation[3 * a + b] - pose.rotation[3 * a + b]) * y[a];
      const double of_x = std::sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2]);
      most = std::sqrt(y[0] * y[0] + y[1] * y[1] + y[2] * y[2]) / of_x;
      const double of_z = std::sqrt(z[0] * z[0] + z[1] * z[1] + z[2] * z[2]);
      if (of_z == 0) break;
      for (std::size_t k = 0; k < 3; ++k) x[k] = z[k] / of_z;
    }
    EXPECT_LE(most, 0.51 * std::sqrt(error) + 1e-15);
    if (by_floats) {
      EXPECT_LE(most, 1e-7);
      EXPECT_LE(std::sqrt(moved), 1e-7);
    }
    EXPECT_EQ(orthonormal(tidy).rotation, tidy.rotation);
    EXPECT_EQ(tidy.translation_m, pose.translation_m);
  }
}

void expect_quaternion(const std::array<double, 9>& rotation) {
  const std::array<double, 4> q = quaternion_of_rotation(rotation);
  const double numbers[4] = {q[0], q[1], q[2], q[3]};
  EXPECT_GE(q[0], 0);
  const std::array<double, 9> back = test::rotation_of(numbers, 1);
  for (std::size_t i = 0; i < 9; ++i) EXPECT_NEAR(back[i], rotation[i], 1e-12) << i;
}

TEST(Quaternion, IsThatOfTheRotation) {
  Random random(1);
  for (int i = 0; i < 1000; ++i) expect_quaternion(test::random_rotation(random));
  // Half turns, where a part of the quaternion that others would divide by is 0.
  expect_quaternion({1, 0, 0, 0, 1, 0, 0, 0, 1});
  expect_quaternion({1, 0, 0, 0, -1, 0, 0, 0, -1});
  expect_quaternion({-1, 0, 0, 0, 1, 0, 0, 0, -1});
  expect_quaternion({-1, 0, 0, 0, -1, 0, 0, 0, 1});
  expect_quaternion({0, 1, 0, 1, 0, 0, 0, 0, -1});
}

}  // namespace
}  // namespace nearmesh
