// SPDX-License-Identifier: Apache-2.0
// Contacts of coarse and mixed levels of detail: errors, ghosts, and what refinement may change.
#include "contact_errors.hpp"
#include "fault_of.hpp"

namespace nearmesh {
namespace {

using test::Point;

TEST(ContactLevels, ErrorsFallToThoseOfTheFullMeshAndBoundsHold) {
  for (const test::ContactScene& scene : test::contact_scenes()) {
    SCOPED_TRACE(scene.name);
    const std::vector<test::ContactErrors> rows = test::contact_errors(scene);
    ASSERT_EQ(rows.size(), 5U);
    for (std::size_t i = 0; i < rows.size(); ++i) {
      SCOPED_TRACE(rows[i].percent);
      EXPECT_GT(rows[i].segments, 0U);
      EXPECT_LE(rows[i].bound_use, 1);
      EXPECT_EQ(rows[i].approximate, rows[i].percent < 100);
      EXPECT_EQ(rows[i].uncertainty_m > 0, rows[i].approximate);
      if (i == 0) continue;
      // A tessellation's own error is the floor; few contacts make a mean uneven.
      EXPECT_LE(rows[i].position_mean_m,
                std::max(1.3 * rows[i - 1].position_mean_m, 1.1 * rows.back().position_mean_m));
      EXPECT_LE(rows[i].uncertainty_m, rows[i - 1].uncertainty_m);
      EXPECT_GT(rows[i].segments, rows[i - 1].segments);
    }
    EXPECT_LT(rows.back().position_max_m, 0.004);
    EXPECT_LT(rows.back().normal_max_rad, 1e-6);
    EXPECT_GT(rows.front().position_mean_m, 5 * rows.back().position_mean_m);
  }
}

/// Splits and collapses at random places.
void change_at_random(LocalModel& model, Random& random) {
  RefineDelta delta;
  const SplitStore& store = model.mesh.store();
  const std::uint32_t n = store.vertex_count();
  for (int runs = 0; runs < 6; ++runs) {
    const VertexId v{random.below(n)};
    if (random.below(2) == 0) {
      for (std::uint32_t u = v.value; u < std::min(n, v.value + n / 10); ++u)
        ASSERT_TRUE(model.mesh.split({u}, delta));
    } else {
      NodeSpan node = model.mesh.current_node(model.mesh.active_predecessor(v));
      for (std::uint32_t up = random.below(6); up > 0; --up)
        if (const NodeSpan parent = store.parent_of(node); parent.size > 0) node = parent;
      model.mesh.collapse(node, delta);
    }
    // One operation, one update: collapses stand before splits in a delta.
    model.tree.update(delta);
    delta = {};
  }
}

/// About y, by step of steps of a turn.
std::array<double, 9> rolled(std::uint32_t step, std::uint32_t steps) {
  const auto [c, s] = test::unit_circle(step, steps);
  return {c, 0, s, 0, 1, 0, -s, 0, c};
}

TEST(RollingBall, HasTheFlatPlatesNormalThroughEveryMixtureOfLevels) {
  const BakedModel plate_model = test::bake_mesh(test::make_plate(8, 0.5, 20), 16);
  const BakedModel ball_model = test::bake_mesh(generate_sphere(32, 0), 16);
  const double depth = 0.03, circle = std::sqrt(1 - (1 - depth) * (1 - depth));
  LocalModel plate(plate_model.store, plate_model.header.grid);
  LocalModel ball(ball_model.store, ball_model.header.grid);
  Random random(3);
  std::size_t partial = 0;
  constexpr std::uint32_t kSteps = 200;
  for (std::uint32_t step = 0; step < kSteps; ++step) {
    SCOPED_TRACE(step);
    const double x = -3 + 6.0 * step / kSteps;  // a turn takes 2 pi metres
    const Pose pose{rolled(step, kSteps), {x, 0.1, 1 - depth}};
    const PosedPair posed =
        pose_pair(plate_model.header.grid, {}, "plate", ball_model.header.grid, pose, "ball")
            .value();
    const auto expect_plate_normals = [&](const Answer& answer) {
      const Contacts contacts = find_contacts(plate.view(), posed.a, ball.view(), posed.b, answer);
      for (const ContactPatch& patch : contacts.patches) {
        EXPECT_LE(test::angle_rad(patch.normal, {0, 0, 1}), 1e-6);
        EXPECT_LE(patch.normal_error_rad, 1e-6);
        EXPECT_TRUE(patch.normal_is_of_a);
        EXPECT_FALSE(patch.approximate);
      }
      for (const ContactSegment& segment : contacts.segments)
        for (const Point& p : {segment.p_m, segment.q_m}) {  // on the circle, and not beyond
          EXPECT_NEAR(p[2], 0, 1e-6);
          EXPECT_LE(test::norm3({p[0] - x, p[1] - 0.1, 0}), circle + 1e-6);
          EXPECT_GE(test::norm3({p[0] - x, p[1] - 0.1, 0}), circle - 0.05);
        }
      return contacts.patches.size();
    };
    change_at_random(plate, random);
    change_at_random(ball, random);
    const Answer seen = query(plate.view(), posed.a, ball.view(), posed.b);
    EXPECT_NE(seen.status, AnswerStatus::kFree);
    partial += seen.status == AnswerStatus::kPartial;
    expect_plate_normals(seen);
    if (step % 4 != 0) continue;
    const Answer whole =
        certify(plate, posed.a, test::no_require, ball, posed.b, test::no_require, {}).value();
    EXPECT_EQ(whole.status, AnswerStatus::kContact);
    EXPECT_EQ(expect_plate_normals(whole), 1U);
  }
  EXPECT_GT(partial, 20U);
}

TEST(RollingBall, OverThePlateTouchesNothingInAnyMixtureOfLevels) {
  const BakedModel plate_model = test::bake_mesh(test::make_plate(8, 0.5, 20), 16);
  const BakedModel ball_model = test::bake_mesh(generate_sphere(32, 0), 16);
  LocalModel plate(plate_model.store, plate_model.header.grid);
  LocalModel ball(ball_model.store, ball_model.header.grid);
  Random random(4);
  for (std::uint32_t step = 0; step < 200; ++step) {
    const Pose pose{rolled(step, 200), {-3 + 0.03 * step, 0.1, 1 + 1e-5}};
    const PosedPair posed =
        pose_pair(plate_model.header.grid, {}, "plate", ball_model.header.grid, pose, "ball")
            .value();
    change_at_random(plate, random);
    change_at_random(ball, random);
    const Answer answer = query(plate.view(), posed.a, ball.view(), posed.b);
    EXPECT_EQ(answer.pair_total, 0U);
    EXPECT_NE(answer.status, AnswerStatus::kContact);
  }
}

/// Greatest distance of an end of one's segments from the other's segments.
double farthest_m(const Contacts& from, const Contacts& to) {
  const auto vec = [](const Point& p) { return test::Vec{p[0], p[1], p[2]}; };
  long double greatest = 0;
  for (const ContactSegment& segment : from.segments)
    for (const Point& p : {segment.p_m, segment.q_m}) {
      long double least = std::numeric_limits<long double>::infinity();
      for (const ContactSegment& other : to.segments)
        least = std::min(least, test::point_segment(vec(p), vec(other.p_m), vec(other.q_m)));
      greatest = std::max(greatest, least);
    }
  return static_cast<double>(greatest);
}

TEST(RestingBall, NeverComesFreeAndStaysWithinTheStatedBound) {
  const BakedModel ground_model = test::bake_mesh(generate_terrain(16, 5), 16);
  IndexedMesh sphere = generate_sphere(24, 0);
  for (Point& p : sphere.positions_m)
    for (double& x : p) x *= 60;
  const BakedModel ball_model = test::bake_mesh(sphere, 16);
  // Its lowest point is 8 m below a vertex of the ground, its middle 52 m above.
  const Point under = test::position_m(ground_model.header, ground_model.store, {120});
  const Pose pose{.translation_m = {under[0], under[1], under[2] + 52}};
  const PosedPair posed =
      pose_pair(ground_model.header.grid, {}, "ground", ball_model.header.grid, pose, "ball")
          .value();
  const test::FullModel full_ground(ground_model), full_ball(ball_model);
  const Answer full = query(full_ground.tree.view(), posed.a, full_ball.tree.view(), posed.b);
  const Contacts exact =
      find_contacts(full_ground.tree.view(), posed.a, full_ball.tree.view(), posed.b, full);
  const test::FullSurface ground_surface(ground_model.store, posed.a),
      ball_surface(ball_model.store, posed.b);
  ASSERT_GT(full.pairs.size(), 10U);

  LocalModel ground(ground_model.store, ground_model.header.grid);
  LocalModel ball(ball_model.store, ball_model.header.grid);
  Random random(5);
  std::array<int, 4> seen{};
  int coarse = 0;
  for (int step = 0; step < 150; ++step) {
    SCOPED_TRACE(step);
    change_at_random(ground, random);
    change_at_random(ball, random);
    const Answer answer = query(ground.view(), posed.a, ball.view(), posed.b);
    ++seen[static_cast<std::size_t>(answer.status)];
    EXPECT_EQ(test::fault_of(answer, full), "");
    if (step % 5 == 0) {
      const Contacts contacts = approximate_contacts(ground.mesh, posed.a, ball.mesh, posed.b);
      EXPECT_LE(test::bound_use(contacts, ground_surface, ball_surface), 1);
    }
    if (step % 30 != 29) continue;
    // Refinement moves contacts by no more than was stated for them, both ways.
    const Contacts before = approximate_contacts(ground.mesh, posed.a, ball.mesh, posed.b);
    ASSERT_GT(before.segments.size(), 0U);
    double stated = 0;
    for (const ContactPatch& patch : before.patches) stated = std::max(stated, patch.uncertainty_m);
    coarse += stated > 0;
    stated += before.position_error_m + exact.position_error_m;
    EXPECT_LE(farthest_m(before, exact), stated);
    EXPECT_LE(farthest_m(exact, before), stated);
    // It never loses a contact again, and ends with all of them.
    EXPECT_EQ(certify(ground, posed.a, test::no_require, ball, posed.b, test::no_require, {})
                  .value()
                  .pairs,
              full.pairs);
    for (int more = 0; more < 5; ++more) {
      RefineDelta delta;
      ASSERT_TRUE(ground.mesh.split({random.below(ground_model.header.vertex_count)}, delta));
      ground.tree.update(delta);
      const Answer still = query(ground.view(), posed.a, ball.view(), posed.b);
      EXPECT_EQ(still.status, AnswerStatus::kContact);
      EXPECT_EQ(still.pairs, full.pairs);
    }
  }
  EXPECT_GE(coarse, 3);
  EXPECT_GT(seen[static_cast<std::size_t>(AnswerStatus::kPartial)], 20);
  EXPECT_GT(seen[static_cast<std::size_t>(AnswerStatus::kUncertain)], 5);
}

}  // namespace
}  // namespace nearmesh
