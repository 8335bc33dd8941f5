// SPDX-License-Identifier: Apache-2.0
#include "brute_force.hpp"
#include "model_pairs.hpp"
#include "nearmesh/core/query/query.hpp"

namespace nearmesh {
namespace {

TEST(TriangleTree, HoldsEveryTriangleOnce) {
  const BakedModel model = test::bake_named("aircraft");
  const test::FullModel full(model);
  EXPECT_EQ(test::walk_tree(full.tree.view(), test::TrueBoxes(model.store)).faces,
            test::keys_of(test::all_faces(model.store)));
}

TEST(TriangleTree, OfNothingMeetsNothing) {
  const BakedModel model = test::bake_named("sphere");
  const test::FullModel full(model);
  const TriangleTree nothing = build_triangle_tree(model.header.grid, {});
  Random random(1);
  const PosedPair posed = test::near_pose(random, model, model);
  const Answer answer = query(nothing.view(), posed.a, full.tree.view(), posed.b);
  EXPECT_EQ(answer.status, AnswerStatus::kFree);
  EXPECT_EQ(answer.clearance_m, std::numeric_limits<double>::infinity());
}

TEST(TriangleTree, CurrentTrianglesAreThoseOfTheCurrentMesh) {
  const BakedModel model = test::bake_named("sphere");
  ActiveMesh mesh(model.store);
  RefineDelta delta;
  for (const VertexId u : global_order(model.store, 50)) ASSERT_TRUE(mesh.split(u, delta));
  const std::vector<ActiveFace> faces = extract_faces(mesh);
  const std::vector<TreeFace> triangles = current_triangles(mesh);
  ASSERT_EQ(triangles.size(), faces.size());
  for (std::size_t i = 0; i < faces.size(); ++i) {
    EXPECT_EQ(triangles[i].key, faces[i].key);
    for (std::size_t k = 0; k < 3; ++k)
      EXPECT_EQ(triangles[i].corners[k], model.store.position(faces[i].corners[k]));
  }
}

using Names = test::ModelNames;
class TriangleTreePair : public ::testing::TestWithParam<Names> {};
INSTANTIATE_TEST_SUITE_P(Models, TriangleTreePair,
                         ::testing::Values(Names{"terrain", "aircraft"}, Names{"sphere", "sphere"},
                                           Names{"soup", "degenerate"}, Names{"book", "components"},
                                           Names{"one_face", "aircraft"}),
                         test::name_of_pair);

TEST_P(TriangleTreePair, AnswersEqualBruteForceOverAllPairs) {
  const BakedModel a = test::bake_named(GetParam().first), b = test::bake_named(GetParam().second);
  const test::FullModel full_a(a), full_b(b);
  const auto faces_a = test::all_faces(a.store), faces_b = test::all_faces(b.store);
  Random random(91);
  std::size_t touching = 0;
  for (int i = 0; i < 12; ++i) {
    SCOPED_TRACE(i);
    const PosedPair posed = test::near_pose(random, a, b);
    const Answer answer = query(full_a.tree.view(), posed.a, full_b.tree.view(), posed.b);
    const auto expected =
        test::touching_pairs(a.store, posed.a, faces_a, b.store, posed.b, faces_b);
    EXPECT_EQ(answer.pairs, expected);
    EXPECT_EQ(answer.status, expected.empty() ? AnswerStatus::kFree : AnswerStatus::kContact);
    touching += expected.empty() ? 0 : 1;
  }
  EXPECT_GT(touching, 0U);
}

}  // namespace
}  // namespace nearmesh
