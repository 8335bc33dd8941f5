// SPDX-License-Identifier: Apache-2.0
// The vector tests never part what touches, part most of what does not, and say the same on every instruction set.
#include "nearmesh/core/geometry/lanes.hpp"

#include <gtest/gtest.h>
#include <hwy/targets.h>

#include <bit>
#include <cmath>
#include <span>

#include "nearmesh/core/base/hash.hpp"
#include "nearmesh/core/base/random.hpp"
#include "nearmesh/core/geometry/triangle_overlap.hpp"
#include "test_models.hpp"

namespace nearmesh {
namespace {

using Triangle = std::array<GridPoint, 3>;
using Patch = std::array<Triangle, 4>;

constexpr int kBits = 21;

struct Frames {
  PosedFrame a, b;
};

Frames random_frames(Random& random, double distance_m) {
  // Two cells, so that the frames' scales differ; the origins make turned models meet.
  const Grid grid_a{{-16, -16, -16}, -16, kBits},
      grid_b{{-16, -16, -16}, random.below(2) == 0 ? -16 : -13, kBits};
  const int lattice = lattice_exponent(grid_a, grid_b);
  Pose pose_a{test::random_rotation(random), {}}, pose_b{test::random_rotation(random), {}};
  for (double& x : pose_b.translation_m) x = random.between(-1, 1) * distance_m;
  return {make_posed_frame(grid_a, pose_a, lattice).value(),
          make_posed_frame(grid_b, pose_b, lattice).value()};
}

/// Four triangles that are nearly in one plane, or any four.
Patch random_patch(Random& random) {
  const int bits = 4 + static_cast<int>(random.below(14));
  const std::uint32_t thickness_bits = random.below(static_cast<std::uint32_t>(bits) + 1);
  GridPoint at;
  for (int k = 0; k < 3; ++k)
    at[k] = static_cast<std::int32_t>(random.below(1U << (kBits - 1))) + (1 << (kBits - 2)) -
            (1 << (bits - 1));
  const std::array<double, 3> tilt{random.between(-1, 1), random.between(-1, 1), 0};
  const int up = static_cast<int>(random.below(3));
  Patch patch;
  for (Triangle& triangle : patch)
    for (GridPoint& p : triangle) {
      const std::int32_t x = static_cast<std::int32_t>(random.below(1U << bits)),
                         y = static_cast<std::int32_t>(random.below(1U << bits));
      p = at;
      p[(up + 1) % 3] += x;
      p[(up + 2) % 3] += y;
      p[up] += static_cast<std::int32_t>(tilt[0] * x + tilt[1] * y) +
               static_cast<std::int32_t>(random.below(1U << thickness_bits));
    }
  return patch;
}

GridBox box_of(const Patch& patch) {
  GridBox box;
  for (const Triangle& triangle : patch)
    for (const GridPoint& p : triangle) box.add(p);
  return box;
}

std::array<double, 3> normal_of(const Triangle& t) {
  std::array<double, 3> e, g, n;
  for (std::size_t k = 0; k < 3; ++k) {
    e[k] = t[1].v[k] - t[0].v[k];
    g[k] = t[2].v[k] - t[0].v[k];
  }
  for (std::size_t k = 0; k < 3; ++k)
    n[k] = e[(k + 1) % 3] * g[(k + 2) % 3] - e[(k + 2) % 3] * g[(k + 1) % 3];
  return n;
}

double along(const std::array<std::int8_t, 3>& normal, const GridPoint& p, const GridBox& box) {
  double sum = 0;
  for (int k = 0; k < 3; ++k)
    sum += normal[static_cast<std::size_t>(k)] * (p[k] - 0.5 * (double(box.lo[k]) + box.hi[k]));
  return sum;
}

/// Around the patch, along the first face's normal; none where that face has no area.
Slab slab_of(const Patch& patch, const GridBox& box) {
  const std::array<double, 3> direction = normal_of(patch[0]);
  if (direction == std::array<double, 3>{}) return {};
  const auto normal = make_slab_normal(direction);
  double from = 1e300, to = -1e300;
  for (const Triangle& triangle : patch)
    for (const GridPoint& p : triangle) {
      from = std::min(from, along(normal, p, box));
      to = std::max(to, along(normal, p, box));
    }
  return {normal, rounded_down(from), -rounded_down(-to)};
}

struct Lanes {
  std::array<Patch, kLanes> patches;
  BoxLanes boxes;
  TriangleLanes triangles;  // the first of each patch
};

Lanes random_lanes(Random& random) {
  Lanes lanes;
  for (std::uint32_t lane = 0; lane < kLanes; ++lane) {
    const Patch& patch = lanes.patches[lane] = random_patch(random);
    const GridBox box = box_of(patch);
    lanes.boxes.set(lane, box, random.below(4) == 0 ? Slab{} : slab_of(patch, box));
    lanes.triangles.set(lane, patch[0]);
  }
  return lanes;
}

/// An upper bound of the distance, metres: that of the nearest corners.
double corner_distance_m(const Frames& frames, std::span<const Triangle> a,
                         std::span<const Triangle> b) {
  double least = 1e300;
  for (const Triangle& s : a)
    for (const GridPoint& p : s)
      for (const Triangle& t : b)
        for (const GridPoint& q : t) {
          const LatticePoint x = pose_point(frames.a, p), y = pose_point(frames.b, q);
          double square = 0;
          for (int k = 0; k < 3; ++k)
            square += static_cast<double>(x[k] - y[k]) * static_cast<double>(x[k] - y[k]);
          least = std::min(least, square);
        }
  return std::ldexp(std::sqrt(least), frames.a.lattice_exp);
}

bool touch(const Frames& frames, const Patch& a, const Patch& b) {
  for (const Triangle& s : a)
    for (const Triangle& t : b)
      if (triangles_overlap(pose_triangle(frames.a, s), pose_triangle(frames.b, t))) return true;
  return false;
}

// Runs the body once for each instruction set that this processor has.
template <class Body>
void for_each_target(const Body& body) {
  int targets = 0;
  for (std::int64_t left = hwy::SupportedTargets(); left != 0; left &= left - 1) {
    const std::int64_t target = left & -left;
    SCOPED_TRACE(hwy::TargetName(target));
    hwy::SetSupportedTargetsForTest(target);
    body();
    hwy::SetSupportedTargetsForTest(0);
    ++targets;
  }
  EXPECT_GE(targets, 1);
}

// A patch of each body is brought to where they just touch; there, and a little before, the lanes' verdicts are held
// against the exact test.
TEST(Lanes, NeverPartWhatTouchesAndPartMostOfWhatDoesNot) {
  std::uint64_t first_digest = 0;
  for_each_target([&first_digest] {
    Random random(33);
    std::uint64_t digest = 0;
    int boxes_parted = 0, boxes_alone = 0, triangles_parted = 0, apart_total = 0, touching = 0;
    int pairs_parted = 0;
    for (int i = 0; i < 400; ++i) {
      Frames frames = random_frames(random, 0);
      const Lanes a = random_lanes(random), b = random_lanes(random);
      const LatticePoint target = pose_point(frames.a, a.patches[0][0][random.below(3)]);
      const LatticePoint corner = pose_point(frames.b, b.patches[0][0][random.below(3)]);
      const auto start = frames.b.translation;
      std::array<std::int64_t, 3> way;
      for (auto& w : way) w = std::int64_t{random.below(2001)} - 1000;
      const auto touches_at = [&](std::int64_t n) {
        for (std::size_t k = 0; k < 3; ++k)
          frames.b.translation[k] = start[k] + target.v[k] - corner.v[k] + way[k] * n;
        return touch(frames, a.patches[0], b.patches[0]);
      };
      std::int64_t near = 0, far = 1 << 20;
      while (far - near > 1) (touches_at((near + far) / 2) ? near : far) = (near + far) / 2;
      for (const std::int64_t n : {near, near + 10, near + 1000}) {
        static_cast<void>(touches_at(n));
        const RelativeFrame f = make_relative_frame(frames.a, frames.b);
        PlacedLanes placed, without_slabs;
        place_lanes(f, b.boxes, placed);
        BoxLanes bare_a, bare_b;
        for (std::uint32_t lane = 0; lane < kLanes; ++lane) {
          bare_a.set(lane, a.boxes.box(lane), {});
          bare_b.set(lane, b.boxes.box(lane), {});
        }
        place_lanes(f, bare_b, without_slabs);
        PlacedTriangles placed_triangles;
        place_triangles(f, b.triangles, placed_triangles);
        for (std::uint32_t j = 0; j < kLanes; ++j) {
          const std::uint32_t boxes = boxes_apart(f, placed, j, a.boxes);
          const std::uint32_t bare = boxes_apart(f, without_slabs, j, bare_a);
          const std::uint32_t triangles = triangles_apart(f, placed, j, a.triangles);
          const PairVerdicts pairs =
              test_triangles(f, as_doubles(a.patches[j][0]), placed_triangles);
          digest = mix(digest ^ (boxes | bare << 8 | triangles << 16 | pairs.apart << 24));
          digest = mix(digest ^ pairs.touching);
          double gaps_m[kLanes], extents_m[kLanes];
          boxes_gaps_m(f, placed, j, a.boxes, gaps_m);
          extents_gaps_m(f, as_doubles(a.patches[j][0]), placed_triangles, extents_m);
          for (std::uint32_t lane = 0; lane < kLanes; ++lane) {
            digest = mix(digest ^ std::bit_cast<std::uint64_t>(gaps_m[lane]));
            digest = mix(digest ^ std::bit_cast<std::uint64_t>(extents_m[lane]));
            ASSERT_EQ(gaps_m[lane] > 0, (boxes >> lane & 1U) != 0);
            ASSERT_LE(gaps_m[lane], corner_distance_m(frames, a.patches[lane], b.patches[j]));
            ASSERT_LE(extents_m[lane], corner_distance_m(frames, {a.patches[j].data(), 1},
                                                         {b.patches[lane].data(), 1}));
          }
          ASSERT_EQ(bare & ~boxes, 0U);  // slabs add
          for (std::uint32_t lane = 0; lane < kLanes; ++lane) {
            if (touch(frames, a.patches[lane], b.patches[j])) {
              ++touching;
              ASSERT_EQ(boxes >> lane & 1U, 0U);
            } else {
              ++apart_total;
              boxes_parted += static_cast<int>(boxes >> lane & 1U);
              boxes_alone += static_cast<int>(bare >> lane & 1U);
            }
            bool one_touches = false;
            for (const Triangle& t : b.patches[j])
              one_touches =
                  one_touches || triangles_overlap(pose_triangle(frames.a, a.patches[lane][0]),
                                                   pose_triangle(frames.b, t));
            if (one_touches) {
              ASSERT_EQ(triangles >> lane & 1U, 0U);
            } else {
              triangles_parted += static_cast<int>(triangles >> lane & 1U);
            }
            if (triangles_overlap(pose_triangle(frames.a, a.patches[j][0]),
                                  pose_triangle(frames.b, b.patches[lane][0]))) {
              ASSERT_EQ(pairs.apart >> lane & 1U, 0U);
            } else {
              ASSERT_EQ(pairs.touching >> lane & 1U, 0U);
              pairs_parted += static_cast<int>(pairs.apart >> lane & 1U);
            }
          }
        }
      }
    }
    EXPECT_GT(touching, 400);
    EXPECT_GT(boxes_parted, apart_total * 9 / 10);
    EXPECT_GT(boxes_parted, boxes_alone);
    EXPECT_GT(triangles_parted, apart_total / 2);
    EXPECT_GT(pairs_parted, apart_total / 2);
    if (first_digest == 0) first_digest = digest;
    EXPECT_EQ(digest, first_digest);
  });
}

GridPoint middle_of(const Triangle& t) {
  GridPoint middle;
  for (int k = 0; k < 3; ++k) middle[k] = (t[0][k] + t[1][k] + t[2][k]) / 3;
  return middle;
}

// Triangles thrown into one place: most that cross are told from most that do not, and none wrongly; small ones, whose
// posed corners are rounded by much of their size, are left open.
TEST(Lanes, PairsOfTrianglesAreDecidedAsTheExactTestDoes) {
  std::uint64_t first_digest = 0;
  for_each_target([&first_digest] {
    Random random(35);
    std::uint64_t digest = 0;
    int touching = 0, joined = 0, apart = 0, parted = 0;
    for (int i = 0; i < 3000; ++i) {
      Frames frames = random_frames(random, 0);
      const int bits = 4 + static_cast<int>(random.below(16));
      const auto thrown = [&](int finer) {
        Triangle triangle;
        const auto flat = static_cast<int>(random.below(12));  // axes 0 to 2 are thin
        for (GridPoint& p : triangle)
          for (int k = 0; k < 3; ++k)
            p[k] = (1 << 20) + static_cast<std::int32_t>(
                                   random.below(1U << std::max(0, k == flat ? 1 : bits - finer)));
        return triangle;
      };
      const Triangle own = thrown(0);
      // Cells of the other may be eight times as large.
      const int finer = frames.b.grid.exponent - frames.a.grid.exponent;
      std::array<Triangle, kLanes> others;
      TriangleLanes lanes;
      for (std::uint32_t lane = 0; lane < kLanes; ++lane) {
        others[lane] = random.below(16) == 0 && lane > 0 ? others[lane - 1] : thrown(finer);
        if (random.below(16) == 0) others[lane][2] = others[lane][1];
        lanes.set(lane, others[lane]);
      }
      const LatticePoint from = pose_point(frames.b, middle_of(others[0])),
                         to = pose_point(frames.a, middle_of(own));
      for (std::size_t k = 0; k < 3; ++k) frames.b.translation[k] += to.v[k] - from.v[k];
      const RelativeFrame f = make_relative_frame(frames.a, frames.b);
      PlacedTriangles placed;
      place_triangles(f, lanes, placed);
      const PairVerdicts verdicts = test_triangles(f, as_doubles(own), placed);
      digest = mix(digest ^ (verdicts.apart | verdicts.touching << 8));
      for (std::uint32_t lane = 0; lane < kLanes; ++lane) {
        const bool is_apart = (verdicts.apart >> lane & 1U) != 0,
                   is_touching = (verdicts.touching >> lane & 1U) != 0;
        if (triangles_overlap(pose_triangle(frames.a, own),
                              pose_triangle(frames.b, others[lane]))) {
          ASSERT_FALSE(is_apart);
          ++touching;
          joined += is_touching ? 1 : 0;
        } else {
          ASSERT_FALSE(is_touching);
          ++apart;
          parted += is_apart ? 1 : 0;
        }
      }
    }
    EXPECT_GT(touching, 2000);
    EXPECT_GT(joined, touching / 2);
    EXPECT_GT(parted, apart * 9 / 10);
    if (first_digest == 0) first_digest = digest;
    EXPECT_EQ(digest, first_digest);
  });
}

TEST(Lanes, SlabsPartParallelPatchesWhoseBoxesOverlap) {
  Random random(34);
  int parted = 0;
  for (int i = 0; i < 100; ++i) {
    // The same tilted patch twice, a little apart along its normal.
    Patch patch;
    for (Triangle& t : patch)
      for (GridPoint& p : t) {
        const auto x = static_cast<std::int32_t>(random.below(1U << 12)),
                   y = static_cast<std::int32_t>(random.below(1U << 12));
        p = {{x, y, x + y}};
      }
    if (normal_of(patch[0]) == std::array<double, 3>{}) continue;
    const GridBox box = box_of(patch);
    const Grid grid{{}, -16, kBits};
    const int lattice = lattice_exponent(grid, grid);
    const double step = std::ldexp(200, -16);
    const RelativeFrame f = make_relative_frame(
        make_posed_frame(grid, {}, lattice).value(),
        make_posed_frame(grid, {.translation_m = {-step, -step, step}}, lattice).value());
    BoxLanes lanes, bare;
    lanes.set(0, box, slab_of(patch, box));
    bare.set(0, box, {});
    PlacedLanes placed, placed_bare;
    place_lanes(f, lanes, placed);
    place_lanes(f, bare, placed_bare);
    EXPECT_EQ(boxes_apart(f, placed_bare, 0, bare) & 1U, 0U);
    parted += static_cast<int>(boxes_apart(f, placed, 0, lanes) & 1U);
  }
  EXPECT_GT(parted, 90);
}

struct Bound {
  GridBox box;
  Slab slab;
};

void expect_holds(const Bound& bound, const Patch& patch) {
  for (const Triangle& triangle : patch)
    for (const GridPoint& p : triangle) {
      EXPECT_TRUE(bound.box.contains({p, p}));
      EXPECT_LE(static_cast<double>(bound.slab.from), along(bound.slab.normal, p, bound.box));
      EXPECT_GE(static_cast<double>(bound.slab.to), along(bound.slab.normal, p, bound.box));
    }
}

double length_of(const std::array<std::int8_t, 3>& normal) {
  double square = 0;
  for (const std::int8_t x : normal) square += x * x;
  return std::sqrt(square);
}

TEST(Lanes, BoundOfBoxesHoldsWhatTheyAndTheirSlabsHold) {
  Random random(35);
  int slabs = 0;
  for (int i = 0; i < 1000; ++i) {
    SCOPED_TRACE(i);
    const Lanes lanes = random_lanes(random);
    const std::uint32_t used = random.below(kAllLanes + 1);
    float sizes[kLanes];
    for (float& size : sizes) size = static_cast<float>(1 + random.below(1000));
    Bound found;
    bound(lanes.boxes, sizes, used, found.box, found.slab);
    GridBox box;
    for (std::uint32_t lane = 0; lane < kLanes; ++lane) {
      if ((used >> lane & 1U) == 0) continue;
      expect_holds(found, lanes.patches[lane]);
      box.add(lanes.boxes.box(lane));
    }
    EXPECT_EQ(found.box, box);
    if (found.slab == Slab{}) continue;
    ++slabs;
    EXPECT_NEAR(length_of(found.slab.normal), kSlabLength, 1.0);
  }
  EXPECT_GT(slabs, 500);
}

TEST(Lanes, BoundOfTrianglesIsTightAboutTheirMeanNormal) {
  Random random(36);
  for (int i = 0; i < 1000; ++i) {
    SCOPED_TRACE(i);
    const std::uint32_t count = 1 + random.below(kLanes);
    std::vector<Triangle> used;
    TriangleLanes triangles;
    GridBox box;
    for (std::uint32_t lane = 0; lane < kLanes; ++lane) {
      if (lane < count) used.push_back(random_patch(random)[0]);
      triangles.set(lane, used.back());
      for (const GridPoint& p : used.back()) box.add(p);
    }
    Bound found;
    bound(triangles, count, found.box, found.slab);
    EXPECT_EQ(found.box, box);
    std::array<double, 3> direction{};
    double least = 1e300, most = -1e300;
    for (const Triangle& triangle : used) {
      const std::array<double, 3> normal = normal_of(triangle);
      for (std::size_t k = 0; k < 3; ++k) direction[k] += normal[k];
      for (const GridPoint& p : triangle) {
        least = std::min(least, along(found.slab.normal, p, found.box));
        most = std::max(most, along(found.slab.normal, p, found.box));
      }
    }
    if (direction == std::array<double, 3>{}) continue;
    EXPECT_EQ(found.slab.normal, make_slab_normal(direction));
    EXPECT_NEAR(static_cast<double>(found.slab.from), least, 1e-6 * std::abs(least));
    EXPECT_NEAR(static_cast<double>(found.slab.to), most, 1e-6 * std::abs(most));
  }
}

}  // namespace
}  // namespace nearmesh
