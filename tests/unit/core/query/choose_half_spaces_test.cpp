// SPDX-License-Identifier: Apache-2.0
#include "core/query/choose_half_spaces.hpp"

#include "fault_of.hpp"
#include "half_spaces.hpp"
#include "model_pairs.hpp"

namespace nearmesh {
namespace {

constexpr Grid kPlainGrid{.exponent = -16, .bits = 21};

RelativeFrame frame_at(const std::array<double, 9>& rotation,
                       const std::array<double, 3>& at_units) {
  Pose pose{.rotation = rotation};
  for (std::size_t k = 0; k < 3; ++k) pose.translation_m[k] = std::ldexp(at_units[k], -16);
  const PosedPair posed = pose_pair(kPlainGrid, {}, "a", kPlainGrid, pose, "b").value();
  return make_relative_frame(posed.a, posed.b);
}

std::vector<GridPoint> cloud(Random& random, std::uint32_t count, std::uint32_t size) {
  std::vector<GridPoint> points(count);
  for (GridPoint& p : points)
    for (int k = 0; k < 3; ++k) p[k] = 500'000 + static_cast<std::int32_t>(random.below(size));
  return points;
}

CenteredBox box_at(const std::array<double, 3>& center, double half) {
  return {center, {half, half, half}};
}

TEST(ChooseHalfSpaces, AreTrueAndPartWhatTheyAreSaidToPart) {
  Random random(41);
  std::size_t all = 0, some = 0, none = 0;
  for (int i = 0; i < 2000; ++i) {
    const auto points = cloud(random, 1 + random.below(60), 1000);
    const GridPoint from = points[random.below(static_cast<std::uint32_t>(points.size()))];
    std::vector<RelativeFrame> frames;
    for (int k = 0; k < 4; ++k)
      frames.push_back(frame_at(test::random_rotation(random), {random.between(-9, 9), 0, 0}));
    std::vector<Obstacle> obstacles(random.below(6));
    for (Obstacle& obstacle : obstacles) {
      obstacle.other_in_own = &frames[random.below(4)];
      // About the points: through the inverse, so that it is near them in their own grid.
      const RelativeFrame& f = *obstacle.other_in_own;
      std::array<double, 3> at{}, there{};
      for (std::size_t k = 0; k < 3; ++k)
        at[k] = 500'500 + random.between(-1500, 1500) - f.translation[k];
      for (std::size_t k = 0; k < 3; ++k)
        there[k] =
            f.inverse[3 * k] * at[0] + f.inverse[3 * k + 1] * at[1] + f.inverse[3 * k + 2] * at[2];
      obstacle.box = box_at(there, random.between(0, 400));
      if (random.below(2) == 0) {
        obstacle.face.emplace();
        for (auto& corner : *obstacle.face)
          for (std::size_t k = 0; k < 3; ++k)
            corner[k] = at[k] + f.translation[k] + random.between(-300, 300);
      }
      if (random.below(3) == 0) obstacle.drift.around = random.between(0, 100);
    }
    const ChosenHalfSpaces chosen = choose_half_spaces(points, from, obstacles, 3);
    EXPECT_LE(chosen.half_spaces.size(), 3U);
    std::size_t left = 0;
    for (const Obstacle& obstacle : obstacles)
      left += std::none_of(chosen.half_spaces.begin(), chosen.half_spaces.end(),
                           [&](const HalfSpace& h) { return keeps_clear(h, from, obstacle); })
                  ? 1
                  : 0;
    EXPECT_EQ(chosen.left, left);
    for (const HalfSpace& h : chosen.half_spaces) {
      for (const GridPoint& p : points) EXPECT_TRUE(contains(h, from, p));
      EXPECT_TRUE(std::any_of(obstacles.begin(), obstacles.end(), [&](const Obstacle& obstacle) {
        return keeps_clear(h, from, obstacle);
      }));
    }
    ++(left == 0 ? all : left < obstacles.size() ? some : none);
  }
  EXPECT_GT(all, 500U);
  EXPECT_GT(some, 20U);
  EXPECT_GT(none, 10U);
}

TEST(ChooseHalfSpaces, OneSufficesWhereAPlaneLeavesRoom) {
  Random random(42);
  for (int i = 0; i < 1000; ++i) {
    const auto points = cloud(random, 40, 1000);
    const RelativeFrame f = frame_at(test::random_rotation(random), {});
    std::array<double, 3> way{};
    double length = 0;
    for (double& x : way) {
      x = random.between(-1, 1);
      length += x * x;
    }
    std::vector<Obstacle> obstacles(1 + random.below(5));
    for (Obstacle& obstacle : obstacles) {
      obstacle.other_in_own = &f;
      obstacle.face.emplace();
      for (auto& corner : *obstacle.face)
        for (std::size_t k = 0; k < 3; ++k)
          corner[k] = 500'500 + way[k] / std::sqrt(length) * 1700 + random.between(-200, 200);
    }
    const ChosenHalfSpaces chosen = choose_half_spaces(points, points[0], obstacles);
    EXPECT_EQ(chosen.left, 0U) << i;
    EXPECT_EQ(chosen.half_spaces.size(), 1U) << i;
  }
}

TEST(ChooseHalfSpaces, OneASideWhereObstaclesStandAround) {
  Random random(43);
  const auto points = cloud(random, 200, 1000);
  const RelativeFrame f = frame_at({1, 0, 0, 0, 1, 0, 0, 0, 1}, {});
  std::vector<Obstacle> obstacles;
  for (const auto& way : {std::array<double, 3>{1, 0, 0}, {-1, 0.2, 0}, {0, 1, 0.1}})
    obstacles.push_back(
        {&f,
         {},
         box_at({500'500 + 1500 * way[0], 500'500 + 1500 * way[1], 500'500 + 1500 * way[2]}, 300),
         {}});
  const ChosenHalfSpaces three = choose_half_spaces(points, points[0], obstacles);
  EXPECT_EQ(three.left, 0U);
  EXPECT_GE(three.half_spaces.size(), 2U);
  EXPECT_GT(choose_half_spaces(points, points[0], obstacles, 1).left, 0U);
  obstacles.push_back({&f, {}, box_at({500'500, 500'500, 500'500}, 1), {}});
  EXPECT_GE(choose_half_spaces(points, points[0], obstacles).left, 1U);
  EXPECT_EQ(choose_half_spaces({}, {}, obstacles).left, 4U);
  EXPECT_EQ(choose_half_spaces(points, points[0], {}).half_spaces.size(), 0U);
}

/// Along own axes: whatever the walk does not part is in it, since it tries these, and others.
bool may_meet(const RelativeFrame& f, const CenteredBox& own, const CenteredBox& other) {
  for (std::size_t k = 0; k < 3; ++k) {
    double middle = f.translation[k] - own.center[k], reach = own.half[k] + f.slack;
    for (std::size_t j = 0; j < 3; ++j) {
      middle += f.rotation[3 * k + j] * other.center[j];
      reach += f.abs_rotation[3 * k + j] * other.half[j];
    }
    if (std::abs(middle) > 1.01 * reach) return false;
  }
  return true;
}

// What it is for: a node that an answer misses is told about instead of split.
class ChooseForPair : public test::ModelPair {};
INSTANTIATE_TEST_SUITE_P(Models, ChooseForPair, test::model_pairs(), test::name_of_pair);

TEST_P(ChooseForPair, WhatIsToldOfMissingNodesSettlesThemOrLeavesThemMissing) {
  const test::FullModel full_a(a_), full_b(b_);
  const test::TrueBoxes truth(a_.store);
  std::size_t missing = 0, settled = 0;
  for (std::uint64_t seed = 0; seed < 60; ++seed) {
    SCOPED_TRACE(seed);
    State state(*this, 2 * seed);
    auto& [random, a, b] = state;
    const PosedPair posed = test::near_pose(random, a_, b_);
    const Answer full = query(full_a.tree.view(), posed.a, full_b.tree.view(), posed.b);
    const Answer before = query(a.view(), posed.a, b.view(), posed.b);
    const RelativeFrame f = make_relative_frame(posed.a, posed.b);
    RefineDelta delta;
    std::vector<NodeSpan> told;
    for (const NodeSpan& node : before.missing_a) {
      const CenteredBox own = centered(a_.store.box(node));
      std::vector<Obstacle> obstacles;
      for (const NodeSpan& other : test::unresolved_nodes(b.mesh)) {
        const CenteredBox box = centered(b_.store.box(other));
        if (may_meet(f, own, box)) obstacles.push_back({&f, {}, box, {}});
      }
      for (const test::KeyedFace& keyed : test::exact_faces(b.mesh, test::all_faces(b_.store))) {
        std::array<GridPoint, 3> corners;
        for (std::size_t c = 0; c < 3; ++c) corners[c] = b_.store.position(keyed.face.corners()[c]);
        const DoubleTriangle face = to_a_units(f, corners);
        if (!box_triangle_apart(f, own, face)) obstacles.push_back({&f, face, {}, {}});
      }
      std::vector<GridPoint> points;
      truth.for_each_corner(node, [&](const GridPoint& p) { points.push_back(p); });
      const ChosenHalfSpaces chosen =
          choose_half_spaces(points, a_.store.position(node.first), obstacles);
      for (const HalfSpace& h : chosen.half_spaces) a.mesh.add_half_space(node, h, delta);
      if (chosen.left == 0) told.push_back(node);
    }
    a.tree.update(delta);
    const Answer after = query(a.view(), posed.a, b.view(), posed.b);
    EXPECT_EQ(test::fault_of(after, full), "");
    for (const NodeSpan& node : told)
      EXPECT_FALSE(std::binary_search(after.missing_a.begin(), after.missing_a.end(), node))
          << to_string(node);
    missing += before.missing_a.size();
    settled += told.size();
  }
  RecordProperty("missing", static_cast<int>(missing));
  RecordProperty("settled", static_cast<int>(settled));
  const std::string name = GetParam().first;
  if (name == "terrain" || name == "sphere") {
    EXPECT_GT(8 * settled, missing);
  }
}

}  // namespace
}  // namespace nearmesh
