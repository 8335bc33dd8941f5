// SPDX-License-Identifier: Apache-2.0
// Probes of bodies in every state of refinement, held against all faces of the full mesh.
#include "nearmesh/core/query/probe.hpp"

#include "core/query/probe_needs.hpp"
#include "instruction_sets.hpp"
#include "rounds.hpp"
#include "solids.hpp"

namespace nearmesh {
namespace {

/// The full mesh in its place, face by face.
struct PosedFaces {
  PosedFaces(const BakedModel& model, const Pose& pose) {
    frame = probe_frame(model.header.grid, pose).value();
    for (const test::KeyedFace& face : test::all_faces(model.store)) {
      keys.push_back(face.key);
      faces.push_back(test::posed(model.store, frame, face.face));
    }
  }
  PosedFrame frame;
  std::vector<FaceKey> keys;
  std::vector<LatticeTriangle> faces;

  [[nodiscard]] RayFound first(const LatticeRay& ray) const {
    RayFound best;
    for (std::size_t i = 0; i < faces.size(); ++i) {
      RayFound next{.has_face = true, .key = keys[i], .face = faces[i]};
      const std::optional<RayHit> hit = first_hit(ray, faces[i]);
      if (!hit) continue;
      next.hit = *hit;
      if (!best.has_face || comes_before(ray, next, best)) best = next;
    }
    return best;
  }
  [[nodiscard]] CutRay cut(const RayProbe& ray) const {
    return cut_ray(ray, bounds_of(frame), frame.lattice_exp);
  }
};

Pose random_pose(Random& random) {
  Pose pose;
  if (random.below(3) != 0) pose.rotation = test::random_rotation(random);
  for (double& t : pose.translation_m) t = random.between(-1e3, 1e3);
  return pose;
}

/// Aimed at vertices, along edges, past the body, along axes, of any length.
std::vector<RayProbe> random_rays(Random& random, const BakedModel& model, const Pose& pose,
                                  std::size_t count) {
  const double size = test::radius_m(model);
  const auto vertex = [&] {
    return test::place(pose, test::position_m(model.header, model.store,
                                              {random.below(model.header.vertex_count)}));
  };
  std::vector<RayProbe> rays(count);
  for (RayProbe& ray : rays) {
    const auto target = vertex(), other = vertex();
    for (std::size_t k = 0; k < 3; ++k) ray.origin_m[k] = target[k] + random.between(-2, 2) * size;
    switch (random.below(5)) {
      case 0:  // at a vertex
        for (std::size_t k = 0; k < 3; ++k) ray.direction[k] = target[k] - ray.origin_m[k];
        break;
      case 1:  // along an axis, through a vertex
        ray.origin_m = target;
        ray.direction = {};
        {
          const std::size_t axis = random.below(3);
          ray.direction[axis] = random.below(2) != 0 ? 1 : -3;
          ray.origin_m[axis] -= ray.direction[axis] * random.between(-1, 2) * size;
        }
        break;
      case 2:  // from vertex to vertex
        ray.origin_m = other;
        for (std::size_t k = 0; k < 3; ++k) ray.direction[k] = target[k] - other[k];
        if (ray.direction == std::array<double, 3>{}) ray.direction[0] = 1;
        break;
      case 3:  // down, through whatever there is
        ray.origin_m = {target[0] + random.between(-0.1, 0.1) * size,
                        target[1] + random.between(-0.1, 0.1) * size, target[2] + size};
        break;
      default:
        for (double& x : ray.direction) x = random.between(-1, 1);
    }
    if (random.below(3) == 0) ray.range_m = random.between(0, 3) * size;
  }
  return rays;
}

void expect_equal(const RayAnswer& answer, const RayFound& truth, const CutRay& cut) {
  ASSERT_NE(answer.status, ProbeStatus::kUncertain);
  ASSERT_EQ(answer.status == ProbeStatus::kHit, truth.has_face);
  EXPECT_EQ(answer.has_face, truth.has_face);
  if (!truth.has_face) return;
  EXPECT_EQ(answer.face, truth.key);
  EXPECT_LE(answer.at_least_m, cut.at_m(truth.hit.t));
  EXPECT_GE(answer.at_most_m, cut.at_m(truth.hit.t));
  EXPECT_LE(answer.at_most_m - answer.at_least_m, cut.end_m * 0x1p-38);
}

class ProbedModel : public ::testing::TestWithParam<const char*> {
 protected:
  BakedModel model_ = test::bake_named(GetParam());
};
INSTANTIATE_TEST_SUITE_P(Models, ProbedModel,
                         ::testing::Values("terrain", "aircraft", "sphere", "soup", "components",
                                           "degenerate", "book", "one_face"),
                         [](const auto& name) { return std::string(name.param); });

TEST_P(ProbedModel, RaysAreNeverWrongAndEndAsOverAllFaces) {
  std::size_t open = 0, hits = 0;
  for (std::uint64_t seed = 0; seed < 30; ++seed) {
    SCOPED_TRACE(seed);
    Random random(seed);
    LocalModel held(model_.store, model_.header.grid);
    test::refine_at_random(held, random);
    const Pose pose = random_pose(random);
    const PosedFaces truth(model_, pose);
    const std::vector<RayProbe> rays = random_rays(random, model_, pose, 40);
    std::vector<RayAnswer> answers(rays.size());
    const auto needs = probe(held.view(), pose, rays, answers);
    ASSERT_TRUE(needs.is_ok()) << needs.status().message();
    for (const NodeSpan& node : needs.value().missing)
      EXPECT_TRUE(node.size > 1 && held.mesh.is_current(node));
    EXPECT_TRUE(std::is_sorted(needs.value().missing.begin(), needs.value().missing.end()));
    std::size_t uncertain = 0;
    for (std::size_t i = 0; i < rays.size(); ++i) {
      SCOPED_TRACE(i);
      const CutRay cut = truth.cut(rays[i]);
      const RayFound first = cut.is_empty ? RayFound{} : truth.first(cut.ray);
      hits += first.has_face ? 1 : 0;
      if (answers[i].status != ProbeStatus::kUncertain) {
        EXPECT_EQ(answers[i].missing, 0U);
        expect_equal(answers[i], first, cut);
        continue;
      }
      ++uncertain;
      EXPECT_GT(answers[i].missing, 0U);
      if (first.has_face) {
        EXPECT_LE(answers[i].at_least_m, cut.at_m(first.hit.t));
      }
      if (answers[i].has_face) {
        EXPECT_GE(answers[i].at_most_m, cut.at_m(first.hit.t));
      }
    }
    EXPECT_EQ(uncertain == 0, needs.value().is_nothing());
    open += uncertain;
    ASSERT_TRUE(certify_probes(held, pose, test::no_require, std::span<const RayProbe>(rays),
                               std::span(answers))
                    .is_ok());
    for (std::size_t i = 0; i < rays.size(); ++i) {
      SCOPED_TRACE(i);
      const CutRay cut = truth.cut(rays[i]);
      expect_equal(answers[i], cut.is_empty ? RayFound{} : truth.first(cut.ray), cut);
    }
  }
  if (GetParam() != std::string("one_face")) {
    EXPECT_GT(open, 20U);
  }
  EXPECT_GT(hits, 150U);
}

/// All that an answer says, as bits.
std::vector<std::uint64_t> bits_of_answers(const std::vector<RayAnswer>& answers,
                                           const ProbeNeeds& needs) {
  std::vector<std::uint64_t> bits;
  const auto add = [&bits](double x) { bits.push_back(std::bit_cast<std::uint64_t>(x)); };
  for (const RayAnswer& answer : answers) {
    bits.push_back(static_cast<std::uint64_t>(answer.status));
    bits.push_back(std::uint64_t{answer.face.split.value} << 32 | answer.face.index);
    bits.push_back(answer.missing);
    add(answer.at_least_m);
    add(answer.at_most_m);
    for (std::size_t k = 0; k < 3; ++k) {
      add(answer.point_m[k]);
      add(answer.normal[k]);
    }
  }
  for (const NodeSpan& node : needs.missing) bits.push_back(node.begin());
  for (const GridBox& box : needs.where)
    for (int k = 0; k < 3; ++k)
      bits.push_back(std::uint64_t(std::uint32_t(box.lo[k])) << 32 | std::uint32_t(box.hi[k]));
  return bits;
}

TEST_P(ProbedModel, RaysDependOnNeitherInstructionSetNorBatch) {
  std::vector<std::uint64_t> bits;
  test::for_each_instruction_set([&] {
    std::vector<std::uint64_t> found;
    for (std::uint64_t seed = 0; seed < 10; ++seed) {
      Random random(seed);
      LocalModel held(model_.store, model_.header.grid);
      test::refine_at_random(held, random);
      const Pose pose = random_pose(random);
      const std::vector<RayProbe> rays = random_rays(random, model_, pose, 150);
      std::vector<RayAnswer> answers(rays.size()), alone(rays.size());
      const auto needs = probe(held.view(), pose, rays, answers);
      ASSERT_TRUE(needs.is_ok());
      const auto more = bits_of_answers(answers, needs.value());
      found.insert(found.end(), more.begin(), more.end());
      for (std::size_t i = 0; i < rays.size(); ++i)
        ASSERT_TRUE(
            probe(held.view(), pose, std::span(rays).subspan(i, 1), std::span(alone).subspan(i, 1))
                .is_ok());
      EXPECT_EQ(bits_of_answers(alone, needs.value()), more);
    }
    if (bits.empty()) bits = found;
    EXPECT_EQ(found, bits);
  });
}

TEST_P(ProbedModel, BallsAreNeverWrongAndEndAsOverAllFaces) {
  std::size_t open = 0, hits = 0, misses = 0;
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    SCOPED_TRACE(seed);
    Random random(seed);
    LocalModel held(model_.store, model_.header.grid);
    test::refine_at_random(held, random);
    const Pose pose = random_pose(random);
    const PosedFaces truth(model_, pose);
    const double size = test::radius_m(model_);
    std::vector<BallProbe> balls(30);
    for (BallProbe& ball : balls) {
      const auto at =
          test::position_m(model_.header, model_.store, {random.below(model_.header.vertex_count)});
      ball.center_m = test::place(pose, at);
      ball.radius_m = size * std::ldexp(random.between(0, 1), -static_cast<int>(random.below(8)));
      const double off = ball.radius_m * random.between(0.2, 3);
      for (double& x : ball.center_m) x += random.between(-off, off);
    }
    std::vector<ShapeAnswer> answers(balls.size());
    const auto needs = probe(held.view(), pose, balls, answers);
    ASSERT_TRUE(needs.is_ok());
    std::vector<bool> touches(balls.size());
    std::vector<std::vector<FaceKey>> keys(balls.size());
    for (std::size_t i = 0; i < balls.size(); ++i) {
      LatticeBall ball;
      const double cell = std::ldexp(1.0, truth.frame.lattice_exp);
      for (std::size_t k = 0; k < 3; ++k)
        ball.center.v[k] = static_cast<std::int64_t>(std::floor(balls[i].center_m[k] / cell + 0.5));
      ball.radius = static_cast<std::int64_t>(std::floor(balls[i].radius_m / cell + 0.5));
      for (std::size_t f = 0; f < truth.faces.size(); ++f)
        if (ball_meets(ball, truth.faces[f])) keys[i].push_back(truth.keys[f]);
      std::sort(keys[i].begin(), keys[i].end());
      touches[i] = !keys[i].empty();
      (touches[i] ? hits : misses) += 1;
      if (answers[i].status == ProbeStatus::kUncertain) {
        ++open;
        EXPECT_GT(answers[i].missing, 0U);
        continue;
      }
      EXPECT_EQ(answers[i].status == ProbeStatus::kHit, touches[i]);
      if (touches[i]) {
        EXPECT_TRUE(std::binary_search(keys[i].begin(), keys[i].end(), answers[i].face));
      }
    }
    ASSERT_TRUE(certify_probes(held, pose, test::no_require, std::span<const BallProbe>(balls),
                               std::span(answers))
                    .is_ok());
    for (std::size_t i = 0; i < balls.size(); ++i)
      EXPECT_EQ(answers[i].status, touches[i] ? ProbeStatus::kHit : ProbeStatus::kMiss);
  }
  if (GetParam() != std::string("one_face")) {
    EXPECT_GT(open, 10U);
  }
  EXPECT_GT(hits, 50U);
  EXPECT_GT(misses, 50U);
}

TEST_P(ProbedModel, BoxesAreNeverWrongAndEndAsTheFullMesh) {
  std::size_t open = 0, hits = 0, misses = 0;
  TriangleTree full = *build_full_tree(model_.header, model_.store);
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    SCOPED_TRACE(seed);
    Random random(seed);
    LocalModel held(model_.store, model_.header.grid);
    test::refine_at_random(held, random);
    const Pose pose = random_pose(random);
    const double size = test::radius_m(model_);
    std::vector<BoxProbe> boxes(20);
    for (BoxProbe& box : boxes) {
      const auto at =
          test::position_m(model_.header, model_.store, {random.below(model_.header.vertex_count)});
      box.pose.translation_m = test::place(pose, at);
      if (random.below(3) != 0) box.pose.rotation = test::random_rotation(random);
      const double scale = std::ldexp(size, -static_cast<int>(random.below(7)));
      for (double& half : box.half_m) half = random.between(0, 2) * scale;
      for (double& x : box.pose.translation_m) x += random.between(-2, 2) * scale;
    }
    std::vector<ShapeAnswer> answers(boxes.size()), truth(boxes.size());
    const auto needs = probe(held.view(), pose, boxes, answers);
    ASSERT_TRUE(needs.is_ok()) << needs.status().message();
    ASSERT_TRUE(probe(full.view(), pose, boxes, truth).is_ok());
    // Of a vertex well inside a box, or a body well outside of it, the box's answer is known
    // without any of this.
    const PosedFaces faces(model_, pose);
    const double cell = std::ldexp(1.0, faces.frame.lattice_exp);
    for (std::size_t i = 0; i < boxes.size(); ++i) {
      const auto& box = boxes[i];
      bool holds_vertex = false;
      std::array<bool, 6> is_beyond;
      is_beyond.fill(true);
      for (const LatticeTriangle& face : faces.faces)
        for (const LatticePoint& p : face) {
          bool inside = true;
          for (std::size_t axis = 0; axis < 3; ++axis) {
            double along = 0;
            for (std::size_t k = 0; k < 3; ++k)
              along += box.pose.rotation[3 * k + axis] *
                       (static_cast<double>(p.v[k]) * cell - box.pose.translation_m[k]);
            inside = inside && std::abs(along) < box.half_m[axis] - 8 * cell;
            is_beyond[2 * axis] = is_beyond[2 * axis] && along > box.half_m[axis] + 8 * cell;
            is_beyond[2 * axis + 1] =
                is_beyond[2 * axis + 1] && along < -box.half_m[axis] - 8 * cell;
          }
          holds_vertex = holds_vertex || inside;
        }
      if (holds_vertex) {
        EXPECT_NE(truth[i].status, ProbeStatus::kMiss);
      }
      if (std::count(is_beyond.begin(), is_beyond.end(), true) != 0) {
        EXPECT_EQ(truth[i].status, ProbeStatus::kMiss);
      }
      hits += truth[i].status == ProbeStatus::kHit ? 1 : 0;
      misses += truth[i].status == ProbeStatus::kMiss ? 1 : 0;
      if (answers[i].status == ProbeStatus::kUncertain) {
        ++open;
      } else {
        EXPECT_EQ(answers[i].status, truth[i].status);
      }
    }
    ASSERT_TRUE(certify_probes(held, pose, test::no_require, std::span<const BoxProbe>(boxes),
                               std::span(answers))
                    .is_ok());
    for (std::size_t i = 0; i < boxes.size(); ++i) EXPECT_EQ(answers[i].status, truth[i].status);
  }
  EXPECT_GT(hits, 30U);
  EXPECT_GT(misses, 30U);
  if (GetParam() != std::string("one_face")) {
    EXPECT_GT(open, 5U);
  }
}

// ---- points -------------------------------------------------------------------------------------

TEST(PointProbe, EndsAsTheWindingNumberOverAllFacesInEveryState) {
  std::size_t inside = 0, on = 0, open = 0;
  for (const IndexedMesh& mesh : {test::make_torus(3, 1, 24, 12), test::make_nested(),
                                  test::make_closed_terrain(12, 3, -2)}) {
    const BakedModel model = test::bake_mesh(mesh, 16);
    for (std::uint64_t seed = 0; seed < 12; ++seed) {
      SCOPED_TRACE(seed);
      Random random(seed);
      LocalModel held(model.store, model.header.grid);
      test::refine_at_random(held, random);
      const Pose pose = random_pose(random);
      const PosedFaces truth(model, pose);
      std::vector<std::array<double, 3>> points(30);
      for (auto& p : points) {
        const LatticeTriangle& face =
            truth.faces[random.below(static_cast<std::uint32_t>(truth.faces.size()))];
        const double off = test::radius_m(model) * random.below(3) * 0.3;
        for (std::size_t k = 0; k < 3; ++k)
          p[k] = std::ldexp(static_cast<double>(face[0].v[k]), truth.frame.lattice_exp) +
                 random.between(-1, 1) * off;
      }
      std::vector<PointAnswer> answers(points.size());
      const auto needs = probe(held.view(), pose, points, answers);
      ASSERT_TRUE(needs.is_ok()) << needs.status().message();
      std::vector<PointAnswer> wanted(points.size());
      for (std::size_t i = 0; i < points.size(); ++i) {
        LatticePoint p;
        for (std::size_t k = 0; k < 3; ++k)
          p.v[k] = static_cast<std::int64_t>(
              std::floor(std::ldexp(points[i][k], -truth.frame.lattice_exp) + 0.5));
        wanted[i].on_surface =
            std::any_of(truth.faces.begin(), truth.faces.end(), [&](const LatticeTriangle& face) {
              return triangles_overlap({p, p, p}, face);
            });
        const bool is_in = wanted[i].on_surface || test::winding_number(truth.faces, p) != 0;
        wanted[i].status = is_in ? ProbeStatus::kHit : ProbeStatus::kMiss;
        inside += is_in ? 1 : 0;
        on += wanted[i].on_surface ? 1 : 0;
        if (answers[i].status == ProbeStatus::kUncertain) {
          ++open;
          EXPECT_GT(answers[i].missing, 0U);
          continue;
        }
        EXPECT_EQ(answers[i].status, wanted[i].status);
        EXPECT_EQ(answers[i].on_surface, wanted[i].on_surface);
      }
      ASSERT_TRUE(certify_probes(held, pose, test::no_require,
                                 std::span<const std::array<double, 3>>(points), std::span(answers))
                      .is_ok());
      for (std::size_t i = 0; i < points.size(); ++i) {
        EXPECT_EQ(answers[i].status, wanted[i].status);
        EXPECT_EQ(answers[i].on_surface, wanted[i].on_surface);
      }
    }
  }
  EXPECT_GT(inside, 200U);
  EXPECT_GT(on, 200U);
  EXPECT_GT(open, 50U);
}

// ---- what is known in closed form ---------------------------------------------------------------

TEST(RayProbe, HeightsAboveACube) {
  const BakedModel cube = test::bake_mesh(test::make_cube(1, 4), 16);
  LocalModel held(cube.store, cube.header.grid);
  Pose pose;
  pose.translation_m = {10, 20, 30};
  const std::vector<RayProbe> rays{
      {.origin_m = {10.3, 20.2, 35}},                          // 4 m above its top
      {.origin_m = {11, 21, 35}},                              // down along an upright edge
      {.origin_m = {11.01, 20, 35}},                           // past it
      {.origin_m = {10.3, 20.2, 35}, .range_m = 3.9},          // too short
      {.origin_m = {10.3, 20.2, 30}},                          // from inside: the bottom
      {.origin_m = {10.3, 20.2, 28}},                          // from below
      {.origin_m = {0, 20.5, 30.25}, .direction = {5, 0, 0}},  // from the side
      {.origin_m = {10.25, 20.5, 31}, .direction = {1, 0, 0}}  // within its top
  };
  std::vector<RayAnswer> answers(rays.size());
  ASSERT_TRUE(certify_probes(held, pose, test::no_require, std::span<const RayProbe>(rays),
                             std::span(answers))
                  .is_ok());
  const double cell = std::ldexp(1.0, cube.header.grid.exponent);
  const std::vector<double> distances{4, 4, -1, -1, 1, -1, 9, 0};
  for (std::size_t i = 0; i < rays.size(); ++i) {
    SCOPED_TRACE(i);
    EXPECT_STREQ(to_string(answers[i].status), distances[i] < 0 ? "miss" : "hit");
    if (distances[i] < 0) {
      EXPECT_TRUE(std::isnan(answers[i].distance_m()));
    } else {
      EXPECT_NEAR(answers[i].distance_m(), distances[i], cell);
    }
  }
  EXPECT_EQ(answers[0].normal, (std::array<double, 3>{0, 0, 1}));
  EXPECT_EQ(answers[4].normal, (std::array<double, 3>{0, 0, -1}));
  EXPECT_EQ(answers[6].normal, (std::array<double, 3>{-1, 0, 0}));
  EXPECT_NEAR(answers[0].point_m[2], 31, cell);
}

TEST(RayProbe, RefusesWhatIsNoRay) {
  const BakedModel cube = test::bake_mesh(test::make_cube(1, 4), 16);
  const LocalModel held(cube.store, cube.header.grid);
  const double infinite = std::numeric_limits<double>::infinity(), nan = std::nan("");
  RayAnswer answer;
  for (const RayProbe& ray :
       {RayProbe{.origin_m = {nan, 0, 0}}, RayProbe{.origin_m = {2e9, 0, 0}},
        RayProbe{.direction = {0, 0, 0}}, RayProbe{.direction = {infinite, 0, 0}},
        RayProbe{.range_m = -1}, RayProbe{.range_m = nan}})
    EXPECT_FALSE(probe(held.view(), {}, std::span(&ray, 1), std::span(&answer, 1)).is_ok());
  const BallProbe ball{.radius_m = nan};
  ShapeAnswer shape;
  EXPECT_FALSE(probe(held.view(), {}, std::span(&ball, 1), std::span(&shape, 1)).is_ok());
  const BoxProbe box{.pose = {}, .half_m = {1, -1, 1}};
  EXPECT_FALSE(probe(held.view(), {}, std::span(&box, 1), std::span(&shape, 1)).is_ok());
  const RayProbe far{.origin_m = {1e9, -1e9, 1e9}, .direction = {1e300, -1e300, 1}};
  EXPECT_TRUE(probe(held.view(), {}, std::span(&far, 1), std::span(&answer, 1)).is_ok());
}

TEST(RayProbe, ANearerHitNeedsNothingBehindIt) {
  const BakedModel terrain = test::bake_named("terrain");
  LocalModel held(terrain.store, terrain.header.grid);
  // A ray straight down meets one place of the terrain, and needs the detail of that place alone.
  const auto middle = test::position_m(terrain.header, terrain.store, {0});
  RayProbe ray{.origin_m = {middle[0] + 0.01, middle[1] + 0.01, middle[2] + 100}};
  RayAnswer answer;
  ASSERT_TRUE(certify_probes(held, {}, test::no_require, std::span<const RayProbe>(&ray, 1),
                             std::span(&answer, 1))
                  .is_ok());
  EXPECT_LT(held.mesh.split_count(), terrain.header.split_count() / 4);
}

}  // namespace
}  // namespace nearmesh
