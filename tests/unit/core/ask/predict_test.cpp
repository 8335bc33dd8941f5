// SPDX-License-Identifier: Apache-2.0
#include "core/ask/predict.hpp"

#include "brute_force.hpp"
#include "core/refine/refined_mesh.hpp"
#include "nearmesh/core/abtree/detail/ab_tree.hpp"
#include "nearmesh/core/geometry/detail/box_overlap.hpp"
#include "test_models.hpp"
#include "tests/unit/subscriber/peer/moving.hpp"

namespace nearmesh {
namespace {

using test::moved;
using test::Vector3;

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
Vector3 in_grid(const Grid& grid, const Pose& pose, const Vector3& world) {
  Vector3 point{};
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
    const Vector3 ours = vertex(a, own_motion.pose), theirs = vertex(b, other_motion.pose);
    for (std::size_t k = 0; k < 3; ++k)
      other_motion.pose.translation_m[k] +=
          ours[k] - theirs[k] + random.between(-1, 1) * scene.reach_m;
    const std::size_t max_boxes = std::size_t{1} << random.below(8);
    const TreeView own_view = own.view(), other_view = other.view();
    const GridBox root = own_view.root().box;
    const std::vector<RegionPart> region =
        swept_region(own_view, own_motion, other_view, other_motion, scene.lookahead_s,
                     scene.margin_m, max_boxes, {{root}});
    EXPECT_LE(region.size(), max_boxes);
    full += max_boxes > kLanes && region.size() + kLanes > max_boxes ? 1 : 0;

    const double margin = std::ldexp(scene.margin_m, -a.header.grid.exponent);
    for (int sample = 0; sample <= 4; ++sample) {
      const double t = scene.lookahead_s * sample / 4;
      const Pose own_pose = moved(own_motion, t), other_pose = moved(other_motion, t);
      for (const test::KeyedFace& face : faces) {
        DoubleTriangle corners{};
        std::vector<GridBox> points;  // corners, each moved by the margin, any way
        for (const VertexId corner : face.face.corners()) {
          const Vector3 at =
              in_grid(a.header.grid, own_pose,
                      test::place(other_pose, test::position_m(b.header, b.store, corner)));
          const std::array<double, 9> turn = test::random_rotation(random);
          GridBox point;
          for (int k = 0; k < 3; ++k) {
            const auto i = static_cast<std::size_t>(k);
            corners[points.size()][i] = at[i];
            const double moved_to = at[i] + turn[i] * margin;
            point.lo[k] = static_cast<std::int32_t>(std::floor(moved_to));
            point.hi[k] = static_cast<std::int32_t>(std::ceil(moved_to));
          }
          points.push_back(point);
        }
        // Parts are convex, so they hold a face if they hold its corners.
        const auto inside = [&](const RegionPart& part) {
          return std::all_of(points.begin(), points.end(),
                             [&](const GridBox& point) { return part.meets(point); });
        };
        CenteredBox reach = centered(root);
        for (double& half : reach.half) half += margin;
        const bool apart = box_triangle_apart(
            make_relative_frame(a.header.grid, own_pose, b.header.grid, other_pose), reach,
            corners);
        const bool is_covered = std::any_of(region.begin(), region.end(), inside);
        ++(is_covered ? covered : out_of_reach);
        ASSERT_TRUE(is_covered || apart) << "time " << t;
      }
    }
  }
  EXPECT_GT(covered, 1000);
  EXPECT_GT(out_of_reach, 1000);
  EXPECT_GT(full, 10);
}

TEST(SweptRegion, IsEmptyWhereTheBodiesCannotMeet) {
  const BakedModel sphere = test::bake_named("sphere");
  Random random(1);
  const Refined own(sphere, random, 0.5), other(sphere, random, 0.5);
  const std::vector<GridBox> near = root_reach(own.model.store);
  Motion far;
  far.pose.translation_m = {0, 0, 10};
  const auto parts = [&](double margin_m) {
    return swept_region(own.view(), {}, other.view(), far, 1, margin_m, 64, near).size();
  };
  EXPECT_EQ(parts(0), 0U);
  EXPECT_GT(parts(9), 0U);
  far.linear_velocity_mps = {0, 0, -9};
  EXPECT_GT(parts(0), 0U);
  far.linear_velocity_mps = {0, 0, 9};
  EXPECT_EQ(parts(0), 0U);
}

TEST(SweptRegion, HasNoPartThatIsNotNear) {
  const BakedModel terrain = test::bake_named("terrain");
  const BakedModel aircraft = test::bake_named("aircraft");
  Random random(1);
  const Refined own(terrain, random, 1), other(aircraft, random, 1);
  Motion landed;
  landed.pose.translation_m = test::position_m(terrain.header, terrain.store, {100});
  const auto all =
      swept_region(own.view(), {}, other.view(), landed, 0, 0, 64, root_reach(terrain.store));
  ASSERT_GT(all.size(), 1U);
  const std::vector<GridBox> near{all[0].box};
  const auto some = swept_region(own.view(), {}, other.view(), landed, 0, 0, 64, near);
  EXPECT_LT(some.size(), all.size());
  EXPECT_FALSE(some.empty());
  for (const RegionPart& part : some) EXPECT_TRUE(part.meets(near[0]));
}

// Of a ball: boxes must hold its bulges, slabs need not.
TEST(SweptRegion, SlabsHugASurfaceAskewToTheAxes) {
  const BakedModel sphere = test::bake_named("sphere");
  Random random(1);
  const Refined own(sphere, random, 1), other(sphere, random, 1);
  const auto region =
      swept_region(own.view(), {}, other.view(), {}, 0, 0, 64, root_reach(sphere.store));
  double with_slabs = 0, boxes = 0;
  const std::int32_t most = sphere.store.grid_max();
  for (int i = 0; i < 20000; ++i) {
    GridBox point;
    for (int k = 0; k < 3; ++k)
      point.lo[k] = point.hi[k] =
          static_cast<std::int32_t>(random.below(static_cast<std::uint32_t>(most)));
    const auto meets = [&](const RegionPart& part) { return part.meets(point); };
    const auto box_meets = [&](const RegionPart& part) { return part.box.meets(point); };
    with_slabs += std::any_of(region.begin(), region.end(), meets) ? 1 : 0;
    boxes += std::any_of(region.begin(), region.end(), box_meets) ? 1 : 0;
  }
  EXPECT_GT(with_slabs, 0);
  EXPECT_LT(with_slabs, boxes / 2);
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
    for (const RegionPart& part : swept_region(own.view(), {}, other.view(), landed, 0, 0,
                                               max_boxes, root_reach(terrain.store))) {
      double product = 1;
      for (int k = 0; k < 3; ++k) product *= double{0} + part.box.hi[k] - part.box.lo[k];
      sum += product;
    }
    return sum;
  };
  EXPECT_LT(volume(64), volume(1) / 2);
}

// ---- requests -----------------------------------------------------------------------------------

class OneRequest : public ::testing::TestWithParam<std::string> {};
INSTANTIATE_TEST_SUITE_P(Models, OneRequest, ::testing::ValuesIn(test::mesh_names()),
                         [](const auto& model) { return model.param; });

// What is asked for at one go suffices: nothing that the query then lacks stands outside the
// region, whatever was known before, and however boxes of children stand out of those of their
// parents.
TEST_P(OneRequest, IsEnoughToCertify) {
  const BakedModel model = test::bake_named(GetParam());
  const BakedModel other = test::bake_named(GetParam() == "aircraft" ? "sphere" : "aircraft");
  const test::FullModel body(other);
  Random random(5);
  int asked = 0;
  for (int i = 0; i < 40; ++i) {
    SCOPED_TRACE(i);
    RefinedMesh replica(model.header);
    AbTree tree(replica.mesh());
    const auto view = [&] { return tree.view(model.header.grid); };
    // Two poses, so that the second finds something known.
    for (int pose = 0; pose < 2; ++pose) {
      const auto poses =
          test::near_poses(random, model, test::radius_m(model), other, test::radius_m(other));
      const Motion own{.pose = poses.a}, motion{.pose = poses.b};
      const PosedPair posed =
          pose_pair(model.header.grid, own.pose, "a", other.header.grid, motion.pose, "b").value();
      const Answer before = query(view(), posed.a, body.tree.view(), posed.b);
      if (is_certified(before.status)) continue;
      const auto region = [&](std::size_t max_parts, std::span<const GridBox> near) {
        return swept_region(view(), own, body.tree.view(), motion, 0, 0, max_parts, near);
      };
      const auto request = make_request(replica.store(), region, before.missing_a,
                                        1U << random.below(9), kMaxRequestSplits);
      ASSERT_TRUE(request.has_value());
      ASSERT_EQ(check_request(model.store, *request).message(), "");
      if (request->attach.size() == kMaxAttachNodes) continue;  // more than one request names
      const Demand demand = collect(model.store, *request, nullptr, AttachRule::kAlways).value();
      ASSERT_FALSE(demand.truncated);
      for (const auto& bytes :
           encode_batches(model.header, model.store, demand.treelet, BoxPolicy::kCutNodes)) {
        const RefinedMesh::Applied applied =
            replica.apply_batch(decode_batch(model.header, bytes).value());
        ASSERT_TRUE(applied.status.is_ok());
        tree.update(applied.delta);
      }
      ++asked;
      const Answer after = query(view(), posed.a, body.tree.view(), posed.b);
      EXPECT_TRUE(is_certified(after.status)) << to_string(after.status);
      EXPECT_EQ(
          after.pairs,
          query(test::FullModel(model).tree.view(), posed.a, body.tree.view(), posed.b).pairs);
    }
  }
  EXPECT_TRUE(asked > 5 || model.header.split_count() < 10) << asked;
}

// Both bodies come over the wire: neither waits for the other, rounds are few, and less is asked
// for than by what the other body's coarse boxes cover.
TEST(MakeRequest, TwoBodiesRefineEachOtherInAFewRounds) {
  const BakedModel model = test::bake_named("sphere");
  const test::FullModel full(model);
  Random random(6);
  int touching = 0;
  std::size_t asked = 0, covered = 0;
  for (int i = 0; i < 20; ++i) {
    SCOPED_TRACE(i);
    const auto poses =
        test::near_poses(random, model, test::radius_m(model), model, test::radius_m(model));
    const std::array<Motion, 2> motions{Motion{.pose = poses.a}, Motion{.pose = poses.b}};
    const Grid& grid = model.header.grid;
    const PosedPair posed = pose_pair(grid, poses.a, "a", grid, poses.b, "b").value();
    std::array<RefinedMesh, 2> replicas{RefinedMesh(model.header), RefinedMesh(model.header)};
    std::array<AbTree, 2> trees{AbTree(replicas[0].mesh()), AbTree(replicas[1].mesh())};
    const auto ask = [&] {
      return query(trees[0].view(grid), posed.a, trees[1].view(grid), posed.b);
    };
    Answer answer = ask();
    for (int round = 0; !is_certified(answer.status); ++round) {
      ASSERT_LT(round, 12);
      std::array<Demand, 2> demands;
      for (std::size_t own = 0; own < 2; ++own) {
        const auto region = [&](std::size_t max_parts, std::span<const GridBox> near) {
          return swept_region(trees[own].view(grid), motions[own], trees[1 - own].view(grid),
                              motions[1 - own], 0, 0, max_parts, near);
        };
        auto request =
            make_request(replicas[own].store(), region,
                         own == 0 ? answer.missing_a : answer.missing_b, 64, kMaxRequestSplits);
        if (!request) continue;
        demands[own] = collect(model.store, *request, nullptr, AttachRule::kAlways).value();
        if (round > 0) continue;
        asked += demands[own].treelet.size();
        for (RegionPart& part : request->region) part.min_extent = 0;
        covered +=
            collect(model.store, *request, nullptr, AttachRule::kAlways).value().treelet.size();
      }
      for (std::size_t own = 0; own < 2; ++own)
        for (const auto& bytes :
             encode_batches(model.header, model.store, demands[own].treelet, BoxPolicy::kCutNodes))
          trees[own].update(
              replicas[own].apply_batch(decode_batch(model.header, bytes).value()).delta);
      answer = ask();
    }
    EXPECT_EQ(answer.pairs, query(full.tree.view(), posed.a, full.tree.view(), posed.b).pairs);
    touching += answer.pairs.empty() ? 0 : 1;
  }
  EXPECT_GT(touching, 3);
  EXPECT_LT(asked, covered * 3 / 4);
}

// Parts of a request are 24 bytes each: where little is missing, a few say enough.
TEST(MakeRequest, WeighsNoMoreThanTheAnswerThatIsExpected) {
  const BakedModel terrain = test::bake_named("terrain");
  std::vector<std::size_t> asked_for;
  const auto region = [&](std::size_t max_parts, std::span<const GridBox>) {
    asked_for.push_back(max_parts);
    return std::vector<RegionPart>{GridBox{{0, 0, 0}, {0x7fffffff, 0x7fffffff, 0x7fffffff}}};
  };
  SplitStore store(terrain.header);
  ASSERT_TRUE(make_request(store, region, {}, 64, kMaxRequestSplits).has_value());
  EXPECT_EQ(asked_for.back(), 64U);
  ASSERT_TRUE(make_request(store, region, {}, 64, 30).has_value());
  EXPECT_EQ(asked_for.back(), 15U);
  // All but the last few splits are known.
  RefinedMesh replica(terrain.header);
  RegionRequest everything{.region = {GridBox{{0, 0, 0}, {0x7fffffff, 0x7fffffff, 0x7fffffff}}},
                           .max_splits = terrain.header.split_count() - 6};
  for (const BaseRoot& root : terrain.header.roots)
    if (root.node.size > 1) everything.attach.push_back(root.node);
  const Demand demand = collect(terrain.store, everything, nullptr, AttachRule::kAlways).value();
  for (const auto& bytes :
       encode_batches(terrain.header, terrain.store, demand.treelet, BoxPolicy::kCutNodes))
    ASSERT_TRUE(replica.apply_batch(decode_batch(terrain.header, bytes).value()).status.is_ok());
  ASSERT_TRUE(make_request(replica.store(), region, {}, 64, kMaxRequestSplits).has_value());
  EXPECT_LE(asked_for.back(), 3U);
}

// What is asked for ahead comes whole: each answer leaves nothing below the nodes it was asked for,
// and about as much is asked for as may be.
TEST(MakeRequest, AsksForWholeNodesWhereThereIsTime) {
  const BakedModel terrain = test::bake_named("terrain");
  const auto region = [](std::size_t, std::span<const GridBox>) {
    return std::vector<RegionPart>{GridBox{{0, 0, 0}, {0x7fffffff, 0x7fffffff, 0x7fffffff}}};
  };
  RefinedMesh replica(terrain.header);
  constexpr std::uint32_t kMost = 150;
  std::size_t requests = 0;
  while (const auto request =
             make_request(replica.store(), region, {}, 64, kMost, Portion::kWholeNodes)) {
    ASSERT_EQ(check_request(terrain.store, *request).message(), "");
    const Demand demand = collect(terrain.store, *request, nullptr, AttachRule::kAlways).value();
    if (request->attach.size() > 1) {
      EXPECT_FALSE(demand.truncated);
    }
    ASSERT_FALSE(demand.treelet.empty());
    for (const auto& bytes :
         encode_batches(terrain.header, terrain.store, demand.treelet, BoxPolicy::kCutNodes))
      ASSERT_TRUE(replica.apply_batch(decode_batch(terrain.header, bytes).value()).status.is_ok());
    ++requests;
  }
  EXPECT_EQ(replica.mesh().split_count(), terrain.header.split_count());
  EXPECT_LT(requests, 3 * terrain.header.split_count() / kMost);
}

TEST(MakeRequest, NamesNothingWhereNothingIsMissing) {
  const BakedModel model = test::bake_named("terrain");
  const auto everywhere = [&](std::size_t, std::span<const GridBox>) {
    return std::vector<RegionPart>{GridBox{{0, 0, 0}, {0x7fffffff, 0x7fffffff, 0x7fffffff}}};
  };
  EXPECT_FALSE(make_request(model.store, everywhere, {}, 64, 100).has_value());
  const SplitStore empty(model.header);
  EXPECT_TRUE(make_request(empty, everywhere, {}, 64, 100).has_value());
}

TEST(MakeRequest, NamesWhatAnAnswerLacksWhereverItIs) {
  const BakedModel model = test::bake_named("terrain");
  const SplitStore empty(model.header);
  const NodeSpan root = model.header.roots[3].node;
  const auto nowhere = [](std::size_t, std::span<const GridBox>) {
    return std::vector<RegionPart>{};
  };
  EXPECT_FALSE(make_request(empty, nowhere, {}, 64, 100).has_value());
  const auto request = make_request(empty, nowhere, {root}, 64, 100);
  ASSERT_TRUE(request.has_value());
  EXPECT_EQ(request->attach, std::vector<NodeSpan>{root});
  EXPECT_EQ(check_request(empty, *request).message(), "");
}

TEST(MergeByPlace, CoversAllPartsWithFewThatAreNotFarApart) {
  Random random(4);
  std::vector<RegionPart> parts;
  // Two crowds, far from each other.
  for (int i = 0; i < 700; ++i) {
    RegionPart part;
    for (int k = 0; k < 3; ++k) {
      part.box.lo[k] = static_cast<std::int32_t>(random.below(1000)) + (i % 2 == 0 ? 0 : 1000000);
      part.box.hi[k] = part.box.lo[k] + static_cast<std::int32_t>(random.below(50));
    }
    part.radius = static_cast<std::int32_t>(random.below(30));
    part.min_extent = 5 + static_cast<std::int32_t>(random.below(10));
    parts.push_back(part);
  }
  EXPECT_EQ(merge_by_place(parts, 700), parts);
  for (const std::size_t most : {1U, 2U, 5U, 256U}) {
    const std::vector<RegionPart> merged = merge_by_place(parts, most);
    ASSERT_EQ(merged.size(), most);
    for (const RegionPart& part : merged) {
      EXPECT_EQ(fault_of(part), nullptr);
      if (most == 2 || most == 256) {
        EXPECT_LT(part.box.extent(), 5000);  // the crowds are a million apart
      }
    }
    for (int i = 0; i < 3000; ++i) {
      const RegionPart& some = parts[random.below(700)];
      GridBox node;
      for (int k = 0; k < 3; ++k) {
        node.lo[k] = some.box.lo[k] - 40 + static_cast<std::int32_t>(random.below(120));
        node.hi[k] = node.lo[k] + static_cast<std::int32_t>(random.below(40));
      }
      const auto asks = [&](const RegionPart& part) { return part.asks_for(node); };
      if (std::any_of(parts.begin(), parts.end(), asks)) {
        ASSERT_TRUE(std::any_of(merged.begin(), merged.end(), asks));
      }
    }
  }
}

}  // namespace
}  // namespace nearmesh
