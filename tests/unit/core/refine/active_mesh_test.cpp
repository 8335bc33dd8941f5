// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/core/refine/detail/active_mesh.hpp"

#include "brute_force.hpp"

namespace nearmesh {
namespace {

/// Does `count` random splits with what they rest on.
void split_some(ActiveMesh& mesh, std::uint32_t count, Random& random) {
  RefineDelta delta;
  for (std::uint32_t i = 0; i < count; ++i)
    ASSERT_TRUE(mesh.split({random.below(mesh.store().vertex_count())}, delta));
}

/// Collapses a random node of the current forest, large or small.
void collapse_some(ActiveMesh& mesh, Random& random) {
  const SplitStore& store = mesh.store();
  const VertexId u{random.below(store.vertex_count())};
  if (store.is_root(u)) return;
  RefineDelta delta;
  mesh.collapse(store.node_of(u), delta);
}

class ActiveMeshOf : public ::testing::TestWithParam<std::string> {};
INSTANTIATE_TEST_SUITE_P(Models, ActiveMeshOf, ::testing::ValuesIn(test::mesh_names()),
                         [](const auto& model) { return model.param; });

TEST_P(ActiveMeshOf, AnyOrderToTheSameSetGivesTheSameHash) {
  const BakedModel model = test::bake_named(GetParam());
  for (std::uint64_t seed = 0; seed < 5; ++seed) {
    SCOPED_TRACE(seed);
    Random random(seed);
    ActiveMesh goal(model.store), wanderer(model.store);
    split_some(goal, random.below(model.header.vertex_count), random);
    std::vector<VertexId> wanted;
    for (const std::uint32_t v : test::active_ids(goal)) wanted.push_back({v});
    for (int i = 0; i < 20; ++i) {
      split_some(wanderer, 20, random);
      collapse_some(wanderer, random);
    }
    RefineDelta delta;
    for (const BaseRoot& root : model.header.roots) wanderer.collapse(root.node, delta);
    test::shuffle(wanted, random);
    for (const VertexId u : wanted) ASSERT_TRUE(wanderer.split(u, delta));
    EXPECT_EQ(wanderer.state_hash(), goal.state_hash());
    EXPECT_EQ(wanderer.split_count(), goal.split_count());
    EXPECT_EQ(test::active_ids(wanderer), test::active_ids(goal));
  }
}

TEST_P(ActiveMeshOf, StaysClosedUnderParents) {
  const BakedModel model = test::bake_named(GetParam());
  Random random(51);
  ActiveMesh mesh(model.store);
  for (int step = 0; step < 10; ++step) {
    split_some(mesh, 10, random);
    collapse_some(mesh, random);
    for (const std::uint32_t v : test::active_ids(mesh)) {
      if (model.store.is_root({v})) continue;
      const NodeSpan parent = model.store.parent_of(model.store.node_of({v}));
      if (parent.size > 0) {
        EXPECT_TRUE(mesh.is_active(model.store.split_of(parent))) << v;
      }
    }
  }
}

TEST_P(ActiveMeshOf, ExtractsEveryFaceWithItsCornersReplaced) {
  const BakedModel model = test::bake_named(GetParam());
  const std::vector<test::KeyedFace> all = test::all_faces(model.store);
  Random random(52);
  ActiveMesh mesh(model.store);
  for (int step = 0; step < 6; ++step) {
    const std::set<std::uint32_t> active = test::active_ids(mesh);
    std::vector<ActiveFace> expected;
    for (const test::KeyedFace& keyed : all) {
      ActiveFace face{keyed.key, keyed.face.corners()};
      for (VertexId& corner : face.corners) corner = test::stand_in(active, corner);
      const auto& c = face.corners;
      if (c[0] != c[1] && c[1] != c[2] && c[2] != c[0]) expected.push_back(face);
    }
    const std::vector<ActiveFace> found = extract_faces(mesh);
    ASSERT_EQ(found.size(), expected.size());
    for (std::size_t i = 0; i < found.size(); ++i) {
      EXPECT_EQ(found[i].key, expected[i].key);
      EXPECT_EQ(found[i].corners, expected[i].corners);
    }
    split_some(mesh, model.header.vertex_count / 8, random);
    if (step % 2 == 1) collapse_some(mesh, random);
  }
}

TEST_P(ActiveMeshOf, ExactFacesAreThoseWhoseCornersAreResolved) {
  const BakedModel model = test::bake_named(GetParam());
  const std::vector<test::KeyedFace> all = test::all_faces(model.store);
  Random random(53);
  ActiveMesh mesh(model.store);
  split_some(mesh, model.header.vertex_count / 2, random);
  std::vector<FaceKey> found;
  for (const test::KeyedFace& keyed : all)
    if (mesh.is_exact(keyed.face)) found.push_back(keyed.key);
  std::sort(found.begin(), found.end());
  EXPECT_EQ(found, test::keys_of(test::exact_faces(mesh, all)));
}

TEST_P(ActiveMeshOf, TreeletOfAStateReachesItFromTheBase) {
  const BakedModel model = test::bake_named(GetParam());
  Random random(54);
  ActiveMesh mesh(model.store), again(model.store);
  split_some(mesh, model.header.vertex_count / 3, random);
  RefineDelta delta;
  for (const TreeletSplit& split : active_treelet(mesh)) {
    EXPECT_TRUE(again.is_current(split.node));  // preorder: what it rests on stands before it
    ASSERT_TRUE(again.split(split.split, delta));
  }
  EXPECT_EQ(again.state_hash(), mesh.state_hash());
}

TEST_P(ActiveMeshOf, PredecessorsAndNodesEqualASearch) {
  const BakedModel model = test::bake_named(GetParam());
  Random random(55);
  ActiveMesh mesh(model.store);
  split_some(mesh, model.header.vertex_count / 4, random);
  const std::set<std::uint32_t> active = test::active_ids(mesh);
  for (std::uint32_t v = 0; v < model.header.vertex_count; ++v)
    ASSERT_EQ(mesh.active_predecessor({v}), test::stand_in(active, {v}));
  std::vector<NodeSpan> unresolved;
  for (const std::uint32_t v : active)
    if (mesh.current_node({v}).size > 1) unresolved.push_back(mesh.current_node({v}));
  EXPECT_EQ(unresolved, test::unresolved_nodes(mesh));
}

TEST(ActiveMesh, SplitReportsWhatItDidParentsFirst) {
  const BakedModel model = test::bake_named("aircraft");
  ActiveMesh mesh(model.store), replay(model.store);
  RefineDelta delta, ignored;
  for (const VertexId u : test::all_splits(model.store)) {  // one that rests on many others
    RefineDelta undone;
    for (const BaseRoot& root : model.header.roots) mesh.collapse(root.node, undone);
    delta = {};
    ASSERT_TRUE(mesh.split(u, delta));
    if (delta.split.size() > 5) break;
  }
  ASSERT_GT(delta.split.size(), 5U);
  for (const VertexId u : delta.split) {
    EXPECT_TRUE(replay.is_current(model.store.node_of(u)));
    ASSERT_TRUE(replay.split(u, ignored));
  }
  EXPECT_EQ(replay.state_hash(), mesh.state_hash());
}

TEST(ActiveMesh, RepeatedSplitChangesNothing) {
  const BakedModel model = test::bake_named("sphere");
  ActiveMesh mesh(model.store);
  const VertexId u = test::all_splits(model.store)[3];
  RefineDelta first, second;
  ASSERT_TRUE(mesh.split(u, first));
  const std::uint64_t hash = mesh.state_hash();
  EXPECT_TRUE(mesh.split(u, second));
  EXPECT_TRUE(second.is_empty());
  EXPECT_EQ(mesh.state_hash(), hash);
}

TEST(ActiveMesh, SplitWithoutItsParentsKnownChangesNothing) {
  const BakedModel model = test::bake_named("sphere");
  const SplitStore empty(model.header);
  ActiveMesh mesh(empty);
  const std::uint64_t hash = mesh.state_hash();
  RefineDelta delta;
  EXPECT_FALSE(mesh.split(test::all_splits(model.store).back(), delta));
  EXPECT_TRUE(delta.is_empty());
  EXPECT_EQ(mesh.state_hash(), hash);
}

TEST(ActiveMesh, CollapseOfARootLeavesItsBase) {
  const BakedModel model = test::bake_named("sphere");
  ActiveMesh mesh(model.store);
  const std::uint64_t base = mesh.state_hash();
  RefineDelta delta;
  for (const VertexId u : test::all_splits(model.store)) ASSERT_TRUE(mesh.split(u, delta));
  delta = {};
  for (const BaseRoot& root : model.header.roots) mesh.collapse(root.node, delta);
  EXPECT_EQ(mesh.state_hash(), base);
  EXPECT_EQ(mesh.split_count(), 0U);
}

TEST(ActiveMesh, CollapseOfAWholeNodeIsNothing) {
  const BakedModel model = test::bake_named("sphere");
  ActiveMesh mesh(model.store);
  RefineDelta delta;
  for (const BaseRoot& root : model.header.roots) mesh.collapse(root.node, delta);
  EXPECT_TRUE(delta.is_empty());
}

TEST(ActiveMesh, CollapseBelowACoarserNodeIsNothing) {
  const BakedModel model = test::bake_named("aircraft");
  ActiveMesh mesh(model.store);
  RefineDelta delta;
  for (const VertexId u : test::all_splits(model.store))
    mesh.collapse(model.store.node_of(u), delta);
  EXPECT_TRUE(delta.is_empty());
}

TEST(ActiveMesh, GlobalOrderTakesLargestNodesAndParentsFirst) {
  const BakedModel model = test::bake_named("terrain");
  const std::vector<VertexId> order = global_order(model.store, 200);
  ASSERT_EQ(order.size(), 200U);
  ActiveMesh mesh(model.store);
  RefineDelta delta;
  std::uint32_t size = 0xffffffffU;
  for (const VertexId u : order) {
    EXPECT_TRUE(mesh.is_current(model.store.node_of(u)));
    EXPECT_LE(model.store.node_of(u).size, size);
    size = model.store.node_of(u).size;
    ASSERT_TRUE(mesh.split(u, delta));
  }
}

}  // namespace
}  // namespace nearmesh
