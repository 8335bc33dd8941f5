// SPDX-License-Identifier: Apache-2.0
// Every scene of the suite, through nearmesh: right in every case. nearmesh-stability runs all variants; here a sample.
#include <gtest/gtest.h>

#include <algorithm>

#include "meshes.hpp"
#include "nearmesh_system.hpp"
#include "oracle.hpp"
#include "scenes.hpp"
#include "variants.hpp"

namespace nearmesh::stability {
namespace {

void expect_right(const Case& c) {
  const NearmeshAnswer answer = ask_nearmesh(c);
  const Mark mark = judge(c, answer.verdict);
  EXPECT_TRUE(mark == Mark::kRight || mark == Mark::kUndecided)
      << c.name << ": expected " << describe_truth(c) << ", found " << describe(answer.verdict)
      << " " << answer.trouble;
}

void expect_scene_right(const std::string& id) {
  const Scene scene = make_scene(id, NEARMESH_TEST_DATA, true);
  EXPECT_FALSE(scene.cases.empty());
  for (const Case& c : scene.cases) expect_right(c);
}

/// The very pairs, not just their number.
void expect_pairs_of_oracle(const std::vector<Case>& cases) {
  for (const Case& c : cases) EXPECT_EQ(ask_nearmesh(c).pairs, touching_pairs(c.a, c.b)) << c.name;
}

std::uint64_t pairs_of(const std::vector<Case>& cases, const std::string& name) {
  for (const Case& c : cases)
    if (c.name == name) return *c.pairs;
  ADD_FAILURE() << "no case " << name;
  return 0;
}

// ---- F3: touching and coplanar --------------------------------------------------------------------

TEST(Stability, F3TouchingPairsAreTheOracles) {
  expect_pairs_of_oracle(touching_cases());
  expect_pairs_of_oracle(small_pair_cases());
}

TEST(Stability, F3VariantsHaveTheSamePairs) { expect_scene_right("F3 pairs"); }

TEST(Stability, F3CountsAreThoseOfAnalysis) {
  const std::vector<Case> cases = touching_cases();
  EXPECT_EQ(pairs_of(cases, "cubes of 192 triangles at (1, 0, 0)"), 644U);
  EXPECT_EQ(pairs_of(cases, "cubes of 192 triangles at (1, 0.5, 0.5)"), 268U);
  EXPECT_EQ(pairs_of(cases, "cubes of 192 triangles at (1, 1, 0)"), 140U);
  EXPECT_EQ(pairs_of(cases, "cubes of 192 triangles at (1, 1, 1)"), 36U);
  EXPECT_EQ(pairs_of(cases, "spheres pole on pole"), 64U * 64U);
}

TEST(Stability, F15HollowsAreNotFilled) { expect_scene_right("F15"); }
TEST(Stability, F4) { expect_scene_right("F4"); }
TEST(Stability, F5) { expect_scene_right("F5"); }
TEST(Stability, F6) { expect_scene_right("F6 pairs"); }
TEST(Stability, F17) { expect_scene_right("F17"); }
TEST(Stability, F18) { expect_scene_right("F18"); }
TEST(Stability, F19) { expect_scene_right("F19"); }
TEST(Stability, F1) { expect_scene_right("F1"); }

}  // namespace
}  // namespace nearmesh::stability
