// SPDX-License-Identifier: Apache-2.0
#include "core/query/obstacles_ahead.hpp"

#include <algorithm>

#include "core/query/lacking_ahead.hpp"
#include "model_pairs.hpp"

namespace nearmesh {
namespace {

constexpr double kSpan_s = 0.5;
constexpr std::size_t kAll = 1'000'000;
constexpr std::uint64_t kEnough = 100'000'000;

/// A cut of one model, and another model whole, so that each node of the first lacks by itself.
struct CutAndWhole {
  CutAndWhole(const BakedModel& baked_a, const BakedModel& baked_b)
      : a(baked_a.store, baked_a.header.grid), b(baked_b.store, baked_b.header.grid) {
    RefineDelta delta;
    for (std::uint32_t v = 0; v < baked_b.store.vertex_count(); ++v)
      if (!baked_b.store.is_root({v})) static_cast<void>(b.mesh.split({v}, delta));
    b.tree.update(delta);
  }
  [[nodiscard]] std::unique_ptr<ObstaclesAhead> obstacles(
      const std::pair<Motion, Motion>& motions) const {
    return ObstaclesAhead::make(a.view(), motions.first, "a", b.view(), motions.second, "b",
                                kSpan_s, 0)
        .value();
  }
  [[nodiscard]] std::vector<NodeSpan> lacking(const std::pair<Motion, Motion>& motions) const {
    return lacking_ahead(a.view(), motions.first, "a", b.view(), motions.second, "b", kSpan_s, 0)
        .value()
        .a;
  }

  LocalModel a, b;
};

class ObstaclesOfNodes : public test::ModelPair {
 protected:
  [[nodiscard]] bool has_nodes() const { return a_.store.vertex_count() > a_.store.roots().size(); }
};
INSTANTIATE_TEST_SUITE_P(Models, ObstaclesOfNodes, test::model_pairs(), test::name_of_pair);

// What obstacles say of a node is what a look ahead sees of it; they are found in larger steps, and
// may say more.
TEST_P(ObstaclesOfNodes, ANodeThatLacksHasSome) {
  Random random(5);
  int with = 0, without = 0;
  for (int i = 0; i < 60; ++i) {
    const std::pair<Motion, Motion> motions = near_motions(random);
    const CutAndWhole cuts(a_, b_);
    const std::vector<NodeSpan> lacking = cuts.lacking(motions);
    const auto obstacles = cuts.obstacles(motions);
    for (const BaseRoot& root : a_.store.roots()) {
      if (root.node.size < 2) continue;
      std::vector<Obstacle> found;
      ASSERT_LE(obstacles->find(root.node, {}, kAll, kEnough, found), kEnough);
      const bool lacks = std::binary_search(lacking.begin(), lacking.end(), root.node);
      EXPECT_TRUE(!found.empty() || !lacks) << i << ": " << to_string(root.node);
      ++(found.empty() ? without : with);
      if (found.size() < 2) continue;
      std::vector<Obstacle> some;
      EXPECT_LE(obstacles->find(root.node, {}, 1, kEnough, some), kEnough);
      EXPECT_TRUE(!some.empty() && some.size() < found.size() + 1);
      some.clear();
      EXPECT_GT(obstacles->find(root.node, {}, kAll, 3, some), 3U) << "three tests do not suffice";
    }
  }
  EXPECT_EQ(with > 8, has_nodes()) << with;
  EXPECT_EQ(without > 8, has_nodes()) << without;
}

// Who asks for what is left, again and again, misses nothing that he would have found at once.
TEST_P(ObstaclesOfNodes, WhatHalfSpacesKeepClearIsNotFoundAndNothingElseIsLeftOut) {
  Random random(6);
  std::size_t parted = 0, left = 0, cleared = 0;
  for (int i = 0; i < 25; ++i) {
    const std::pair<Motion, Motion> motions = near_motions(random);
    CutAndWhole cuts(a_, b_);
    const auto obstacles = cuts.obstacles(motions);
    for (const BaseRoot& root : a_.store.roots()) {
      if (root.node.size < 2) continue;
      const GridPoint& from = a_.store.position(root.node.first);
      std::vector<GridPoint> points;
      for (std::uint32_t v = root.node.begin(); v < root.node.end(); ++v)
        points.push_back(a_.store.position({v}));
      std::vector<Obstacle> all;
      ASSERT_LE(obstacles->find(root.node, {}, kAll, kEnough, all), kEnough);
      const std::vector<HalfSpace> told = choose_half_spaces(points, from, all, 2).half_spaces;
      if (told.empty()) continue;
      std::vector<Obstacle> found;
      ASSERT_LE(obstacles->find(root.node, told, kAll, kEnough, found), kEnough);
      const auto is_parted = [&](const Obstacle& obstacle) {
        return std::any_of(told.begin(), told.end(), [&](const HalfSpace& half_space) {
          return keeps_clear(half_space, from, obstacle);
        });
      };
      EXPECT_TRUE(std::none_of(found.begin(), found.end(), is_parted));
      const auto expected =
          std::count_if(all.begin(), all.end(), [&](const Obstacle& o) { return !is_parted(o); });
      EXPECT_GE(expected, static_cast<std::ptrdiff_t>(found.size()));
      EXPECT_EQ(expected > 0, !found.empty()) << "of coarser parts none is parted that all are";
      parted += all.size() - found.size();
      left += found.size();
      if (!found.empty()) continue;
      // Told of them, the node lacks no more.
      RefineDelta delta;
      for (const HalfSpace& half_space : told)
        static_cast<void>(cuts.a.mesh.add_half_space(root.node, half_space, delta));
      cuts.a.tree.update(delta);
      const std::vector<NodeSpan> lacking = cuts.lacking(motions);
      EXPECT_FALSE(std::binary_search(lacking.begin(), lacking.end(), root.node));
      ++cleared;
      for (const HalfSpace& half_space : told) EXPECT_LT(half_space.direction, 1 << kDirectionBits);
    }
  }
  if (GetParam().first == std::string("terrain")) {
    EXPECT_GT(parted, 0U);
    EXPECT_GT(left, 0U);
    EXPECT_GT(cleared, 0U);
  }
}

TEST(ObstaclesAheadOfMotions, AreThoseThatASweepTakes) {
  const BakedModel baked = test::bake_named("terrain");
  const CutAndWhole cuts(baked, baked);
  Motion bad;
  bad.linear_velocity_mps[0] = std::numeric_limits<double>::quiet_NaN();
  const auto made =
      ObstaclesAhead::make(cuts.a.view(), {}, "a", cuts.b.view(), bad, "the mover", kSpan_s, 0);
  ASSERT_FALSE(made.is_ok());
  EXPECT_NE(made.status().message().find("the mover"), std::string::npos);
}

}  // namespace
}  // namespace nearmesh
