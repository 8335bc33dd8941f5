// SPDX-License-Identifier: Apache-2.0
// Predicates where signs are hard, box tests and gaps, poses up to their limits.
#include "core/geometry/kernels_for_tests.hpp"
#include "core/geometry/triangle_overlap.hpp"
#include "jobs.hpp"
#include "test_models.hpp"

namespace nearmesh::digest_jobs {
namespace {

// Corners on a lattice of `side` points an axis, `scale` apart, each moved by at most `jitter`:
// small sides make coplanar, touching and degenerate triangles common, and a jitter of 1 at a great
// scale makes them almost so.
std::uint64_t predicates(std::uint32_t side, std::int64_t scale, std::uint32_t jitter) {
  Random random(side * 1000 + jitter);
  Digest digest;
  for (int i = 0; i < 20000; ++i) {
    LatticeTriangle t[2];
    for (LatticeTriangle& triangle : t)
      for (LatticePoint& corner : triangle)
        for (int k = 0; k < 3; ++k)
          corner[k] = scale * random.below(side) + random.below(2 * jitter + 1) - jitter;
    digest.add(triangles_overlap(t[0], t[1]) ? 1 : 0);
  }
  return digest.value();
}

Grid random_grid(Random& random) {
  Grid grid;
  grid.bits = kMinGridBits + static_cast<int>(random.below(kMaxGridBits - kMinGridBits + 1));
  grid.exponent = static_cast<int>(random.below(60)) - 45;
  for (double& x : grid.origin_m)
    x = std::ldexp(std::floor(random.between(-1e6, 1e6)), grid.exponent);
  return grid;
}

Pose random_pose(Random& random) {
  Pose pose{.rotation = test::random_rotation(random)};
  if (random.below(8) == 0) pose.rotation = {0, -1, 0, 1, 0, 0, 0, 0, 1};
  for (double& x : pose.translation_m) {
    const double mantissa = random.between(-1, 1);
    x = std::ldexp(mantissa, static_cast<int>(random.below(60)) - 30);
  }
  if (random.below(16) == 0) pose.translation_m = {1e9, -1e9, 5e-324};
  return pose;
}

GridPoint random_point(const Grid& grid, Random& random) {
  GridPoint p;
  for (int k = 0; k < 3; ++k) p[k] = static_cast<std::int32_t>(random.next() >> (64 - grid.bits));
  return p;
}

std::uint64_t poses() {
  Random random(11);
  Digest digest;
  for (int i = 0; i < 20000; ++i) {
    const Grid a = random_grid(random), b = random_grid(random);
    const Pose pose = random_pose(random);
    digest.add(static_cast<std::uint64_t>(check_pose(pose, "body").code()));
    const int lattice = lattice_exponent(a, b);
    digest.add(static_cast<std::uint64_t>(lattice));
    const Result<PosedFrame> frame = make_posed_frame(a, pose, lattice);
    digest.add(static_cast<std::uint64_t>(frame.status().code()));
    if (!frame.is_ok()) continue;
    for (const std::int64_t x : frame.value().rotation) digest.add(static_cast<std::uint64_t>(x));
    for (int p = 0; p < 4; ++p)
      for (const std::int64_t x : pose_point(frame.value(), random_point(a, random)).v)
        digest.add(static_cast<std::uint64_t>(x));
  }
  return digest.value();
}

GridBox random_box(const Grid& grid, Random& random) {
  GridBox box;
  const GridPoint at = random_point(grid, random);
  box.add(at);
  const auto reach = std::uint32_t{1} << random.below(static_cast<std::uint32_t>(grid.bits));
  GridPoint far = at;
  for (int k = 0; k < 3; ++k) far[k] -= static_cast<std::int32_t>(random.below(reach));
  box.add(far);
  return box;
}

std::uint64_t boxes() {
  Random random(12);
  Digest digest;
  for (int i = 0; i < 2000; ++i) {
    // Two models of like size, so that boxes are near each other as often as not.
    Grid a = random_grid(random), b = a;
    b.exponent += static_cast<int>(random.below(3));
    Pose pose_a{.rotation = test::random_rotation(random)};
    Pose pose_b{.rotation = test::random_rotation(random)};
    for (double& x : pose_b.translation_m)
      x = std::ldexp(random.between(-1, 1), a.exponent + a.bits);
    const Result<PosedPair> posed = pose_pair(a, pose_a, "a", b, pose_b, "b");
    digest.add(static_cast<std::uint64_t>(posed.status().code()));
    if (!posed.is_ok()) continue;
    const RelativeFrame frame = make_relative_frame(posed.value().a, posed.value().b);
    for (const auto* matrix : {&frame.rotation, &frame.inverse, &frame.abs_cofactor})
      for (const double x : *matrix) digest.add_bits(x);
    for (const double x : frame.translation) digest.add_bits(x);
    digest.add_bits(frame.slack);
    digest.add_bits(frame.least_metres_per_unit);
    digest.add_bits(frame.least_metres_per_b_unit);
    for (int n = 0; n < 16; ++n) {
      const CenteredBox box_a = centered(random_box(a, random));
      const CenteredBox box_b = centered(random_box(b, random));
      digest.add(boxes_apart(frame, box_a, box_b) ? 1 : 0);
      digest.add_bits(boxes_gap_m(frame, box_a, box_b));
      std::array<GridPoint, 3> own, other;
      for (GridPoint& p : own) p = random_point(a, random);
      for (GridPoint& p : other) p = random_point(b, random);
      const DoubleTriangle triangle = to_a_units(frame, other);
      for (const auto& corner : triangle)
        for (const double x : corner) digest.add_bits(x);
      digest.add(box_triangle_apart(frame, box_a, triangle) ? 1 : 0);
      digest.add_bits(triangles_gap_m(frame, as_doubles(own), triangle));
    }
  }
  return digest.value();
}

std::uint64_t lanes() {
  Random random(13);
  Digest digest;
  for (int i = 0; i < 500; ++i) {
    Grid a = random_grid(random), b = a;
    b.exponent += static_cast<int>(random.below(3));
    Pose pose_b{.rotation = test::random_rotation(random)};
    for (double& x : pose_b.translation_m)
      x = std::ldexp(random.between(-1, 1), a.exponent + a.bits);
    const Result<PosedPair> posed = pose_pair(a, {}, "a", b, pose_b, "b");
    if (!posed.is_ok()) continue;
    const RelativeFrame frame = make_relative_frame(posed.value().a, posed.value().b);
    BoxLanes own, other;
    TriangleLanes triangles;
    for (std::uint32_t lane = 0; lane < kLanes; ++lane)
      for (const auto& [grid, into] : {std::pair(&a, &own), std::pair(&b, &other)}) {
        const GridBox box = random_box(*grid, random);
        const auto normal =
            make_slab_normal({random.between(-1, 1), random.between(-1, 1), random.between(-1, 1)});
        const double width = kSlabLength * static_cast<double>(box.extent());
        const double from = random.between(-0.5, 0) * width;  // one after the other
        const double to = random.between(0, 0.5) * width;
        const Slab slab{normal, rounded_down(from), -rounded_down(-to)};
        digest.add_bits(static_cast<double>(slab.from));
        digest.add_bits(static_cast<double>(slab.to));
        into->set(lane, box, slab);
        triangles.set(lane, {box.lo, box.hi, random_point(*grid, random)});
      }
    float sizes[kLanes];
    for (float& size : sizes) size = static_cast<float>(random.below(1U << 20));
    for (const bool of_boxes : {true, false}) {
      GridBox box;
      Slab slab;
      if (of_boxes) {
        bound(own, sizes, random.below(kAllLanes + 1), box, slab);
      } else {
        bound(triangles, 1 + random.below(kLanes), box, slab);
      }
      digest.add_bits(static_cast<double>(slab.from));
      digest.add_bits(static_cast<double>(slab.to));
      for (std::size_t k = 0; k < 3; ++k) {
        digest.add(static_cast<std::uint8_t>(slab.normal[k]));
        digest.add(static_cast<std::uint32_t>(box.lo.v[k]));
        digest.add(static_cast<std::uint32_t>(box.hi.v[k]));
      }
    }
    const RelativeFrame back = make_relative_frame(posed.value().b, posed.value().a);
    GridBox bounds_a, bounds_b;
    for (std::uint32_t lane = 0; lane < kLanes; ++lane) {
      bounds_a.add(own.box(lane));
      bounds_b.add(other.box(lane));
      for (const GridPoint& corner : triangles.corners(lane)) bounds_b.add(corner);
    }
    const Placing placing_a(back, frame, bounds_a), placing_b(frame, back, bounds_b);
    PlacedBoxes placed_a, placed_b;
    PlacedFaces placed_faces;
    place_boxes(placing_a, own, placed_a);
    place_boxes(placing_b, other, placed_b);
    place_faces(placing_b, triangles, placed_faces);
    for (std::uint32_t lane = 0; lane < kLanes; ++lane) {
      digest.add_bits(static_cast<double>(placed_b.other.thickness[lane]));
      digest.add_bits(static_cast<double>(placed_faces.boxes.own.normal[0][lane]));
      digest.add(boxes_apart(placing_a, placed_a, placed_b, lane));
      digest.add(boxes_apart(placing_a, placed_a, placed_faces.boxes, lane));
      digest.add(faces_apart(placing_b, placed_faces, placed_a, lane));
      TriangleLanes turned;
      for (std::uint32_t to = 0; to < kLanes; ++to)
        turned.set(to, triangles.corners((to + lane) % kLanes));
      const PairVerdicts verdicts = test_triangles(frame, turned, triangles);
      digest.add(verdicts.apart);
      digest.add(verdicts.touching);
    }
  }
  return digest.value();
}

}  // namespace

std::vector<Job> geometry_jobs() {
  return {{"predicates.small_lattice", [] { return predicates(3, 1, 0); }},
          {"predicates.lattice", [] { return predicates(8, 1, 0); }},
          {"predicates.almost_regular", [] { return predicates(3, std::int64_t{1} << 37, 1); }},
          {"predicates.mid_range", [] { return predicates(4, std::int64_t{1} << 20, 2); }},
          {"predicates.general", [] { return predicates(1U << 30, 256, 100); }},
          {"poses", poses},
          {"boxes", boxes},
          {"lanes", lanes}};
}

}  // namespace nearmesh::digest_jobs
