// SPDX-License-Identifier: Apache-2.0
// The vector tests never part what touches, part most of what does not, and say the same on every
// instruction set.
#include "core/geometry/kernels_for_tests.hpp"

#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <span>

#include "core/base/hash.hpp"
#include "core/base/random.hpp"
#include "core/geometry/triangle_overlap.hpp"
#include "core/geometry/vec3.hpp"
#include "instruction_sets.hpp"
#include "rounds.hpp"
#include "test_models.hpp"

namespace nearmesh {
namespace {

using Triangle = std::array<GridPoint, 3>;
using Patch = std::array<Triangle, 4>;

constexpr int kGridBits = 21;

struct Frames {
  PosedFrame a, b;
};

/// Turned at random, origins in one place. b's cells are 2^coarser times as large.
Frames random_frames(Random& random, int bits, int coarser) {
  const Grid grid_a{{-16, -16, -16}, 5 - bits, bits},
      grid_b{{-16, -16, -16}, 5 - bits + coarser, bits};
  const int lattice = lattice_exponent(grid_a, grid_b);
  const Pose pose_a{test::random_rotation(random), {}}, pose_b{test::random_rotation(random), {}};
  return {make_posed_frame(grid_a, pose_a, lattice).value(),
          make_posed_frame(grid_b, pose_b, lattice).value()};
}

/// Four triangles that are nearly in one plane, or any four: within 2^bits cells of `at`, nearly.
Patch random_patch(Random& random, const GridPoint& at, int bits) {
  const std::uint32_t thickness_bits = random.below(static_cast<std::uint32_t>(bits) + 1);
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

/// The same anywhere in the middle of the grid.
Patch random_patch(Random& random) {
  const int bits = 4 + static_cast<int>(random.below(14));
  GridPoint at;
  for (int k = 0; k < 3; ++k)
    at[k] = static_cast<std::int32_t>(random.below(1U << (kGridBits - 1))) +
            (1 << (kGridBits - 2)) - (1 << (bits - 1));
  return random_patch(random, at, bits);
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

template <class MakePatch>
Lanes make_lanes(Random& random, const MakePatch& make_patch) {
  Lanes lanes;
  for (std::uint32_t lane = 0; lane < kLanes; ++lane) {
    const Patch& patch = lanes.patches[lane] = make_patch();
    const GridBox box = box_of(patch);
    lanes.boxes.set(lane, box, random.below(4) == 0 ? Slab{} : slab_of(patch, box));
    lanes.triangles.set(lane, patch[0]);
  }
  return lanes;
}

Lanes random_lanes(Random& random) {
  return make_lanes(random, [&random] { return random_patch(random); });
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

bool touch(const Frames& frames, std::span<const Triangle> a, std::span<const Triangle> b) {
  for (const Triangle& s : a)
    for (const Triangle& t : b)
      if (triangles_overlap(pose_triangle(frames.a, s), pose_triangle(frames.b, t))) return true;
  return false;
}

GridBox bounds_of(const BoxLanes& boxes) {
  GridBox bounds;
  for (std::uint32_t lane = 0; lane < kLanes; ++lane) bounds.add(boxes.box(lane));
  return bounds;
}

BoxLanes without_slabs(const BoxLanes& boxes) {
  BoxLanes bare;
  for (std::uint32_t lane = 0; lane < kLanes; ++lane) bare.set(lane, boxes.box(lane), {});
  return bare;
}

TriangleLanes repeat(const Triangle& triangle) {
  TriangleLanes lanes;
  for (std::uint32_t lane = 0; lane < kLanes; ++lane) lanes.set(lane, triangle);
  return lanes;
}

/// One body's lanes as both see them.
struct PlacedBody {
  PlacedBoxes boxes, bare;
  PlacedFaces faces;
};
PlacedBody place(const Placing& placing, const Lanes& lanes) {
  PlacedBody out;
  place_boxes(placing, lanes.boxes, out.boxes);
  place_boxes(placing, without_slabs(lanes.boxes), out.bare);
  place_faces(placing, lanes.triangles, out.faces);
  return out;
}

/// Moves b so that a corner of its first patch is `n` steps from one of a's; steps of one way.
class Approach {
 public:
  Approach(Frames& frames, const Lanes& a, const Lanes& b, Random& random)
      : frames_(frames), a_(a.patches[0]), b_(b.patches[0]), start_(frames.b.translation) {
    const LatticePoint target = pose_point(frames.a, a_[0][random.below(3)]);
    const LatticePoint corner = pose_point(frames.b, b_[0][random.below(3)]);
    for (std::size_t k = 0; k < 3; ++k) {
      start_[k] += target.v[k] - corner.v[k];
      way_[k] = std::int64_t{random.below(2001)} - 1000;
    }
  }
  void move_to(std::int64_t n) {
    for (std::size_t k = 0; k < 3; ++k) frames_.b.translation[k] = start_[k] + way_[k] * n;
  }
  /// The last n at which the first patches touch, nearly.
  std::int64_t last_touch() {
    std::int64_t near = 0, far = 1 << 20;
    while (far - near > 1) {
      const std::int64_t middle = (near + far) / 2;
      move_to(middle);
      (touch(frames_, a_, b_) ? near : far) = middle;
    }
    return near;
  }

 private:
  Frames& frames_;
  const Patch &a_, &b_;
  std::array<std::int64_t, 3> start_, way_;
};

// A patch of each body is brought to where they just touch; there, and a little before, the lanes'
// verdicts are held against the exact test.
TEST(Lanes, NeverPartWhatTouchesAndPartMostOfWhatDoesNot) {
  std::uint64_t first_digest = 0;
  test::for_each_instruction_set([&first_digest] {
    Random random(33);
    std::uint64_t digest = 0;
    int boxes_parted = 0, boxes_alone = 0, triangles_parted = 0, apart_total = 0, touching = 0;
    int pairs_parted = 0, faces_parted = 0, gaps_alone = 0, way_alone = 0, way_by_slabs = 0,
        near_corners = 0;
    for (int i = 0; i < test::rounds(400); ++i) {
      Frames frames = random_frames(random, kGridBits, random.below(2) == 0 ? 0 : 3);
      const Lanes a = random_lanes(random), b = random_lanes(random);
      Approach approach(frames, a, b, random);
      const std::int64_t near = approach.last_touch();
      for (const std::int64_t n : {near, near + 10, near + 1000}) {
        approach.move_to(n);
        const RelativeFrame f = make_relative_frame(frames.a, frames.b),
                            g = make_relative_frame(frames.b, frames.a);
        const Placing placing_a(g, f, bounds_of(a.boxes)), placing_b(f, g, bounds_of(b.boxes));
        const PlacedBody placed_a = place(placing_a, a), placed_b = place(placing_b, b);
        PlacedLanes placed, placed_bare;
        place_lanes(f, b.boxes, placed);
        place_lanes(f, without_slabs(b.boxes), placed_bare);
        PlacedTriangles placed_triangles;
        place_triangles(f, b.triangles, placed_triangles);
        for (std::uint32_t j = 0; j < kLanes; ++j) {
          // Any way serves; that from corner to corner shows most.
          const DoubleTriangle own = as_doubles(a.patches[j][0]),
                               other = to_a_units(f, b.patches[j][0]);
          const ApartWay way(
              f, random.below(4) == 0
                     ? std::array<double, 3>{random.between(-1, 1), random.between(-1, 1), 1}
                     : minus(other[0], own[0]));
          const std::uint32_t boxes = boxes_apart(placing_a, placed_a.boxes, placed_b.boxes, j);
          const std::uint32_t bare = boxes_apart(placing_a, placed_a.bare, placed_b.bare, j);
          const std::uint32_t triangles = faces_apart(placing_a, placed_a.faces, placed_b.boxes, j);
          const std::uint32_t faces =
              faces_apart(placing_b, placed_b.faces, placed_a.faces.boxes, j);
          const PairVerdicts pairs = test_triangles(f, repeat(a.patches[j][0]), b.triangles);
          digest = mix(digest ^ (boxes | bare << 8 | triangles << 16 | pairs.apart << 24));
          digest = mix(digest ^ (pairs.touching | faces << 8));
          double gaps_m[kLanes], extents_m[kLanes], way_m[kLanes], bare_way_m[kLanes];
          find_gaps_along(f, way, placed, j, a.boxes, way_m);
          find_gaps_along(f, way, placed_bare, j, without_slabs(a.boxes), bare_way_m);
          // Of the first triangle of a's patch j and of each of b's: by what they reach along the
          // way.
          double reaches[kLanes], reaches_back[kLanes];
          find_reaches(a.triangles, way.way, reaches);
          find_reaches(b.triangles, way.back, reaches_back);
          BoxGaps gaps;
          find_box_gaps(f, placed, j, a.boxes, gaps);
          for (std::uint32_t lane = 0; lane < kLanes; ++lane)
            gaps_m[lane] = std::max(gaps.on_own_m[lane], gaps.on_other_m[lane]);
          extents_gaps_m(f, as_doubles(a.patches[j][0]), placed_triangles, extents_m);
          for (std::uint32_t lane = 0; lane < kLanes; ++lane) {
            digest = mix(digest ^ std::bit_cast<std::uint64_t>(gaps_m[lane]));
            digest = mix(digest ^ std::bit_cast<std::uint64_t>(extents_m[lane]));
            digest = mix(digest ^ std::bit_cast<std::uint64_t>(way_m[lane]));
            gaps_alone += gaps_m[lane] > 0 && (boxes >> lane & 1U) == 0 ? 1 : 0;
            ASSERT_LE(gaps_m[lane], corner_distance_m(frames, a.patches[lane], b.patches[j]));
            digest = mix(digest ^ std::bit_cast<std::uint64_t>(reaches[lane] - reaches_back[lane]));
            const double apart_m =
                (way.origins - way.room - reaches[j] - reaches_back[lane]) * way.metres;
            const double corners_m =
                corner_distance_m(frames, {a.patches[j].data(), 1}, {b.patches[lane].data(), 1});
            ASSERT_LE(apart_m, corners_m);
            near_corners += apart_m > corners_m / 2 ? 1 : 0;
            ASSERT_LE(way_m[lane], corner_distance_m(frames, a.patches[lane], b.patches[j]));
            ASSERT_LE(bare_way_m[lane], way_m[lane]);  // slabs add
            way_by_slabs += bare_way_m[lane] < way_m[lane] ? 1 : 0;
            way_alone += lane == j && way_m[lane] > gaps_m[lane] ? 1 : 0;
            ASSERT_LE(extents_m[lane], corner_distance_m(frames, {a.patches[j].data(), 1},
                                                         {b.patches[lane].data(), 1}));
          }
          ASSERT_EQ(bare & ~boxes, 0U);  // slabs add
          for (std::uint32_t lane = 0; lane < kLanes; ++lane) {
            if (touch(frames, a.patches[lane], b.patches[j])) {
              ++touching;
              ASSERT_EQ(boxes >> lane & 1U, 0U);
              ASSERT_EQ(gaps_m[lane], 0);
              ASSERT_LE(way_m[lane], 0);
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
              ASSERT_EQ((pairs.apart | faces) >> lane & 1U, 0U);
            } else {
              ASSERT_EQ(pairs.touching >> lane & 1U, 0U);
              faces_parted += static_cast<int>(faces >> lane & 1U);
              pairs_parted += static_cast<int>(pairs.apart >> lane & 1U);
            }
          }
        }
      }
    }
    EXPECT_GE(touching, test::rounds(400));
    EXPECT_GT(boxes_parted, apart_total * 9 / 10);
    EXPECT_GT(boxes_parted, boxes_alone);
    EXPECT_GT(triangles_parted, apart_total / 2);
    EXPECT_GT(pairs_parted, apart_total / 2);
    EXPECT_GT(faces_parted, apart_total * 9 / 10);
    EXPECT_GT(way_alone, apart_total / kLanes / 10);
    EXPECT_GT(near_corners, apart_total / 10);
    EXPECT_GT(way_by_slabs, apart_total / 10);
    EXPECT_LT(gaps_alone, apart_total / 100);  // what doubles part, floats do, nearly
    if (first_digest == 0) first_digest = digest;
    EXPECT_EQ(digest, first_digest);
  });
}

// Coordinates of 31 bits lose seven of them in a float, which is more than the patches that meet
// there may measure, or a good part of how far apart large ones are.
TEST(Lanes, FloatsPartNothingThatTouchesOnTheFinestGrids) {
  Random random(43);
  int touching = 0, parted = 0;
  for (int i = 0; i < test::rounds(2000); ++i) {
    // The last: about where normals leave the range of floats.
    const int coarser[] = {0, 3, -40, 84 + static_cast<int>(random.below(16))};
    Frames frames = random_frames(random, kMaxGridBits, coarser[random.below(4)]);
    const auto bits = static_cast<int>(2 + random.below(26));  // within int32, wherever they are
    const auto lanes_in_one_place = [&] {
      GridPoint at;
      for (int k = 0; k < 3; ++k)
        at[k] = static_cast<std::int32_t>((1U << 30) + random.below(1U << 28));
      return make_lanes(random, [&] {
        GridPoint near = at;
        for (int k = 0; k < 3; ++k) near[k] += static_cast<std::int32_t>(random.below(1U << bits));
        return random_patch(random, near, bits - static_cast<int>(random.below(2)));
      });
    };
    const Lanes a = lanes_in_one_place(), b = lanes_in_one_place();
    Approach approach(frames, a, b, random);
    approach.move_to(approach.last_touch());
    const RelativeFrame f = make_relative_frame(frames.a, frames.b),
                        g = make_relative_frame(frames.b, frames.a);
    const Placing placing_a(g, f, bounds_of(a.boxes)), placing_b(f, g, bounds_of(b.boxes));
    const PlacedBody placed_a = place(placing_a, a), placed_b = place(placing_b, b);
    for (std::uint32_t j = 0; j < kLanes; ++j) {
      const std::uint32_t boxes = boxes_apart(placing_a, placed_a.boxes, placed_b.boxes, j);
      const std::uint32_t triangles = faces_apart(placing_a, placed_a.faces, placed_b.boxes, j);
      const std::uint32_t faces = faces_apart(placing_a, placed_a.faces, placed_b.faces.boxes, j);
      for (std::uint32_t lane = 0; lane < kLanes; ++lane) {
        const std::span<const Triangle> first{a.patches[lane].data(), 1};
        if (touch(frames, a.patches[lane], b.patches[j])) {
          ++touching;
          ASSERT_EQ(boxes >> lane & 1U, 0U) << i;
        } else {
          parted += static_cast<int>(boxes >> lane & 1U);
        }
        if (touch(frames, first, b.patches[j])) {
          ASSERT_EQ(triangles >> lane & 1U, 0U) << i;
        }
        if (touch(frames, first, {b.patches[j].data(), 1})) {
          ASSERT_EQ(faces >> lane & 1U, 0U) << i;
        }
      }
    }
  }
  EXPECT_GT(touching, test::rounds(1000));
  EXPECT_GT(parted, test::rounds(1000));
}

GridPoint middle_of(const Triangle& t) {
  GridPoint middle;
  for (int k = 0; k < 3; ++k) middle[k] = (t[0][k] + t[1][k] + t[2][k]) / 3;
  return middle;
}

// Triangles thrown into one place: most that cross are told from most that do not, and none
// wrongly; small ones, whose posed corners are rounded by much of their size, are left open.
TEST(Lanes, PairsOfTrianglesAreDecidedAsTheExactTestDoes) {
  std::uint64_t first_digest = 0;
  test::for_each_instruction_set([&first_digest] {
    Random random(35);
    std::uint64_t digest = 0;
    int touching = 0, joined = 0, apart = 0, parted = 0;
    for (int i = 0; i < test::rounds(3000); ++i) {
      Frames frames = random_frames(random, kGridBits, random.below(2) == 0 ? 0 : 3);
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
      const PairVerdicts verdicts = test_triangles(f, repeat(own), lanes);
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
    EXPECT_GT(touching, test::rounds(2000));
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
    const Grid grid{{}, -16, kGridBits};
    const int lattice = lattice_exponent(grid, grid);
    const double step = std::ldexp(200, -16);
    const PosedFrame at_rest = make_posed_frame(grid, {}, lattice).value();
    const PosedFrame moved =
        make_posed_frame(grid, {.translation_m = {-step, -step, step}}, lattice).value();
    const RelativeFrame f = make_relative_frame(at_rest, moved),
                        g = make_relative_frame(moved, at_rest);
    const Placing placing_a(g, f, box), placing_b(f, g, box);
    BoxLanes lanes, bare;
    lanes.set(0, box, slab_of(patch, box));
    bare.set(0, box, {});
    PlacedBoxes a, b, bare_a, bare_b;
    place_boxes(placing_a, lanes, a);
    place_boxes(placing_b, lanes, b);
    place_boxes(placing_a, bare, bare_a);
    place_boxes(placing_b, bare, bare_b);
    EXPECT_EQ(boxes_apart(placing_a, bare_a, bare_b, 0) & 1U, 0U);
    parted += static_cast<int>(boxes_apart(placing_a, a, b, 0) & 1U);
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
  for (int i = 0; i < test::rounds(1000); ++i) {
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
  EXPECT_GT(slabs, test::rounds(500));
}

TEST(Lanes, BoundOfTrianglesIsTightAboutTheirMeanNormal) {
  Random random(36);
  for (int i = 0; i < test::rounds(1000); ++i) {
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
