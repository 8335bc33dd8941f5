// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/core/query/query.hpp"

#include "brute_force.hpp"
#include "contact_errors.hpp"
#include "distance.hpp"
#include "instruction_sets.hpp"
#include "model_pairs.hpp"
#include "rounds.hpp"

namespace nearmesh {
namespace {

bool is_unresolved(const ActiveMesh& mesh, NodeSpan node) {
  return node.size > 1 && mesh.is_current(node);
}

using Names = test::ModelNames;
class QueryPair : public test::ModelPair {};
INSTANTIATE_TEST_SUITE_P(Models, QueryPair, test::model_pairs(), test::name_of_pair);

TEST_P(QueryPair, PairsEqualBruteForceOverExactFacesInEveryState) {
  const auto faces_a = test::all_faces(a_.store), faces_b = test::all_faces(b_.store);
  for (std::uint64_t seed = 0; seed < 25; ++seed) {
    SCOPED_TRACE(seed);
    State state(*this, seed);
    auto& [random, a, b] = state;
    const PosedPair posed = test::near_pose(random, a_, b_);
    const Answer answer = query(a.view(), posed.a, b.view(), posed.b);
    EXPECT_EQ(answer.pairs,
              test::touching_pairs(a_.store, posed.a, test::exact_faces(a.mesh, faces_a), b_.store,
                                   posed.b, test::exact_faces(b.mesh, faces_b)));
  }
}

TEST_P(QueryPair, NamesMissingNodesExactlyWhenNotCertified) {
  for (std::uint64_t seed = 0; seed < 100; ++seed) {
    SCOPED_TRACE(seed);
    State state(*this, seed);
    auto& [random, a, b] = state;
    const PosedPair posed = test::near_pose(random, a_, b_);
    const Answer answer = query(a.view(), posed.a, b.view(), posed.b);
    EXPECT_EQ(is_certified(answer.status), answer.missing_a.empty() && answer.missing_b.empty());
    EXPECT_EQ(answer.pairs.empty(),
              answer.status == AnswerStatus::kFree || answer.status == AnswerStatus::kUncertain);
    for (const NodeSpan& node : answer.missing_a) EXPECT_TRUE(is_unresolved(a.mesh, node));
    for (const NodeSpan& node : answer.missing_b) EXPECT_TRUE(is_unresolved(b.mesh, node));
    EXPECT_TRUE(std::is_sorted(answer.missing_a.begin(), answer.missing_a.end()));
    EXPECT_TRUE(std::is_sorted(answer.missing_b.begin(), answer.missing_b.end()));
    EXPECT_EQ(std::adjacent_find(answer.missing_a.begin(), answer.missing_a.end()),
              answer.missing_a.end());
    EXPECT_EQ(answer.uncertainty_m > 0, !is_certified(answer.status));
  }
}

TEST_P(QueryPair, AnswersDoNotDependOnTheInstructionSet) {
  std::vector<std::uint64_t> digests;
  test::for_each_instruction_set([&] {
    std::vector<std::uint64_t> found;
    for (std::uint64_t seed = 0; seed < 25; ++seed) {
      State state(*this, seed);
      auto& [random, a, b] = state;
      const PosedPair posed = test::near_pose(random, a_, b_);
      for (const bool any : {false, true})
        found.push_back(digest(query(a.view(), posed.a, b.view(), posed.b,
                                     {.any = any, .clearance = Clearance::kExact})));
    }
    if (digests.empty()) digests = found;
    EXPECT_EQ(found, digests);
  });
}

TEST_P(QueryPair, SwappedBodiesGiveTheMirroredAnswer) {
  for (std::uint64_t seed = 0; seed < 100; ++seed) {
    SCOPED_TRACE(seed);
    State state(*this, seed);
    auto& [random, a, b] = state;
    const PosedPair posed = test::near_pose(random, a_, b_);
    const Answer answer = query(a.view(), posed.a, b.view(), posed.b);
    const Answer mirrored = query(b.view(), posed.b, a.view(), posed.a);
    EXPECT_EQ(answer.status, mirrored.status);
    std::vector<FacePair> pairs;
    for (const FacePair& pair : mirrored.pairs) pairs.push_back({pair.b, pair.a});
    std::sort(pairs.begin(), pairs.end());
    EXPECT_EQ(answer.pairs, pairs);
  }
}

TEST_P(QueryPair, ALimitCutsTheListAndSaysSo) {
  for (std::uint64_t seed = 0; seed < 50; ++seed) {
    SCOPED_TRACE(seed);
    State state(*this, seed);
    auto& [random, a, b] = state;
    const PosedPair posed = test::near_pose(random, a_, b_);
    const Answer all = query(a.view(), posed.a, b.view(), posed.b);
    EXPECT_EQ(all.pair_total, all.pairs.size());
    EXPECT_FALSE(all.truncated);
    const std::size_t limit = all.pairs.size() / 2;
    const Answer cut = query(a.view(), posed.a, b.view(), posed.b, {.max_pairs = limit});
    EXPECT_EQ(cut.pair_total, all.pair_total);
    EXPECT_EQ(cut.truncated, all.pair_total > limit);
    EXPECT_EQ(cut.pairs, std::vector(all.pairs.begin(), all.pairs.begin() + std::ptrdiff_t(limit)));
    EXPECT_EQ(cut.status, all.status);
    EXPECT_EQ(digest(cut) == digest(all), all.pair_total == 0);
  }
}

TEST_P(QueryPair, NoFaceBelowAMissingNodeIsFartherThanTheUncertainty) {
  const test::TrueBoxes boxes_a(a_.store), boxes_b(b_.store);
  for (std::uint64_t seed = 0; seed < 50; ++seed) {
    SCOPED_TRACE(seed);
    Random random(seed);
    LocalModel a(a_.store, a_.header.grid), b(b_.store, b_.header.grid);
    test::refine_at_random(a, random);
    const PosedPair posed = test::near_pose(random, a_, b_);
    const Answer answer = query(a.view(), posed.a, b.view(), posed.b);
    const auto expect_near = [&](const BakedModel& model, const std::vector<NodeSpan>& missing) {
      for (const test::KeyedFace& keyed : test::all_faces(model.store))
        for (const VertexId corner : keyed.face.corners())
          for (const NodeSpan& node : missing) {
            if (!node.contains(corner)) continue;
            for (const VertexId c : keyed.face.corners()) {
              double square = 0;
              for (int k = 0; k < 3; ++k)
                square += std::pow(std::ldexp(double(model.store.position(c)[k]) -
                                                  model.store.position(node.first)[k],
                                              model.header.grid.exponent),
                                   2);
              EXPECT_LE(std::sqrt(square), answer.uncertainty_m * (1 + 1e-12));
            }
          }
    };
    expect_near(a_, answer.missing_a);
    expect_near(b_, answer.missing_b);
  }
}

TEST_P(QueryPair, AnyStopsAtOnePairWithTheSameVerdict) {
  const test::FullModel full_a(a_), full_b(b_);
  Random random(101);
  for (int i = 0; i < 100; ++i) {
    const PosedPair posed = test::near_pose(random, a_, b_);
    const Answer all = query(full_a.tree.view(), posed.a, full_b.tree.view(), posed.b);
    const Answer any =
        query(full_a.tree.view(), posed.a, full_b.tree.view(), posed.b, {.any = true});
    EXPECT_EQ(any.status, all.status);
    EXPECT_EQ(any.pairs.size(), all.pairs.empty() ? 0U : 1U);
  }
}

TEST_P(QueryPair, EarlyContactOfAnyIsNeverWrong) {
  const test::FullModel full_a(a_), full_b(b_);
  for (std::uint64_t seed = 0; seed < 60; ++seed) {
    SCOPED_TRACE(seed);
    State state(*this, seed);
    auto& [random, a, b] = state;
    const PosedPair posed = test::near_pose(random, a_, b_);
    const Answer full =
        query(full_a.tree.view(), posed.a, full_b.tree.view(), posed.b, {.any = true});
    const Answer any = query(a.view(), posed.a, b.view(), posed.b, {.any = true});
    if (is_certified(any.status)) {
      EXPECT_EQ(any.status, full.status);
    }
  }
}

// ---- clearance ----------------------------------------------------------------------------------

class ClearanceOf : public ::testing::TestWithParam<Names> {};
INSTANTIATE_TEST_SUITE_P(Models, ClearanceOf,
                         ::testing::Values(Names{"sphere", "sphere"}, Names{"terrain", "sphere"},
                                           Names{"aircraft", "one_face"}),
                         test::name_of_pair);

IndexedMesh tiny(const std::string& name) {
  if (name == "sphere") return generate_sphere(10, 0);
  if (name == "terrain") return generate_terrain(6, 1);
  return name == "aircraft" ? generate_aircraft(200, 1) : test::make_mesh(name);
}

/// Bodies apart along a random direction, from nearly touching to far.
PosedPair apart_pose(Random& random, const BakedModel& a, const BakedModel& b) {
  const Pose pose_a{.rotation = test::random_rotation(random)};
  Pose pose_b{.rotation = test::random_rotation(random)};
  std::array<double, 3> direction{};
  double length = 0;
  for (double& x : direction) {
    x = random.between(-1, 1);
    length += x * x;
  }
  const double reach = (test::radius_m(a) + test::radius_m(b)) * random.between(0.3, 4);
  const double half_a = std::ldexp(1.0, a.header.grid.exponent + a.header.grid.bits - 1);
  const double half_b = std::ldexp(1.0, b.header.grid.exponent + b.header.grid.bits - 1);
  std::array<double, 3> middle_a = a.header.grid.origin_m, middle_b = b.header.grid.origin_m;
  for (std::size_t k = 0; k < 3; ++k) middle_a[k] += half_a, middle_b[k] += half_b;
  const auto at_a = test::place(pose_a, middle_a), at_b = test::place(pose_b, middle_b);
  for (std::size_t k = 0; k < 3; ++k)
    pose_b.translation_m[k] = at_a[k] - at_b[k] + direction[k] / std::sqrt(length) * reach;
  return pose_pair(a.header.grid, pose_a, "a", b.header.grid, pose_b, "b").value();
}

double true_distance_m(const BakedModel& a, const PosedFrame& frame_a, const BakedModel& b,
                       const PosedFrame& frame_b) {
  double least = std::numeric_limits<double>::infinity();
  const auto faces_b = test::all_faces(b.store);
  for (const test::KeyedFace& fa : test::all_faces(a.store)) {
    const LatticeTriangle ta = test::posed(a.store, frame_a, fa.face);
    for (const test::KeyedFace& fb : faces_b)
      least = std::min(
          least, test::distance_m(ta, test::posed(b.store, frame_b, fb.face), frame_a.lattice_exp));
  }
  return least;
}

TEST_P(ClearanceOf, NeverExceedsTheTrueDistance) {
  const BakedModel model_a = test::bake_mesh(tiny(GetParam().first), 8);
  const BakedModel model_b = test::bake_mesh(tiny(GetParam().second), 8);
  const test::TrueHalfSpaces half_spaces_a(model_a.store), half_spaces_b(model_b.store);
  int free = 0;
  for (int seed = 0; seed < test::rounds(60); ++seed) {
    SCOPED_TRACE(seed);
    Random random(static_cast<std::uint64_t>(seed));
    const PosedPair posed = apart_pose(random, model_a, model_b);
    LocalModel a(model_a.store, model_a.header.grid), b(model_b.store, model_b.header.grid);
    if (seed % 2 == 0) test::refine_at_random(a, random);
    if (seed % 3 > 0) {
      test::tell_half_spaces(a, half_spaces_a, random);
      test::tell_half_spaces(b, half_spaces_b, random);
    }
    const Result<Answer> answer =
        certify(a, posed.a, test::no_require, b, posed.b, test::no_require, {});
    ASSERT_TRUE(answer.is_ok()) << answer.status().message();
    if (answer.value().status != AnswerStatus::kFree) {
      EXPECT_EQ(answer.value().clearance_m, 0);
      continue;
    }
    ++free;
    const double distance = true_distance_m(model_a, posed.a, model_b, posed.b);
    EXPECT_LE(answer.value().clearance_m, distance * (1 + 1e-9));
    EXPECT_GE(answer.value().clearance_m, 0);
  }
  EXPECT_GT(free, test::rounds(20));
}

TEST_P(ClearanceOf, IsNearTheTrueDistanceOfFullMeshes) {
  const BakedModel model_a = test::bake_mesh(tiny(GetParam().first), 8);
  const BakedModel model_b = test::bake_mesh(tiny(GetParam().second), 8);
  const test::FullModel a(model_a), b(model_b);
  double share = 0, count = 0;
  for (int seed = 0; seed < test::rounds(40); ++seed) {
    Random random(static_cast<std::uint64_t>(seed));
    const PosedPair posed = apart_pose(random, model_a, model_b);
    const Answer answer = query(a.tree.view(), posed.a, b.tree.view(), posed.b);
    if (answer.status != AnswerStatus::kFree) continue;
    share += answer.clearance_m / true_distance_m(model_a, posed.a, model_b, posed.b);
    ++count;
  }
  EXPECT_GT(share / count, 0.3);
}

TEST_P(ClearanceOf, IsAtLeastTheShareThatItSays) {
  const BakedModel model_a = test::bake_mesh(tiny(GetParam().first), 8);
  const BakedModel model_b = test::bake_mesh(tiny(GetParam().second), 8);
  const test::FullModel a(model_a), b(model_b);
  int shorter = 0;
  for (int seed = 0; seed < test::rounds(60); ++seed) {
    SCOPED_TRACE(seed);
    Random random(static_cast<std::uint64_t>(seed));
    const PosedPair posed = apart_pose(random, model_a, model_b);
    const auto ask = [&](Clearance sought) {
      return query(a.tree.view(), posed.a, b.tree.view(), posed.b, {.clearance = sought});
    };
    const Answer exact = ask(Clearance::kExact), bound = ask(Clearance::kBound);
    EXPECT_EQ(digest(exact), digest(bound));
    if (exact.status != AnswerStatus::kFree) continue;
    EXPECT_EQ(exact.clearance_share, 1);
    EXPECT_GE(bound.clearance_share, kClearanceShare);  // so small models are searched in 256 steps
    EXPECT_LE(bound.clearance_m, exact.clearance_m);
    EXPECT_GE(bound.clearance_m, bound.clearance_share * exact.clearance_m * (1 - 1e-12));
    shorter += bound.stats.box_tests < exact.stats.box_tests ? 1 : 0;
    const Answer none = ask(Clearance::kNone);
    EXPECT_EQ(none.clearance_m, 0);
    EXPECT_EQ(none.clearance_share, 0);
    EXPECT_EQ(digest(none), digest(exact));
  }
  EXPECT_GT(shorter, test::rounds(10));
}

TEST_P(ClearanceOf, TheDistanceIsBracketedInAnyStateByPointsOfTheFullMeshes) {
  const BakedModel model_a = test::bake_mesh(tiny(GetParam().first), 8);
  const BakedModel model_b = test::bake_mesh(tiny(GetParam().second), 8);
  int uncertain = 0, bounded = 0;
  for (int seed = 0; seed < test::rounds(90); ++seed) {
    SCOPED_TRACE(seed);
    Random random(static_cast<std::uint64_t>(seed));
    const PosedPair posed = seed % 2 == 0 ? apart_pose(random, model_a, model_b)
                                          : test::near_pose(random, model_a, model_b);
    LocalModel a(model_a.store, model_a.header.grid), b(model_b.store, model_b.header.grid);
    test::refine_at_random(a, random);
    test::refine_at_random(b, random);
    const Answer answer = query(a.view(), posed.a, b.view(), posed.b);
    if (answer.pair_total > 0) {
      EXPECT_EQ(answer.distance_at_most_m, 0);
      EXPECT_EQ(answer.clearance_m, 0);
      continue;
    }
    uncertain += answer.status == AnswerStatus::kUncertain ? 1 : 0;
    EXPECT_GE(answer.distance_at_most_m,
              true_distance_m(model_a, posed.a, model_b, posed.b) * (1 - 1e-12));
    EXPECT_LE(answer.clearance_m, answer.distance_at_most_m);
    ASSERT_LT(answer.distance_at_most_m, std::numeric_limits<double>::infinity());
    ++bounded;
    const double cell_m = std::ldexp(1.0, posed.a.lattice_exp);
    EXPECT_NEAR(std::hypot(answer.nearest_a_m[0] - answer.nearest_b_m[0],
                           answer.nearest_a_m[1] - answer.nearest_b_m[1],
                           answer.nearest_a_m[2] - answer.nearest_b_m[2]),
                answer.distance_at_most_m, cell_m * 1e-3);
    EXPECT_LT(test::FullSurface(model_a.store, posed.a).distance(answer.nearest_a_m),
              cell_m * 1e-3);
    EXPECT_LT(test::FullSurface(model_b.store, posed.b).distance(answer.nearest_b_m),
              cell_m * 1e-3);
  }
  EXPECT_GE(uncertain, test::rounds(5));
  EXPECT_GT(bounded, test::rounds(30));
}

TEST_P(ClearanceOf, BothBoundsMeetOnFullMeshesThatAreSearchedToTheEnd) {
  const BakedModel model_a = test::bake_mesh(tiny(GetParam().first), 8);
  const BakedModel model_b = test::bake_mesh(tiny(GetParam().second), 8);
  const test::FullModel a(model_a), b(model_b);
  int free = 0;
  for (int seed = 0; seed < test::rounds(60); ++seed) {
    SCOPED_TRACE(seed);
    Random random(static_cast<std::uint64_t>(seed));
    const PosedPair posed = apart_pose(random, model_a, model_b);
    const Answer exact =
        query(a.tree.view(), posed.a, b.tree.view(), posed.b, {.clearance = Clearance::kExact});
    if (exact.status != AnswerStatus::kFree) continue;
    ++free;
    const double rounding_m = 16 * std::ldexp(1.0, posed.a.lattice_exp);
    EXPECT_LE(exact.distance_at_most_m, exact.clearance_m * (1 + 1e-5) + rounding_m);
    const double distance = true_distance_m(model_a, posed.a, model_b, posed.b);
    EXPECT_LE(exact.clearance_m, distance * (1 + 1e-9));
    EXPECT_GE(exact.distance_at_most_m, distance * (1 - 1e-9));
    const Answer bound = query(a.tree.view(), posed.a, b.tree.view(), posed.b);
    EXPECT_LE(bound.distance_at_most_m,
              bound.clearance_m / bound.clearance_share * (1 + 1e-5) + rounding_m);
  }
  EXPECT_GT(free, test::rounds(20));
}

TEST_P(ClearanceOf, IsPositiveFromTheBaseWhenBodiesAreFarApart) {
  const BakedModel model_a = test::bake_mesh(tiny(GetParam().first), 8);
  const BakedModel model_b = test::bake_mesh(tiny(GetParam().second), 8);
  const double reach = 4 * (test::radius_m(model_a) + test::radius_m(model_b));
  const Pose pose_b{.translation_m = {reach, 0, 0}};
  const PosedPair posed =
      pose_pair(model_a.header.grid, {}, "a", model_b.header.grid, pose_b, "b").value();
  const LocalModel a(model_a.store, model_a.header.grid), b(model_b.store, model_b.header.grid);
  const Answer answer = query(a.view(), posed.a, b.view(), posed.b);
  EXPECT_EQ(answer.status, AnswerStatus::kFree);
  EXPECT_GT(answer.clearance_m, reach / 10);
}

// ---- exact touching -----------------------------------------------------------------------------

/// Two squares of two triangles, the second moved by `z` cells of the first's grid.
Answer squares_at(double z_cells) {
  const IndexedMesh square{{{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}}, {{0, 1, 2}, {0, 2, 3}}};
  const BakedModel model = test::bake_mesh(square, 16);
  const test::FullModel full(model);
  const Pose above{.translation_m = {0, 0, std::ldexp(z_cells, model.header.grid.exponent)}};
  const PosedPair posed =
      pose_pair(model.header.grid, {}, "a", model.header.grid, above, "b").value();
  return query(full.tree.view(), posed.a, full.tree.view(), posed.b);
}

TEST(Query, CoplanarFacesTouch) {
  EXPECT_EQ(squares_at(0).status, AnswerStatus::kContact);
  EXPECT_EQ(squares_at(0).pairs.size(), 4U);
}

TEST(Query, OneCellApartIsFree) { EXPECT_EQ(squares_at(1).status, AnswerStatus::kFree); }

TEST(Query, OneCellApartTheOtherWayIsFree) {
  EXPECT_EQ(squares_at(-1).status, AnswerStatus::kFree);
}

TEST(Query, DoesNotClaimMoreThanOneCellOfClearance) {
  const IndexedMesh square{{{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}}, {{0, 1, 2}, {0, 2, 3}}};
  EXPECT_LE(squares_at(1).clearance_m,
            std::ldexp(1.0, test::bake_mesh(square, 16).header.grid.exponent));
}

TEST(PosePair, NamesTheBodyWhosePoseIsWrong) {
  const Grid grid;
  const Pose bad{.rotation = {1, 0, 0, 0, 1, 0, 0, 0, -1}};
  const Result<PosedPair> posed = pose_pair(grid, {}, "hull", grid, bad, "rotor");
  ASSERT_FALSE(posed.is_ok());
  EXPECT_NE(posed.status().message().find("rotor"), std::string::npos) << posed.status().message();
}

TEST(Digest, TellsContactSetsApart) {
  const FacePair one{{{1}, 0}, {{2}, 0}}, two{{{1}, 0}, {{2}, 1}}, turned{{{2}, 0}, {{1}, 0}},
      base{{{}, 1}, {{2}, 0}};
  const std::vector<std::vector<FacePair>> sets{{}, {one}, {two}, {turned}, {base}, {one, two}};
  for (std::size_t i = 0; i < sets.size(); ++i)
    for (std::size_t j = 0; j < sets.size(); ++j)
      EXPECT_EQ(digest(sets[i]) == digest(sets[j]), i == j) << i << " " << j;
}

TEST(AnswerStatus, HasAWordForEach) {
  EXPECT_STREQ(to_string(AnswerStatus::kFree), "free");
  EXPECT_STREQ(to_string(AnswerStatus::kContact), "contact");
  EXPECT_STREQ(to_string(AnswerStatus::kPartial), "partial");
  EXPECT_STREQ(to_string(AnswerStatus::kUncertain), "uncertain");
  EXPECT_STREQ(to_string(AnswerStatus::kContained), "contained");
}

}  // namespace
}  // namespace nearmesh
