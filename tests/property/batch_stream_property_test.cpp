// SPDX-License-Identifier: Apache-2.0
// A peer's view of a stream: whatever prefix of it has come, whatever is lost, no certified answer
// is wrong.
#include "half_spaces.hpp"
#include "nearmesh/core/geometry/detail/box_overlap.hpp"
#include "random_policies.hpp"
#include "rounds.hpp"

namespace nearmesh {
namespace {

using test::Body;

struct Sent {
  bool to_a;
  std::vector<std::uint8_t> bytes;
};

class Stream {
 public:
  Stream(const BakedModel& a, const BakedModel& b) : a_(a), b_(b), full_a_(a), full_b_(b) {}

  /// Small batches of all that certifies the pose, those for a and for b in turn.
  std::vector<Sent> batches(const PosedPair& posed) const {
    LocalModel a(a_.store, a_.header.grid), b(b_.store, b_.header.grid);
    EXPECT_TRUE(certify(a, posed.a, test::no_require, b, posed.b, test::no_require, {}).is_ok());
    const auto for_a = encode_batches(a_.header, a_.store, active_treelet(a.mesh),
                                      BoxPolicy::kCutNodes, kBatchBytes);
    const auto for_b = encode_batches(b_.header, b_.store, active_treelet(b.mesh),
                                      BoxPolicy::kCutNodes, kBatchBytes);
    std::vector<Sent> sent;
    for (std::size_t i = 0; i < std::max(for_a.size(), for_b.size()); ++i) {
      if (i < for_a.size()) sent.push_back({true, for_a[i]});
      if (i < for_b.size()) sent.push_back({false, for_b[i]});
    }
    return sent;
  }
  Answer full(const PosedPair& posed) const {
    return query(full_a_.tree.view(), posed.a, full_b_.tree.view(), posed.b);
  }

  static constexpr std::size_t kBatchBytes = 200;

 private:
  const BakedModel &a_, &b_;
  const test::FullModel full_a_, full_b_;
};

Answer ask(const Body& a, const Body& b, const PosedPair& posed) {
  return query(a.view(), posed.a, b.view(), posed.b, {.clearance = Clearance::kNone});
}

void expect_never_wrong(const Answer& answer, const Answer& full) {
  EXPECT_EQ(test::fault_of(answer, full), "");
}

using Names = std::pair<const char*, const char*>;
class BatchStream : public ::testing::TestWithParam<Names> {
 protected:
  BakedModel a_ = test::bake_named(GetParam().first), b_ = test::bake_named(GetParam().second);
  Stream stream_{a_, b_};
};
INSTANTIATE_TEST_SUITE_P(Models, BatchStream,
                         ::testing::Values(Names{"terrain", "aircraft"}, Names{"sphere", "sphere"},
                                           Names{"soup", "components"},
                                           Names{"degenerate", "aircraft"}),
                         [](const auto& names) {
                           return std::string(names.param.first) + "_" + names.param.second;
                         });

TEST_P(BatchStream, EveryPrefixIsNeverWrongAndTheWholeIsCertified) {
  for (std::uint64_t seed = 0; seed < 40; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    Random random(seed);
    const PosedPair posed = test::near_pose(random, a_, b_);
    const Answer full = stream_.full(posed);
    Body a(a_.header), b(b_.header);
    expect_never_wrong(ask(a, b, posed), full);
    for (const Sent& sent : stream_.batches(posed)) {
      (sent.to_a ? a : b).apply(sent.bytes);
      expect_never_wrong(ask(a, b, posed), full);
    }
    const Answer last = ask(a, b, posed);
    EXPECT_TRUE(is_certified(last.status));
    expect_never_wrong(last, full);
  }
}

TEST_P(BatchStream, AnyOrderIsNeverWrongAndTheWholeIsCertified) {
  for (std::uint64_t seed = 0; seed < 30; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    Random random(1000 + seed);
    const PosedPair posed = test::near_pose(random, a_, b_);
    const Answer full = stream_.full(posed);
    std::vector<Sent> batches = stream_.batches(posed);
    test::shuffle(batches, random);
    Body a(a_.header), b(b_.header);
    for (const Sent& sent : batches) {
      (sent.to_a ? a : b).apply(sent.bytes);
      expect_never_wrong(ask(a, b, posed), full);
    }
    EXPECT_TRUE(is_certified(ask(a, b, posed).status));
  }
}

TEST_P(BatchStream, AnySingleLossIsNeverWrongAndIsHealedByTheBatchAlone) {
  for (std::uint64_t seed = 0; seed < 8; ++seed) {
    Random random(2000 + seed);
    const PosedPair posed = test::near_pose(random, a_, b_);
    const Answer full = stream_.full(posed);
    const std::vector<Sent> batches = stream_.batches(posed);
    for (std::size_t lost = 0; lost < batches.size(); ++lost) {
      SCOPED_TRACE("seed " + std::to_string(seed) + ", lost " + std::to_string(lost));
      Body a(a_.header), b(b_.header);
      for (std::size_t i = 0; i < batches.size(); ++i)
        if (i != lost) (batches[i].to_a ? a : b).apply(batches[i].bytes);
      expect_never_wrong(ask(a, b, posed), full);
      (batches[lost].to_a ? a : b).apply(batches[lost].bytes);
      EXPECT_TRUE(is_certified(ask(a, b, posed).status));
      ASSERT_FALSE(HasFailure());
    }
  }
}

// Half-spaces of whatever nodes, in batches that come in any order, some twice and some not at all.
TEST_P(BatchStream, HalfSpacesAreNeverWrongWhateverIsLost) {
  const test::TrueHalfSpaces truth_a(a_.store), truth_b(b_.store);
  std::size_t told = 0, nearer = 0, certified = 0, bare_certified = 0;
  for (std::uint64_t seed = 0; seed < static_cast<std::uint64_t>(test::rounds(150)); ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    Random random(9000 + seed);
    const PosedPair posed = test::near_pose(random, a_, b_);
    const Answer full = stream_.full(posed);
    Body a(a_.header), b(b_.header), bare_a(a_.header), bare_b(b_.header);
    const auto target_of = [&](const BakedModel& model) {
      return &model == &a_ ? test::random_target(posed.a, posed.b, b_.store, random)
                           : test::random_target(posed.b, posed.a, a_.store, random);
    };
    const auto send = [&](const BakedModel& model, const test::TrueHalfSpaces& truth, Body& body,
                          Body& bare) {
      LocalModel local(model.store, model.header.grid);
      test::refine_at_random(local, random);
      const Treelet treelet = active_treelet(local.mesh);
      const std::uint32_t most = 40 + random.below(400);
      auto batches = encode_batches(
          model.header, model.store, treelet, BoxPolicy::kCutNodes, most,
          test::random_half_spaces(model.store, treelet, truth, random, target_of(model)));
      test::shuffle(batches, random);
      for (std::size_t i = 0; i < batches.size(); ++i) {
        if (random.below(6) == 0) continue;
        body.apply(batches[i]);
        if (random.below(6) == 0)
          body.apply(batches[random.below(static_cast<std::uint32_t>(i) + 1)]);
        // The same without.
        SplitBatch batch = decode_batch(model.header, batches[i]).value();
        told += batch.half_spaces.size();
        batch.half_spaces.clear();
        bare.tree.update(bare.replica.apply_batch(batch).delta);
        if (random.below(8) == 0) expect_never_wrong(ask(a, b, posed), full);
      }
    };
    for (int round = 0; round < 3; ++round) {
      send(a_, truth_a, a, bare_a);
      send(b_, truth_b, b, bare_b);
      const Answer answer = query(a.view(), posed.a, b.view(), posed.b);
      expect_never_wrong(answer, full);
      const Answer bare = ask(bare_a, bare_b, posed);
      const std::size_t missing = answer.missing_a.size() + answer.missing_b.size(),
                        bare_missing = bare.missing_a.size() + bare.missing_b.size();
      nearer += missing < bare_missing ? 1 : 0;
      Random alike = random;
      bare_a.evict_some(alike);
      bare_b.evict_some(alike);
      a.evict_some(random);
      b.evict_some(random);
      expect_never_wrong(ask(a, b, posed), full);
    }
    // What was lost comes after all. (That certifies, but for nodes that are split further and
    // whose boxes reach farther.)
    for (const Sent& sent : stream_.batches(posed)) {
      (sent.to_a ? a : b).apply(sent.bytes);
      (sent.to_a ? bare_a : bare_b).apply(sent.bytes);
    }
    const Answer last = ask(a, b, posed);
    expect_never_wrong(last, full);
    certified += is_certified(last.status) ? 1 : 0;
    bare_certified += is_certified(ask(bare_a, bare_b, posed).status) ? 1 : 0;
  }
  EXPECT_GT(told, 100U);
  EXPECT_GT(nearer, 0U);
  EXPECT_GE(certified, bare_certified);
}

// The real exchange: the peer names what its answer lacks, the publisher collects below those
// nodes.
TEST_P(BatchStream, AskingForWhatIsMissingEndsCertified) {
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    Random random(4000 + seed);
    const PosedPair posed = test::near_pose(random, a_, b_);
    const Answer full = stream_.full(posed);
    Body a(a_.header), b(b_.header);
    const auto serve = [&](const BakedModel& model, Body& body,
                           const std::vector<NodeSpan>& missing) {
      if (missing.empty()) return;
      const RegionRequest request =
          test::request_missing(body.replica.store(), missing, 1 + random.below(40));
      ASSERT_TRUE(check_request(model.store, request).is_ok());
      const Result<Demand> demand = collect(model.store, request, nullptr);
      ASSERT_TRUE(demand.is_ok());
      ASSERT_FALSE(demand.value().treelet.empty());
      for (const auto& bytes : encode_batches(model.header, model.store, demand.value().treelet,
                                              BoxPolicy::kCutNodes, Stream::kBatchBytes))
        if (random.below(4) > 0) body.apply(bytes);  // a quarter is lost
    };
    for (int round = 0;; ++round) {
      ASSERT_LT(round, 4000);
      const Answer answer = ask(a, b, posed);
      expect_never_wrong(answer, full);
      if (is_certified(answer.status)) break;
      serve(a_, a, answer.missing_a);
      serve(b_, b, answer.missing_b);
    }
  }
}

// Requests that overlap bring the same splits with other boxes, and what is lost leaves nodes with
// an ancestor's. Which batch comes first must not show in the answer, not even in what it lacks or
// in its clearance.
TEST_P(BatchStream, OverlappingBatchesInAnyOrderGiveTheSameAnswers) {
  std::uint64_t lacking = 0;
  for (std::uint64_t seed = 0; seed < 10; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    Random random(6000 + seed);
    std::vector<Sent> batches;
    for (int i = 0; i < 12; ++i) {
      const bool to_a = i % 2 == 0;
      const BakedModel& model = to_a ? a_ : b_;
      const GridBox region = test::random_region(model.store, random);
      const std::uint32_t splits = 1 + random.below(300);
      for (auto& bytes : test::serve(model, test::request_region(model.store, region, splits), 100))
        if (random.below(3) > 0) batches.push_back({to_a, std::move(bytes)});  // the rest is lost
    }
    std::vector<std::unique_ptr<Body>> as, bs;
    for (int order = 0; order < 3; ++order) {
      as.push_back(std::make_unique<Body>(a_.header));
      bs.push_back(std::make_unique<Body>(b_.header));
      for (const Sent& sent : batches) {
        Body& body = *(sent.to_a ? as : bs).back();
        body.apply(sent.bytes);
      }
      test::shuffle(batches, random);
    }
    for (int pose = 0; pose < 12; ++pose) {
      const PosedPair posed = test::near_pose(random, a_, b_);
      const Answer first = query(as[0]->view(), posed.a, bs[0]->view(), posed.b);
      lacking += first.missing_a.size() + first.missing_b.size();
      for (std::size_t i = 1; i < as.size(); ++i)
        EXPECT_EQ(digest(query(as[i]->view(), posed.a, bs[i]->view(), posed.b)), digest(first));
    }
  }
  EXPECT_GT(lacking, 0U);
}

// Demand by the other body's posed boxes, the way a subscriber predicts. One request certifies
// nearly always; not in every pose, since quantised boxes do not nest: a child's may meet the
// region where its parent's does not.
TEST_P(BatchStream, DemandOfTheOtherBodysBoxesCertifiesInTwoRequests) {
  const auto faces_b = test::all_faces(b_.store);
  for (std::uint64_t seed = 0; seed < 30; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    Random random(5000 + seed);
    const PosedPair posed = test::near_pose(random, a_, b_);
    LocalModel b(b_.store, b_.header.grid);
    RefineDelta delta;
    for (const VertexId u : test::all_splits(b_.store)) ASSERT_TRUE(b.mesh.split(u, delta));
    b.tree.update(delta);
    RegionRequest request{.max_splits = kMaxRequestSplits};
    for (const BaseRoot& root : a_.header.roots)
      if (root.node.size > 1) request.attach.push_back(root.node);
    const RelativeFrame b_in_a = make_relative_frame(posed.a, posed.b);
    for (const test::KeyedFace& keyed : faces_b) {
      std::array<GridPoint, 3> corners;
      for (std::size_t k = 0; k < 3; ++k) corners[k] = b_.store.position(keyed.face.corners()[k]);
      GridBox box;
      bool near = true;
      for (const auto& corner : to_a_units(b_in_a, corners)) {
        GridPoint lo, hi;
        for (int k = 0; k < 3; ++k) {
          const double x = corner[static_cast<std::size_t>(k)];
          near = near && std::abs(x) < 1e9;
          lo[k] = static_cast<std::int32_t>(std::floor(std::clamp(x, -1e9, 1e9)) - 4);
          hi[k] = static_cast<std::int32_t>(std::ceil(std::clamp(x, -1e9, 1e9)) + 4);
        }
        box.add(lo);
        box.add(hi);
      }
      if (near) request.region.push_back(box);
    }
    Body a(a_.header);
    AttachRule rule = AttachRule::kInRegion;
    Answer answer;
    for (int round = 0; round < 2 && !request.attach.empty(); ++round) {
      const Result<Demand> demand = collect(a_.store, request, nullptr, rule);
      ASSERT_TRUE(demand.is_ok());
      for (const auto& bytes :
           encode_batches(a_.header, a_.store, demand.value().treelet, BoxPolicy::kCutNodes))
        a.apply(bytes);
      answer = query(a.view(), posed.a, b.view(), posed.b);
      request.attach = answer.missing_a;
      rule = AttachRule::kAlways;
    }
    EXPECT_TRUE(is_certified(answer.status));
    EXPECT_EQ(answer.pairs, stream_.full(posed).pairs);
  }
}

}  // namespace
}  // namespace nearmesh
