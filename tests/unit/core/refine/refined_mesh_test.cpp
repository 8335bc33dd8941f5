// SPDX-License-Identifier: Apache-2.0
#include "core/refine/refined_mesh.hpp"

#include "half_spaces.hpp"

namespace nearmesh {
namespace {

/// The whole model in batches of at most `max_bytes`, decoded.
std::vector<SplitBatch> all_batches(const BakedModel& model, std::size_t max_bytes) {
  ActiveMesh mesh(model.store);
  RefineDelta delta;
  for (const VertexId u : test::all_splits(model.store)) EXPECT_TRUE(mesh.split(u, delta));
  std::vector<SplitBatch> batches;
  for (const auto& bytes : encode_batches(model.header, model.store, active_treelet(mesh),
                                          BoxPolicy::kCutNodes, max_bytes)) {
    Result<SplitBatch> batch = decode_batch(model.header, bytes);
    EXPECT_TRUE(batch.is_ok()) << batch.status().message();
    batches.push_back(std::move(batch).value());
  }
  return batches;
}

void apply(RefinedMesh& replica, const SplitBatch& batch) {
  const RefinedMesh::Applied applied = replica.apply_batch(batch);
  ASSERT_TRUE(applied.status.is_ok()) << applied.status.message();
}

void expect_same_mesh(const RefinedMesh& a, const RefinedMesh& b) {
  EXPECT_EQ(a.mesh().state_hash(), b.mesh().state_hash());
  const std::vector<ActiveFace> x = extract_faces(a.mesh()), y = extract_faces(b.mesh());
  ASSERT_EQ(x.size(), y.size());
  for (std::size_t i = 0; i < x.size(); ++i) {
    ASSERT_EQ(x[i].key, y[i].key);
    ASSERT_EQ(x[i].corners, y[i].corners);
    for (const VertexId corner : x[i].corners)
      ASSERT_EQ(a.store().position(corner), b.store().position(corner));
  }
}

class ApplyBatchTo : public ::testing::TestWithParam<std::string> {};
INSTANTIATE_TEST_SUITE_P(Models, ApplyBatchTo, ::testing::ValuesIn(test::mesh_names()),
                         [](const auto& model) { return model.param; });

TEST_P(ApplyBatchTo, AllBatchesGiveTheFullMesh) {
  const BakedModel model = test::bake_named(GetParam());
  RefinedMesh replica(model.header);
  for (const SplitBatch& batch : all_batches(model, kMaxBatchBytes)) apply(replica, batch);
  EXPECT_EQ(replica.mesh().split_count(), model.header.split_count());
  EXPECT_EQ(extract_faces(replica.mesh()).size(), model.header.face_count);
}

TEST_P(ApplyBatchTo, AnyOrderWithRepeatsGivesTheSameMesh) {
  const BakedModel model = test::bake_named(GetParam());
  const std::vector<SplitBatch> batches = all_batches(model, 80);
  RefinedMesh straight(model.header);
  for (const SplitBatch& batch : batches) apply(straight, batch);
  for (std::uint64_t seed = 0; seed < 3; ++seed) {
    SCOPED_TRACE(seed);
    Random random(seed);
    std::vector<std::size_t> order;
    for (std::size_t i = 0; i < batches.size(); ++i)
      for (std::uint32_t n = 1 + random.below(2); n > 0; --n) order.push_back(i);
    test::shuffle(order, random);
    RefinedMesh replica(model.header);
    for (const std::size_t i : order) apply(replica, batches[i]);
    EXPECT_EQ(replica.parked_splits(), 0U);
    expect_same_mesh(replica, straight);
  }
}

TEST_P(ApplyBatchTo, StateIsClosedUnderParentsWhateverIsLost) {
  const BakedModel model = test::bake_named(GetParam());
  const std::vector<SplitBatch> batches = all_batches(model, 60);
  Random random(62);
  RefinedMesh replica(model.header);
  for (const SplitBatch& batch : batches)
    if (random.below(2) == 0) apply(replica, batch);
  for (const std::uint32_t v : test::active_ids(replica.mesh())) {
    ASSERT_TRUE(replica.store().is_known({v}));
    if (replica.store().is_root({v})) continue;
    const NodeSpan parent = replica.store().parent_of(replica.store().node_of({v}));
    if (parent.size > 0) {
      EXPECT_TRUE(replica.mesh().is_active(replica.store().split_of(parent)));
    }
  }
}

// ---- half-spaces --------------------------------------------------------------------------------

/// The model in batches with half-spaces, by several answers that go ever deeper: so that nodes get
/// some and lose them.
std::vector<SplitBatch> batches_with_half_spaces(const BakedModel& model, std::uint64_t seed) {
  const test::TrueHalfSpaces truth(model.store);
  Random random(seed);
  ActiveMesh mesh(model.store), before(model.store);
  RefineDelta delta;
  const std::vector<VertexId> order = test::all_splits(model.store);
  std::vector<SplitBatch> batches;
  for (const std::size_t share : {5U, 20U, 70U}) {
    for (std::size_t i = 0; 100 * i < share * order.size(); ++i)
      EXPECT_TRUE(mesh.split(order[i], delta));
    Treelet treelet = active_treelet(mesh);
    std::erase_if(treelet, [&](const TreeletSplit& s) { return before.is_active(s.split); });
    for (const TreeletSplit& s : treelet) EXPECT_TRUE(before.split(s.split, delta));
    for (const auto& bytes :
         encode_batches(model.header, model.store, treelet, BoxPolicy::kCutNodes, 150,
                        test::random_half_spaces(model.store, treelet, truth, random)))
      batches.push_back(decode_batch(model.header, bytes).value());
  }
  return batches;
}

std::vector<NodeHalfSpace> half_spaces_of(const RefinedMesh& replica) {
  std::vector<NodeHalfSpace> all;
  for (const NodeSpan& node : test::unresolved_nodes(replica.mesh()))
    for (const HalfSpace& half_space : replica.mesh().half_spaces().of(node.first))
      all.push_back({node, half_space});
  return all;
}

TEST_P(ApplyBatchTo, HalfSpacesComeInAnyOrderWithRepeats) {
  const BakedModel model = test::bake_named(GetParam());
  const std::vector<SplitBatch> batches = batches_with_half_spaces(model, 5);
  RefinedMesh straight(model.header);
  for (const SplitBatch& batch : batches) apply(straight, batch);
  const std::vector<NodeHalfSpace> expected = half_spaces_of(straight);
  RefinedMesh bare(model.header);
  for (SplitBatch batch : batches) {
    batch.half_spaces.clear();
    apply(bare, batch);
  }
  EXPECT_EQ(bare.mesh().state_hash() == straight.mesh().state_hash(), expected.empty());
  for (std::uint64_t seed = 0; seed < 6; ++seed) {
    SCOPED_TRACE(seed);
    Random random(seed);
    std::vector<SplitBatch> some = batches;
    for (std::size_t i = 0; i < batches.size(); ++i)
      if (random.below(3) == 0) some.push_back(batches[i]);
    test::shuffle(some, random);
    RefinedMesh replica(model.header);
    for (const SplitBatch& batch : some) apply(replica, batch);
    expect_same_mesh(replica, straight);
    EXPECT_EQ(half_spaces_of(replica), expected);
  }
}

// What is left of the digest is that of the splits: nothing of what was dropped stays in it.
TEST_P(ApplyBatchTo, HalfSpacesGoWithTheirNode) {
  const BakedModel model = test::bake_named(GetParam());
  for (std::uint64_t seed = 0; seed < 4; ++seed) {
    Random random(seed);
    RefinedMesh replica(model.header);
    for (const SplitBatch& batch : batches_with_half_spaces(model, seed)) {
      if (random.below(4) == 0) continue;
      apply(replica, batch);
      for (std::uint32_t n = random.below(3); n > 0; --n) {
        const VertexId u{random.below(model.header.vertex_count)};
        if (!replica.store().is_known(u) || replica.store().is_root(u)) continue;
        const NodeSpan node = replica.store().node_of(u);
        if (replica.collapse(node).collapsed.empty()) continue;
        EXPECT_TRUE(replica.mesh().half_spaces().of(node.first).empty());
        replica.forget(node);
      }
      ActiveMesh twin(model.store);
      RefineDelta delta;
      for (const std::uint32_t v : test::active_ids(replica.mesh()))
        if (!model.store.is_root({v})) {
          ASSERT_TRUE(twin.split({v}, delta));
        }
      for (const NodeHalfSpace& told : half_spaces_of(replica))
        ASSERT_TRUE(twin.add_half_space(told.node, told.half_space, delta));
      ASSERT_EQ(twin.state_hash(), replica.mesh().state_hash());
    }
    for (const BaseRoot& root : model.header.roots) static_cast<void>(replica.collapse(root.node));
    if (half_spaces_of(replica).empty()) {
      EXPECT_EQ(replica.mesh().state_hash(), RefinedMesh(model.header).mesh().state_hash());
    }
  }
}

TEST(ApplyBatch, AHalfSpaceOfASplitNodeDoesNotCount) {
  const BakedModel model = test::bake_named("terrain");
  RefinedMesh replica(model.header);
  for (const SplitBatch& batch : all_batches(model, kMaxBatchBytes)) apply(replica, batch);
  const std::uint64_t before = replica.mesh().state_hash();
  SplitBatch batch;
  for (const BaseRoot& root : model.header.roots)
    if (root.node.size > 1) batch.half_spaces.push_back({root.node, {1, 0}});
  ASSERT_FALSE(batch.half_spaces.empty());
  const RefinedMesh::Applied applied = replica.apply_batch(batch);
  EXPECT_TRUE(applied.status.is_ok());
  EXPECT_TRUE(applied.delta.is_empty());
  EXPECT_EQ(replica.mesh().state_hash(), before);
}

/// One code short of the truth, of each node that a batch makes, in some directions: how many are
/// refused, if the rest follows.
TEST(ApplyBatch, FalseHalfSpacesAreFoundByWhatIsKnownOfTheirNodeOrComes) {
  const BakedModel model = test::bake_named("aircraft");
  const test::TrueHalfSpaces truth(model.store);
  const std::vector<SplitBatch> batches = all_batches(model, 80);
  Random random(8);
  std::size_t at_once = 0, later = 0, tried = 0;
  for (std::size_t i = 0; i + 1 < batches.size() && tried < 300; ++i) {
    RefinedMesh held(model.header);
    for (std::size_t k = 0; k <= i; ++k) apply(held, batches[k]);
    for (const NodeSpan& node : test::unresolved_nodes(held.mesh())) {
      if (random.below(3) > 0) continue;
      HalfSpace wrong =
          *truth.tightest(node, static_cast<std::uint16_t>(random.below(1U << kDirectionBits)));
      if (wrong.reach < 40) continue;
      wrong.reach = static_cast<std::uint8_t>(wrong.reach - 8);  // half as far
      ++tried;
      RefinedMesh replica(model.header);
      for (std::size_t k = 0; k <= i; ++k) apply(replica, batches[k]);
      SplitBatch batch;
      batch.half_spaces.push_back({node, wrong});
      Status fault = replica.apply_batch(batch).status;
      at_once += fault.is_ok() ? 0 : 1;
      if (!fault.is_ok()) {
        EXPECT_NE(fault.message().find(to_string(node)), std::string::npos);
        EXPECT_NE(fault.message().find("half-space"), std::string::npos);
        continue;
      }
      for (std::size_t k = 0; k < batches.size() && fault.is_ok(); ++k)
        fault = replica.apply_batch(batches[k]).status;
      later += fault.is_ok() ? 0 : 1;
    }
  }
  EXPECT_GT(tried, 100U);
  EXPECT_GT(at_once, tried / 20);
  EXPECT_GT(at_once + later, tried / 3);
  RecordProperty("tried", static_cast<int>(tried));
  RecordProperty("found_at_once", static_cast<int>(at_once));
  RecordProperty("found_later", static_cast<int>(later));
}

// A face of long ago, with a corner in the node: looked at in turn.
TEST(ApplyBatch, FalseHalfSpacesAreFoundByFacesThatAreKnownInPart) {
  const BakedModel model = test::bake_named("sphere");
  const std::vector<SplitBatch> batches = all_batches(model, 150);
  std::size_t found = 0;
  RefinedMesh held(model.header);
  for (std::size_t i = 0; i < batches.size() / 2; ++i) apply(held, batches[i]);
  for (const NodeSpan& node : test::unresolved_nodes(held.mesh()))
    for (std::uint16_t direction = 100; direction < 4096 && found == 0; direction += 500) {
      RefinedMesh replica(model.header);
      for (std::size_t i = 0; i < batches.size() / 2; ++i) apply(replica, batches[i]);
      SplitBatch batch;
      batch.half_spaces.push_back({node, {direction, 0}});
      if (!replica.apply_batch(batch).status.is_ok()) continue;
      // Nothing new: only the checks in turn can find it.
      for (int round = 0; round < 200 && found == 0; ++round)
        found += replica.apply_batch(SplitBatch{}).status.is_ok() ? 0 : 1;
    }
  EXPECT_GT(found, 0U);
}

TEST(ApplyBatch, ReportsWhatBecameActiveParentsFirst) {
  const BakedModel model = test::bake_named("aircraft");
  std::vector<SplitBatch> batches = all_batches(model, 60);
  std::reverse(batches.begin(), batches.end());
  RefinedMesh replica(model.header);
  ActiveMesh replay(model.store);
  RefineDelta ignored;
  for (const SplitBatch& batch : batches) {
    const RefinedMesh::Applied applied = replica.apply_batch(batch);
    ASSERT_TRUE(applied.status.is_ok());
    for (const VertexId u : applied.delta.split) {
      EXPECT_TRUE(replay.is_current(model.store.node_of(u)));
      ASSERT_TRUE(replay.split(u, ignored));
    }
    ASSERT_EQ(replay.state_hash(), replica.mesh().state_hash());
  }
}

TEST(ApplyBatch, ParksWhatHasNoParentYet) {
  const BakedModel model = test::bake_named("terrain");
  const std::vector<SplitBatch> batches = all_batches(model, 60);
  for (const SplitBatch& batch : batches) {
    RefinedMesh replica(model.header);
    if (replica.store().is_node(batch.splits.front().node)) continue;
    apply(replica, batch);
    EXPECT_EQ(replica.mesh().split_count(), 0U);
    EXPECT_GT(replica.parked_splits(), 0U);
    return;
  }
  FAIL() << "no batch hangs on another";
}

TEST(ApplyBatch, ForestDeeperThanTheLimitIsRefused) {
  // Ever the same node less its last vertex, without boxes: the worst that a hostile publisher can
  // make walks climb.
  SpmHeader header;
  header.grid.bits = 4;
  header.vertex_count = kMaxForestDepth + 100;
  header.roots = {{{{0}, header.vertex_count}, {}, {}}};
  RefinedMesh replica(header);
  SplitBatch batch;
  for (std::uint32_t n = header.vertex_count; n > 1; --n)
    batch.splits.push_back({.node = {{0}, n}, .split = {n - 1}});
  const RefinedMesh::Applied applied = replica.apply_batch(batch);
  EXPECT_EQ(applied.status.code(), StatusCode::kCorrupt);
  EXPECT_NE(applied.status.message().find("deeper"), std::string::npos) << applied.status.message();
  EXPECT_EQ(applied.delta.split.size(), kMaxForestDepth);
  const NodeSpan deepest = replica.mesh().current_node({0});
  EXPECT_EQ(deepest.size, header.vertex_count - kMaxForestDepth);
  EXPECT_EQ(replica.store().box(deepest), replica.store().box(header.roots[0].node));
}

class ContradictingBatch : public ::testing::Test {
 protected:
  void SetUp() override {
    for (std::size_t i = 0; i < batches_.size() / 2; ++i) apply(replica_, batches_[i]);
    hash_ = replica_.mesh().state_hash();
    known_ = replica_.store().known_splits();
  }
  /// A record known to the replica, alone.
  [[nodiscard]] SplitBatch known_record() const {
    SplitBatch batch;
    for (const SplitRecord& record : batches_[0].splits) {
      if (record.face_count == 0) continue;
      batch.splits = {record};
      batch.faces.assign(batches_[0].faces.begin() + record.face_begin,
                         batches_[0].faces.begin() + record.face_begin + record.face_count);
      batch.splits[0].face_begin = 0;
      break;
    }
    return batch;
  }
  void expect_refused(const SplitBatch& batch) {
    const RefinedMesh::Applied applied = replica_.apply_batch(batch);
    EXPECT_EQ(applied.status.code(), StatusCode::kCorrupt);
    EXPECT_TRUE(applied.delta.is_empty());
    EXPECT_EQ(replica_.mesh().state_hash(), hash_);
    EXPECT_EQ(replica_.store().known_splits(), known_);
  }

  BakedModel model_ = test::bake_named("aircraft");
  std::vector<SplitBatch> batches_ = all_batches(model_, 100);
  RefinedMesh replica_{model_.header};
  std::uint64_t hash_ = 0;
  std::uint32_t known_ = 0;
};

TEST_F(ContradictingBatch, RepeatIsAccepted) {
  EXPECT_TRUE(replica_.apply_batch(known_record()).status.is_ok());
  EXPECT_EQ(replica_.mesh().state_hash(), hash_);
}

TEST_F(ContradictingBatch, AnotherPositionIsRefused) {
  SplitBatch batch = known_record();
  batch.splits[0].offset[2] += batch.splits[0].offset[2] > 0 ? -1 : 1;
  expect_refused(batch);
}

TEST_F(ContradictingBatch, AnotherFaceIsRefused) {
  SplitBatch batch = known_record();
  batch.faces[0].flipped = !batch.faces[0].flipped;
  expect_refused(batch);
}

TEST_F(ContradictingBatch, AnotherSplitOfANodeIsRefused) {
  SplitBatch batch = known_record();
  batch.splits[0].face_count = 0;
  batch.splits[0].split = {
      batch.splits[0].node.begin() +
      (batch.splits[0].split.value == batch.splits[0].node.begin() + 1 ? 2U : 1U)};
  if (batch.splits[0].node.size < 3) GTEST_SKIP() << "the node has one split only";
  expect_refused(batch);
}

TEST_F(ContradictingBatch, PositionOutsideTheGridIsRefused) {
  SplitBatch batch{.splits = {batches_[0].splits[0]}};  // of a root
  RefinedMesh fresh(model_.header);
  batch.splits[0].face_begin = batch.splits[0].face_count = 0;
  batch.splits[0].offset[0] = 0x7fffffff;
  EXPECT_EQ(fresh.apply_batch(batch).status.code(), StatusCode::kCorrupt);
  EXPECT_EQ(fresh.store().known_splits(), 0U);
}

TEST_F(ContradictingBatch, WhatStoodBeforeItIsReportedAsApplied) {
  SplitBatch batch = known_record();
  batch.splits[0].offset[2] += batch.splits[0].offset[2] > 0 ? -1 : 1;
  // A good batch that is new, with the contradiction behind it.
  SplitBatch mixed = batches_[batches_.size() / 2];
  SplitRecord bad = batch.splits[0];
  bad.face_begin = static_cast<std::uint32_t>(mixed.faces.size());
  mixed.faces.insert(mixed.faces.end(), batch.faces.begin(), batch.faces.end());
  mixed.splits.push_back(bad);
  ActiveMesh replay(model_.store);
  RefineDelta ignored;
  for (const std::uint32_t v : test::active_ids(replica_.mesh()))
    ASSERT_TRUE(replay.split({v}, ignored));
  const RefinedMesh::Applied applied = replica_.apply_batch(mixed);
  EXPECT_EQ(applied.status.code(), StatusCode::kCorrupt);
  EXPECT_FALSE(applied.delta.split.empty());
  for (const VertexId u : applied.delta.split) ASSERT_TRUE(replay.split(u, ignored));
  EXPECT_EQ(replay.state_hash(), replica_.mesh().state_hash());
}

TEST(RefinedMesh, CollapsedForgottenAndSentAgainIsTheSame) {
  const BakedModel model = test::bake_named("terrain");
  const std::vector<SplitBatch> batches = all_batches(model, 200);
  RefinedMesh straight(model.header), replica(model.header);
  for (const SplitBatch& batch : batches) {
    apply(straight, batch);
    apply(replica, batch);
  }
  Random random(63);
  for (int round = 0; round < 10; ++round) {
    for (int i = 0; i < 20; ++i) {
      const VertexId u{random.below(model.header.vertex_count)};
      if (model.store.is_root(u)) continue;
      const NodeSpan node = model.store.node_of(u);
      if (!replica.store().is_node(node)) continue;
      static_cast<void>(replica.collapse(node));
      if (replica.mesh().is_current(node)) replica.forget(node);
    }
    ASSERT_LT(replica.store().known_splits(), model.header.split_count());
    std::vector<std::size_t> order(batches.size());
    for (std::size_t i = 0; i < order.size(); ++i) order[i] = i;
    test::shuffle(order, random);
    for (const std::size_t i : order) apply(replica, batches[i]);
    expect_same_mesh(replica, straight);
  }
}

TEST(RefinedMesh, ForgetDropsAllKnowledgeBelowTheNode) {
  const BakedModel model = test::bake_named("terrain");
  RefinedMesh replica(model.header);
  for (const SplitBatch& batch : all_batches(model, 200)) apply(replica, batch);
  for (const BaseRoot& root : model.header.roots) {
    static_cast<void>(replica.collapse(root.node));
    replica.forget(root.node);
  }
  EXPECT_EQ(replica.store().known_splits(), 0U);
  EXPECT_EQ(replica.mesh().split_count(), 0U);
}

TEST(RefinedMesh, MovedReplicaWorksOn) {
  const BakedModel model = test::bake_named("sphere");
  const std::vector<SplitBatch> batches = all_batches(model, 100);
  RefinedMesh first(model.header);
  apply(first, batches[0]);
  RefinedMesh second(std::move(first));
  for (const SplitBatch& batch : batches) apply(second, batch);
  EXPECT_EQ(second.mesh().split_count(), model.header.split_count());
}

// The box of a node that is not split leaves out corners, known here, of faces with their other
// corner in it; nothing that comes with it says so.
TEST(ApplyBatch, FindsAFaceThatIsKnownInPartOutsideTheBoxOfItsOtherCornersNode) {
  const BakedModel model = test::bake_mesh(generate_sphere(24, 0), 16);
  ActiveMesh half(model.store);
  RefineDelta delta;
  const std::vector<VertexId> order = global_order(model.store, model.header.split_count() / 2);
  for (const VertexId u : order) ASSERT_TRUE(half.split(u, delta));
  const auto encoded =
      encode_batches(model.header, model.store, active_treelet(half), BoxPolicy::kCutNodes);
  std::vector<SplitBatch> batches;
  for (const auto& bytes : encoded) batches.push_back(decode_batch(model.header, bytes).value());
  std::size_t found = 0;
  for (SplitBatch& batch : batches)
    for (SplitRecord& record : batch.splits)
      for (std::size_t side = 0; side < 6; ++side) {
        if (record.right_box == kNoBox || record.right_box[side] < 6) continue;
        record.right_box[side] -= 6;  // a third of the extent
        RefinedMesh replica(model.header);
        Status fault;
        for (int round = 0; round < 100 && fault.is_ok(); ++round)
          for (std::size_t i = 0; i < batches.size() && fault.is_ok(); ++i)
            fault = replica.apply_batch(batches[i]).status;
        found += fault.message().find("a face of its lies outside") != std::string::npos ? 1 : 0;
        record.right_box[side] += 6;
      }
  EXPECT_GT(found, 10U) << "that no single record contradicts";
}

}  // namespace
}  // namespace nearmesh
