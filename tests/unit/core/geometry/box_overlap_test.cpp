// SPDX-License-Identifier: Apache-2.0
// Boxes and triangles of posed models: never "apart" across a contact, never a gap above the truth,
// and still sharp. The hard poses are found by bisection: the last lattice step that still touches.
#include "nearmesh/core/geometry/detail/lanes.hpp"

#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <iostream>
#include <limits>

#include "core/base/random.hpp"
#include "core/geometry/triangle_overlap.hpp"
#include "instruction_sets.hpp"
#include "rounds.hpp"

namespace nearmesh {
namespace {

using GridTriangle = std::array<GridPoint, 3>;

struct Scene {
  PosedFrame a;
  PosedFrame b;
  GridTriangle in_a;
  GridTriangle in_b;
};

std::int32_t below(Random& random, int bits) {
  return static_cast<std::int32_t>(random.next() & ((std::uint64_t{1} << bits) - 1));
}

/// Identity, quarter turns, slight tilts of these (near-parallel edges) and any rotation.
std::array<double, 9> some_rotation(Random& random) {
  double q[4] = {random.between(-1, 1), random.between(-1, 1), random.between(-1, 1),
                 random.between(-1, 1)};
  const std::uint32_t kind = random.below(4);
  if (kind < 3) {
    for (double& x : q) x = random.below(2);
    if (kind == 1)
      for (double& x : q)
        x += random.between(-1, 1) * std::ldexp(1, -static_cast<int>(random.below(40)));
  }
  double norm = 0;
  for (const double x : q) norm += x * x;
  if (norm < 1e-3) return Pose{}.rotation;
  const double s = 2 / norm;
  const auto [w, x, y, z] = q;
  std::array<double, 9> r{
      1 - s * (y * y + z * z), s * (x * y - w * z),     s * (x * z + w * y),
      s * (x * y + w * z),     1 - s * (x * x + z * z), s * (y * z - w * x),
      s * (x * z - w * y),     s * (y * z + w * x),     1 - s * (x * x + y * y)};
  if (random.below(4) == 0)  // as far from orthonormal as check_pose allows
    for (double& entry : r) entry *= random.below(2) ? 1 + 4.5e-6 : 1 - 4.5e-6;
  if (!check_pose({r, {}}, "b").is_ok()) return Pose{}.rotation;
  return r;
}

GridTriangle some_triangle(Random& random, int bits) {
  const int size = 1 + static_cast<int>(random.below(static_cast<std::uint32_t>(bits)));
  GridTriangle t;
  const std::int32_t room =
      static_cast<std::int32_t>((std::int64_t{1} << bits) - (std::int64_t{1} << size));
  const bool flat = random.below(2) == 0;  // in a face of its box
  const int axis = static_cast<int>(random.below(3));
  for (int k = 0; k < 3; ++k) {
    const std::int32_t base = room > 0 ? below(random, bits) % room : 0;
    for (GridPoint& p : t) p[k] = base + below(random, size);
    if (flat && k == axis)
      for (GridPoint& p : t) p[k] = base;
  }
  return t;
}

PosedFrame some_frame(Random& random, const Grid& grid, int lattice_exp) {
  Pose pose{some_rotation(random), {}};
  return make_posed_frame(grid, pose, lattice_exp).value();
}

Scene some_scene(Random& random, int bits) {
  const Grid grid_a{{}, -16, bits};
  const Grid grid_b{{}, -16 + static_cast<int>(random.below(9)) - 4, bits};
  const int e = lattice_exponent(grid_a, grid_b);
  return {some_frame(random, grid_a, e), some_frame(random, grid_b, e), some_triangle(random, bits),
          some_triangle(random, bits)};
}

CenteredBox box_around(const GridTriangle& t) {
  GridBox box;
  for (const GridPoint& p : t) box.add(p);
  return centered(box);
}

bool in_contact(const Scene& s) {
  return triangles_overlap(pose_triangle(s.a, s.in_a), pose_triangle(s.b, s.in_b));
}

std::int64_t random_cells(Random& random, int bits) {
  return static_cast<std::int64_t>(random.next() & ((std::uint64_t{1} << bits) - 1)) -
         (std::int64_t{1} << (bits - 1));
}

/// Moves b so that one of its posed corners falls on one of a's, then along a random direction to
/// the last step that still touches; both then far away together.
void move_to_last_contact(Random& random, Scene& s) {
  const LatticePoint target = pose_point(s.a, s.in_a[random.below(3)]);
  const LatticePoint corner = pose_point(s.b, s.in_b[random.below(3)]);
  std::array<std::int64_t, 3> start;
  for (std::size_t k = 0; k < 3; ++k) start[k] = s.b.translation[k] + target.v[k] - corner.v[k];
  const std::array<double, 3> direction{random.between(-1, 1) * random.below(2),
                                        random.between(-1, 1) * random.below(2),
                                        random.between(-1, 1) * random.below(2)};
  const auto step = [&](std::int64_t n) {
    for (std::size_t k = 0; k < 3; ++k)
      s.b.translation[k] = start[k] + std::llround(direction[k] * static_cast<double>(n));
    return in_contact(s);
  };
  std::int64_t lo = 0;
  std::int64_t hi = std::int64_t{1} << 40;
  while (hi - lo > 1) {
    const std::int64_t mid = (lo + hi) / 2;
    (step(mid) ? lo : hi) = mid;
  }
  step(lo);
  for (std::size_t k = 0; k < 3; ++k) {
    const std::int64_t together = random_cells(random, 1 + static_cast<int>(random.below(58)));
    s.a.translation[k] += together;
    s.b.translation[k] += together;
  }
}

/// Boundary poses of many scenes; `check` sees each.
template <class Check>
void for_each_last_contact(std::uint64_t seed, const Check& check) {
  std::cout << "seed " << seed << '\n';
  Random random(seed);
  for (const int bits : {4, 10, 16, 21, 26, 31})
    for (int i = 0; i < test::rounds(4000); ++i) {
      Scene scene = some_scene(random, bits);
      move_to_last_contact(random, scene);
      ASSERT_TRUE(in_contact(scene));
      check(scene);
      if (::testing::Test::HasFailure()) FAIL() << "bits " << bits << " scene " << i;
    }
}

TEST(BoxesApart, NeverAcrossAContact) {
  for_each_last_contact(21, [](const Scene& s) {
    const CenteredBox a = box_around(s.in_a);
    const CenteredBox b = box_around(s.in_b);
    EXPECT_FALSE(boxes_apart(make_relative_frame(s.a, s.b), a, b));
    EXPECT_FALSE(boxes_apart(make_relative_frame(s.b, s.a), b, a));
  });
}

GridBox grid_box_of(const GridTriangle& t) {
  GridBox box;
  for (const GridPoint& p : t) box.add(p);
  return box;
}

TEST(BallsApart, NeverAcrossAContact) {
  for_each_last_contact(31, [](const Scene& s) {
    EXPECT_FALSE(balls_apart(s.a, grid_box_of(s.in_a), s.b, grid_box_of(s.in_b)));
    EXPECT_FALSE(balls_apart(s.b, grid_box_of(s.in_b), s.a, grid_box_of(s.in_a)));
  });
}

TEST(BallsApart, OnlyWhereBoxesAreFromTheFirstStepOn) {
  Random random(32);
  for_each_last_contact(32, [&random](Scene s) {
    const GridBox a = grid_box_of(s.in_a), b = grid_box_of(s.in_b);
    const std::array<double, 3> direction{random.between(-1, 1), random.between(-1, 1),
                                          random.between(-1, 1)};
    const auto start = s.b.translation;
    const auto is_apart = [&](std::int64_t n) {
      for (std::size_t k = 0; k < 3; ++k)
        s.b.translation[k] = start[k] + std::llround(direction[k] * static_cast<double>(n));
      return balls_apart(s.a, a, s.b, b);
    };
    std::int64_t near = 0, far = std::int64_t{1} << 45;
    if (!is_apart(far)) return;  // a direction of hardly any length
    while (far - near > 1) {
      const std::int64_t mid = (near + far) / 2;
      (is_apart(mid) ? far : near) = mid;
    }
    ASSERT_TRUE(is_apart(far));
    EXPECT_TRUE(boxes_apart(make_relative_frame(s.a, s.b), centered(a), centered(b)));
    EXPECT_TRUE(boxes_apart(make_relative_frame(s.b, s.a), centered(b), centered(a)));
  });
}

TEST(BallsApart, WhereTheWayIsSomeLongerThanBothRadii) {
  const Grid grid{{}, -16, 21};
  const PosedFrame a = make_posed_frame(grid, {}, lattice_exponent(grid, grid)).value();
  PosedFrame b = a;
  const GridBox box{{{-1000, -1000, -1000}}, {{1000, 1000, 1000}}};
  const std::int64_t unit = std::int64_t{1} << (30 - a.shift);
  b.translation[1] = 3468 * unit;  // twice 1000 sqrt(3) is 3464.1
  EXPECT_FALSE(balls_apart(a, box, b, box));
  b.translation[1] = 3472 * unit;
  EXPECT_TRUE(balls_apart(a, box, b, box));
}

TEST(BoxesGap, ZeroAcrossAContact) {
  for_each_last_contact(22, [](const Scene& s) {
    EXPECT_EQ(boxes_gap_m(make_relative_frame(s.a, s.b), box_around(s.in_a), box_around(s.in_b)),
              0);
  });
}

TEST(BoxTriangleApart, NeverAcrossAContact) {
  for_each_last_contact(23, [](const Scene& s) {
    const RelativeFrame ab = make_relative_frame(s.a, s.b);
    EXPECT_FALSE(box_triangle_apart(ab, box_around(s.in_a), to_a_units(ab, s.in_b)));
    const RelativeFrame ba = make_relative_frame(s.b, s.a);
    EXPECT_FALSE(box_triangle_apart(ba, box_around(s.in_b), to_a_units(ba, s.in_a)));
  });
}

/// The tightest half-space of a triangle, about as long as a stored one.
BoundedPart half_space_around(const std::array<GridPoint, 3>& t,
                              const std::array<double, 3>& towards) {
  BoundedPart part;
  const auto normal = make_slab_normal(towards);
  for (std::size_t k = 0; k < 3; ++k) part.normal[k] = normal[k];
  part.bound = -1e300;
  for (const GridPoint& p : t) {
    double at = 0;
    for (std::size_t k = 0; k < 3; ++k) at += part.normal[k] * p.v[k];
    part.bound = std::max(part.bound, at);
  }
  return part;
}

// Directions: at random, and that from one triangle to the other, along which they are nearly
// parted.
TEST(HalfSpaceApart, NeverAcrossAContact) {
  Random random(25);
  for_each_last_contact(25, [&](const Scene& s) {
    for (const bool swapped : {false, true}) {
      const RelativeFrame f =
          swapped ? make_relative_frame(s.b, s.a) : make_relative_frame(s.a, s.b);
      const auto &own = swapped ? s.in_b : s.in_a, &other = swapped ? s.in_a : s.in_b;
      const DoubleTriangle there = to_a_units(f, other);
      for (int i = 0; i < 4; ++i) {
        std::array<double, 3> towards{};
        for (std::size_t k = 0; k < 3; ++k)
          towards[k] = i == 0 ? there[0][k] + there[1][k] + there[2][k] - own[0].v[k] -
                                    own[1].v[k] - own[2].v[k]
                              : random.between(-1, 1);
        if (std::abs(towards[0]) + std::abs(towards[1]) + std::abs(towards[2]) < 1e-6)
          towards[0] = 1;
        const BoundedPart part = half_space_around(own, towards);
        EXPECT_FALSE(half_space_triangle_stay_apart(f, {}, part, there));
        EXPECT_FALSE(half_space_box_stay_apart(f, {}, part, box_around(other)));
      }
    }
  });
}

TEST(HalfSpaceApart, JustWhereTheOtherIsBeyondThePlaneByMoreThanTheSlack) {
  Random random(26);
  int boxes = 0;
  for (int i = 0; i < 20000; ++i) {
    const Grid grid{.exponent = -16, .bits = 21};
    const PosedFrame frame = make_posed_frame(grid, {}, -18).value();
    const RelativeFrame f = make_relative_frame(frame, frame);
    const auto point = [&] {
      GridPoint p;
      for (int k = 0; k < 3; ++k) p[k] = static_cast<std::int32_t>(random.below(1000));
      return p;
    };
    const std::array<GridPoint, 3> a{point(), point(), point()}, b{point(), point(), point()};
    const BoundedPart part = half_space_around(
        a, {random.between(-1, 1), random.between(-1, 1), random.between(0.1, 1)});
    double least = 1e300, length = 0;
    for (std::size_t k = 0; k < 3; ++k) length += std::abs(part.normal[k]);
    for (const GridPoint& p : b)
      least =
          std::min(least, part.normal[0] * p[0] + part.normal[1] * p[1] + part.normal[2] * p[2]);
    const double beyond = least - part.bound;
    const bool apart = half_space_triangle_stay_apart(f, {}, part, to_a_units(f, b));
    EXPECT_EQ(apart, beyond > f.slack * length) << beyond;
    const bool box_apart = half_space_box_stay_apart(f, {}, part, box_around(b));
    EXPECT_LE(box_apart, apart);
    boxes += box_apart ? 1 : 0;
    // A drift as far as the way between them is the end of it.
    Drift drift;
    drift.around = beyond / length;
    EXPECT_FALSE(half_space_triangle_stay_apart(f, drift, part, to_a_units(f, b)));
  }
  EXPECT_GT(boxes, 100);
}

TEST(TrianglesGap, ZeroAcrossAContact) {
  for_each_last_contact(24, [](const Scene& s) {
    const RelativeFrame f = make_relative_frame(s.a, s.b);
    EXPECT_EQ(triangles_gap_m(f, as_doubles(s.in_a), to_a_units(f, s.in_b)), 0);
  });
}

// ---- Gaps against sampled distances
// --------------------------------------------------------------

/// Distance in metres of the posed triangles by alternating projection in long double: from above.
long double distance_from_above_m(const Scene& s) {
  using Point = std::array<long double, 3>;
  const LatticeTriangle ta = pose_triangle(s.a, s.in_a);
  const LatticeTriangle tb = pose_triangle(s.b, s.in_b);
  const auto relative = [&](const LatticePoint& p) {
    Point out;
    for (std::size_t k = 0; k < 3; ++k) out[k] = static_cast<long double>(p.v[k] - ta[0].v[k]);
    return out;
  };
  const std::array<std::array<Point, 3>, 2> t{
      {{relative(ta[0]), relative(ta[1]), relative(ta[2])},
       {relative(tb[0]), relative(tb[1]), relative(tb[2])}}};
  const auto at = [](const std::array<Point, 3>& tri, long double x, long double y) {
    Point p;
    for (std::size_t k = 0; k < 3; ++k)
      p[k] = tri[0][k] + x * (tri[1][k] - tri[0][k]) + y * (tri[2][k] - tri[0][k]);
    return p;
  };
  const auto distance = [](const Point& p, const Point& q) {
    long double sum = 0;
    for (std::size_t k = 0; k < 3; ++k) sum += (p[k] - q[k]) * (p[k] - q[k]);
    return std::sqrt(sum);
  };
  // Pattern search over the four barycentric coordinates; the distance is convex in them.
  std::array<long double, 4> best{1.0L / 3, 1.0L / 3, 1.0L / 3, 1.0L / 3};
  const auto value = [&](const std::array<long double, 4>& c) {
    return distance(at(t[0], c[0], c[1]), at(t[1], c[2], c[3]));
  };
  long double least = value(best);
  for (long double step = 0.25L; step > 1e-5L;) {
    bool better = false;
    for (int code = 1; code < 81; ++code) {
      std::array<long double, 4> next = best;
      for (int k = 0, rest = code; k < 4; ++k, rest /= 3)
        next[static_cast<std::size_t>(k)] += step * (rest % 3 - 1);
      if (next[0] < 0 || next[1] < 0 || next[0] + next[1] > 1 || next[2] < 0 || next[3] < 0 ||
          next[2] + next[3] > 1)
        continue;
      const long double found = value(next);
      if (found < least) {
        least = found;
        best = next;
        better = true;
      }
    }
    if (!better) step /= 2;
  }
  return std::ldexp(least, s.a.lattice_exp);
}

/// Free scenes at every scale of distance: from the last contact outward.
template <class Check>
void for_each_free_scene(std::uint64_t seed, const Check& check) {
  std::cout << "seed " << seed << '\n';
  Random random(seed);
  for (const int bits : {4, 12, 21, 31})
    for (int i = 0; i < test::rounds(150); ++i) {
      Scene scene = some_scene(random, bits);
      move_to_last_contact(random, scene);
      for (std::size_t k = 0; k < 3; ++k)
        scene.b.translation[k] += random_cells(random, 2 + static_cast<int>(random.below(39)));
      if (in_contact(scene)) continue;
      check(scene, distance_from_above_m(scene));
      if (::testing::Test::HasFailure()) FAIL() << "bits " << bits << " scene " << i;
    }
}

TEST(TrianglesGap, NeverAboveTheDistance) {
  for_each_free_scene(25, [](const Scene& s, long double distance_m) {
    const RelativeFrame f = make_relative_frame(s.a, s.b);
    EXPECT_LE(triangles_gap_m(f, as_doubles(s.in_a), to_a_units(f, s.in_b)), distance_m);
  });
}

TEST(BoxesGap, NeverAboveTheDistanceOfTrianglesInside) {
  for_each_free_scene(26, [](const Scene& s, long double distance_m) {
    EXPECT_LE(boxes_gap_m(make_relative_frame(s.a, s.b), box_around(s.in_a), box_around(s.in_b)),
              distance_m);
  });
}

TEST(BoxesGap, PositiveExactlyWhenBoxesAreApart) {
  int apart = 0;
  for_each_free_scene(27, [&](const Scene& s, long double) {
    const RelativeFrame f = make_relative_frame(s.a, s.b);
    const CenteredBox a = box_around(s.in_a);
    const CenteredBox b = box_around(s.in_b);
    apart += boxes_apart(f, a, b);
    EXPECT_EQ(boxes_gap_m(f, a, b) > 0, boxes_apart(f, a, b));
    // Who needs no more than so much learns as much, whether that is less than the gap or more.
    const double all_m = boxes_gap_m(f, a, b);
    for (const double enough_m : {all_m / 2, all_m, 2 * all_m, 1e-9}) {
      const double found_m = boxes_gap_m(f, a, b, enough_m);
      EXPECT_EQ(found_m > 0, all_m > 0);
      EXPECT_EQ(std::min(found_m, enough_m), std::min(all_m, enough_m));
      EXPECT_LE(found_m, all_m);
    }
  });
  EXPECT_GT(apart, test::rounds(200));
}

TEST(ExtentInA, ShowsNoMoreThanAllAxes) {
  int shown = 0;
  for_each_free_scene(28, [&](const Scene& s, long double distance_m) {
    const RelativeFrame f = make_relative_frame(s.a, s.b);
    const CenteredBox a = box_around(s.in_a), b = box_around(s.in_b);
    const Extent extent = extent_in_a(f, b);
    double gap = 0;
    for (std::size_t k = 0; k < 3; ++k)
      gap = std::max(
          {gap, a.center[k] - a.half[k] - extent.hi[k], extent.lo[k] - a.center[k] - a.half[k]});
    const double gap_m = gap * extent.metres_per_unit;
    shown += gap_m > 0 ? 1 : 0;
    EXPECT_LE(gap_m, boxes_gap_m(f, a, b) + f.slack * f.metres_per_unit);
    EXPECT_LE(gap_m, distance_m);
  });
  EXPECT_GT(shown, test::rounds(100));
}

TEST(TrianglesGap, IsSharp) {
  int sharp = 0;
  int scenes = 0;
  for_each_free_scene(28, [&](const Scene& s, long double distance_m) {
    const RelativeFrame f = make_relative_frame(s.a, s.b);
    const double gap_m = triangles_gap_m(f, as_doubles(s.in_a), to_a_units(f, s.in_b));
    ++scenes;
    sharp += gap_m >= 0.98L * (distance_m - 2.5L * f.slack * f.metres_per_unit);
  });
  EXPECT_GT(sharp, scenes * (test::kSanitized ? 90 : 97) / 100);  // few scenes are uneven
}

// ---- Clear cases
// ---------------------------------------------------------------------------------

constexpr int kBits = 21;
const Grid kGrid{{}, -16, kBits};

PosedFrame frame_at(const std::array<double, 9>& rotation, const std::array<double, 3>& t_m) {
  return make_posed_frame(kGrid, {rotation, t_m}, lattice_exponent(kGrid, kGrid)).value();
}

CenteredBox box_of(GridPoint lo, GridPoint hi) {
  GridBox box;
  box.add(lo);
  box.add(hi);
  return centered(box);
}

const CenteredBox kMetreCube = box_of({{0, 0, 0}}, {{1 << 16, 1 << 16, 1 << 16}});

/// The turn by angle (sin, cos) about an axis of the frame.
std::array<double, 9> turn(int axis, double angle) {
  const double c = std::cos(angle);
  const double s = std::sin(angle);
  if (axis == 0) return {1, 0, 0, 0, c, -s, 0, s, c};
  if (axis == 1) return {c, 0, s, 0, 1, 0, -s, 0, c};
  return {c, -s, 0, s, c, 0, 0, 0, 1};
}

TEST(CenteredBox, IsExactOverTheWholeInt32Range) {
  const std::int32_t lo = std::numeric_limits<std::int32_t>::min();
  const std::int32_t hi = std::numeric_limits<std::int32_t>::max();
  const CenteredBox box = box_of({{lo, lo, 3}}, {{hi, lo + 1, 3}});
  EXPECT_EQ(box.center, (std::array<double, 3>{-0.5, -0x1p31 + 0.5, 3}));
  EXPECT_EQ(box.half, (std::array<double, 3>{0x1p31 - 0.5, 0.5, 0}));
}

TEST(RelativeFrame, MapsPosedPointsOntoEachOther) {
  Random random(29);
  for (int i = 0; i < 2000; ++i) {
    const Scene s = some_scene(random, kBits);
    const RelativeFrame f = make_relative_frame(s.a, s.b);
    const DoubleTriangle mapped = to_a_units(f, s.in_b);
    const double cell = std::ldexp(1, s.a.lattice_exp - s.a.grid.exponent);
    for (std::size_t c = 0; c < 3; ++c) {
      const LatticePoint posed_b = pose_point(s.b, s.in_b[c]);
      for (std::size_t k = 0; k < 3; ++k) {  // a's affine image of the mapped point
        double image = 0;
        for (std::size_t j = 0; j < 3; ++j)
          image += static_cast<double>(s.a.rotation[3 * k + j]) * 0x1p-30 * mapped[c][j];
        image += static_cast<double>(s.a.translation[k]) * cell;
        EXPECT_NEAR(image, static_cast<double>(posed_b.v[k]) * cell, 0.51 * cell);
      }
    }
  }
}

TEST(RelativeFrame, SlackGrowsWithTheTranslation) {
  const RelativeFrame near =
      make_relative_frame(frame_at(Pose{}.rotation, {}), frame_at(Pose{}.rotation, {}));
  const RelativeFrame far =
      make_relative_frame(frame_at(Pose{}.rotation, {}), frame_at(Pose{}.rotation, {1e9, 0, 0}));
  EXPECT_GE(far.slack - near.slack, 64 * 0x1p-53 * far.translation[0]);
  EXPECT_LT(far.slack, 4);
}

TEST(BoxesApart, FindsFaceSeparationAlongEveryAxisOfBothBoxes) {
  for (int axis = 0; axis < 3; ++axis)
    for (const double side : {-1.0, 1.0})
      for (int turned = 0; turned < 2; ++turned) {
        // The other cube stands on an edge: only the untilted cube's faces separate them.
        const auto tilt = turn((axis + 1) % 3, 0.78);
        std::array<double, 3> t{};
        t[static_cast<std::size_t>(axis)] = side * 2.2;
        const PosedFrame plain = frame_at(Pose{}.rotation, {});
        const PosedFrame tilted = frame_at(tilt, t);
        EXPECT_TRUE(boxes_apart(
            turned ? make_relative_frame(tilted, plain) : make_relative_frame(plain, tilted),
            kMetreCube, kMetreCube));
      }
}

TEST(BoxesApart, FindsSeparationByCrossedEdgesOnly) {
  // Long bars crossing at right angles, each turned 45 degrees about its own length: edge over
  // edge.
  const double quarter = std::atan(1.0);
  const CenteredBox bar_x{{0, 0, 0}, {1e6, 1000, 1000}};
  const CenteredBox bar_y{{0, 0, 0}, {1000, 1e6, 1000}};
  const double touch_m = std::ldexp(2000 * std::sqrt(2.0), -16);
  const auto apart = [&](double height_m) {
    return boxes_apart(make_relative_frame(frame_at(turn(0, quarter), {}),
                                           frame_at(turn(1, quarter), {0, 0, height_m})),
                       bar_x, bar_y);
  };
  EXPECT_TRUE(apart(touch_m + 0.0001));
  EXPECT_FALSE(apart(touch_m - 0.0001));
}

TEST(BoxesGap, IsSharpForFaceSeparatedBoxes) {
  for (const double gap_m : {0.1, 1.0, 100.0, 1e6}) {
    const RelativeFrame f = make_relative_frame(frame_at(Pose{}.rotation, {}),
                                                frame_at(Pose{}.rotation, {1 + gap_m, 0.25, 0}));
    const double found_m = boxes_gap_m(f, kMetreCube, kMetreCube);
    EXPECT_LE(found_m, gap_m);
    EXPECT_GE(found_m, gap_m * (1 - 1e-3));
  }
}

TEST(BoxesGap, IsSharpCornerToCorner) {
  const RelativeFrame f =
      make_relative_frame(frame_at(Pose{}.rotation, {}), frame_at(Pose{}.rotation, {2, 3, 3}));
  EXPECT_LE(boxes_gap_m(f, kMetreCube, kMetreCube), 3);  // (1, 2, 2)
  EXPECT_GE(boxes_gap_m(f, kMetreCube, kMetreCube), 3 * (1 - 1e-3));
}

TEST(BoxesGap, CountsInMetresWhenTheOtherModelIsCoarser) {
  const Grid coarse{{}, -6, kBits};
  const int e = lattice_exponent(kGrid, coarse);
  const PosedFrame a = make_posed_frame(kGrid, {Pose{}.rotation, {-3, 0, 0}}, e).value();
  const PosedFrame b = make_posed_frame(coarse, {turn(0, 0.3), {5, 0, 0}}, e).value();
  const CenteredBox coarse_cube = box_of({{0, 0, 0}}, {{64, 64, 64}});
  EXPECT_NEAR(boxes_gap_m(make_relative_frame(a, b), kMetreCube, coarse_cube), 7, 7e-3);
  EXPECT_NEAR(boxes_gap_m(make_relative_frame(b, a), coarse_cube, kMetreCube), 7, 7e-3);
}

TEST(BoxTriangleApart, FindsTheBoxFaces) {
  const RelativeFrame f =
      make_relative_frame(frame_at(Pose{}.rotation, {}), frame_at(Pose{}.rotation, {}));
  // A wide blade with its tip 20 units off the middle of a face: its plane and its edges' planes
  // all cut the cube, so only the face separates them.
  for (int axis = 0; axis < 3; ++axis)
    for (const bool above : {false, true})
      for (const std::int32_t distance : {20, -20}) {
        GridTriangle blade;
        for (std::size_t c = 0; c < 3; ++c) {
          const std::int32_t away = distance + (c == 0 ? 0 : c == 1 ? 40000 : 90000);
          blade[c][axis] = above ? 65536 + away : -away;
          blade[c][(axis + 1) % 3] = 30000;
          blade[c][(axis + 2) % 3] = c == 0 ? 30000 : c == 1 ? -300000 : 360000;
        }
        EXPECT_EQ(box_triangle_apart(f, kMetreCube, as_doubles(blade)), distance > 0);
      }
}

TEST(BoxTriangleApart, FindsTheTrianglePlane) {
  const RelativeFrame f =
      make_relative_frame(frame_at(Pose{}.rotation, {}), frame_at(Pose{}.rotation, {}));
  // x + y + z = 3 * 2^16 + 30 just beyond the cube's corner, far wider than the cube.
  const std::int32_t d = 3 * 65536 + 30;
  const GridTriangle t{{{{d + 400000, -200000, -200000}},
                        {{-200000, d + 400000, -200000}},
                        {{-200000, -200000, d + 400000}}}};
  EXPECT_TRUE(box_triangle_apart(f, kMetreCube, as_doubles(t)));
  const GridTriangle cut{{{{d + 400000, -200000, -200060}},
                          {{-200000, d + 400000, -200060}},
                          {{-200000, -200000, d + 399940}}}};
  EXPECT_FALSE(box_triangle_apart(f, kMetreCube, as_doubles(cut)));
}

TEST(BoxTriangleApart, FindsCrossedEdges) {
  const RelativeFrame f =
      make_relative_frame(frame_at(Pose{}.rotation, {}), frame_at(Pose{}.rotation, {}));
  // An edge of the triangle passes the cube's edge x = y = 2^16 on the diagonal, rising with z, and
  // its plane leans over the cube.
  const std::int32_t c = 65536;
  const auto leaning = [&](std::int32_t distance) {
    return as_doubles(GridTriangle{{{{c + 100000 + distance, c - 100000 + distance, -40000}},
                                    {{c - 100000 + distance, c + 100000 + distance, 100000}},
                                    {{c + 100000 + distance, c + 50000 + distance, 60000}}}});
  };
  for (const auto& order : {std::array<std::size_t, 3>{0, 1, 2}, {1, 0, 2}, {2, 0, 1}, {2, 1, 0}}) {
    const auto at = [&](std::int32_t distance) {
      const DoubleTriangle t = leaning(distance);
      return DoubleTriangle{t[order[0]], t[order[1]], t[order[2]]};
    };
    EXPECT_TRUE(box_triangle_apart(f, kMetreCube, at(20)));
    EXPECT_FALSE(box_triangle_apart(f, kMetreCube, at(-20)));
  }
}

TEST(TrianglesGap, IsSharpFaceCornerAndEdge) {
  const RelativeFrame f =
      make_relative_frame(frame_at(Pose{}.rotation, {}), frame_at(Pose{}.rotation, {}));
  const GridTriangle floor{{{{0, 0, 0}}, {{90000, 0, 0}}, {{0, 90000, 0}}}};
  const auto gap_units = [&](const GridTriangle& t) {
    const double gap_m = triangles_gap_m(f, as_doubles(floor), as_doubles(t));
    EXPECT_EQ(gap_m, triangles_gap_m(f, as_doubles(t), as_doubles(floor)));
    return std::ldexp(gap_m, 16);
  };
  EXPECT_NEAR(gap_units({{{{9, 9, 500}}, {{9, 40, 900}}, {{40, 9, 900}}}}), 500, 0.5);
  EXPECT_NEAR(gap_units({{{{-300, -400, 0}}, {{-900, -400, 7}}, {{-300, -900, 7}}}}), 500, 0.5);
  EXPECT_NEAR(gap_units({{{{50, -40, -70}}, {{50, -40, 90}}, {{70, -900, 9}}}}), 40, 0.5);
}

/// The corners are few, so that flat triangles, points and common corners are among them.
TEST(TrianglesGaps, HaveTheBitsOfTheSlowTwin) {
  int apart = 0;
  test::for_each_instruction_set([&apart] {
    Random random(31);
    for (int i = 0; i < test::rounds(300); ++i) {
      const Scene s = some_scene(random, i % 2 == 0 ? 2 : 12);
      const RelativeFrame f = make_relative_frame(s.a, s.b);
      TriangleLanes lanes;
      std::array<GridTriangle, kLanes> triangles;
      for (std::uint32_t lane = 0; lane < kLanes; ++lane) {
        triangles[lane] = lane == 0 ? s.in_b : some_scene(random, i % 2 == 0 ? 2 : 12).in_b;
        lanes.set(lane, triangles[lane]);
      }
      PlacedTriangles placed;
      place_triangles(f, lanes, placed);
      double gaps_m[kLanes];
      triangles_gaps_m(f, as_doubles(s.in_a), placed, gaps_m);
      for (std::uint32_t lane = 0; lane < kLanes; ++lane) {
        const double gap_m = triangles_gap_m(f, as_doubles(s.in_a), to_a_units(f, triangles[lane]));
        ASSERT_EQ(std::bit_cast<std::uint64_t>(gaps_m[lane]), std::bit_cast<std::uint64_t>(gap_m));
        apart += gap_m > 0 ? 1 : 0;
      }
    }
  });
  EXPECT_GT(apart, test::rounds(300));
}

TEST(TrianglesGap, CountsMetresOfPosedTriangles) {
  const PosedFrame a = frame_at(turn(1, 0.4), {10, 0, 0});
  const PosedFrame b = frame_at(turn(2, -0.7), {10, 0, 800});
  const RelativeFrame f = make_relative_frame(a, b);
  const GridTriangle t{{{{0, 0, 0}}, {{1, 0, 0}}, {{0, 1, 0}}}};
  EXPECT_NEAR(triangles_gap_m(f, as_doubles(t), to_a_units(f, t)), 800, 0.001);
}

}  // namespace
}  // namespace nearmesh
