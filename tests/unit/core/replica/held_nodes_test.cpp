// SPDX-License-Identifier: Apache-2.0
#include "core/replica/held_nodes.hpp"

#include "half_spaces.hpp"

namespace nearmesh {
namespace {

const auto kKnowsAll = [](NodeSpan) { return Status::ok(); };

/// Two answers: the larger half of all nodes, and the rest. Nodes where the first is cut come with
/// a box of their own.
std::vector<SplitBatch> decoded_batches(const BakedModel& model, std::size_t max_bytes,
                                        bool with_half_spaces = false) {
  const test::TrueHalfSpaces truth(model.store);
  Random random(4);
  ActiveMesh half(model.store), whole(model.store);
  RefineDelta delta;
  const std::vector<VertexId> splits = test::all_splits(model.store);
  for (std::size_t i = 0; i < splits.size(); ++i) {
    if (2 * i < splits.size()) {
      EXPECT_TRUE(half.split(splits[i], delta));
    }
    EXPECT_TRUE(whole.split(splits[i], delta));
  }
  Treelet rest = active_treelet(whole);
  std::erase_if(rest, [&](const TreeletSplit& split) { return half.is_active(split.split); });
  std::vector<SplitBatch> batches;
  for (const Treelet& treelet : {active_treelet(half), rest})
    for (const auto& bytes : encode_batches(
             model.header, model.store, treelet, BoxPolicy::kCutNodes, max_bytes,
             with_half_spaces ? test::random_half_spaces(model.store, treelet, truth, random)
                              : std::vector<NodeHalfSpace>()))
      batches.push_back(decode_batch(model.header, bytes).value());
  return batches;
}

/// What answers depend on: the same nodes are unresolved, in the same boxes.
void expect_same(const Replica& one, const Replica& other) {
  ASSERT_EQ(one.mesh().state_hash(), other.mesh().state_hash());
  ASSERT_EQ(test::exact_faces(one.mesh(), test::all_faces(one.store())).size(),
            test::exact_faces(other.mesh(), test::all_faces(other.store())).size());
  for (const NodeSpan& node : test::unresolved_nodes(one.mesh())) {
    ASSERT_EQ(one.store().box_code(node), other.store().box_code(node)) << to_string(node);
    ASSERT_EQ(one.store().box(node), other.store().box(node)) << to_string(node);
    ASSERT_TRUE(std::ranges::equal(one.mesh().half_spaces().of(node.first),
                                   other.mesh().half_spaces().of(node.first)))
        << to_string(node);
  }
}

Replica made_from(const BakedModel& model, const HeldNodes& held) {
  Result<SplitBatch> batch = held_batch(model.store, kKnowsAll, held.bits);
  EXPECT_TRUE(batch.is_ok()) << batch.status().message();
  Replica replica(model.header);
  EXPECT_TRUE(replica.take(batch.value()).status.is_ok());
  EXPECT_EQ(held_nodes(replica).box_digest, held.box_digest);
  return replica;
}

// Also in the midst of an answer, where nodes that the next batch splits came without a box of
// their own.
TEST(HeldNodes, MakeTheSameReplicaWhichGoesOnAlike) {
  std::size_t with_box = 0, without_box = 0, with_half_spaces = 0;
  for (std::size_t i = 0; i < 2 * test::mesh_names().size(); ++i) {
    const std::string name = test::mesh_names()[i / 2];
    const bool told = i % 2 == 1;
    const BakedModel model = test::bake_named(name);
    const std::vector<SplitBatch> batches = decoded_batches(model, 150, told);
    for (const std::size_t share : {0U, 3U, 5U, 9U, 10U}) {
      const std::size_t taken = batches.size() * share / 10;
      SCOPED_TRACE(name + " after " + std::to_string(taken) + " of " +
                   std::to_string(batches.size()) + (told ? ", with half-spaces" : ""));
      Replica replica(model.header);
      for (std::size_t k = 0; k < taken; ++k) ASSERT_TRUE(replica.take(batches[k]).status.is_ok());
      for (const NodeSpan& node : test::unresolved_nodes(replica.mesh()))
        ++(replica.store().box_code(node) == kNoBox ? without_box : with_box);
      std::size_t half_spaces = 0;
      for (const NodeSpan& node : test::unresolved_nodes(replica.mesh()))
        half_spaces += replica.mesh().half_spaces().of(node.first).size();
      with_half_spaces += half_spaces > 0 ? 1 : 0;
      const HeldNodes held = held_nodes(replica);
      EXPECT_LE(8 * held.bits.size(),
                8 + (told ? 3 : 2) * model.header.roots.size() + 21 * half_spaces +
                    (told ? 6 : 5) * std::size_t{replica.mesh().split_count()});
      Replica twin = made_from(model, held);
      expect_same(replica, twin);
      for (std::size_t k = taken; k < batches.size(); ++k) {
        ASSERT_TRUE(replica.take(batches[k]).status.is_ok());
        ASSERT_TRUE(twin.take(batches[k]).status.is_ok());
        expect_same(replica, twin);
      }
    }
  }
  EXPECT_GT(with_box, 100U);
  EXPECT_GT(without_box, 20U);
  EXPECT_GT(with_half_spaces, 5U);
}

TEST(HeldNodes, TellWhatIsLeftAfterDetailWasGivenUp) {
  const BakedModel model = test::bake_named("terrain");
  Replica replica(model.header);
  for (const SplitBatch& batch : decoded_batches(model, 300))
    ASSERT_TRUE(replica.take(batch).status.is_ok());
  EXPECT_LE(held_nodes(replica).bits.size(), model.header.roots.size() / 4 + 1);  // two bits a root
  GridBox whole;
  for (const BaseRoot& root : model.store.roots()) whole.add(model.store.box(root.node));
  whole.hi[0] = whole.lo[0] + (whole.hi[0] - whole.lo[0]) / 2;
  static_cast<void>(replica.give_up({{RegionPart{whole}}}));
  ASSERT_GT(replica.give_ups(), 0U);
  expect_same(replica, made_from(model, held_nodes(replica)));
}

// As of a peer that was served by somebody whose boxes are larger: true ones, but not the file's.
TEST(HeldNodes, AnotherBoxHasAnotherDigest) {
  const BakedModel model = test::bake_named("terrain");
  const SplitBatch batch = decoded_batches(model, 600).front();
  Replica one(model.header);
  ASSERT_TRUE(one.take(batch).status.is_ok());
  std::size_t others = 0;
  for (std::size_t i = 0; i < batch.splits.size(); ++i) {
    if (batch.splits[i].left_box == kNoBox) continue;
    SplitBatch larger = batch;
    ++larger.splits[i].left_box[0];
    Replica other(model.header);
    if (!other.take(larger).status.is_ok()) continue;  // beyond its parent's
    ++others;
    EXPECT_EQ(held_nodes(one).bits, held_nodes(other).bits);
    EXPECT_NE(held_nodes(one).box_digest, held_nodes(other).box_digest);
  }
  EXPECT_GT(others, 0U);
}

TEST(HeldNodes, BitsThatDoNotFitAreRefused) {
  const BakedModel model = test::bake_named("sphere");
  Replica replica(model.header);
  ASSERT_TRUE(replica.take(decoded_batches(model, 600).front()).status.is_ok());
  const std::vector<std::uint8_t> good = held_nodes(replica).bits;
  for (std::size_t size = 0; size < good.size(); ++size)
    EXPECT_EQ(held_batch(model.store, kKnowsAll, {good.data(), size}).status().code(),
              StatusCode::kInvalidArgument)
        << size;
  std::vector<std::uint8_t> longer = good;
  longer.push_back(0);
  EXPECT_EQ(held_batch(model.store, kKnowsAll, longer).status().code(),
            StatusCode::kInvalidArgument);
  const Status broken{StatusCode::kIo, "no block"};
  EXPECT_EQ(held_batch(
                model.store, [&](NodeSpan) { return broken; }, good)
                .status()
                .code(),
            StatusCode::kIo);
  // Any bits: refused, or some replica.
  Random random(7);
  for (int i = 0; i < 300; ++i) {
    std::vector<std::uint8_t> bits = good;
    for (int k = 0; k < 3; ++k)
      bits[random.below(static_cast<std::uint32_t>(bits.size()))] ^=
          static_cast<std::uint8_t>(1U << random.below(8));
    const Result<SplitBatch> batch = held_batch(model.store, kKnowsAll, bits);
    if (!batch.is_ok()) continue;
    Replica any(model.header);
    EXPECT_TRUE(any.take(batch.value()).status.is_ok());
  }
}

// In few bytes a million could be told of one node, in one step of the walk.
TEST(HeldNodes, MoreHalfSpacesOfANodeThanAreKeptAreRefused) {
  const BakedModel model = test::bake_named("sphere");
  for (const std::size_t count : {kMaxHalfSpaces, kMaxHalfSpaces + 1}) {
    std::vector<bool> bits{true};  // half-spaces are told
    for (const BaseRoot& root : model.header.roots) {
      if (root.node.size < 2) continue;
      bits.insert(bits.end(), 2, false);  // unresolved, no box of its own
      for (std::size_t i = 0; i < (&root == &model.header.roots.front() ? count : 0); ++i) {
        bits.push_back(true);
        for (int bit = 0; bit < kDirectionBits + kReachBits; ++bit)
          bits.push_back(bit < 4 && (i >> bit & 1U) != 0);
      }
      bits.push_back(false);
    }
    std::vector<std::uint8_t> bytes((bits.size() + 7) / 8);
    for (std::size_t i = 0; i < bits.size(); ++i)
      bytes[i / 8] = static_cast<std::uint8_t>(bytes[i / 8] | (bits[i] ? 1U : 0U) << i % 8);
    const Result<SplitBatch> batch = held_batch(model.store, kKnowsAll, bytes);
    if (count <= kMaxHalfSpaces) {
      ASSERT_TRUE(batch.is_ok()) << batch.status().message();
      EXPECT_EQ(batch.value().half_spaces.size(), count);
    } else {
      EXPECT_EQ(batch.status().code(), StatusCode::kInvalidArgument);
    }
  }
}

}  // namespace
}  // namespace nearmesh
