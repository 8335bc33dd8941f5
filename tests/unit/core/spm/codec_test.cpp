// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/core/spm/detail/codec.hpp"

#include <algorithm>
#include <set>
#include <utility>

#include "core/base/hash.hpp"
#include "core/demand/collect.hpp"
#include "core/spm/bits.hpp"
#include "core/spm/blocks.hpp"
#include "core/spm/contexts.hpp"
#include "core/spm/train.hpp"
#include "half_spaces.hpp"

namespace nearmesh {
namespace {

/// What a random request of a random box brings.
Treelet random_treelet(Random& random, const BakedModel& model, std::uint32_t max_splits) {
  RegionRequest request{.max_splits = max_splits};
  for (const BaseRoot& root : model.header.roots)
    if (root.node.size > 1 && random.below(4) > 0) request.attach.push_back(root.node);
  const GridPoint& at = model.store.position({random.below(model.header.vertex_count)});
  const std::int32_t radius = model.store.grid_max() >> random.below(8);
  GridBox box;
  for (int k = 0; k < 3; ++k) {
    box.lo[k] = std::max(0, at[k] - radius);
    box.hi[k] = std::min<std::int32_t>(model.store.grid_max(), at[k] + radius);
  }
  request.region = {box};
  Result<Demand> demand = collect(model.store, request, nullptr);
  EXPECT_TRUE(demand.is_ok());
  return demand.value().treelet;
}

void expect_record(const BakedModel& model, const TreeletSplit& split, const SplitBatch& batch,
                   const SplitRecord& record, BoxPolicy policy) {
  ASSERT_EQ(record.node, split.node);
  ASSERT_EQ(record.split, split.split);
  for (int k = 0; k < 3; ++k)
    EXPECT_EQ(record.offset[static_cast<std::size_t>(k)],
              model.store.position(split.split)[k] - model.store.position(split.node.first)[k]);
  const auto faces = model.store.faces(split.split);
  ASSERT_EQ(record.face_count, faces.size());
  for (std::uint32_t i = 0; i < record.face_count; ++i)
    EXPECT_EQ(batch.faces[record.face_begin + i], faces[i]);
  const auto expected_box = [&](NodeSpan child, bool included) {
    if (child.size < 2 || (policy == BoxPolicy::kCutNodes && included)) return kNoBox;
    return model.store.box_code(child);
  };
  EXPECT_EQ(record.left_box, expected_box(record.left(), split.left_included));
  EXPECT_EQ(record.right_box, expected_box(record.right(), split.right_included));
}

void expect_round_trip(const BakedModel& model, const Treelet& treelet, BoxPolicy policy,
                       std::size_t max_bytes) {
  std::size_t next = 0;
  for (const auto& bytes : encode_batches(model.header, model.store, treelet, policy, max_bytes)) {
    const Result<SplitBatch> batch = decode_batch(model.header, bytes);
    ASSERT_TRUE(batch.is_ok()) << batch.status().message();
    ASSERT_LE(next + batch.value().splits.size(), treelet.size());
    for (const SplitRecord& record : batch.value().splits)
      expect_record(model, treelet[next++], batch.value(), record, policy);
  }
  EXPECT_EQ(next, treelet.size());
}

class Codec : public ::testing::TestWithParam<std::string> {};
INSTANTIATE_TEST_SUITE_P(Models, Codec, ::testing::ValuesIn(test::mesh_names()),
                         [](const auto& model) { return model.param; });

TEST_P(Codec, WireBatchesDecodeToTheTreelet) {
  const BakedModel model = test::bake_named(GetParam());
  Random random(11);
  for (int i = 0; i < 30; ++i)
    expect_round_trip(model, random_treelet(random, model, 1 + random.below(600)),
                      BoxPolicy::kCutNodes, kMaxBatchBytes);
}

TEST_P(Codec, FileBatchesDecodeToTheTreelet) {
  const BakedModel model = test::bake_named(GetParam());
  Random random(12);
  for (int i = 0; i < 30; ++i)
    expect_round_trip(model, random_treelet(random, model, 1 + random.below(600)),
                      BoxPolicy::kAllNodes, std::size_t{1} << 31);
}

TEST_P(Codec, TinyBatchesDecodeToTheTreelet) {
  const BakedModel model = test::bake_named(GetParam());
  Random random(13);
  for (int i = 0; i < 10; ++i)
    expect_round_trip(model, random_treelet(random, model, 200), BoxPolicy::kCutNodes,
                      1 + random.below(100));
}

// The first of an answer's batches may have to share a datagram.
TEST_P(Codec, FirstBatchHasItsOwnLimit) {
  const BakedModel model = test::bake_named(GetParam());
  Random random(15);
  for (int i = 0; i < 30; ++i) {
    const Treelet treelet = random_treelet(random, model, 1 + random.below(600));
    const std::size_t first = random.below(2 * kMaxBatchBytes);
    const auto batches = encode_batches(model.header, model.store, treelet, BoxPolicy::kCutNodes,
                                        kMaxBatchBytes, {}, first);
    std::size_t next = 0;
    for (const auto& bytes : batches) {
      const SplitBatch batch = decode_batch(model.header, bytes).value();
      EXPECT_LE(bytes.size(), kMaxBatchBytes);
      if (next == 0 && first > 200) {
        EXPECT_LE(bytes.size(), first);
      }
      for (const SplitRecord& record : batch.splits)
        expect_record(model, treelet[next++], batch, record, BoxPolicy::kCutNodes);
    }
    EXPECT_EQ(next, treelet.size());
    // Where no record has room the batch is as if there were no such limit.
    EXPECT_EQ(encode_batches(model.header, model.store, treelet, BoxPolicy::kCutNodes,
                             kMaxBatchBytes, {}, 1),
              encode_batches(model.header, model.store, treelet, BoxPolicy::kCutNodes));
  }
}

TEST_P(Codec, NoBatchExceedsTheDatagram) {
  const BakedModel model = test::bake_named(GetParam());
  Random random(14);
  for (int i = 0; i < 30; ++i)
    for (const auto& bytes :
         encode_batches(model.header, model.store, random_treelet(random, model, kMaxRequestSplits),
                        BoxPolicy::kCutNodes))
      EXPECT_LE(bytes.size(), kMaxBatchBytes);
}

// What a publisher chooses by is what it sends, to the bit.
TEST_P(Codec, BitsOfSplitsAreThoseOfTheirBatch) {
  const BakedModel model = test::bake_named(GetParam());
  Random random(18);
  for (int i = 0; i < 30; ++i) {
    const Treelet treelet = random_treelet(random, model, 1 + random.below(600));
    if (treelet.empty()) continue;
    const std::vector<SplitBits> bits = bits_of(model.header, model.store, treelet);
    ASSERT_EQ(bits.size(), treelet.size());
    BitWriter head;
    std::size_t attached = 0, expected = 8;
    std::set<NodeSpan> announced;
    std::uint32_t end = 0;  // of the last attach node
    const std::vector<BaseRoot>& roots = model.header.roots;
    for (std::size_t k = 0; k < treelet.size(); ++k) {
      const TreeletSplit& split = treelet[k];
      const NodeSpan left = split.node.left_of(split.split),
                     right = split.node.right_of(split.split);
      expected += bits[k].record + (split.left_included ? 0 : bits[k].left_box) +
                  (split.right_included ? 0 : bits[k].right_box);
      EXPECT_EQ(bits[k].left_box > 0, left.size > 1);
      EXPECT_EQ(bits[k].right_box > 0, right.size > 1);
      if (split.left_included) announced.insert(left);
      if (split.right_included) announced.insert(right);
      if (announced.contains(split.node)) continue;
      ++attached;
      // A root by how many are passed over, any other node by place and size.
      head.put(0, 1);
      const auto root = std::find_if(roots.begin(), roots.end(),
                                     [&](const BaseRoot& one) { return one.node == split.node; });
      if (root != roots.end()) {
        head.put_gamma(static_cast<std::uint64_t>(std::count_if(
            roots.begin(), root, [&](const BaseRoot& one) { return one.node.begin() >= end; })));
      } else {
        head.put_count(split.node.begin() - end);
        head.put_gamma(split.node.size - 2);
      }
      end = split.node.end();
    }
    head.put_gamma(treelet.size());
    head.put_gamma(attached);
    expected += head.bit_count();
    const auto batches = encode_batches(model.header, model.store, treelet, BoxPolicy::kCutNodes,
                                        std::size_t{1} << 31);
    ASSERT_EQ(batches.size(), 1U);
    EXPECT_EQ(batches[0].size(), (expected + 7) / 8);
  }
}

TEST_P(Codec, StoredBlocksHoldEverySplitOnce) {
  const BakedModel model = test::bake_named(GetParam());
  std::vector<std::uint32_t> seen(model.header.vertex_count);
  for (const NodeSpan& root : block_roots(model.store)) {
    const Treelet treelet = block_treelet(model.store, root);
    for (const TreeletSplit& split : treelet) ++seen[split.split.value];
    expect_round_trip(model, treelet, BoxPolicy::kAllNodes, std::size_t{1} << 31);
  }
  for (std::uint32_t v = 0; v < seen.size(); ++v)
    EXPECT_EQ(seen[v], model.store.is_root({v}) ? 0U : 1U) << v;
}

// Each batch alone into a store that holds the whole model otherwise: nothing of the batches before
// it is needed.
TEST(CodecBatches, EachDecodesAlone) {
  const BakedModel model = test::bake_named("terrain");
  Random random(17);
  const Treelet treelet = random_treelet(random, model, 500);
  auto batches = encode_batches(model.header, model.store, treelet, BoxPolicy::kCutNodes, 60);
  ASSERT_GT(batches.size(), 5U);
  std::vector<std::size_t> order(batches.size());
  for (std::size_t i = 0; i < order.size(); ++i) order[i] = i;
  test::shuffle(order, random);
  std::vector<VertexId> splits;
  for (const std::size_t i : order) {
    const Result<SplitBatch> batch = decode_batch(model.header, batches[i]);
    ASSERT_TRUE(batch.is_ok()) << batch.status().message();
    for (const SplitRecord& record : batch.value().splits) splits.push_back(record.split);
  }
  std::sort(splits.begin(), splits.end());
  std::vector<VertexId> expected;
  for (const TreeletSplit& split : treelet) expected.push_back(split.split);
  std::sort(expected.begin(), expected.end());
  EXPECT_EQ(splits, expected);
}

// A peer's store has boxes only where what it was sent was cut. What it passes on may be cut
// elsewhere.
TEST(CodecBatches, ComeFromAPartOfTheModelToo) {
  const BakedModel model = test::bake_named("terrain");
  Random random(16);
  const auto fill = [&](SplitStore& store, const SplitStore& from, const Treelet& treelet) {
    for (const auto& bytes : encode_batches(model.header, from, treelet, BoxPolicy::kCutNodes)) {
      const Result<SplitBatch> batch = decode_batch(model.header, bytes);
      ASSERT_TRUE(batch.is_ok()) << batch.status().message();
      for (const SplitRecord& record : batch.value().splits)
        ASSERT_TRUE(
            store
                .insert(record, {batch.value().faces.data() + record.face_begin, record.face_count})
                .is_ok());
    }
  };
  std::vector<GridBox> around(model.header.vertex_count);  // the faces at each vertex
  const auto add = [&](const SplitFace& face) {
    for (const VertexId at : {face.left, face.right, face.outside})
      for (const VertexId corner : {face.left, face.right, face.outside})
        around[at.value].add(model.store.position(corner));
  };
  for (const SplitFace& face : model.store.base_faces()) add(face);
  for (std::uint32_t v = 0; v < model.header.vertex_count; ++v)
    for (const SplitFace& face : model.store.faces({v})) add(face);
  SplitStore part(model.header), passed_on(model.header);
  fill(part, model.store, random_treelet(random, model, 2000));
  std::size_t without_box = 0;
  for (int i = 0; i < 80; ++i) {
    RegionRequest request{.attach = {}, .region = {part.box(part.roots()[0].node)}};
    for (const BaseRoot& root : part.roots())
      if (root.node.size > 1) request.attach.push_back(root.node);
    request.max_splits = 1 + random.below(1000);
    const Demand demand = collect(part, request, nullptr, AttachRule::kAlways).value();
    fill(passed_on, part, demand.treelet);
    for (const TreeletSplit& split : demand.treelet)
      for (const NodeSpan& child :
           {split.node.left_of(split.split), split.node.right_of(split.split)}) {
        if (child.size < 2) continue;
        without_box += part.box_code(child)[0] == kNoBoxCode ? 1 : 0;
        GridBox faces = around[child.begin()];
        for (std::uint32_t v = child.begin(); v < child.end(); ++v) faces.add(around[v]);
        const GridBox box = passed_on.box(child);
        for (int k = 0; k < 3; ++k) {
          EXPECT_LE(box.lo[k], faces.lo[k]);
          EXPECT_GE(box.hi[k], faces.hi[k]);
        }
      }
  }
  EXPECT_GT(without_box, 100U);
}

TEST(MakeTables, LeavesOutWhatAPeerSeldomMeets) {
  TrainingCounts counts(static_cast<std::size_t>(coding_context_count()));
  auto& offsets = counts[record::kOffset0];
  offsets[3] = 10 * kTableSplits - 19;
  offsets[4] = 10;
  offsets[5] = 9;
  auto& others = counts[record::kFaceCount];
  for (std::size_t symbol = 3; symbol < 10; ++symbol) others[symbol] = 9;
  others[1] = others[2] = 11;
  others[0] = 100;
  const CodingTables tables = make_tables(counts);
  const auto length = [&](int context, std::size_t symbol) {
    return tables.contexts()[static_cast<std::size_t>(context)].lengths[symbol];
  };
  EXPECT_GT(length(record::kOffset0, 4), 0);
  EXPECT_EQ(length(record::kOffset0, 5), 0);
  EXPECT_GT(length(record::kFaceCount, 1), 0);
  for (std::size_t symbol = 3; symbol < 10; ++symbol)
    EXPECT_EQ(length(record::kFaceCount, symbol), 0);
  // The escape stands for what was left out: 63 uses, to 100, 11 and 11.
  EXPECT_EQ(length(record::kFaceCount, kEscape), 2);
  EXPECT_EQ(length(record::kFaceCount, 1), 3);
}

// ---- half-spaces --------------------------------------------------------------------------------

TEST_P(Codec, HalfSpacesGoWithTheirNodesAndOnTheirOwn) {
  const BakedModel model = test::bake_named(GetParam());
  const test::TrueHalfSpaces truth(model.store);
  Random random(17);
  for (const std::size_t max_bytes : {std::size_t{60}, std::size_t{300}, kMaxBatchBytes})
    for (int i = 0; i < 20; ++i) {
      const Treelet treelet = i == 0 ? Treelet{} : random_treelet(random, model, random.below(200));
      const auto told = test::random_half_spaces(model.store, treelet, truth, random);
      std::vector<NodeHalfSpace> found;
      std::size_t next = 0;
      for (const auto& bytes : encode_batches(model.header, model.store, treelet,
                                              BoxPolicy::kCutNodes, max_bytes, told)) {
        const Result<SplitBatch> batch = decode_batch(model.header, bytes);
        ASSERT_TRUE(batch.is_ok()) << batch.status().message();
        EXPECT_EQ(bytes.front(), batch.value().half_spaces.empty() ? 0 : kWithHalfSpaces);
        if (batch.value().splits.size() != 1) {
          EXPECT_LE(bytes.size(), max_bytes);
        }
        for (const SplitRecord& record : batch.value().splits)
          expect_record(model, treelet[next++], batch.value(), record, BoxPolicy::kCutNodes);
        found.insert(found.end(), batch.value().half_spaces.begin(),
                     batch.value().half_spaces.end());
      }
      EXPECT_EQ(next, treelet.size());
      std::sort(found.begin(), found.end());
      EXPECT_EQ(found, told);
    }
}

TEST(CodecHalfSpaces, CostNothingWhereThereAreNoneAndSome21BitsEach) {
  const BakedModel model = test::bake_named("terrain");
  const test::TrueHalfSpaces truth(model.store);
  Random random(18);
  const Treelet treelet = random_treelet(random, model, 100);
  std::vector<NodeHalfSpace> told;
  std::size_t cut = 0;
  for (const TreeletSplit& split : treelet)
    for (const NodeSpan& node :
         {split.node.left_of(split.split), split.node.right_of(split.split)}) {
      const bool included = node.first == split.split ? split.right_included : split.left_included;
      if (node.size < 2 || included) continue;
      ++cut;
      for (const int direction : {7, 1000, 3000})
        told.push_back({node, *truth.tightest(node, static_cast<std::uint16_t>(direction))});
    }
  std::sort(told.begin(), told.end());
  const auto encode = [&](std::span<const NodeHalfSpace> half_spaces) {
    const auto batches = encode_batches(model.header, model.store, treelet, BoxPolicy::kCutNodes,
                                        std::size_t{1} << 20, half_spaces);
    EXPECT_EQ(batches.size(), 1U);
    return batches.front();
  };
  const auto without = encode({}), with = encode(told);
  EXPECT_EQ(without, encode_batches(model.header, model.store, treelet, BoxPolicy::kCutNodes,
                                    std::size_t{1} << 20)
                         .front());
  EXPECT_GT(told.size(), 30U);
  EXPECT_LE(8 * (with.size() - without.size()), 21 * told.size() + cut + 8);
}

/// A batch of one half-space of a held node, its fields as they are given.
std::vector<std::uint8_t> batch_of(std::uint32_t first, std::uint32_t size,
                                   std::span<const HalfSpace> half_spaces, int held = 1) {
  BitWriter out;
  out.put(kWithHalfSpaces, 8);
  out.put_gamma(0);
  out.put_gamma(0);
  out.put_gamma(static_cast<std::uint64_t>(held));
  for (int i = 0; i < held; ++i) {
    out.put(0, 1);
    out.put_count(i == 0 ? first : 0);
    out.put_gamma(size - 2);
    for (std::size_t k = 0; k < half_spaces.size(); ++k) {
      out.put(half_spaces[k].direction, kDirectionBits);
      out.put(half_spaces[k].reach, kReachBits);
      if (k + 1 < kMaxHalfSpaces) out.put(k + 1 < half_spaces.size(), 1);
    }
  }
  return std::move(out).finish();
}

TEST(CodecHalfSpaces, MalformedOnesAreRefusedAndNamed) {
  const BakedModel model = test::bake_named("sphere");
  const auto fault = [&](std::vector<std::uint8_t> bytes) {
    return decode_batch(model.header, bytes).status().message();
  };
  const std::uint32_t n = model.header.vertex_count;
  const HalfSpace low{5, 9}, high{6, 0};
  EXPECT_EQ(fault(batch_of(0, n, {{low, high}})), "");
  EXPECT_EQ(fault(batch_of(0, 2, {{low}}, 2)), "");
  EXPECT_NE(fault(batch_of(0, n + 1, {{low}})).find("outside the model's"), std::string::npos);
  EXPECT_NE(fault(batch_of(n - 1, 2, {{low}})).find("outside the model's"), std::string::npos);
  EXPECT_NE(fault(batch_of(0, 9, {{high, low}})).find("node [0, 9): directions do not ascend"),
            std::string::npos);
  EXPECT_NE(fault(batch_of(0, 9, {{low, low}})).find("directions do not ascend"),
            std::string::npos);
  EXPECT_NE(fault(batch_of(0, 2, {}, 0)).find("there are none"), std::string::npos);
  auto longer = batch_of(0, 9, {{low}});
  longer.push_back(0);
  EXPECT_NE(fault(longer).find("left over after its half-spaces"), std::string::npos);
  const std::vector<std::uint8_t> good = batch_of(0, 9, {{low, high}});
  for (std::size_t size = 0; size < good.size(); ++size)
    EXPECT_NE(fault({good.begin(), good.begin() + static_cast<std::ptrdiff_t>(size)}), "") << size;
}

TEST(CodecHalfSpaces, DamagedBytesAreRefusedOrReadAsSomethingInRange) {
  const BakedModel model = test::bake_named("aircraft");
  const test::TrueHalfSpaces truth(model.store);
  Random random(19);
  for (int i = 0; i < 2000; ++i) {
    const Treelet treelet = random_treelet(random, model, 30);
    auto batches =
        encode_batches(model.header, model.store, treelet, BoxPolicy::kCutNodes, kMaxBatchBytes,
                       test::random_half_spaces(model.store, treelet, truth, random));
    if (batches.empty()) continue;
    auto& bytes = batches.front();
    for (std::uint32_t n = 1 + random.below(3); n > 0; --n)
      bytes[random.below(static_cast<std::uint32_t>(bytes.size()))] ^=
          static_cast<std::uint8_t>(1U << random.below(8));
    if (random.below(3) == 0) bytes.resize(random.below(static_cast<std::uint32_t>(bytes.size())));
    const Result<SplitBatch> batch = decode_batch(model.header, bytes);
    if (!batch.is_ok()) continue;
    for (const NodeHalfSpace& told : batch.value().half_spaces) {
      EXPECT_GE(told.node.size, 2U);
      EXPECT_LE(told.node.end(), model.header.vertex_count);
      EXPECT_LT(told.half_space.direction, 1U << kDirectionBits);
    }
  }
}

TEST(CodecBatches, NothingGivesNoBatch) {
  const BakedModel model = test::bake_named("sphere");
  EXPECT_TRUE(encode_batches(model.header, model.store, {}, BoxPolicy::kCutNodes).empty());
}

// The one batch that may exceed the limit: a split that alone brings more faces than fit.
TEST(CodecBatches, SplitTooLargeForADatagramStandsAlone) {
  SpmHeader header;
  header.vertex_count = 2002;
  header.roots.push_back({{{0}, 4}, {}, {}});
  for (std::uint32_t v = 4; v < header.vertex_count; ++v)
    header.roots.push_back({{{v}, 1}, {}, {}});
  header.tables = make_tables(TrainingCounts(static_cast<std::size_t>(coding_context_count())));
  SplitStore store(header);
  std::vector<SplitFace> faces;
  for (std::uint32_t v = 4; v < header.vertex_count; ++v) faces.push_back({{0}, {2}, {v}});
  ASSERT_TRUE(store.insert({.node = {{0}, 4}, .split = {2}}, faces).is_ok());
  ASSERT_TRUE(store.insert({.node = {{0}, 2}, .split = {1}}, {}).is_ok());
  ASSERT_TRUE(store.insert({.node = {{2}, 2}, .split = {3}}, {}).is_ok());
  const Treelet treelet{{{{0}, 4}, {2}, true, true}, {{{0}, 2}, {1}}, {{{2}, 2}, {3}}};
  const auto batches = encode_batches(header, store, treelet, BoxPolicy::kCutNodes);
  ASSERT_EQ(batches.size(), 2U);
  EXPECT_GT(batches[0].size(), kMaxBatchBytes);
  EXPECT_LE(batches[1].size(), kMaxBatchBytes);
  const Result<SplitBatch> batch = decode_batch(header, batches[0]);
  ASSERT_TRUE(batch.is_ok()) << batch.status().message();
  EXPECT_EQ(batch.value().faces, faces);
}

/// Encloses whatever lies in the grid.
constexpr BoxCode kWholeGrid{kMaxExtentCode, kMaxExtentCode, kMaxExtentCode,
                             kMaxExtentCode, kMaxExtentCode, kMaxExtentCode};

/// A forest of one root of `size` vertices beside `others` single ones, split at random down to the
/// leaves, with any faces and places: what no simplifier makes.
struct AnyModel {
  SpmHeader header;
  std::unique_ptr<SplitStore> store;
  Treelet treelet;
};
AnyModel make_any_model(Random& random, std::uint32_t size, std::uint32_t others) {
  AnyModel model;
  model.header.vertex_count = size + others;
  model.header.roots.push_back({{{0}, size}, {}, kWholeGrid});
  for (std::uint32_t v = size; v < size + others; ++v)
    model.header.roots.push_back({{{v}, 1}, {}, kWholeGrid});
  model.store = std::make_unique<SplitStore>(model.header);
  std::vector<NodeSpan> stack{model.header.roots[0].node};
  while (!stack.empty()) {
    const NodeSpan node = stack.back();
    stack.pop_back();
    SplitRecord record{.node = node, .split = {node.begin() + 1 + random.below(node.size - 1)}};
    const auto& from = model.store->position(node.first);
    for (int k = 0; k < 3; ++k)
      record.offset[static_cast<std::size_t>(k)] =
          static_cast<std::int32_t>(random.below(1U << 21) >> random.below(22)) - from[k];
    std::vector<SplitFace> faces(random.below(2) == 0 ? 2 : random.below(6));
    for (SplitFace& face : faces) {
      face.left = {node.begin() + random.below(record.left().size)};
      face.right = {record.split.value + random.below(record.right().size)};
      // Few different corners and often the same slot: guesses come true, lists run over, owners
      // change.
      const std::uint32_t away = random.below(model.header.vertex_count - node.size);
      const std::uint32_t near = random.below(2) == 0 ? away & ~255U : away % 8;
      face.outside = {near < node.begin() ? near : (away < node.begin() ? away : away + node.size)};
      face.flipped = random.below(2) == 0;
    }
    std::sort(faces.begin(), faces.end(), [](const SplitFace& a, const SplitFace& b) {
      return std::tuple(a.flipped, a.left, a.right, a.outside) <
             std::tuple(b.flipped, b.left, b.right, b.outside);
    });
    EXPECT_TRUE(model.store->insert(record, faces).is_ok());
    model.treelet.push_back({node, record.split, record.left().size > 1, record.right().size > 1});
    if (record.right().size > 1) stack.push_back(record.right());
    if (record.left().size > 1) stack.push_back(record.left());
  }
  TrainingCounts counts;
  count_treelet(model.header, *model.store, model.treelet, BoxPolicy::kCutNodes, counts);
  model.header.tables = make_tables(counts);
  return model;
}

void expect_any_round_trip(const AnyModel& model, std::size_t max_bytes) {
  std::size_t next = 0;
  for (const auto& bytes :
       encode_batches(model.header, *model.store, model.treelet, BoxPolicy::kCutNodes, max_bytes)) {
    const Result<SplitBatch> batch = decode_batch(model.header, bytes);
    ASSERT_TRUE(batch.is_ok()) << batch.status().message();
    for (const SplitRecord& record : batch.value().splits) {
      const VertexId split = model.treelet[next++].split;
      ASSERT_EQ(record.split, split);
      const auto faces = model.store->faces(split);
      ASSERT_EQ(record.face_count, faces.size());
      for (std::uint32_t i = 0; i < record.face_count; ++i)
        ASSERT_EQ(batch.value().faces[record.face_begin + i], faces[i]);
    }
  }
  EXPECT_EQ(next, model.treelet.size());
}

TEST(CodecBatches, AnyForestWithAnyFacesDecodesToItself) {
  for (std::uint64_t seed = 0; seed < 60; ++seed) {
    SCOPED_TRACE(seed);
    Random random(seed);
    const AnyModel model = make_any_model(random, 2 + random.below(1500), 3 + random.below(1500));
    expect_any_round_trip(model, std::size_t{1} << 31);
    expect_any_round_trip(model, 40 + random.below(2000));
  }
}

// Sides of 2^14 vertices and more have their size written out.
TEST(CodecBatches, LargeNodesDecodeToThemselves) {
  Random random(31);
  const AnyModel model = make_any_model(random, 200000, 5);
  const TreeletSplit& first = model.treelet.front();
  ASSERT_GE(std::min(first.node.left_of(first.split).size, first.node.right_of(first.split).size),
            1U << 14);
  expect_any_round_trip(model, std::size_t{1} << 31);
}

// The bytes of a model that depends on nothing but this file and the codec. Where this fails the
// format has changed: raise the versions (spm_format.md, section 12) and then this number.
TEST(CodecBatches, BytesAreThoseOfThisVersion) {
  Random random(32);
  const AnyModel model = make_any_model(random, 700, 400);
  std::uint64_t hash = 0;
  for (const auto& bytes :
       encode_batches(model.header, *model.store, model.treelet, BoxPolicy::kCutNodes))
    hash = mix(hash ^ hash_bytes(bytes));
  EXPECT_EQ(hash, 13800791699819264871U);
}

// ---- bytes from outside
// ---------------------------------------------------------------------------

/// Decodes, and applies what was accepted to a store of the true model and to one that starts
/// empty.
void expect_harmless(const BakedModel& model, const std::vector<std::uint8_t>& bytes) {
  const Result<SplitBatch> batch = decode_batch(model.header, bytes);
  if (!batch.is_ok()) {
    EXPECT_EQ(batch.status().code(), StatusCode::kCorrupt);
    EXPECT_FALSE(batch.status().message().empty());
    return;
  }
  EXPECT_LE(batch.value().splits.size(), bytes.size() * 8);
  EXPECT_LE(batch.value().faces.size(), bytes.size() * 8);
  SplitStore store(model.header);
  ActiveMesh mesh(store);
  AbTree tree(mesh);
  RefineDelta delta;
  for (const SplitRecord& record : batch.value().splits) {
    EXPECT_GE(record.node.size, 2U);
    EXPECT_LE(record.node.end(), model.header.vertex_count);
    const auto inserted =
        store.insert(record, {batch.value().faces.data() + record.face_begin, record.face_count});
    if (inserted.is_ok() && inserted.value() == SplitStore::Insertion::kAdded) {
      EXPECT_TRUE(mesh.split(record.split, delta));
    }
  }
  tree.update(delta);
}

TEST(DecodeBatch, SurvivesRandomBytes) {
  const BakedModel model = test::bake_named("aircraft");
  Random random(21);
  for (int i = 0; i < 20000; ++i) {
    std::vector<std::uint8_t> bytes(random.below(200));
    for (std::uint8_t& byte : bytes) byte = static_cast<std::uint8_t>(random.next());
    if (!bytes.empty()) bytes[0] &= 1;  // past the flags
    expect_harmless(model, bytes);
  }
}

TEST(DecodeBatch, SurvivesSparseBytes) {  // long runs of zeros are long gamma codes
  const BakedModel model = test::bake_named("aircraft");
  Random random(22);
  for (int i = 0; i < 20000; ++i) {
    std::vector<std::uint8_t> bytes(8 + random.below(60));
    for (std::uint32_t j = random.below(6); j > 0; --j)
      bytes[random.below(static_cast<std::uint32_t>(bytes.size()))] =
          static_cast<std::uint8_t>(1U << random.below(8));
    bytes[0] &= 1;
    expect_harmless(model, bytes);
  }
}

TEST(DecodeBatch, RefusesEveryTruncation) {
  const BakedModel model = test::bake_named("aircraft");
  Random random(23);
  for (int i = 0; i < 5; ++i) {
    const auto batches = encode_batches(model.header, model.store,
                                        random_treelet(random, model, 120), BoxPolicy::kCutNodes);
    for (const auto& bytes : batches)
      for (std::size_t n = 0; n < bytes.size(); ++n) {
        const Result<SplitBatch> batch = decode_batch(model.header, {bytes.data(), n});
        EXPECT_FALSE(batch.is_ok()) << n << " of " << bytes.size();
      }
  }
}

TEST(DecodeBatch, RefusesAppendedBytes) {
  const BakedModel model = test::bake_named("aircraft");
  Random random(24);
  auto bytes = encode_batches(model.header, model.store, random_treelet(random, model, 50),
                              BoxPolicy::kCutNodes)
                   .front();
  bytes.push_back(0);
  EXPECT_FALSE(decode_batch(model.header, bytes).is_ok());
}

TEST(DecodeBatch, SurvivesEveryFlippedBit) {
  const BakedModel model = test::bake_named("aircraft");
  Random random(25);
  for (int i = 0; i < 3; ++i) {
    auto bytes = encode_batches(model.header, model.store, random_treelet(random, model, 60),
                                BoxPolicy::kCutNodes)
                     .front();
    for (std::size_t bit = 0; bit < bytes.size() * 8; ++bit) {
      bytes[bit / 8] ^= static_cast<std::uint8_t>(1U << bit % 8);
      expect_harmless(model, bytes);
      bytes[bit / 8] ^= static_cast<std::uint8_t>(1U << bit % 8);
    }
  }
}

/// A batch with one record below an attach node, whose name is written by `put_name`.
template <class PutName>
std::vector<std::uint8_t> batch_with_attach(const PutName& put_name) {
  BitWriter out;
  out.put(0, 8);
  out.put_gamma(1);
  out.put_gamma(1);
  put_name(out);
  for (int i = 0; i < 16; ++i) out.put(0, 8);
  return std::move(out).finish();
}
void expect_attach_refused(const SpmHeader& header, const std::vector<std::uint8_t>& bytes) {
  const Result<SplitBatch> batch = decode_batch(header, bytes);
  ASSERT_FALSE(batch.is_ok());
  EXPECT_NE(batch.status().message().find("attach node"), std::string::npos)
      << batch.status().message();
}

TEST(DecodeBatch, RefusesAnAttachNodeWithoutASize) {
  expect_attach_refused(test::bake_named("sphere").header, batch_with_attach([](BitWriter& out) {
                          out.put(0, 1);
                          out.put_count(0);
                          out.put64(0);  // of a gamma number the zeros alone
                        }));
}

TEST(DecodeBatch, RefusesAnAttachNodeBeyondTheLastVertex) {
  const SpmHeader header = test::bake_named("sphere").header;
  for (const std::uint32_t first : {header.vertex_count - 1, header.vertex_count, 0x7fffffffU})
    expect_attach_refused(header, batch_with_attach([&](BitWriter& out) {
                            out.put(0, 1);
                            out.put_count(first);
                            out.put_gamma(0);
                          }));
}

TEST(DecodeBatch, RefusesARootThatIsNotThere) {
  const SpmHeader header = test::bake_named("sphere").header;
  for (const std::uint64_t root : {std::uint64_t{header.roots.size()}, std::uint64_t{0xfffffffeU}})
    expect_attach_refused(header, batch_with_attach([&](BitWriter& out) {
                            out.put(1, 1);
                            out.put_gamma(root);
                          }));
}

// A triangle has no detail: each of its roots is a vertex.
TEST(DecodeBatch, RefusesARootOfOneVertex) {
  const IndexedMesh triangle{{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}, {{0, 1, 2}}};
  const CleanResult clean = clean_mesh(triangle).value();
  const BakedModel model = bake(clean.mesh, clean.report.rounding_error_m, {}).value();
  ASSERT_EQ(model.header.roots.front().node.size, 1U);
  expect_attach_refused(model.header, batch_with_attach([](BitWriter& out) {
                          out.put(1, 1);
                          out.put_gamma(0);
                        }));
}

// What a peer that holds the base alone is sent names whole roots: two bits for each.
TEST(CodecBatches, NameWholeRootsInTwoBitsEach) {
  const BakedModel model = test::bake_named("terrain");
  Treelet treelet;
  std::size_t bits = 8;
  for (const BaseRoot& root : model.header.roots) {
    ASSERT_GT(root.node.size, 1U);
    treelet.push_back({root.node, model.store.split_of(root.node), false, false});
    bits += 2;
  }
  for (const SplitBits& split : bits_of(model.header, model.store, treelet))
    bits += split.record + split.left_box + split.right_box;
  BitWriter counts;
  for (int i = 0; i < 2; ++i) counts.put_gamma(treelet.size());
  const auto batches = encode_batches(model.header, model.store, treelet, BoxPolicy::kCutNodes);
  ASSERT_EQ(batches.size(), 1U);
  EXPECT_EQ(batches[0].size(), (bits + counts.bit_count() + 7) / 8);
  const Result<SplitBatch> decoded = decode_batch(model.header, batches[0]);
  ASSERT_TRUE(decoded.is_ok()) << decoded.status().message();
  for (std::size_t i = 0; i < treelet.size(); ++i)
    EXPECT_EQ(decoded.value().splits[i].node, treelet[i].node);
}

TEST(DecodeBatch, RefusesCountsBeyondItsBytes) {
  const BakedModel model = test::bake_named("sphere");
  BitWriter out;
  out.put(0, 8);
  out.put_gamma(0x7fffffffU);
  out.put_gamma(0x7fffffffU);
  const Result<SplitBatch> batch = decode_batch(model.header, std::move(out).finish());
  ASSERT_FALSE(batch.is_ok());
  EXPECT_NE(batch.status().message().find("counts"), std::string::npos) << batch.status().message();
}

TEST(DecodeBatch, RefusesAnUnknownPolicy) {
  const BakedModel model = test::bake_named("sphere");
  const std::vector<std::uint8_t> bytes{2, 0, 0, 0};
  const Result<SplitBatch> batch = decode_batch(model.header, bytes);
  ASSERT_FALSE(batch.is_ok());
  EXPECT_NE(batch.status().message().find("flags"), std::string::npos) << batch.status().message();
}

}  // namespace
}  // namespace nearmesh
