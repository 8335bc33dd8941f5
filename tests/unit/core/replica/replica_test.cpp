// SPDX-License-Identifier: Apache-2.0
#include "core/replica/replica.hpp"

#include "brute_force.hpp"
#include "core/spm/blocks.hpp"
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

/// The lower third, along x, of the box around a model.
RegionPart lower_third(const SplitStore& store) {
  GridBox whole;
  for (const BaseRoot& root : store.roots()) whole.add(store.box(root.node));
  whole.hi[0] = whole.lo[0] + (whole.hi[0] - whole.lo[0]) / 3;
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
    EXPECT_EQ(replica.give_ups(), 0U);
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
    const RegionPart kept = lower_third(model.store);

    static_cast<void>(replica.give_up({{kept}}));
    EXPECT_EQ(replica.give_ups(), 1U);
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
  RegionPart whole = lower_third(model.store);
  whole.box.hi[0] = std::numeric_limits<std::int32_t>::max();
  static_cast<void>(replica.give_up({{whole}}));
  EXPECT_EQ(replica.give_ups(), 0U);
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

// ---- what arrives, against the boxes ------------------------------------------------------------

/// Two roots: [0, 4) in a box of 10 cells around (20, 20, 20), [4, 6) in one of 100 around (30, 20,
/// 20). Vertex 5 lies at `far` cells on x.
struct TwoRoots {
  explicit TwoRoots(std::int32_t far) {
    header.vertex_count = 6;
    header.grid.bits = 21;
    const auto box = [](std::int64_t cells) {
      BoxCode code{};
      code.fill(box_extent_code(cells));
      return code;
    };
    header.roots = {{{{0}, 4}, {{20, 20, 20}}, box(10)}, {{{4}, 2}, {{30, 20, 20}}, box(100)}};
    // The face (1, 3, 5) belongs to the split of [0, 4).
    batch.faces = {{{1}, {3}, {5}}};
    batch.splits = {{.node = {{0}, 4}, .split = {2}, .offset = {1, 0, 0}, .face_count = 1},
                    {.node = {{0}, 2}, .split = {1}, .offset = {0, 1, 0}, .face_begin = 1},
                    {.node = {{2}, 2}, .split = {3}, .offset = {0, 2, 0}, .face_begin = 1},
                    {.node = {{4}, 2}, .split = {5}, .offset = {far - 30, 0, 0}, .face_begin = 1}};
  }
  [[nodiscard]] Replica::Taken take() const {
    Replica replica(header);
    Replica::Taken taken = replica.take(batch);
    EXPECT_EQ(taken.contradicts, !taken.status.is_ok());
    EXPECT_EQ(replica.mesh().split_count(), taken.status.is_ok() ? 4U : 0U);
    return taken;
  }
  void expect_refused(const char* why) const {
    const Replica::Taken taken = take();
    EXPECT_EQ(taken.status.code(), StatusCode::kCorrupt);
    EXPECT_NE(taken.status.message().find(why), std::string::npos)
        << why << ": " << taken.status.message();
  }
  /// Of the first split's children.
  void set_boxes(std::uint8_t left, std::uint8_t right) {
    batch.splits[0].left_box.fill(left);
    batch.splits[0].right_box.fill(right);
  }
  SpmHeader header;
  SplitBatch batch;
};

TEST(Replica, TakesWhatItsBoxesHold) {
  TwoRoots model(28);
  EXPECT_TRUE(model.take().status.is_ok()) << model.take().status.message();
  model.set_boxes(box_extent_code(9), box_extent_code(9));
  EXPECT_TRUE(model.take().status.is_ok()) << model.take().status.message();
}

TEST(Replica, RefusesAVertexOutsideTheBoxOfItsNode) {
  TwoRoots model(28);
  model.batch.splits[2].offset = {0, 12, 0};
  model.expect_refused("its vertex lies outside the box of the node");
}

TEST(Replica, RefusesABoxThatReachesFartherThanThoseAboveIt) {
  TwoRoots model(28);
  model.set_boxes(box_extent_code(14), box_extent_code(9));
  model.expect_refused("the left box reaches farther");
  model.set_boxes(box_extent_code(9), box_extent_code(14));
  model.expect_refused("the right box reaches farther");
}

TEST(Replica, RefusesBoxesThatHaveNoRoomForTheirFace) {
  TwoRoots model(28);
  model.batch.splits[0].offset = {6, 0, 0};
  model.set_boxes(box_extent_code(2), box_extent_code(2));
  model.expect_refused("no face has room");
}

TEST(Replica, RefusesAFaceOfAKnownVertexOutsideABox) {
  TwoRoots model(28);
  std::swap(model.batch.splits[0], model.batch.splits[3]);  // 5 is known when the face comes
  EXPECT_TRUE(model.take().status.is_ok()) << model.take().status.message();
  model.batch.splits[0].offset = {20, 0, 0};
  model.expect_refused("a face lies outside a box that must enclose it");
}

/// The face is exact when its last corner comes, which nothing else holds against the box of its
/// slot.
TEST(Replica, RefusesAnExactFaceOutsideTheBoxOfItsSlot) {
  TwoRoots(50).expect_refused("node [0, 4): a face lies outside the box that came for it");
}

// ---- audits -------------------------------------------------------------------------------------

constexpr std::uint64_t kLiar = 7, kHonest = 8;

/// A model whose largest root has several blocks, its file, and batches of it in one of which a
/// face of a split with `turned_` is turned round.
class ReplicaAudit : public testing::Test {
 protected:
  BakedModel model_ = test::bake_mesh(test::make_mesh("terrain"), 4);
  std::unique_ptr<test::TempFile> saved_ = test::write_model(model_);
  ModelFile file_ = std::move(ModelFile::open(saved_->path())).value();
  Replica replica_{file_.header()};
  VertexId turned_;

  /// The whole model but for the lie, if any, as one batch.
  [[nodiscard]] SplitBatch told(bool is_lie) {
    SplitBatch all;
    for (const auto& bytes : all_batches(model_, kMaxBatchBytes)) {
      const SplitBatch batch = decode_sealed(model_.header, bytes).value();
      for (SplitRecord record : batch.splits) {
        const auto begin = batch.faces.begin() + record.face_begin;
        record.face_begin = static_cast<std::uint32_t>(all.faces.size());
        all.faces.insert(all.faces.end(), begin, begin + record.face_count);
        all.splits.push_back(record);
        if (is_lie && all.splits.size() > 1 && !turned_.is_valid() && record.face_count > 0) {
          turned_ = record.split;
          SplitFace& face = all.faces[record.face_begin];
          face.flipped = !face.flipped;
        }
      }
    }
    return all;
  }
  Replica::Taken audit(VertexId split, std::uint64_t sender, std::size_t spoiled = 0) {
    return audit(model_.store.node_of(split), sender, spoiled);
  }
  Replica::Taken audit(NodeSpan node, std::uint64_t sender = kHonest, std::size_t spoiled = 0) {
    Replica::Taken last;
    for (auto& piece : file_.prove(node).value()) {
      if (spoiled > 0) piece[std::min(spoiled, piece.size() - 1)] ^= 1;
      seal_batch(file_.content_hash(), piece);
      last = replica_.take(piece, sender);
    }
    return last;
  }
  [[nodiscard]] NodeSpan largest_root() const {
    const auto& roots = model_.header.roots;
    return std::max_element(roots.begin(), roots.end(),
                            [](const auto& x, const auto& y) { return x.node.size < y.node.size; })
        ->node;
  }
  void expect_forgotten(const Replica::Taken& taken, std::uint64_t liar) {
    EXPECT_TRUE(taken.contradicts);
    EXPECT_EQ(taken.liar, liar);
    EXPECT_EQ(replica_.mesh().split_count(), 0U);
    EXPECT_TRUE(liar == 0 || replica_.distrusts(liar));
  }
};

TEST_F(ReplicaAudit, OfTheTruthChangesNothing) {
  for (const auto& bytes : all_batches(model_, 300)) {
    auto sealed = bytes;
    sealed.resize(sealed.size() - kSealBytes);
    seal_batch(file_.content_hash(), sealed);
    ASSERT_TRUE(replica_.take(sealed, kHonest).status.is_ok());
  }
  const std::uint64_t before = replica_.mesh().state_hash();
  for (const VertexId u : test::all_splits(model_.store)) {
    const Replica::Taken taken = audit(u, kHonest);
    ASSERT_TRUE(taken.status.is_ok()) << taken.status.message();
    EXPECT_EQ(std::count(taken.audited.begin(), taken.audited.end(), model_.store.node_of(u)), 1);
  }
  EXPECT_EQ(replica_.mesh().state_hash(), before);
}

TEST_F(ReplicaAudit, NamesWhoLiedWhoeverProves) {
  ASSERT_TRUE(replica_.take(told(true), kLiar).status.is_ok());
  const Replica::Taken taken = audit(turned_, kHonest);
  EXPECT_NE(taken.status.message().find("split " + std::to_string(turned_.value) +
                                        " was told with hash "),
            std::string::npos)
      << taken.status.message();
  expect_forgotten(taken, kLiar);
  EXPECT_FALSE(replica_.distrusts(kHonest));
}

// A publisher that is started anew is another one: in weeks there are more than can be told apart
// at a time.
TEST_F(ReplicaAudit, NamesWhoLiedAfterManyPublishersThatAreGone) {
  SplitBatch first = told(false);
  first.splits.resize(1);
  for (std::uint64_t publisher = 100; publisher < 100 + 2 * kManyTellers; ++publisher)
    ASSERT_TRUE(replica_.take(first, publisher).status.is_ok());
  ASSERT_TRUE(replica_.take(told(true), kLiar).status.is_ok());
  expect_forgotten(audit(turned_, kHonest), kLiar);
}

// Each of whom told of something that is here.
TEST_F(ReplicaAudit, NamesNobodyWhereMoreToldThanAreToldApart) {
  const SplitBatch all = told(true);
  ASSERT_GT(all.splits.size(), kManyTellers + 2U);
  SplitBatch one = all, lie = all;
  for (std::size_t i = 0; i < all.splits.size(); ++i) {
    const bool is_lie = all.splits[i].split == turned_;
    (is_lie ? lie : one).splits.assign(1, all.splits[i]);
    if (is_lie) continue;
    ASSERT_TRUE(replica_.take(one, 100 + i).status.is_ok());
  }
  ASSERT_TRUE(replica_.take(lie, kLiar).status.is_ok());
  expect_forgotten(audit(turned_, kHonest), 0);
  // All is given up, so numbers are spare again.
  ASSERT_TRUE(replica_.take(all, kLiar).status.is_ok());
  expect_forgotten(audit(turned_, kHonest), kLiar);
}

TEST_F(ReplicaAudit, BlamesTheTellerOfASplitNotOfItsParent) {
  SplitBatch lie = told(true);
  // The liar's splits wait for the first, which the honest one tells.
  SplitBatch first = told(false);
  first.splits.resize(1);
  lie.splits.erase(lie.splits.begin());
  ASSERT_TRUE(replica_.take(lie, kLiar).status.is_ok());
  ASSERT_TRUE(replica_.take(first, kHonest).status.is_ok());
  expect_forgotten(audit(turned_, kHonest), kLiar);
}

// Who proves nothing may have told more than what is here: splits that wait for their parents, and
// half-spaces.
TEST_F(ReplicaAudit, OfWhomNothingIsProvedNothingIsLeft) {
  SplitBatch waits = told(true), first = told(false);
  first.splits.resize(1);
  waits.splits.erase(waits.splits.begin());
  const NodeSpan root = first.splits[0].node;
  waits.half_spaces = {{root, {.direction = 0, .reach = 255}},
                       {first.splits[0].left(), {.direction = 0, .reach = 255}}};
  ASSERT_TRUE(replica_.take(waits, kLiar).status.is_ok());
  ASSERT_GT(replica_.parked_splits(), 0U);
  ASSERT_FALSE(replica_.mesh().half_spaces().of(root.first).empty());
  const std::uint32_t give_ups = replica_.give_ups();
  replica_.distrust(kLiar);
  EXPECT_EQ(replica_.give_ups(), give_ups + 1);
  EXPECT_EQ(replica_.parked_splits(), 0U);
  EXPECT_TRUE(replica_.mesh().half_spaces().is_empty());
  ASSERT_TRUE(replica_.take(first, kHonest).status.is_ok());
  Replica alone(file_.header());
  ASSERT_TRUE(alone.take(first, kHonest).status.is_ok());
  EXPECT_EQ(replica_.mesh().state_hash(), alone.mesh().state_hash());
}

// Then the content has no block for what was drawn. The one around it shows that.
TEST_F(ReplicaAudit, OfANodeThatTheContentDoesNotHaveShowsTheLie) {
  const NodeSpan root = largest_root();
  std::size_t lies = 0;
  for (std::uint32_t at = root.begin() + 2; at < root.end(); at += 7) {
    SCOPED_TRACE(at);
    const VertexId split{at};
    if (split == model_.store.split_of(root)) continue;
    const NodeSpan left = root.left_of(split);
    const SplitBatch lie{
        .splits = {{.node = root, .split = split}, {.node = left, .split = {left.begin() + 1}}}};
    replica_ = Replica(file_.header());
    if (!replica_.take(lie, kLiar).status.is_ok()) continue;  // a lie without care
    ASSERT_EQ(replica_.mesh().split_count(), 2U);
    expect_forgotten(audit(left), kLiar);
    EXPECT_FALSE(replica_.distrusts(kHonest));
    ++lies;
  }
  EXPECT_GT(lies, 20U);
}

TEST_F(ReplicaAudit, ASplitThatCutsABlockIsALie) {
  const NodeSpan root = largest_root();
  const std::vector<NodeSpan> blocks = block_roots(model_.store);
  const auto block = std::find_if(blocks.begin(), blocks.end(), [&](const NodeSpan& one) {
    return one.size > 8 && one.begin() > root.begin() && one.end() < root.end();
  });
  ASSERT_NE(block, blocks.end());
  const SplitBatch lie{.splits = {{.node = root, .split = {block->begin() + 1}}}};
  ASSERT_TRUE(replica_.take(lie, kLiar).status.is_ok());
  const Replica::Taken taken = audit(*block);
  EXPECT_NE(taken.status.message().find(", which cuts that node of the content"), std::string::npos)
      << taken.status.message();
  expect_forgotten(taken, kLiar);
}

TEST_F(ReplicaAudit, RefusesAProofThatIsNotOfTheContent) {
  ASSERT_TRUE(replica_.take(told(false), kHonest).status.is_ok());
  const VertexId split = test::all_splits(model_.store).front();
  for (const std::size_t byte : {9, 13, 40, 400}) {  // the block's root, the path, the block
    SCOPED_TRACE(byte);
    replica_ = Replica(file_.header());
    ASSERT_TRUE(replica_.take(told(false), kHonest).status.is_ok());
    const Replica::Taken taken = audit(split, kLiar, byte);
    EXPECT_FALSE(taken.status.is_ok());
    expect_forgotten(taken, kLiar);
    EXPECT_FALSE(replica_.distrusts(kHonest));
  }
}

// Whoever hears of an audit may write pieces of its own between those of the proof.
TEST_F(ReplicaAudit, PiecesOfOthersAreNoneOfTheProof) {
  ASSERT_TRUE(replica_.take(told(false), kHonest).status.is_ok());
  const auto whole = file_.prove(model_.header.roots.front().node).value();
  ASSERT_EQ(whole.size(), 1U);
  // A byte, then two words: where the piece begins, and how much there is.
  constexpr std::size_t kHead = 9, kPieces = 3;
  const std::size_t size = whole[0].size() - kHead;
  std::vector<std::vector<std::uint8_t>> pieces;
  for (std::size_t i = 0; i < kPieces; ++i) {
    const std::size_t from = i * size / kPieces, to = (i + 1) * size / kPieces;
    std::vector<std::uint8_t>& piece =
        pieces.emplace_back(whole[0].begin(), whole[0].begin() + kHead);
    for (std::size_t k = 0; k < 4; ++k) piece[1 + k] = static_cast<std::uint8_t>(from >> 8 * k);
    piece.insert(piece.end(), whole[0].begin() + static_cast<std::ptrdiff_t>(kHead + from),
                 whole[0].begin() + static_cast<std::ptrdiff_t>(kHead + to));
  }
  Replica::Taken taken;
  for (auto& piece : pieces) {
    auto other = piece;
    other.back() ^= 1;
    seal_batch(file_.content_hash(), piece);
    seal_batch(file_.content_hash(), other);
    taken = replica_.take(piece, kHonest);
    ASSERT_TRUE(taken.status.is_ok()) << taken.status.message();
    if (taken.audited.empty()) {
      EXPECT_TRUE(replica_.take(other, kLiar).status.is_ok());
    }
  }
  EXPECT_FALSE(taken.audited.empty());
  EXPECT_FALSE(replica_.distrusts(kHonest));
  // Of more senders than are told apart those that are left out begin anew.
  for (std::uint64_t sender = 100; sender < 200; ++sender)
    EXPECT_TRUE(replica_.take(pieces.front(), sender).status.is_ok());
  EXPECT_FALSE(
      audit(model_.store.split_of(model_.header.roots.front().node), kHonest).audited.empty());
}

TEST_F(ReplicaAudit, APieceThatIsMissingMakesTheWholeCountForNothing) {
  ASSERT_TRUE(replica_.take(told(false), kHonest).status.is_ok());
  auto pieces = file_.prove(model_.header.roots.front().node).value();
  for (std::size_t i = 1; i < pieces.size(); ++i) {
    seal_batch(file_.content_hash(), pieces[i]);
    const Replica::Taken taken = replica_.take(pieces[i], kHonest);
    EXPECT_TRUE(taken.status.is_ok());
    EXPECT_TRUE(taken.audited.empty());
  }
}

}  // namespace
}  // namespace nearmesh
