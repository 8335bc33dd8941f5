// SPDX-License-Identifier: Apache-2.0
#include "core/replica/replica.hpp"

#include "brute_force.hpp"
#include "nearmesh/core/query/query.hpp"

namespace nearmesh {
namespace {

std::vector<std::vector<std::uint8_t>> all_batches(const BakedModel& model, std::size_t max_bytes) {
  ActiveMesh mesh(model.store);
  RefineDelta delta;
  for (const VertexId u : test::all_splits(model.store)) EXPECT_TRUE(mesh.split(u, delta));
  auto batches = encode_batches(model.header, model.store, active_treelet(mesh),
                                BoxPolicy::kCutNodes, max_bytes);
  for (auto& bytes : batches) seal_batch(model.header.content, bytes);
  return batches;
}

/// The tree holds what the mesh does: its exact faces and unresolved nodes, each where it is.
void expect_tree_follows(const Replica& replica, const BakedModel& model) {
  const test::TreeContent content = test::walk_tree(replica.view(), test::TrueBoxes(model.store));
  EXPECT_EQ(content.faces,
            test::keys_of(test::exact_faces(replica.mesh(), test::all_faces(model.store))));
  EXPECT_EQ(content.unresolved, test::unresolved_nodes(replica.mesh()));
}

/// The lower half, along x, of the box around a model.
RegionPart lower_half(const SplitStore& store) {
  GridBox whole;
  for (const BaseRoot& root : store.roots()) whole.add(store.box(root.node));
  whole.hi[0] = whole.lo[0] + (whole.hi[0] - whole.lo[0]) / 2;
  return RegionPart{whole};
}

TEST(Replica, TakesBatchesInAnyOrderAndItsTreeFollows) {
  for (const std::string& name : test::mesh_names()) {
    SCOPED_TRACE(name);
    const BakedModel model = test::bake_named(name);
    std::vector<std::vector<std::uint8_t>> batches = all_batches(model, 120);
    Random random(3);
    test::shuffle(batches, random);
    Replica replica(model.header);
    for (const auto& bytes : batches) {
      const Replica::Taken taken = replica.take(bytes);
      ASSERT_TRUE(taken.status.is_ok()) << taken.status.message();
      EXPECT_GE(std::min({taken.times.load_s, taken.times.refine_s, taken.times.tree_s}), 0);
    }
    EXPECT_EQ(replica.taken_batches(), batches.size());
    EXPECT_EQ(replica.mesh().split_count(), model.header.split_count());
    EXPECT_FALSE(replica.gave_up_detail());
    expect_tree_follows(replica, model);
  }
}

TEST(Replica, TakesBatchesThatWereDecodedElsewhere) {
  const BakedModel model = test::bake_named("terrain");
  Replica decodes(model.header), takes(model.header);
  for (const auto& bytes : all_batches(model, 300)) {
    ASSERT_TRUE(decodes.take(bytes).status.is_ok());
    const Replica::Taken taken = takes.take(decode_sealed(model.header, bytes).value());
    ASSERT_TRUE(taken.status.is_ok());
    EXPECT_EQ(taken.times.load_s, 0);
    ASSERT_EQ(takes.mesh().state_hash(), decodes.mesh().state_hash());
  }
  EXPECT_EQ(takes.taken_batches(), decodes.taken_batches());
  expect_tree_follows(takes, model);
}

TEST(Replica, ABatchThatDoesNotDecodeIsCountedAndChangesNothing) {
  const BakedModel model = test::bake_named("terrain");
  Replica replica(model.header);
  EXPECT_FALSE(replica.take(std::vector<std::uint8_t>{1, 2, 3}).status.is_ok());
  EXPECT_EQ(replica.taken_batches(), 1U);
  EXPECT_EQ(replica.mesh().state_hash(), Replica(model.header).mesh().state_hash());
  expect_tree_follows(replica, model);
}

TEST(Replica, AContradictionMakesItForgetAllDetail) {
  const BakedModel model = test::bake_named("terrain");
  SplitBatch batch = decode_sealed(model.header, all_batches(model, 600).front()).value();
  ASSERT_GT(batch.splits.size(), 4U);
  batch.splits.resize(batch.splits.size() / 2);
  SplitRecord wrong = batch.splits.front();
  wrong.split = {wrong.split.value + 1};  // the node is divided already, elsewhere
  ASSERT_GT(wrong.node.end(), wrong.split.value);
  batch.splits.push_back(wrong);
  Replica replica(model.header);
  const Replica::Taken taken = replica.take(batch);
  EXPECT_EQ(taken.status.code(), StatusCode::kCorrupt);
  EXPECT_TRUE(taken.contradicts);
  EXPECT_EQ(replica.mesh().state_hash(), Replica(model.header).mesh().state_hash());
  expect_tree_follows(replica, model);
}

TEST(Replica, WhoContradictedTheModelIsNotListenedToAgain) {
  const BakedModel model = test::bake_named("terrain");
  const auto batches = all_batches(model, 300);
  constexpr std::uint64_t kLiar = 7, kHonest = 8;
  Replica replica(model.header);
  ASSERT_TRUE(replica.take(batches[0], kLiar).status.is_ok());
  std::vector<std::uint8_t> nonsense{1, 2, 3};
  seal_batch(model.header.content, nonsense);
  const Replica::Taken taken = replica.take(nonsense, kLiar);
  EXPECT_TRUE(taken.contradicts);
  EXPECT_TRUE(replica.distrusts(kLiar));
  EXPECT_FALSE(replica.distrusts(kHonest));
  EXPECT_TRUE(replica.take(batches[1], kLiar).status.is_ok());
  EXPECT_EQ(replica.mesh().split_count(), 0U) << "counted and dropped";
  EXPECT_EQ(replica.taken_batches(), 3U);
  for (const auto& bytes : batches) ASSERT_TRUE(replica.take(bytes, kHonest).status.is_ok());
  EXPECT_EQ(replica.mesh().split_count(), model.header.split_count());
  expect_tree_follows(replica, model);
}

TEST(Replica, OfTenThousandBatchesWithOneBitChangedNoneIsTaken) {
  const BakedModel model = test::bake_named("terrain");
  const auto batches = all_batches(model, 600);
  Random random(1);
  Replica replica(model.header);
  std::size_t accepted = 0;
  for (int i = 0; i < 10'000; ++i) {
    auto bytes = batches[random.below(static_cast<std::uint32_t>(batches.size()))];
    const std::uint32_t bit = random.below(static_cast<std::uint32_t>(bytes.size() * 8));
    bytes[bit / 8] ^= static_cast<std::uint8_t>(1U << bit % 8);
    const Replica::Taken taken = replica.take(bytes);
    accepted += taken.status.is_ok() ? 1 : 0;
    EXPECT_FALSE(taken.contradicts);
  }
  EXPECT_EQ(accepted, 0U);
  EXPECT_EQ(replica.mesh().split_count(), 0U);
  SpmHeader other = model.header;
  other.content.low ^= 1;
  EXPECT_FALSE(decode_sealed(other, batches[0]).is_ok()) << "a seal is of one content";
}

TEST(Replica, GivesUpWhatMeetsNothingKept) {
  for (const char* name : {"terrain", "sphere", "components"}) {
    SCOPED_TRACE(name);
    const BakedModel model = test::bake_named(name);
    const std::vector<std::vector<std::uint8_t>> batches = all_batches(model, 300);
    Replica replica(model.header);
    for (const auto& bytes : batches) ASSERT_TRUE(replica.take(bytes).status.is_ok());
    const std::uint64_t full = replica.mesh().state_hash();
    const RegionPart kept = lower_half(model.store);

    static_cast<void>(replica.give_up({{kept}}));
    EXPECT_TRUE(replica.gave_up_detail());
    EXPECT_LT(replica.mesh().split_count(), model.header.split_count());
    EXPECT_GT(replica.mesh().split_count(), 0U);
    EXPECT_EQ(replica.store().known_splits(), replica.mesh().split_count());  // forgotten too
    for (const NodeSpan& node : test::unresolved_nodes(replica.mesh()))
      EXPECT_FALSE(kept.meets(replica.store().box(node)));
    expect_tree_follows(replica, model);

    for (const auto& bytes : batches) ASSERT_TRUE(replica.take(bytes).status.is_ok());
    EXPECT_EQ(replica.mesh().state_hash(), full);
    expect_tree_follows(replica, model);
  }
}

TEST(Replica, KeepsAllWhereAllIsKept) {
  const BakedModel model = test::bake_named("terrain");
  Replica replica(model.header);
  for (const auto& bytes : all_batches(model, 300)) ASSERT_TRUE(replica.take(bytes).status.is_ok());
  RegionPart whole = lower_half(model.store);
  whole.box.hi[0] = std::numeric_limits<std::int32_t>::max();
  static_cast<void>(replica.give_up({{whole}}));
  EXPECT_FALSE(replica.gave_up_detail());
  EXPECT_EQ(replica.mesh().split_count(), model.header.split_count());
}

TEST(Replica, WorksOnWhereItWasMovedTo) {
  const BakedModel model = test::bake_named("sphere");
  const std::vector<std::vector<std::uint8_t>> batches = all_batches(model, 200);
  Replica first(model.header);
  ASSERT_TRUE(first.take(batches[0]).status.is_ok());
  Replica second(std::move(first));
  for (const auto& bytes : batches) ASSERT_TRUE(second.take(bytes).status.is_ok());
  EXPECT_EQ(second.mesh().split_count(), model.header.split_count());
  expect_tree_follows(second, model);
}

TEST(Replica, StartsFromAHeaderFromOutside) {
  const BakedModel model = test::bake_named("terrain");
  std::vector<std::uint8_t> bytes = encode_header(model.header);
  Result<Replica> replica = Replica::from_header(bytes);
  ASSERT_TRUE(replica.is_ok()) << replica.status().message();
  expect_tree_follows(replica.value(), model);
  bytes.pop_back();
  EXPECT_FALSE(Replica::from_header(bytes).is_ok());
}

}  // namespace
}  // namespace nearmesh
