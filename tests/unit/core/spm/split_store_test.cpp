// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/core/spm/detail/split_store.hpp"

#include "nearmesh/core/spm/detail/codec.hpp"
#include "test_models.hpp"

namespace nearmesh {
namespace {

/// A record of a complete store, with its boxes and faces.
SplitRecord record_of(const SplitStore& store, VertexId u, std::vector<SplitFace>& faces) {
  SplitRecord record{.node = store.node_of(u), .split = u};
  for (int k = 0; k < 3; ++k)
    record.offset[static_cast<std::size_t>(k)] =
        store.position(u)[k] - store.position(record.node.first)[k];
  if (record.left().size > 1) record.left_box = store.box_code(record.left());
  if (record.right().size > 1) record.right_box = store.box_code(record.right());
  const auto own = store.faces(u);
  faces.assign(own.begin(), own.end());
  record.face_count = static_cast<std::uint32_t>(faces.size());
  return record;
}

class SplitStoreInsert : public ::testing::Test {
 protected:
  // The first split with a face whose right child and left child both have vertices to spare.
  void SetUp() override {
    for (const VertexId u : test::all_splits(model_.store)) {
      record_ = record_of(model_.store, u, faces_);
      if (model_.store.is_root(record_.node.first) && !faces_.empty() && record_.right().size > 2 &&
          record_.node == model_.store.initial_node(record_.node.first))
        return;
    }
    FAIL() << "no such split";
  }
  void expect_refused(const char* what) {
    const std::uint32_t known = store_.known_splits();
    const auto inserted = store_.insert(record_, faces_);
    ASSERT_FALSE(inserted.is_ok());
    EXPECT_EQ(inserted.status().code(), StatusCode::kCorrupt);
    EXPECT_NE(inserted.status().message().find(what), std::string::npos)
        << inserted.status().message();
    EXPECT_EQ(store_.known_splits(), known);
  }

  BakedModel model_ = test::bake_named("sphere");
  SplitStore store_{model_.header};
  SplitRecord record_;
  std::vector<SplitFace> faces_;
};

TEST_F(SplitStoreInsert, AddsASplitOfARoot) {
  const auto inserted = store_.insert(record_, faces_);
  ASSERT_TRUE(inserted.is_ok()) << inserted.status().message();
  EXPECT_EQ(inserted.value(), SplitStore::Insertion::kAdded);
  EXPECT_EQ(store_.split_of(record_.node), record_.split);
}

TEST_F(SplitStoreInsert, KnowsARepeatedSplit) {
  ASSERT_TRUE(store_.insert(record_, faces_).is_ok());
  EXPECT_EQ(store_.insert(record_, faces_).value(), SplitStore::Insertion::kKnown);
  EXPECT_EQ(store_.known_splits(), 1U);
}

TEST_F(SplitStoreInsert, TakesBoxesThatComeLater) {
  SplitRecord bare = record_;
  bare.left_box = bare.right_box = kNoBox;
  ASSERT_TRUE(store_.insert(bare, faces_).is_ok());
  EXPECT_EQ(store_.box_code(record_.right()), kNoBox);
  EXPECT_EQ(store_.insert(bare, faces_).value(), SplitStore::Insertion::kKnown);
  EXPECT_EQ(store_.insert(record_, faces_).value(), SplitStore::Insertion::kBoxed);
  EXPECT_EQ(store_.insert(record_, faces_).value(), SplitStore::Insertion::kKnown);
  EXPECT_EQ(store_.box_code(record_.right()), record_.right_box);
}

TEST_F(SplitStoreInsert, NodeWithoutABoxInheritsItsParents) {
  SplitRecord bare = record_;
  bare.left_box = bare.right_box = kNoBox;
  ASSERT_TRUE(store_.insert(bare, faces_).is_ok());
  EXPECT_EQ(store_.box(record_.right()), store_.box(record_.node));
}

TEST_F(SplitStoreInsert, ReportsAMissingParent) {
  record_.node = record_.right();
  record_.split = {record_.split.value + 1};
  EXPECT_EQ(store_.insert(record_, {}).value(), SplitStore::Insertion::kNoParent);
  EXPECT_EQ(store_.known_splits(), 0U);
}

TEST_F(SplitStoreInsert, ReportsNodesBeyondTheModelAsWithoutParent) {
  record_.node = {{model_.header.vertex_count}, 2};
  EXPECT_EQ(store_.insert(record_, {}).value(), SplitStore::Insertion::kNoParent);
}

TEST_F(SplitStoreInsert, RefusesAnotherSplitOfTheNode) {
  ASSERT_TRUE(store_.insert(record_, faces_).is_ok());
  record_.split = {record_.split.value + 1};
  faces_.clear();
  expect_refused("another split");
}

TEST_F(SplitStoreInsert, RefusesAnotherPosition) {
  ASSERT_TRUE(store_.insert(record_, faces_).is_ok());
  record_.offset[0] += record_.offset[0] > 0 ? -1 : 1;
  expect_refused("another position");
}

TEST_F(SplitStoreInsert, RefusesOtherFaces) {
  ASSERT_TRUE(store_.insert(record_, faces_).is_ok());
  faces_[0].flipped = !faces_[0].flipped;
  expect_refused("other faces");
}

TEST_F(SplitStoreInsert, RefusesFewerFaces) {
  ASSERT_TRUE(store_.insert(record_, faces_).is_ok());
  faces_.pop_back();
  expect_refused("other faces");
}

TEST_F(SplitStoreInsert, RefusesAPositionBelowTheGrid) {
  record_.offset[1] = -0x7fffffff;
  expect_refused("outside the grid");
}

TEST_F(SplitStoreInsert, RefusesAPositionAboveTheGrid) {
  record_.offset[1] = 0x7fffffff;
  expect_refused("outside the grid");
}

TEST_F(SplitStoreInsert, RefusesASplitAtTheNodesFirstVertex) {
  record_.split = record_.node.first;
  expect_refused("outside the node");
}

TEST_F(SplitStoreInsert, RefusesASplitBeyondTheNode) {
  record_.split = {record_.node.end()};
  expect_refused("outside the node");
}

TEST_F(SplitStoreInsert, RefusesAFaceWithoutACornerOnTheLeft) {
  faces_[0].left = faces_[0].right;
  expect_refused("face");
}

TEST_F(SplitStoreInsert, RefusesAFaceWithoutACornerOnTheRight) {
  faces_[0].right = faces_[0].left;
  expect_refused("face");
}

TEST_F(SplitStoreInsert, RefusesAFaceInsideTheNode) {
  faces_[0].outside = faces_[0].left;
  expect_refused("face");
}

TEST_F(SplitStoreInsert, RefusesAFaceBeyondTheModel) {
  faces_[0].outside = {model_.header.vertex_count};
  expect_refused("face");
}

TEST(SplitStore, EraseInReverseForgetsEverything) {
  BakedModel model = test::bake_named("book");  // with a split of many faces
  std::vector<VertexId> splits = test::all_splits(model.store);
  for (auto u = splits.rbegin(); u != splits.rend(); ++u) model.store.erase(*u);
  EXPECT_EQ(model.store.known_splits(), 0U);
  for (std::uint32_t v = 0; v < model.header.vertex_count; ++v)
    EXPECT_EQ(model.store.is_known({v}), model.store.is_root({v}));
}

TEST(SplitStore, TakesAnErasedSplitAgain) {
  BakedModel model = test::bake_named("book");
  const VertexId last = test::all_splits(model.store).back();
  std::vector<SplitFace> faces;
  const SplitRecord record = record_of(model.store, last, faces);
  model.store.erase(last);
  EXPECT_EQ(model.store.insert(record, faces).value(), SplitStore::Insertion::kAdded);
  EXPECT_EQ(model.store.split_of(record.node), last);
}

TEST(SplitStore, ParentAndChildNameEachOther) {
  const BakedModel model = test::bake_named("aircraft");
  for (const VertexId u : test::all_splits(model.store)) {
    const NodeSpan node = model.store.node_of(u);
    const NodeSpan left = node.left_of(u), right = node.right_of(u);
    EXPECT_EQ(model.store.split_of(node), u);
    EXPECT_EQ(model.store.parent_of(left), node);
    EXPECT_EQ(model.store.parent_of(right), node);
    EXPECT_TRUE(model.store.is_node(left) && model.store.is_node(right));
  }
}

TEST(SplitStore, IntervalsThatAreNoNodesAreNone) {
  const BakedModel model = test::bake_named("aircraft");
  std::vector<NodeSpan> nodes;
  for (const BaseRoot& root : model.header.roots) nodes.push_back(root.node);
  for (const VertexId u : test::all_splits(model.store)) {
    const NodeSpan node = model.store.node_of(u);
    nodes.push_back(node.left_of(u));
    nodes.push_back(node.right_of(u));
  }
  std::sort(nodes.begin(), nodes.end());
  Random random(41);
  for (int i = 0; i < 20000; ++i) {
    const NodeSpan node{{random.below(model.header.vertex_count + 5)}, random.below(70)};
    EXPECT_EQ(model.store.is_node(node), std::binary_search(nodes.begin(), nodes.end(), node));
  }
}

}  // namespace
}  // namespace nearmesh
