// SPDX-License-Identifier: Apache-2.0
// Boxes and triangles adrift: never "stay apart" where the drift brings them together, and no finer
// than at rest.
#include <algorithm>
#include <cmath>

#include "nearmesh/core/geometry/detail/lanes.hpp"
#include "test_models.hpp"

namespace nearmesh {
namespace {

using Vec3 = std::array<double, 3>;
using Triangle = std::array<GridPoint, 3>;

struct DriftingPair {
  Grid grid_a, grid_b;
  Pose pose_a, pose_b;
  Triangle in_a, in_b;
  RelativeFrame frame;
  DoubleTriangle a, b;  ///< in A's units
};

Triangle some_triangle(Random& random) {
  const int bits = 2 + int(random.below(19));
  Triangle t;
  for (int k = 0; k < 3; ++k) {
    const auto base = std::int32_t(random.below((1U << 21) - (1U << bits)));
    const bool flat = random.below(3) == 0;
    for (GridPoint& p : t) p[k] = base + (flat ? 0 : std::int32_t(random.below(1U << bits)));
  }
  return t;
}

DriftingPair some_scene(Random& random) {
  DriftingPair s;
  s.grid_a = {.exponent = -16, .bits = 21};
  s.grid_b = {.exponent = -20 + int(random.below(9)), .bits = 21};
  for (Grid* grid : {&s.grid_a, &s.grid_b})
    for (double& x : grid->origin_m)
      x = std::ldexp(std::floor(random.between(-1e6, 1e6)), grid->exponent);
  s.pose_a.rotation = test::random_rotation(random);
  if (random.below(2) == 0) s.pose_b.rotation = test::random_rotation(random);
  const double far = std::exp2(random.between(-4, 16));
  for (std::size_t k = 0; k < 3; ++k) {
    s.pose_a.translation_m[k] = random.between(-far, far);
    s.pose_b.translation_m[k] = s.pose_a.translation_m[k] + random.between(-30, 30);
  }
  s.in_a = some_triangle(random);
  s.in_b = some_triangle(random);
  s.frame = make_relative_frame(s.grid_a, s.pose_a, s.grid_b, s.pose_b);
  s.a = as_doubles(s.in_a);
  s.b = to_a_units(s.frame, s.in_b);
  return s;
}

CenteredBox box_of(const Triangle& t) {
  GridBox box;
  for (const GridPoint& p : t) box.add(p);
  return centered(box);
}

Vec3 point_of(Random& random, const DoubleTriangle& t) {
  double w[3], sum = 0;
  for (double& x : w) sum += x = random.below(3) == 0 ? 0 : random.unit() + 1e-3;
  if (sum == 0) sum = w[0] = 1;
  Vec3 p{};
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t k = 0; k < 3; ++k) p[k] += w[i] / sum * t[i][k];
  return p;
}

std::array<long double, 3> world(const Grid& grid, const Pose& pose, const Vec3& units) {
  std::array<long double, 3> x{}, out{};
  for (std::size_t k = 0; k < 3; ++k)
    x[k] = grid.origin_m[k] + std::ldexp((long double)units[k], grid.exponent);
  for (std::size_t r = 0; r < 3; ++r) {
    out[r] = pose.translation_m[r];
    for (std::size_t c = 0; c < 3; ++c) out[r] += (long double)pose.rotation[3 * r + c] * x[c];
  }
  return out;
}

TEST(RelativeFrameOfPoses, MapsPointsWithinItsSlack) {
  Random random(31);
  for (int i = 0; i < 20000; ++i) {
    const DriftingPair s = some_scene(random);
    for (std::size_t corner = 0; corner < 3; ++corner) {
      const GridPoint& p = s.in_b[corner];
      const auto in_a = world(s.grid_a, s.pose_a, s.b[corner]);
      const auto in_b = world(s.grid_b, s.pose_b, {double(p[0]), double(p[1]), double(p[2])});
      long double square = 0;
      for (std::size_t k = 0; k < 3; ++k) square += (in_a[k] - in_b[k]) * (in_a[k] - in_b[k]);
      EXPECT_LE(std::ldexp(std::sqrt(square), -s.grid_a.exponent), s.frame.slack);
    }
    EXPECT_LT(s.frame.slack, 0.01);  // some doubles' rounding, no lattice
  }
}

TEST(RelativeFrameOfPoses, VectorsOfTheWorldTurnIntoTheGrid) {
  Random random(32);
  for (int i = 0; i < 1000; ++i) {
    const DriftingPair s = some_scene(random);
    const Vec3 v{random.between(-9, 9), random.between(-9, 9), random.between(-9, 9)};
    const Vec3 units = to_grid_units(s.grid_a, s.pose_a, v);
    const auto from = world(s.grid_a, s.pose_a, {}), to = world(s.grid_a, s.pose_a, units);
    for (std::size_t k = 0; k < 3; ++k) EXPECT_NEAR(double(to[k] - from[k]), v[k], 1e-9);
  }
}

/// A drift that takes a point of b to one of a: partly along, partly around, in shares of all
/// magnitudes.
Drift drift_together(Random& random, const Vec3& p, const Vec3& q) {
  Drift drift;
  Vec3 way{p[0] - q[0], p[1] - q[1], p[2] - q[2]};
  double around = 0;
  const double spare = random.below(3) == 0 ? 0 : std::exp2(random.between(-10, 18));
  for (double& x : way) {
    const double e = random.between(-1, 1) * spare;
    x -= e;
    around += e * e;
  }
  const double s =
      (random.below(2) == 0 ? 1 : -1) * (random.below(2) == 0 ? 1 : random.between(0.1, 1));
  for (std::size_t k = 0; k < 3; ++k) drift.along[k] = way[k] / s;
  drift.around = std::sqrt(around);
  return drift;
}

TEST(Drift, NothingStaysApartFromWhatItIsTakenTo) {
  Random random(33);
  for (int i = 0; i < 100000; ++i) {
    const DriftingPair s = some_scene(random);
    const Drift drift = drift_together(random, point_of(random, s.a), point_of(random, s.b));
    EXPECT_FALSE(triangles_stay_apart(s.frame, drift, s.a, s.b));
    EXPECT_FALSE(boxes_stay_apart(s.frame, drift, box_of(s.in_a), box_of(s.in_b)));
    EXPECT_FALSE(box_triangle_stay_apart(s.frame, drift, box_of(s.in_a), s.b));
    BoundedPart part{{random.between(-127, 127), random.between(-127, 127), 127}, -1e300};
    for (double& x : part.normal) x = std::floor(x);
    for (const Vec3& corner : s.a)
      part.bound = std::max(part.bound, part.normal[0] * corner[0] + part.normal[1] * corner[1] +
                                            part.normal[2] * corner[2]);
    EXPECT_FALSE(half_space_triangle_stay_apart(s.frame, drift, part, s.b));
    EXPECT_FALSE(half_space_box_stay_apart(s.frame, drift, part, box_of(s.in_b)));
  }
}

TEST(Drift, NoneLeavesBoxesApartThatWereAtRest) {
  Random random(34);
  int apart = 0;
  for (int i = 0; i < 20000; ++i) {
    const DriftingPair s = some_scene(random);
    const CenteredBox a = box_of(s.in_a), b = box_of(s.in_b);
    EXPECT_EQ(boxes_stay_apart(s.frame, {}, a, b), boxes_apart(s.frame, a, b));
    EXPECT_EQ(box_triangle_stay_apart(s.frame, {}, a, s.b), box_triangle_apart(s.frame, a, s.b));
    if (triangles_gap_m(s.frame, s.a, s.b) > 0) {
      EXPECT_TRUE(triangles_stay_apart(s.frame, {}, s.a, s.b));
    }
    apart += boxes_apart(s.frame, a, b);
  }
  EXPECT_GT(apart, 1000);
}

TEST(Drift, SlidingPastCostsNothing) {
  // A floor and what slides a hundred units above it, by far more than that.
  const Grid grid{.exponent = -16, .bits = 21};
  const RelativeFrame f = make_relative_frame(grid, {}, grid, {});
  const Triangle floor{{{{0, 0, 0}}, {{90000, 0, 0}}, {{0, 90000, 0}}}};
  const Triangle above{{{{9, 9, 100}}, {{9, 400, 100}}, {{400, 9, 900}}}};
  const Drift slide{{1e6, -1e6, 98}, 1}, sink{{1e6, -1e6, 100}, 1};
  EXPECT_TRUE(boxes_stay_apart(f, slide, box_of(floor), box_of(above)));
  EXPECT_TRUE(box_triangle_stay_apart(f, slide, box_of(floor), as_doubles(above)));
  EXPECT_TRUE(triangles_stay_apart(f, slide, as_doubles(floor), as_doubles(above)));
  EXPECT_FALSE(boxes_stay_apart(f, sink, box_of(floor), box_of(above)));
  EXPECT_FALSE(box_triangle_stay_apart(f, sink, box_of(floor), as_doubles(above)));
  EXPECT_FALSE(triangles_stay_apart(f, sink, as_doubles(floor), as_doubles(above)));
}

TEST(Drift, TurnedTrianglesSlidePastEachOtherToo) {
  // The same, seen from a model that is turned: no axis of A's helps, only the direction between
  // the triangles.
  const Grid grid{.exponent = -16, .bits = 21};
  Random random(35);
  for (int i = 0; i < 1000; ++i) {
    const Pose turned{.rotation = test::random_rotation(random)};
    const RelativeFrame f = make_relative_frame(grid, turned, grid, {});
    const DoubleTriangle low = to_a_units(f, {{{{0, 0, 0}}, {{90000, 0, 0}}, {{0, 90000, 0}}}});
    const DoubleTriangle high =
        to_a_units(f, {{{{90, 90, 100}}, {{90, 400, 200}}, {{400, 90, 200}}}});
    const double unit = 0x1p-16;
    const Drift slide{to_grid_units(grid, turned, {9e3 * unit, -9e3 * unit, 98 * unit}), 1};
    const Drift sink{to_grid_units(grid, turned, {0, 0, 100 * unit}), 1};
    EXPECT_TRUE(triangles_stay_apart(f, slide, low, high));
    EXPECT_FALSE(triangles_stay_apart(f, sink, low, high));
  }
}

// Eight at a time say what one by one does.
TEST(DriftLanes, SayWhatSinglePairsDo) {
  Random random(37);
  int boxes_apart = 0, boxes_close = 0, faces_apart = 0, faces_close = 0;
  for (int i = 0; i < 4000; ++i) {
    const DriftingPair s = some_scene(random);
    const CenteredBox own = box_of(s.in_a), other = box_of(s.in_b);
    // Lanes about where a's box is, as b's grid has it, of all sizes.
    const auto lanes_about = [&](const CenteredBox& box) {
      std::array<Triangle, kLanes> triangles;
      for (Triangle& t : triangles) {
        const double way = std::exp2(random.between(0, 18));
        for (int k = 0; k < 3; ++k) {
          const double at = box.center[std::size_t(k)] + random.between(-way, way);
          for (GridPoint& p : t)
            p[k] = std::int32_t(std::clamp(at + random.between(-way, way) / 4, 0.0, 0x1p21 - 1));
        }
      }
      return triangles;
    };
    const auto triangles_b = lanes_about(other), triangles_a = lanes_about(own);
    BoxLanes boxes_a, boxes_b;
    TriangleLanes faces_b;
    for (std::uint32_t lane = 0; lane < kLanes; ++lane) {
      GridBox box_a, box_b;
      for (const GridPoint& p : triangles_a[lane]) box_a.add(p);
      for (const GridPoint& p : triangles_b[lane]) box_b.add(p);
      boxes_a.set(lane, box_a, {});
      boxes_b.set(lane, box_b, {});
      faces_b.set(lane, triangles_b[lane]);
    }
    // Brought together: b's frame moved so that the boxes are about each other.
    RelativeFrame f = s.frame;
    for (std::size_t k = 0; k < 3; ++k) {
      double at = 0;
      for (std::size_t j = 0; j < 3; ++j) at += f.rotation[3 * k + j] * other.center[j];
      f.translation[k] = own.center[k] - at + random.between(-1, 1) * own.half[k];
    }
    DriftLanes drifts;
    const double size = std::exp2(random.between(-4, 16));
    for (double& x : drifts.along) x = random.between(-1, 1) * size;
    for (double& x : drifts.around) x = random.below(3) == 0 ? 0 : random.unit() * size;
    const std::uint32_t of_b = boxes_stay_apart(f, drifts, own, boxes_b),
                        of_a = boxes_stay_apart(f, drifts, boxes_a, other),
                        of_faces = box_triangles_stay_apart(f, {drifts.along, drifts.around[0]},
                                                            own, faces_b);
    for (std::uint32_t lane = 0; lane < kLanes; ++lane) {
      const Drift drift{drifts.along, drifts.around[lane]};
      const bool apart = boxes_stay_apart(f, drift, own, centered(boxes_b.box(lane)));
      ASSERT_EQ(of_b >> lane & 1U, apart ? 1U : 0U) << i << ", lane " << lane;
      ASSERT_EQ(of_a >> lane & 1U,
                boxes_stay_apart(f, drift, centered(boxes_a.box(lane)), other) ? 1U : 0U)
          << i << ", lane " << lane;
      ++(apart ? boxes_apart : boxes_close);
      const bool face_apart = box_triangle_stay_apart(f, {drifts.along, drifts.around[0]}, own,
                                                      to_a_units(f, triangles_b[lane]));
      ASSERT_EQ(of_faces >> lane & 1U, face_apart ? 1U : 0U) << i << ", lane " << lane;
      ++(face_apart ? faces_apart : faces_close);
    }
  }
  for (const int count : {boxes_apart, boxes_close, faces_apart, faces_close})
    EXPECT_GT(count, 2000);
}

}  // namespace
}  // namespace nearmesh
