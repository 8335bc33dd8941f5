// SPDX-License-Identifier: Apache-2.0
// Every scene of the suite, through nearmesh: right in every case. nearmesh-stability runs all
// variants; here a sample.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <thread>

#include "bound_checker.hpp"
#include "contact_check.hpp"
#include "meshes.hpp"
#include "nearmesh/core/query/contacts.hpp"
#include "nearmesh_system.hpp"
#include "oracle.hpp"
#include "scenes.hpp"
#include "test_models.hpp"
#include "variants.hpp"

namespace nearmesh::stability {
namespace {

void expect_right(const Case& c) {
  const NearmeshAnswer answer = ask_nearmesh(c);
  const auto expect = [&answer](const Case& asked) {
    const Mark mark = judge(asked, answer.verdict);
    EXPECT_TRUE(mark == Mark::kRight || mark == Mark::kUndecided)
        << asked.name << ": expected " << describe_truth(asked) << ", found "
        << describe(answer.verdict) << " " << answer.trouble;
  };
  expect(c);
  if (c.question == Question::kTouch && c.pairs) expect(as_pairs(c));
}

void expect_scene_right(const std::string& id) {
  const Scene scene = make_scene(id, NEARMESH_TEST_DATA, true);
  EXPECT_FALSE(scene.cases.empty());
  for (const Case& c : scene.cases) expect_right(c);
}

void split_all(LocalModel& model) { refine(model, every_split(model.mesh.store())); }

// ---- F1: what has not come ----------------------------------------------------------------------

TEST(Stability, F1NoAnswerOnMissingDataIsWrong) { expect_scene_right("F1"); }

/// Cases that differ by state only, one for each ground and place of the ball.
std::vector<Case> needle_places() {
  std::vector<Case> places = streamed_cases(std::numeric_limits<std::uint32_t>::max(), 0);
  std::erase_if(places, [](const Case& c) { return !c.held_a.empty(); });
  return places;
}

TEST(Stability, F1EveryPrefixOfTheStreamIsHonest) {
  std::size_t contacts = 0, uncertain = 0;
  const std::vector<Case> places = needle_places();
  ASSERT_EQ(places.size(), 20U);
  for (const Case& c : places) {
    const auto ball = build_model(*c.b.mesh, c.base_faces);
    ASSERT_TRUE(ball.is_ok());
    const BakedModel &baked_a = c.model_a->baked, &baked_b = ball.value()->baked;
    const PosedPair posed =
        pose_pair(baked_a.header.grid, c.a.pose, "a", baked_b.header.grid, c.b.pose, "b").value();
    LocalModel a(baked_a.store, baked_a.header.grid), b(baked_b.store, baked_b.header.grid);
    split_all(b);
    const auto expect_honest = [&] {
      const Answer answer =
          query(a.view(), posed.a, b.view(), posed.b, {.clearance = Clearance::kNone});
      uncertain += answer.status == AnswerStatus::kUncertain ? 1 : 0;
      if (c.touches) {
        EXPECT_NE(answer.status, AnswerStatus::kFree) << c.name << a.mesh.split_count();
      } else {
        EXPECT_TRUE(answer.status == AnswerStatus::kFree ||
                    answer.status == AnswerStatus::kUncertain)
            << c.name << a.mesh.split_count();
      }
    };
    expect_honest();
    for (const VertexId u : every_split(baked_a.store)) {
      RefineDelta delta;
      ASSERT_TRUE(a.mesh.split(u, delta));
      a.tree.update(delta);
      expect_honest();
    }
    contacts += c.touches ? 1 : 0;
  }
  EXPECT_GE(contacts, 8U);
  EXPECT_GT(uncertain, 1000U);
}

// The scene would be empty if the needle never vanished.
TEST(Stability, F1TheNeedleVanishesWithItsRegion) {
  std::size_t without_needle = 0;
  for (const Case& c : streamed_cases(std::numeric_limits<std::uint32_t>::max(), 6)) {
    const IndexedMesh held = held_mesh(*c.model_a, c.held_a);
    without_needle += std::none_of(held.positions_m.begin(), held.positions_m.end(),
                                   [](const auto& p) { return p[2] > 2; }) &&
                      c.touches;
  }
  EXPECT_GT(without_needle, 10U);
}

// ---- F2: inside ---------------------------------------------------------------------------------

TEST(Stability, F2InsideIsToldFromOutside) { expect_scene_right("F2"); }

TEST(Stability, F2OpenSheetsSayThatTheyHaveNoInside) {
  Case c = solid_cases().back();
  c.a.mesh = share(generate_terrain(24, 7));
  EXPECT_EQ(ask_nearmesh(c).verdict.kind, Verdict::Kind::kRefused);
}

// ---- F3: touching and coplanar ------------------------------------------------------------------

/// The very pairs, not just their number.
void expect_pairs_of_oracle(const std::vector<Case>& cases) {
  for (const Case& c : cases) EXPECT_EQ(ask_nearmesh(c).pairs, touching_pairs(c.a, c.b)) << c.name;
}

TEST(Stability, F3TouchingPairsAreTheOracles) {
  expect_pairs_of_oracle(touching_cases());
  expect_pairs_of_oracle(small_pair_cases());
}

TEST(Stability, F3VariantsHaveTheSamePairs) { expect_scene_right("F3"); }

TEST(Stability, F3CountsAreThoseOfAnalysis) {
  const std::vector<Case> cases = touching_cases();
  const auto pairs_of = [&cases](const std::string& name) {
    const auto at =
        std::find_if(cases.begin(), cases.end(), [&](const Case& c) { return c.name == name; });
    return at == cases.end() ? 0 : ask_nearmesh(*at).verdict.pairs;
  };
  EXPECT_EQ(pairs_of("cubes of 192 triangles at (1, 0, 0)"), 644U);
  EXPECT_EQ(pairs_of("cubes of 192 triangles at (1, 0.5, 0.5)"), 268U);
  EXPECT_EQ(pairs_of("cubes of 192 triangles at (1, 1, 0)"), 140U);
  EXPECT_EQ(pairs_of("cubes of 192 triangles at (1, 1, 1)"), 36U);
  EXPECT_EQ(pairs_of("spheres pole on pole"), 64U * 64U);
}

// ---- F4: slivers and degenerate triangles -------------------------------------------------------

TEST(Stability, F4NothingTouchableVanishes) { expect_scene_right("F4"); }

// Kept faces keep their numbers: the whisker, last in the file, is the one that touches.
TEST(Stability, F4FaceNumbersDoNotShift) {
  for (const Case& c : degenerate_cases()) {
    if (c.name.find("whisker") == std::string::npos ||
        c.name.find("tip on a face") == std::string::npos)
      continue;
    const auto whisker = static_cast<std::uint32_t>(c.a.mesh->faces.size() - 1);
    const PairList pairs = ask_nearmesh(c).pairs;
    EXPECT_EQ(pairs, touching_pairs(c.a, c.b)) << c.name;
    ASSERT_FALSE(pairs.empty()) << c.name;
    for (const auto& pair : pairs) EXPECT_EQ(pair.first, whisker) << c.name;
  }
}

// ---- F5: NaN and the like -----------------------------------------------------------------------

TEST(Stability, F5WhatIsNoPoseIsRefused) { expect_scene_right("F5"); }

TEST(Stability, F5ARefusalNamesTheBodyAndDisturbsNothing) {
  const Case sound = touching_cases().front();
  const auto model = build_model(*sound.a.mesh, 16);
  ASSERT_TRUE(model.is_ok());
  const Grid& grid = model.value()->baked.header.grid;
  const NearmeshAnswer before = ask_nearmesh(sound);
  std::size_t refused = 0;
  for (const Case& c : invalid_cases()) {
    if (c.question != Question::kInvalid) continue;
    const auto mesh = build_model(*c.b.mesh, 16);
    if (!mesh.is_ok()) {
      EXPECT_NE(mesh.status().message().find("vertex 5"), std::string::npos)
          << mesh.status().message();
      continue;
    }
    const Result<PosedPair> posed = pose_pair(grid, c.a.pose, "hull", grid, c.b.pose, "rotor");
    ASSERT_FALSE(posed.is_ok()) << c.name;
    EXPECT_NE(posed.status().message().find("rotor"), std::string::npos)
        << posed.status().message();
    ++refused;
  }
  EXPECT_GT(refused, 30U);
  EXPECT_EQ(ask_nearmesh(sound).pairs, before.pairs);
}

// ---- F6 to F10 ----------------------------------------------------------------------------------

TEST(Stability, F6FarTinyAndHugeAreNoDifferent) { expect_scene_right("F6"); }
// A point has no size of its own; beside a small body it must not coarsen what is resolved.
TEST(Stability, F6PointsMeetTinyAndHugeBodies) {
  std::size_t asked = 0;
  for (const Case& c : degenerate_cases()) {
    if (!c.name.starts_with("point")) continue;
    for (const int k : {-20, -7, 7, 20})
      if (const auto other = scaled(c, k)) expect_right(*other), ++asked;
  }
  EXPECT_GT(asked, 20U);
}

TEST(Stability, F7NothingTunnels) { expect_scene_right("F7"); }
TEST(Stability, F8ContactsLieOnBothSurfaces) { expect_scene_right("F8"); }
TEST(Stability, F9NoGhostsAtInnerEdges) { expect_scene_right("F9"); }
TEST(Stability, F10NoContactIsLostAsLevelsChange) { expect_scene_right("F10"); }

// On the way to the full mesh: once a contact is proved it stays, and until then the mesh passes
// within the stated bound of where the contact turns out to be.
TEST(Stability, F10ContactsMoveWithinTheirBoundAndStay) {
  for (const Case& c : resting_cases()) {
    if (!c.held_a.empty()) continue;
    const auto ball = build_model(*c.b.mesh, c.base_faces);
    ASSERT_TRUE(ball.is_ok());
    const BakedModel &baked_a = c.model_a->baked, &baked_b = ball.value()->baked;
    const PosedPair posed =
        pose_pair(baked_a.header.grid, c.a.pose, "a", baked_b.header.grid, c.b.pose, "b").value();
    LocalModel a(baked_a.store, baked_a.header.grid), b(baked_b.store, baked_b.header.grid);
    split_all(b);
    LocalModel full(baked_a.store, baked_a.header.grid);
    split_all(full);
    const Answer truth = query(full.view(), posed.a, b.view(), posed.b);
    const Contacts at_last = find_contacts(full.view(), posed.a, b.view(), posed.b, truth);
    ASSERT_FALSE(at_last.segments.empty());
    bool proved = false;
    const std::vector<VertexId> order = every_split(baked_a.store);
    for (std::size_t i = 0; i < order.size(); ++i) {
      RefineDelta delta;
      ASSERT_TRUE(a.mesh.split(order[i], delta));
      a.tree.update(delta);
      const Answer answer =
          query(a.view(), posed.a, b.view(), posed.b, {.clearance = Clearance::kNone});
      ASSERT_NE(answer.status, AnswerStatus::kFree);
      const bool touches_now = answer.status != AnswerStatus::kUncertain;
      EXPECT_TRUE(touches_now || !proved) << c.name << " after " << i;
      if (i % 16 == 0) {
        const Body coarse{
            share(held_mesh(*c.model_a,
                            {order.begin(), order.begin() + static_cast<std::ptrdiff_t>(i) + 1})),
            c.a.pose};
        const double bound_m = answer.uncertainty_m + at_last.position_error_m;
        for (const ContactSegment& segment : at_last.segments)
          EXPECT_LE(distance_m(segment.p_m, coarse), bound_m * (1 + 1e-9))
              << c.name << " after " << i;
      }
      proved = proved || touches_now;
    }
    EXPECT_TRUE(proved);
  }
}

// ---- F11: bounds --------------------------------------------------------------------------------

TEST(Stability, F11EveryStoredBoundHolds) { expect_scene_right("F11"); }

TEST(Stability, F11EveryStoredBoundOfTheTestModelsHolds) {
  for (const std::string& name : test::mesh_names())
    EXPECT_EQ(test::check_bounds(test::bake_named(name).store, 24), "") << name;
}

// ---- F12, F13: order and threads ----------------------------------------------------------------

TEST(Stability, F12AnswersDoNotDependOnTheWay) { expect_scene_right("F12"); }

TEST(Stability, F13TwoThreadsGiveOneDigest) {
  const std::vector<Case> cases = thread_cases();
  ASSERT_FALSE(cases.empty());
  const auto digests = [&cases] {
    std::vector<std::uint64_t> found;
    for (const Case& c : cases) {
      const auto a = build_model(*c.a.mesh, 16), b = build_model(*c.b.mesh, 16);
      LocalModel local_a(a.value()->baked.store, a.value()->baked.header.grid);
      LocalModel local_b(b.value()->baked.store, b.value()->baked.header.grid);
      const PosedPair posed =
          pose_pair(local_a.grid, c.a.pose, "a", local_b.grid, c.b.pose, "b").value();
      const auto require = [](NodeSpan) { return Status::ok(); };
      found.push_back(
          digest(certify(local_a, posed.a, require, local_b, posed.b, require, {}).value()));
    }
    return found;
  };
  const std::vector<std::uint64_t> alone = digests();
  std::vector<std::uint64_t> first, second;
  std::thread thread([&] { first = digests(); });
  second = digests();
  thread.join();
  EXPECT_EQ(first, alone);
  EXPECT_EQ(second, alone);
}

// ---- F15 to F19 ---------------------------------------------------------------------------------

TEST(Stability, F15HollowsAreNotFilled) { expect_scene_right("F15"); }

TEST(Stability, F16FilesLoadOrAreRefusedAsListed) {
  if (file_cases(NEARMESH_TEST_DATA).empty())
    GTEST_SKIP() << "no test data at " << NEARMESH_TEST_DATA << "/bad; set NEARMESH_TEST_DATA";
  expect_scene_right("F16");
}

TEST(Stability, F17HugeTrianglesMeetSmallBodies) { expect_scene_right("F17"); }
TEST(Stability, F18ACutListSaysSo) { expect_scene_right("F18"); }

TEST(Stability, F19GapsDownToAQuarterOfACell) { expect_scene_right("F19"); }

// Bisection over the lattice, a quarter of a grid cell a step: contact on one side, free on the
// other, all the way.
TEST(Stability, F19TheVerdictFlipsOnceAndInTheExactPlace) {
  for (const Case& c : gap_cases()) {
    if (c.name.find("gap 2^-0 m") == std::string::npos) continue;
    const auto a = build_model(*c.a.mesh, 16), b = build_model(*c.b.mesh, 16);
    ASSERT_TRUE(a.is_ok() && b.is_ok());
    LocalModel local_a(a.value()->baked.store, a.value()->baked.header.grid);
    LocalModel local_b(b.value()->baked.store, b.value()->baked.header.grid);
    split_all(local_a);
    split_all(local_b);
    const double step_m = std::ldexp(1.0, lattice_exponent(local_a.grid, local_b.grid));
    // The case is one metre away from touching, along x or z.
    const std::size_t axis = c.name.starts_with("faces") || c.name.starts_with("edges") ? 0 : 2;
    const double contact_m = c.b.pose.translation_m[axis] - 1;
    const auto touches_at = [&](std::int64_t steps) {
      Pose pose = c.b.pose;
      pose.translation_m[axis] = contact_m + static_cast<double>(steps) * step_m;
      const PosedPair posed =
          pose_pair(local_a.grid, c.a.pose, "a", local_b.grid, pose, "b").value();
      const Answer answer = query(local_a.view(), posed.a, local_b.view(), posed.b);
      EXPECT_TRUE(is_certified(answer.status));
      return answer.status == AnswerStatus::kContact;
    };
    std::int64_t touching = -static_cast<std::int64_t>(.25 / step_m),
                 apart = static_cast<std::int64_t>(1 / step_m);
    ASSERT_TRUE(touches_at(touching)) << c.name;
    ASSERT_FALSE(touches_at(apart)) << c.name;
    while (apart - touching > 1) {
      const std::int64_t middle = touching + (apart - touching) / 2;
      (touches_at(middle) ? touching : apart) = middle;
    }
    EXPECT_EQ(touching, 0) << c.name;
    for (std::int64_t steps = -40; steps <= 40; ++steps)
      EXPECT_EQ(touches_at(steps), steps <= 0) << c.name;
  }
}

}  // namespace
}  // namespace nearmesh::stability
