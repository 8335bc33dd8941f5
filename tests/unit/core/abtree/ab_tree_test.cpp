// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/core/abtree/detail/ab_tree.hpp"

#include "core/base/resources.hpp"
#include "core/refine/refined_mesh.hpp"
#include "half_spaces.hpp"
#include "nearmesh/core/query/query.hpp"
#include "random_policies.hpp"

namespace nearmesh {
namespace {

/// A mesh and its tree, changed at random: splits one by one, many in one delta, and collapses of
/// all sizes.
class Wanderer {
 public:
  Wanderer(const BakedModel& model, std::uint64_t seed)
      : random_(seed), model_(model), mesh_(model.store), tree_(mesh_) {}

  void step() {
    RefineDelta delta;
    const std::uint32_t kind = random_.below(4);
    if (kind == 0) {
      ASSERT_TRUE(mesh_.split(any_vertex(), delta));
    } else if (kind < 3) {
      // Near each other, so that slots fill up and faces become exact.
      const std::uint32_t first = any_vertex().value;
      const std::uint32_t count = 1 + random_.below(90);
      for (std::uint32_t v = first; v < std::min(first + count, model_.header.vertex_count); ++v) {
        ASSERT_TRUE(mesh_.split({v}, delta));
      }
    } else {
      const VertexId u = any_vertex();
      if (!model_.store.is_root(u)) mesh_.collapse(model_.store.node_of(u), delta);
      if (random_.below(3) == 0) {  // and splits elsewhere, in the same delta
        ASSERT_TRUE(mesh_.split(any_vertex(), delta));
      }
    }
    for (std::uint32_t n = random_.below(6); n > 0; --n) {
      const NodeSpan node = mesh_.current_node(mesh_.active_predecessor(any_vertex()));
      if (node.size < 2) continue;
      for (const HalfSpace& half_space : half_spaces_.some(node, random_, 3))
        mesh_.add_half_space(node, half_space, delta);
    }
    tree_.update(delta);
  }
  [[nodiscard]] const ActiveMesh& mesh() const { return mesh_; }
  [[nodiscard]] AbTree& tree() { return tree_; }

 private:
  VertexId any_vertex() { return {random_.below(model_.header.vertex_count)}; }

  Random random_;
  const BakedModel& model_;
  const test::TrueHalfSpaces half_spaces_{model_.store};
  ActiveMesh mesh_;
  AbTree tree_;
};

/// Down to each block and unresolved node. Places in the arrays may differ.
void expect_same_shape(const TreeView& x, const TreeView& y) {
  std::vector<std::pair<TreeEntry, TreeEntry>> stack{{x.root(), y.root()}};
  while (!stack.empty()) {
    const auto [a, b] = stack.back();
    stack.pop_back();
    ASSERT_EQ(a.box, b.box);
    ASSERT_EQ(a.slab, b.slab);
    ASSERT_EQ(a.kind_and_count, b.kind_and_count);
    if (a.kind() != TreeEntry::Kind::kInner) continue;
    for (std::uint32_t lane = 0; lane < kLanes; ++lane)
      stack.emplace_back(x.nodes[a.first].entry(lane), y.nodes[b.first].entry(lane));
  }
}

class AbTreeOf : public ::testing::TestWithParam<std::string> {};
INSTANTIATE_TEST_SUITE_P(Models, AbTreeOf, ::testing::ValuesIn(test::mesh_names()),
                         [](const auto& model) { return model.param; });

TEST_P(AbTreeOf, HoldsExactlyTheExactFacesAndTheUnresolvedNodes) {
  const BakedModel model = test::bake_named(GetParam());
  const std::vector<test::KeyedFace> all = test::all_faces(model.store);
  const test::TrueBoxes boxes(model.store);
  for (std::uint64_t seed = 0; seed < 4; ++seed) {
    SCOPED_TRACE(seed);
    Wanderer wanderer(model, seed);
    for (int i = 0; i < 40; ++i) {
      SCOPED_TRACE(i);
      wanderer.step();
      const test::TreeContent content =
          test::walk_tree(wanderer.tree().view(model.header.grid), boxes);
      ASSERT_EQ(content.faces, test::keys_of(test::exact_faces(wanderer.mesh(), all)));
      ASSERT_EQ(content.unresolved, test::unresolved_nodes(wanderer.mesh()));
      ASSERT_EQ(wanderer.tree().stats().exact_faces, content.faces.size());
    }
  }
}

TEST_P(AbTreeOf, FollowedTreeHoldsWhatOneFromScratchHolds) {
  const BakedModel model = test::bake_named(GetParam());
  const test::TrueBoxes boxes(model.store);
  Wanderer wanderer(model, 81);
  for (int i = 0; i < 60; ++i) {
    SCOPED_TRACE(i);
    wanderer.step();
    const AbTree scratch(wanderer.mesh());
    const auto followed = test::walk_tree(wanderer.tree().view(model.header.grid), boxes);
    const auto built = test::walk_tree(scratch.view(model.header.grid), boxes);
    ASSERT_EQ(followed.faces, built.faces);
    ASSERT_EQ(followed.unresolved, built.unresolved);
    ASSERT_EQ(wanderer.tree().stats().slots, scratch.stats().slots);
  }
}

TEST_P(AbTreeOf, AnswersAsOneFromScratch) {
  const BakedModel model = test::bake_named(GetParam());
  const BakedModel other = test::bake_named("sphere");
  ActiveMesh other_mesh(other.store);
  RefineDelta delta;
  for (const VertexId u : global_order(other.store, other.header.split_count() / 2))
    ASSERT_TRUE(other_mesh.split(u, delta));
  const AbTree other_tree(other_mesh);
  Random random(82);
  Wanderer wanderer(model, 82);
  for (int i = 0; i < 30; ++i) {
    SCOPED_TRACE(i);
    wanderer.step();
    const AbTree scratch(wanderer.mesh());
    const PosedPair posed = test::near_pose(random, model, other);
    const Answer x = query(wanderer.tree().view(model.header.grid), posed.a,
                           other_tree.view(other.header.grid), posed.b);
    const Answer y = query(scratch.view(model.header.grid), posed.a,
                           other_tree.view(other.header.grid), posed.b);
    EXPECT_EQ(x.status, y.status);
    EXPECT_EQ(x.pairs, y.pairs);
    EXPECT_EQ(x.missing_a, y.missing_a);
    EXPECT_EQ(x.missing_b, y.missing_b);
    EXPECT_EQ(x.clearance_m, y.clearance_m);
    EXPECT_EQ(x.uncertainty_m, y.uncertainty_m);
    EXPECT_EQ(digest(x), digest(y));
  }
}

TEST_P(AbTreeOf, FollowsAReplicaWhoseBatchesComeInAnyOrderAndAreForgottenAgain) {
  const BakedModel model = test::bake_named(GetParam());
  const std::vector<test::KeyedFace> all = test::all_faces(model.store);
  const test::TrueBoxes boxes(model.store);
  ActiveMesh full(model.store);
  RefineDelta ignored;
  for (const VertexId u : test::all_splits(model.store)) ASSERT_TRUE(full.split(u, ignored));
  std::vector<SplitBatch> batches;
  for (const auto& bytes :
       encode_batches(model.header, model.store, active_treelet(full), BoxPolicy::kCutNodes, 150))
    batches.push_back(std::move(decode_batch(model.header, bytes)).value());
  Random random(83);
  RefinedMesh replica(model.header);
  AbTree tree(replica.mesh());
  for (int round = 0; round < 3; ++round) {
    test::shuffle(batches, random);
    for (std::size_t i = 0; i < batches.size(); ++i) {
      tree.update(replica.apply_batch(batches[i]).delta);
      if (i % 8 != 0) continue;
      const auto content = test::walk_tree(tree.view(model.header.grid), boxes);
      ASSERT_EQ(content.faces, test::keys_of(test::exact_faces(replica.mesh(), all)));
      ASSERT_EQ(content.unresolved, test::unresolved_nodes(replica.mesh()));
    }
    for (int i = 0; i < 30; ++i) {
      const VertexId u{random.below(model.header.vertex_count)};
      if (model.store.is_root(u) || !replica.store().is_node(model.store.node_of(u))) continue;
      const NodeSpan node = model.store.node_of(u);
      tree.update(replica.collapse(node));
      if (replica.mesh().is_current(node)) replica.forget(node);
      const auto content = test::walk_tree(tree.view(model.header.grid), boxes);
      ASSERT_EQ(content.faces, test::keys_of(test::exact_faces(replica.mesh(), all)));
      ASSERT_EQ(content.unresolved, test::unresolved_nodes(replica.mesh()));
    }
  }
}

// A publisher sends a node's box only where the node's own split is not in the same answer, so a
// box may come long after its node, and after nodes below that did without.
TEST_P(AbTreeOf, BoxesThatComeLateChangeTheTreeAsIfTheyHadComeFirst) {
  const BakedModel model = test::bake_named(GetParam());
  Treelet treelet;
  {
    ActiveMesh mesh(model.store);
    RefineDelta delta;
    for (const VertexId u :
         global_order(model.store, std::min(model.header.split_count() / 2, 150U)))
      ASSERT_TRUE(mesh.split(u, delta));
    treelet = active_treelet(mesh);
  }
  Treelet without_boxes = treelet;
  for (TreeletSplit& split : without_boxes) {
    split.left_included = split.node.left_of(split.split).size > 1;
    split.right_included = split.node.right_of(split.split).size > 1;
  }
  // One record a batch; to the encoder all children are included, so none has a box.
  const auto decode = [&](const TreeletSplit& split, BoxPolicy policy) {
    const auto bytes = encode_batches(model.header, model.store, {split}, policy);
    Result<SplitBatch> batch = decode_batch(model.header, bytes.front());
    EXPECT_TRUE(batch.is_ok()) << batch.status().message();
    return std::move(batch).value();
  };
  RefinedMesh replica(model.header);
  AbTree tree(replica.mesh());
  for (const TreeletSplit& split : without_boxes)
    tree.update(replica.apply_batch(decode(split, BoxPolicy::kCutNodes)).delta);
  const auto expect_as_from_scratch = [&] {
    const AbTree scratch(replica.mesh());
    expect_same_shape(tree.view(model.header.grid), scratch.view(model.header.grid));
  };
  expect_as_from_scratch();
  Random random(85);
  test::shuffle(treelet, random);
  bool any = false;
  for (const TreeletSplit& split : treelet) {
    const RefinedMesh::Applied applied = replica.apply_batch(decode(split, BoxPolicy::kAllNodes));
    any = any || !applied.delta.boxed.empty();
    tree.update(applied.delta);
    expect_as_from_scratch();
    if (HasFatalFailure()) return;
  }
  EXPECT_TRUE(any || GetParam() == "one_face");
  for (const TreeletSplit& split : treelet)  // nothing new: nothing to do
    EXPECT_TRUE(replica.apply_batch(decode(split, BoxPolicy::kAllNodes)).delta.is_empty());
}

// Large enough for several layers of upper nodes, which are packed anew where a large node is split
// after smaller ones elsewhere, or made whole.
TEST(AbTree, UpperNodesArePackedAsFromScratch) {
  const BakedModel model = test::bake_mesh(generate_terrain(100, 3), 16);
  const SplitStore& store = model.store;
  ActiveMesh mesh(store);
  AbTree tree(mesh);
  Random random(86);
  const auto vertices = model.header.vertex_count;
  for (int i = 0; i < 150; ++i) {
    SCOPED_TRACE(i);
    RefineDelta delta;
    for (std::uint32_t n = 1 + random.below(3); n > 0; --n) {
      const std::uint32_t first = random.below(vertices), count = random.below(600),
                          step = 1 + random.below(40);
      if (random.below(4) == 0) {
        const VertexId u{first};
        if (!store.is_root(u)) mesh.collapse(store.node_of(u), delta);
      }
      for (std::uint32_t v = first; v < std::min(first + count, vertices); v += step) {
        ASSERT_TRUE(mesh.split({v}, delta));
      }
    }
    tree.update(delta);
    const AbTree scratch(mesh);
    expect_same_shape(tree.view(model.header.grid), scratch.view(model.header.grid));
    if (HasFatalFailure()) return;
  }
  EXPECT_GT(mesh.split_count(), 1000U);
}

// The fewer lanes stand empty, the fewer nodes a query opens.
TEST(AbTree, NodesOfAWholeModelAreNearlyFull) {
  const BakedModel model = test::bake_mesh(generate_terrain(100, 3), 16);
  ActiveMesh mesh(model.store);
  RefineDelta delta;
  for (const VertexId u : test::all_splits(model.store)) ASSERT_TRUE(mesh.split(u, delta));
  const AbTree tree(mesh);
  const TreeView view = tree.view(model.header.grid);
  std::size_t nodes = 0, lanes = 0;
  std::vector<TreeEntry> stack{view.root()};
  while (!stack.empty()) {
    const TreeEntry entry = stack.back();
    stack.pop_back();
    if (entry.kind() != TreeEntry::Kind::kInner) continue;
    ++nodes;
    view.for_each_child(entry, [&](const TreeEntry& child) {
      ++lanes;
      stack.push_back(child);
    });
  }
  // The lowest hold what is left of a slot.
  EXPECT_GT(static_cast<double>(lanes) / static_cast<double>(nodes), 5.5);
}

// A book's vertices hang on its spine: long chains of nodes, many of them without a face, below
// several roots.
TEST(AbTree, FollowsRootsThatCollapseBesideEmptyOnes) {
  const BakedModel model = test::bake_mesh(test::make_book(200), 16);
  ASSERT_GT(model.header.roots.size(), 8U);
  const test::TrueBoxes boxes(model.store);
  for (std::uint64_t seed = 0; seed < 200; ++seed) {
    SCOPED_TRACE(seed);
    Random random(seed);
    LocalModel local(model.store, model.header.grid);
    for (int round = 0; round < 4; ++round) {
      test::split_random(local, random);
      if (random.below(2) == 0) {
        test::collapse_some(local, random);
      } else {
        test::collapse_to_base(local);
      }
      const AbTree anew(local.mesh);
      const test::TreeContent followed = test::walk_tree(local.view(), boxes),
                              built = test::walk_tree(anew.view(model.header.grid), boxes);
      ASSERT_EQ(followed.faces, built.faces);
      ASSERT_EQ(followed.unresolved, built.unresolved);
    }
  }
}

TEST(AbTree, CollapseTouchesOnlyWhatWasActive) {
  // A header of a few bytes may announce 2^30 vertices.
  SpmHeader header;
  header.grid.bits = 4;
  header.vertex_count = kMaxVertices - 1;
  header.roots = {{{{0}, header.vertex_count}, {}, {}}};
  RefinedMesh replica(header);
  AbTree tree(replica.mesh());
  const std::uint32_t middle = header.vertex_count / 2;
  SplitBatch batch;
  batch.splits = {{.node = header.roots[0].node, .split = {middle}}};
  tree.update(replica.apply_batch(batch).delta);
  ASSERT_TRUE(replica.mesh().is_active({middle}));
  const std::uint64_t before = resident_memory_bytes();
  tree.update(replica.collapse(header.roots[0].node));
  EXPECT_FALSE(replica.mesh().is_active({middle}));
  EXPECT_LT(resident_memory_bytes(), before + (32U << 20));
}

TEST(AbTree, UpdateWithoutAChangeRebuildsNothing) {
  const BakedModel model = test::bake_named("terrain");
  Wanderer wanderer(model, 84);
  for (int i = 0; i < 10; ++i) wanderer.step();
  wanderer.tree().update({});
  EXPECT_EQ(wanderer.tree().stats().rebuilt_slots, 0U);
  EXPECT_EQ(wanderer.tree().stats().rebuilt_faces, 0U);
}

TEST(AbTree, OneSplitRebuildsNoMoreThanItsSurroundings) {
  const BakedModel model = test::bake_mesh(generate_terrain(48, 7), 64);
  ActiveMesh mesh(model.store);
  RefineDelta delta;
  const std::vector<VertexId> splits = test::all_splits(model.store);
  for (const VertexId u : splits)
    if (u != splits.back()) {
      ASSERT_TRUE(mesh.split(u, delta));
    }
  AbTree tree(mesh);
  RefineDelta last;
  ASSERT_TRUE(mesh.split(splits.back(), last));
  tree.update(last);
  EXPECT_GT(tree.stats().rebuilt_slots, 0U);
  EXPECT_LT(tree.stats().rebuilt_slots, 10U);
  EXPECT_GT(tree.stats().slots, 40U);
}

TEST(AbTree, CollapsedToTheBaseItForgetsItsFaces) {
  const BakedModel model = test::bake_named("terrain");
  ActiveMesh mesh(model.store);
  RefineDelta delta;
  for (const VertexId u : test::all_splits(model.store)) ASSERT_TRUE(mesh.split(u, delta));
  AbTree tree(mesh);
  EXPECT_EQ(tree.stats().exact_faces, model.header.face_count);
  RefineDelta back;
  for (const BaseRoot& root : model.header.roots) mesh.collapse(root.node, back);
  tree.update(back);
  EXPECT_EQ(test::walk_tree(tree.view(model.header.grid), test::TrueBoxes(model.store)).unresolved,
            test::unresolved_nodes(mesh));
  EXPECT_LT(tree.stats().exact_faces, model.header.face_count);
}

TEST(AbTree, MemoryDoesNotGrowWithRefiningAndCollapsing) {
  const BakedModel model = test::bake_named("terrain");
  ActiveMesh mesh(model.store);
  AbTree tree(mesh);
  std::uint64_t after_first = 0;
  for (int round = 0; round < 20; ++round) {
    RefineDelta delta, back;
    for (const VertexId u : test::all_splits(model.store)) ASSERT_TRUE(mesh.split(u, delta));
    tree.update(delta);
    for (const BaseRoot& root : model.header.roots) mesh.collapse(root.node, back);
    tree.update(back);
    if (round == 1) after_first = tree.stats().bytes;
  }
  EXPECT_LE(tree.stats().bytes, after_first * 3 / 2);
}

// A slot's box that encloses all faces whose home is there, but not one that only has its outside
// corner there.
TEST(AbTree, FindsAnExactFaceOutsideTheBoxOfAnotherCornersSlot) {
  const BakedModel model = test::bake_mesh(generate_sphere(40, 0), 16);
  const SplitStore& store = model.store;
  std::size_t tried = 0;
  for (const VertexId u : test::all_splits(store)) {
    const NodeSpan slot = store.node_of(u).right_of(u);
    if (store.node_of(u).size <= kSlotSize || slot.size > kSlotSize || slot.size < 2) continue;
    GridBox home, all;
    for (const test::KeyedFace& keyed : test::all_faces(store)) {
      GridBox box;
      bool touches = false;
      for (const VertexId corner : keyed.face.corners()) {
        box.add(store.position(corner));
        touches |= slot.contains(corner);
      }
      if (touches) all.add(box);
      if (slot.contains(keyed.face.right)) home.add(box);
    }
    home.add(store.position(u));
    const BoxCode narrow = encode_box(store.position(u), home);
    if (decode_box(store.position(u), narrow, store.grid_max()).contains(all)) continue;
    SplitStore lie(model.header);
    bool is_taken = true;
    for (const VertexId v : test::all_splits(store)) {
      SplitRecord record{.node = store.node_of(v), .split = v};
      for (std::size_t k = 0; k < 3; ++k)
        record.offset[k] = store.position(v)[static_cast<int>(k)] -
                           store.position(record.node.first)[static_cast<int>(k)];
      if (record.left().size > 1) record.left_box = store.box_code(record.left());
      if (record.right().size > 1)
        record.right_box = v == u ? narrow : store.box_code(record.right());
      is_taken = is_taken && lie.insert(record, store.faces(v).span()).is_ok();
    }
    if (!is_taken) continue;
    ++tried;
    ActiveMesh mesh(lie);
    AbTree tree(mesh);
    RefineDelta delta;
    for (const VertexId v : test::all_splits(lie)) ASSERT_TRUE(mesh.split(v, delta));
    tree.update(delta);
    EXPECT_EQ(tree.contradiction(), slot);
  }
  EXPECT_GT(tried, 0U);
}

}  // namespace
}  // namespace nearmesh
