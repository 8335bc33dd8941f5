// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/subscriber/predict.hpp"

#include "brute_force.hpp"
#include "moving.hpp"
#include "nearmesh/core/abtree/ab_tree.hpp"
#include "test_models.hpp"

namespace nearmesh {
namespace {

using subscriber::swept_region;
using test::moved;
using test::Vector;

// A model refined at random places, with its tree.
struct Refined {
  Refined(const BakedModel& baked, Random& random, double share)
      : model(baked), mesh(model.store), tree(mesh) {
    RefineDelta delta;
    for (const VertexId u : test::all_splits(model.store))
      if (random.unit() < share) static_cast<void>(mesh.split(u, delta));
    tree.update(delta);
  }
  TreeView view() const { return tree.view(model.header.grid); }
  const BakedModel& model;
  ActiveMesh mesh;
  AbTree tree;
};

Motion random_motion(Random& random, double reach_m, double speed_mps, double turn_radps) {
  Motion motion;
  motion.pose.rotation = test::random_rotation(random);
  for (std::size_t k = 0; k < 3; ++k) {
    motion.pose.translation_m[k] = random.between(-reach_m, reach_m);
    motion.linear_velocity_mps[k] = random.between(-speed_mps, speed_mps);
    motion.angular_velocity_radps[k] = random.between(-turn_radps, turn_radps);
  }
  return motion;
}

// A point of the world in a body's grid, in grid units.
Vector in_grid(const Grid& grid, const Pose& pose, const Vector& world) {
  Vector point{};
  for (std::size_t i = 0; i < 3; ++i) {
    for (std::size_t k = 0; k < 3; ++k)
      point[i] += pose.rotation[3 * k + i] * (world[k] - pose.translation_m[k]);
    point[i] = std::ldexp(point[i] - grid.origin_m[i], -grid.exponent);
  }
  return point;
}

struct Scene {
  double reach_m, speed_mps, turn_radps, lookahead_s, margin_m;
};

TEST(SweptRegion, CoversEveryFaceAtEveryTimeOfTheLookAhead) {
  const BakedModel terrain = test::bake_mesh(generate_terrain(16, 3), 16);
  const BakedModel aircraft = test::bake_mesh(generate_aircraft(300, 3), 16);
  const auto terrain_faces = test::all_faces(terrain.store);
  const auto aircraft_faces = test::all_faces(aircraft.store);
  int covered = 0, out_of_reach = 0, full = 0;
  for (std::uint64_t seed = 1; seed <= 60; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    Random random(seed);
    const bool swap = random.below(2) == 0;
    const BakedModel &a = swap ? terrain : aircraft, &b = swap ? aircraft : terrain;
    const auto& faces = swap ? aircraft_faces : terrain_faces;
    const Refined own(a, random, random.unit()), other(b, random, random.unit());
    const Scene scene{random.below(2) == 0 ? 5.0 : 100.0, random.below(4) == 0 ? 0.0 : 300.0,
                      random.below(3) == 0 ? 0.0 : 2.0,
                      random.below(4) == 0 ? 0 : random.between(0, 2),
                      random.below(2) == 0 ? 0 : random.between(0, 50)};
    const Motion own_motion = random_motion(random, 10, scene.speed_mps, scene.turn_radps);
    Motion other_motion = random_motion(random, scene.reach_m, scene.speed_mps, scene.turn_radps);
    // One vertex of the other body stands near one of our own.
    const auto vertex = [&](const BakedModel& model, const Pose& pose) {
      const VertexId v{random.below(model.header.vertex_count)};
      return test::place(pose, test::position_m(model.header, model.store, v));
    };
    const Vector ours = vertex(a, own_motion.pose), theirs = vertex(b, other_motion.pose);
    for (std::size_t k = 0; k < 3; ++k)
      other_motion.pose.translation_m[k] +=
          ours[k] - theirs[k] + random.between(-1, 1) * scene.reach_m;
    const std::size_t max_boxes = std::size_t{1} << random.below(8);
    const TreeView own_view = own.view(), other_view = other.view();
    const std::vector<GridBox> region = swept_region(own_view, own_motion, other_view, other_motion,
                                                     scene.lookahead_s, scene.margin_m, max_boxes);
    EXPECT_LE(region.size(), max_boxes);
    full += region.size() == max_boxes ? 1 : 0;

    const GridBox root = own_view.root().box;
    const double margin = std::ldexp(scene.margin_m, -a.header.grid.exponent);
    for (int sample = 0; sample <= 4; ++sample) {
      const double t = scene.lookahead_s * sample / 4;
      const Pose own_pose = moved(own_motion, t), other_pose = moved(other_motion, t);
      for (const test::KeyedFace& face : faces) {
        Vector lo{1e300, 1e300, 1e300}, hi{-1e300, -1e300, -1e300};
        for (const VertexId corner : face.face.corners()) {
          const Vector at =
              in_grid(a.header.grid, own_pose,
                      test::place(other_pose, test::position_m(b.header, b.store, corner)));
          for (std::size_t k = 0; k < 3; ++k) {
            lo[k] = std::min(lo[k], at[k] - margin);
            hi[k] = std::max(hi[k], at[k] + margin);
          }
        }
        const auto inside = [&](const GridBox& box) {
          for (int k = 0; k < 3; ++k)
            if (lo[static_cast<std::size_t>(k)] < box.lo[k] ||
                hi[static_cast<std::size_t>(k)] > box.hi[k])
              return false;
          return true;
        };
        bool apart = false;
        for (int k = 0; k < 3; ++k)
          apart = apart || hi[static_cast<std::size_t>(k)] < root.lo[k] ||
                  lo[static_cast<std::size_t>(k)] > root.hi[k];
        const bool is_covered = std::any_of(region.begin(), region.end(), inside);
        ++(is_covered ? covered : out_of_reach);
        ASSERT_TRUE(is_covered || apart) << "time " << t;
      }
    }
  }
  EXPECT_GT(covered, 1000);
  EXPECT_GT(out_of_reach, 1000);
  EXPECT_GT(full, 20);
}

TEST(SweptRegion, IsEmptyWhereTheBodiesCannotMeet) {
  const BakedModel sphere = test::bake_named("sphere");
  Random random(1);
  const Refined own(sphere, random, 0.5), other(sphere, random, 0.5);
  Motion far;
  far.pose.translation_m = {0, 0, 10};
  EXPECT_TRUE(swept_region(own.view(), {}, other.view(), far, 1, 0, 64).empty());
  EXPECT_FALSE(swept_region(own.view(), {}, other.view(), far, 1, 9, 64).empty());
  far.linear_velocity_mps = {0, 0, -9};
  EXPECT_FALSE(swept_region(own.view(), {}, other.view(), far, 1, 0, 64).empty());
  far.linear_velocity_mps = {0, 0, 9};
  EXPECT_TRUE(swept_region(own.view(), {}, other.view(), far, 1, 0, 64).empty());
}

TEST(SweptRegion, MoreBoxesGiveASmallerRegion) {
  const BakedModel terrain = test::bake_named("terrain");
  const BakedModel aircraft = test::bake_named("aircraft");
  Random random(1);
  const Refined own(terrain, random, 1), other(aircraft, random, 1);
  Motion landed;
  landed.pose.translation_m = test::position_m(terrain.header, terrain.store, {100});
  const auto volume = [&](std::size_t max_boxes) {
    double sum = 0;
    for (const GridBox& box : swept_region(own.view(), {}, other.view(), landed, 0, 0, max_boxes)) {
      double product = 1;
      for (int k = 0; k < 3; ++k) product *= double{0} + box.hi[k] - box.lo[k];
      sum += product;
    }
    return sum;
  };
  EXPECT_LT(volume(64), volume(1) / 2);
}

}  // namespace
}  // namespace nearmesh
