// SPDX-License-Identifier: Apache-2.0
#include "core/certificate/certificate.hpp"

#include <cmath>
#include <numbers>
#include <set>

#include "brute_force.hpp"
#include "core/replica/held_nodes.hpp"
#include "core/replica/replica.hpp"
#include "core/spm/packed_certificate.hpp"
#include "fault_of.hpp"
#include "held_whole.hpp"
#include "model_pairs.hpp"

namespace nearmesh {
namespace {

constexpr std::uint64_t kPeer = 7;

Motion random_motion(Random& random, const Pose& pose) {
  Motion motion{.pose = pose};
  for (double& x : motion.linear_velocity_mps) x = random.between(-1, 1);
  for (double& x : motion.angular_velocity_radps) x = random.between(-0.2, 0.2);
  return motion;
}

/// A server and a peer of two models.
struct Desk {
  Desk(const BakedModel& baked_a, const BakedModel& baked_b)
      : path_a(test::write_model(baked_a)),
        path_b(test::write_model(baked_b)),
        file_a(ModelFile::open(path_a->path()).value()),
        file_b(ModelFile::open(path_b->path()).value()),
        a(file_a.header()),
        b(file_b.header()) {}

  CertificateRequest ask(const Motion& motion_a, const Motion& motion_b, float horizon_s) const {
    CertificateRequest request;
    request.horizon_s = horizon_s;
    request.models = {{file_a.content_hash(), a.mesh().state_hash(), {}},
                      {file_b.content_hash(), b.mesh().state_hash(), {}}};
    request.pairs = {relative(motion_a, motion_b)};
    request.pairs[0].b = 1;
    if (file_a.content_hash() == file_b.content_hash()) {
      request.models.pop_back();
      request.pairs[0].b = 0;
    }
    return request;
  }
  CertificateBeginner beginner(const CertificateRequest& request) {
    EXPECT_TRUE(check_request(request).is_ok());
    return {kPeer, request, mirrors, file_of()};
  }
  /// Counts its calls.
  CertificateBeginner::FileOf file_of() {
    return [this](const ContentHash& content) {
      ++looks;
      return content == file_a.content_hash()   ? test::lent(file_a)
             : content == file_b.content_hash() ? test::lent(file_b)
                                                : nullptr;
    };
  }
  std::size_t looks = 0;
  BegunCertificate begin(const CertificateRequest& request) {
    EXPECT_TRUE(check_request(request).is_ok());
    return begin_certificate(kPeer, request, mirrors, file_of());
  }
  /// All that is sent, taken in. Out: how many batches.
  std::size_t answer(CertificateMaker& maker, std::uint64_t round_tests = kLookTests) {
    std::size_t batches = 0;
    SampleRoom room;
    while (!maker.is_done()) {
      ++rounds;
      if (!maker.is_sending()) room = {};
      Result<CertificateMaker::Part> part = maker.next(round_tests);
      EXPECT_TRUE(part.is_ok()) << part.status().message();
      if (!part.is_ok()) break;
      for (std::vector<std::uint8_t>& batch : part.value().batches) {
        seal_batch(part.value().content, batch);
        const bool is_a = part.value().content == file_a.content_hash();
        Replica& replica = is_a ? a : b;
        const SplitBatch sent = decode_sealed(replica.header(), batch).value();
        splits += sent.splits.size();
        for (const NodeHalfSpace& half_space : sent.half_spaces) told.push_back({is_a, half_space});
        EXPECT_TRUE(replica.take(batch).status.is_ok());
        ++batches;
        bytes += batch.size();
        datagrams += batch.size() > room.left() ? 1 : 0;
        room.add(batch.size());
      }
    }
    return batches;
  }

  /// What the peer holds of b's model.
  Replica& other() { return file_a.content_hash() == file_b.content_hash() ? a : b; }

  struct Told {
    bool of_a;
    NodeHalfSpace half_space;
  };
  std::unique_ptr<test::TempFile> path_a, path_b;
  ModelFile file_a, file_b;
  Replica a, b;
  std::vector<Told> told;  ///< all that came
  std::size_t splits = 0, rounds = 0, bytes = 0, datagrams = 0;
  Mirrors mirrors;
};

class Certificate : public test::ModelPair {
 protected:
  std::pair<Motion, Motion> near_motions(Random& random) const {
    const test::PairOfPoses poses =
        test::near_poses(random, a_, test::radius_m(a_), b_, test::radius_m(b_));
    return {random_motion(random, poses.a), random_motion(random, poses.b)};
  }
};
INSTANTIATE_TEST_SUITE_P(Models, Certificate, test::model_pairs(), test::name_of_pair);

TEST_P(Certificate, OneRoundTripCertifiesNowAndAhead) {
  const test::FullModel full_a(a_), full_b(b_);
  Random random(1);
  constexpr float kHorizon_s = 0.5;
  int asked = 0, certified = 0;
  for (int i = 0; i < 12; ++i) {
    Desk desk(a_, b_);
    const auto [motion_a, motion_b] = near_motions(random);
    BegunCertificate begun = desk.begin(desk.ask(motion_a, motion_b, kHorizon_s));
    ASSERT_TRUE(begun.maker) << begun.why_not;
    desk.answer(*begun.maker);
    for (int step = 0; step <= 10; ++step) {
      const double time_s = 0.1 * double{kHorizon_s} * step;
      const Result<PosedPair> posed = pose_pair(a_.header.grid, pose_at(motion_a, time_s), "a",
                                                b_.header.grid, pose_at(motion_b, time_s), "b");
      ASSERT_TRUE(posed.is_ok());
      const Answer answer =
          query(desk.a.view(), posed.value().a, desk.other().view(), posed.value().b);
      if (step == 0) {
        EXPECT_EQ(desk.a.mesh().state_hash(),
                  desk.mirrors.find(kPeer, test::lent(desk.file_a), desk.a.mesh().state_hash())
                      .mirror->state());
        EXPECT_TRUE(is_certified(answer.status))
            << "pose " << i << ", " << to_string(answer.status) << ", missing "
            << answer.missing_a.size() << " " << answer.missing_b.size();
      }
      const Answer full = query(full_a.tree.view(), posed.value().a, full_b.tree.view(),
                                posed.value().b, {.clearance = Clearance::kNone});
      EXPECT_EQ(test::fault_of(answer, full), "") << i << ", " << step;
      ++asked;
      certified += is_certified(answer.status) ? 1 : 0;
    }
  }
  // Both turn, so the way of the one as seen from the other is bent; the request says it straight.
  EXPECT_GE(certified, asked * 9 / 10) << certified << " of " << asked;
}

// A round that may make few tests does not come to an end at once; more of them do.
TEST_P(Certificate, ShortRoundsCertifyToo) {
  Random random(9);
  std::size_t rounds = 0, short_rounds = 0;
  for (int i = 0; i < 12; ++i) {
    const auto [motion_a, motion_b] = near_motions(random);
    const PosedPair posed =
        pose_pair(a_.header.grid, motion_a.pose, "a", b_.header.grid, motion_b.pose, "b").value();
    Desk desk(a_, b_), short_desk(a_, b_);
    for (auto [its, tests] :
         {std::pair{&desk, kLookTests}, std::pair{&short_desk, std::uint64_t{20}}}) {
      BegunCertificate begun = its->begin(its->ask(motion_a, motion_b, 0));
      ASSERT_TRUE(begun.maker) << begun.why_not;
      its->answer(*begun.maker, tests);
      const Answer answer = query(its->a.view(), posed.a, its->other().view(), posed.b);
      EXPECT_TRUE(is_certified(answer.status)) << i << ", " << tests << " tests";
    }
    rounds += desk.rounds;
    short_rounds += short_desk.rounds;
  }
  EXPECT_GT(short_rounds, rounds);
}

// Where the sender errs the receiver's answers do: every face of the full mesh is held against
// every claim.
TEST_P(Certificate, HalfSpacesThatAreSentHoldEveryFace) {
  const test::TrueBoxes truth_a(a_.store), truth_b(b_.store);
  Random random(21);
  std::size_t told = 0, splits = 0, bare_splits = 0;
  for (int i = 0; i < 40; ++i) {
    Desk desk(a_, b_);
    for (int step = 0; step < 3; ++step) {
      const auto [motion_a, motion_b] = near_motions(random);
      BegunCertificate begun =
          desk.begin(desk.ask(motion_a, motion_b, 0.1F * static_cast<float>(step)));
      ASSERT_TRUE(begun.maker) << begun.why_not;
      desk.answer(*begun.maker);
      if (step > 0) continue;
      LocalModel bare_a(a_.store, a_.header.grid), bare_b(b_.store, b_.header.grid);
      const PosedPair posed =
          pose_pair(a_.header.grid, motion_a.pose, "a", b_.header.grid, motion_b.pose, "b").value();
      ASSERT_TRUE(certify(bare_a, posed.a, test::no_require, bare_b, posed.b, test::no_require, {})
                      .is_ok());
      splits += desk.splits;
      bare_splits += bare_a.mesh.split_count() + bare_b.mesh.split_count();
    }
    for (const Desk::Told& its : desk.told) {
      const auto& [node, half_space] = its.half_space;
      const BakedModel& model = its.of_a ? a_ : b_;
      const GridPoint from = model.store.position(node.first);
      (its.of_a ? truth_a : truth_b)
          .for_each_corner(node, [&, half = half_space](const GridPoint& p) {
            EXPECT_TRUE(contains(half, from, p));
          });
    }
    told += desk.told.size();
  }
  EXPECT_GT(told, 0U);
  if (std::string(GetParam().first) == "terrain") {
    EXPECT_LT(10 * splits, 9 * bare_splits) << "they spare splits";
  }
}

// A claim that did not last is not made again: the node is split, so that requests end.
TEST_P(Certificate, NodesThatHaveHalfSpacesAreSplitNext) {
  Random random(22);
  Desk desk(a_, b_);
  std::set<std::pair<bool, NodeSpan>> known;
  std::size_t again = 0;
  for (int i = 0; i < 12; ++i) {
    const auto [motion_a, motion_b] = near_motions(random);
    BegunCertificate begun = desk.begin(desk.ask(motion_a, motion_b, 0.1F));
    ASSERT_TRUE(begun.maker) << begun.why_not;
    desk.told.clear();
    desk.answer(*begun.maker);
    std::set<std::pair<bool, NodeSpan>> now;
    for (const Desk::Told& told : desk.told) now.insert({told.of_a, told.half_space.node});
    for (const auto& node : now) again += known.insert(node).second ? 0 : 1;
  }
  EXPECT_GT(known.size(), 0U);
  EXPECT_EQ(again, 0U);
}

TEST_P(Certificate, NoMoreIsTakenToBeHeldThanAMirrorMayCost) {
  Desk desk(a_, b_);
  Random random(8);
  const auto [motion_a, motion_b] = near_motions(random);
  BegunCertificate begun = desk.begin(desk.ask(motion_a, motion_b, 0));
  ASSERT_TRUE(begun.maker) << begun.why_not;
  desk.answer(*begun.maker);
  const std::size_t splits = desk.a.mesh().split_count();
  if (splits == 0) return;
  const std::vector<std::uint8_t> held = held_nodes(desk.a).bits;
  EXPECT_EQ(make_mirror(test::lent(desk.file_a), held, splits - 1).status().code(),
            StatusCode::kUnsupported);
  const auto mirror = make_mirror(test::lent(desk.file_a), held, splits);
  ASSERT_TRUE(mirror.is_ok()) << mirror.status().message();
  EXPECT_EQ(mirror.value()->state(), desk.a.mesh().state_hash());
}

TEST_P(Certificate, WhatIsHeldIsNotSentAgain) {
  Desk desk(a_, b_);
  Random random(2);
  const auto [motion_a, motion_b] = near_motions(random);
  for (int round = 0; round < 2; ++round) {
    BegunCertificate begun = desk.begin(desk.ask(motion_a, motion_b, 0.1F));
    ASSERT_TRUE(begun.maker) << begun.why_not;
    const std::size_t batches = desk.answer(*begun.maker);
    if (round == 1) {
      EXPECT_EQ(batches, 0U);
    }
  }
}

TEST_P(Certificate, StateThatIsNotKnownIsToldOnce) {
  Desk desk(a_, b_);
  Random random(3);
  Motion motion_a, motion_b;
  BegunCertificate begun;
  std::size_t batches = 0;
  for (int i = 0; i < 100 && batches == 0; ++i) {
    std::tie(motion_a, motion_b) = near_motions(random);
    begun = desk.begin(desk.ask(motion_a, motion_b, 0));
    ASSERT_TRUE(begun.maker);
    batches = desk.answer(*begun.maker);
  }
  ASSERT_GT(batches, 0U);
  desk.mirrors.forget(kPeer);

  CertificateRequest request = desk.ask(motion_a, motion_b, 0);
  for (int i = 0; i < 3; ++i) {
    begun = desk.begin(request);
    if (begun.maker) break;
    ASSERT_FALSE(begun.wants_regions) << begun.why_not;
    for (CertificateRequest::Model& model : request.models)
      if (model.content == begun.content)
        model.held = held_nodes(model.content == desk.file_a.content_hash() ? desk.a : desk.b).bits;
  }
  ASSERT_TRUE(begun.maker) << begun.why_not;
  EXPECT_EQ(desk.answer(*begun.maker), 0U);
  EXPECT_TRUE(desk.begin(desk.ask(motion_a, motion_b, 0)).maker) << "it is known now";
}

// Mirrors that sleep are as they were when they wake, half-spaces included; and they take hardly
// any memory meanwhile. They wake in parts, since that takes as long as a peer's word does.
TEST_P(Certificate, MirrorsThatSleepWakeAsTheyWere) {
  Desk desk(a_, b_);
  Random random(10);
  Motion motion_a, motion_b;
  for (int i = 0; i < 4; ++i) {
    std::tie(motion_a, motion_b) = near_motions(random);
    BegunCertificate begun = desk.begin(desk.ask(motion_a, motion_b, 0.1F));
    ASSERT_TRUE(begun.maker) << begun.why_not;
    desk.answer(*begun.maker);
  }
  ASSERT_NE(desk.mirrors.find(kPeer, test::lent(desk.file_a), desk.a.mesh().state_hash()).mirror,
            nullptr);
  // Others come: what was longest without use falls asleep.
  const std::size_t others = 2 * Mirrors::kMaxAwakeSplits / Mirrors::kSplitsAMirror;
  for (std::uint64_t peer = 100; peer < 100 + others; ++peer)
    ASSERT_NE(
        desk.mirrors.find(peer, test::lent(desk.file_a), Mirror(test::lent(desk.file_a)).state())
            .mirror,
        nullptr);
  EXPECT_LE(desk.mirrors.awake_count(), Mirrors::kMaxAwakeSplits / Mirrors::kSplitsAMirror + 1);
  EXPECT_TRUE(desk.mirrors.is_asleep(kPeer, desk.file_a.content_hash()));
  const std::size_t bytes = desk.mirrors.asleep_bytes();
  EXPECT_GT(bytes, 0U);
  EXPECT_LT(bytes, 1024 * others);
  CertificateBeginner beginner = desk.beginner(desk.ask(motion_a, motion_b, 0.1F));
  std::optional<BegunCertificate> begun;
  constexpr std::size_t kNodesAtATime = 16;
  std::size_t parts = 0;
  for (; !begun; ++parts) {
    const std::size_t before = beginner.told_nodes();
    begun = beginner.next(kNodesAtATime);
    ASSERT_LE(beginner.told_nodes(), before + kNodesAtATime);
  }
  const std::size_t splits =
      desk.a.mesh().split_count() + (&desk.other() == &desk.a ? 0 : desk.b.mesh().split_count());
  EXPECT_GE(beginner.told_nodes(), splits);
  EXPECT_GT(parts, splits / kNodesAtATime);
  ASSERT_TRUE(begun->maker) << "it is known: " << begun->why_not;
  const std::shared_ptr<Mirror> again =
      desk.mirrors.find(kPeer, test::lent(desk.file_a), desk.a.mesh().state_hash()).mirror;
  ASSERT_NE(again, nullptr);
  const HeldNodes was = held_nodes(desk.a), is = held_nodes(again->model().mesh);
  EXPECT_EQ(held_batch(desk.file_a.store(), test::no_require, was.bits).value().splits.size(),
            held_batch(desk.file_a.store(), test::no_require, is.bits).value().splits.size());
  EXPECT_EQ(desk.answer(*begun->maker), 0U) << "it holds what it did";
}

// Eight half-spaces take as long as two splits.
TEST_P(Certificate, NodesThatHalfSpacesAreToldOfCountAsSplits) {
  Desk desk(a_, b_);
  Random random(11);
  std::size_t told_of = 0;
  for (int i = 0; i < 20 && told_of == 0; ++i) {
    const auto [motion_a, motion_b] = near_motions(random);
    BegunCertificate begun = desk.begin(desk.ask(motion_a, motion_b, 0));
    ASSERT_TRUE(begun.maker) << begun.why_not;
    desk.answer(*begun.maker);
    std::set<NodeSpan> nodes;
    for (const Desk::Told& told : desk.told)
      if (told.of_a && desk.a.mesh().is_current(told.half_space.node))
        nodes.insert(told.half_space.node);
    told_of = nodes.size();
  }
  if (told_of == 0) return;  // models whose nodes cannot be kept clear
  MirrorMaker maker(test::lent(desk.file_a), held_nodes(desk.a).bits);
  while (maker.next(1).value() == nullptr) {
  }
  EXPECT_EQ(maker.told_nodes(), desk.a.mesh().split_count() + told_of);
}

TEST(CertificateRequests, MirrorsAreMadeInParts) {
  const BakedModel terrain = test::bake_named("terrain"), aircraft = test::bake_named("aircraft");
  Desk desk(terrain, aircraft);
  CertificateRequest request = desk.ask({}, {}, 0);
  std::size_t splits = 0;
  for (const auto& [model, file] :
       {std::pair(&request.models[0], &desk.file_a), {&request.models[1], &desk.file_b}}) {
    model->held = test::held_whole(file->header());
    model->state = make_mirror(test::lent(*file), model->held).value()->state();
    splits += file->header().split_count();
  }
  constexpr std::size_t kNodesAtATime = 64;
  CertificateBeginner beginner = desk.beginner(request);
  std::optional<BegunCertificate> begun;
  std::size_t parts = 0;
  for (; !begun; ++parts) {
    const std::size_t before = beginner.told_nodes();
    begun = beginner.next(kNodesAtATime);
    ASSERT_LE(beginner.told_nodes(), before + kNodesAtATime);
  }
  EXPECT_TRUE(begun->maker) << begun->why_not;
  EXPECT_EQ(beginner.told_nodes(), splits);
  EXPECT_EQ(parts, splits / kNodesAtATime + 1);
  EXPECT_NE(desk.mirrors.find(kPeer, test::lent(desk.file_a), request.models[0].state).mirror,
            nullptr);
  EXPECT_NE(desk.mirrors.find(kPeer, test::lent(desk.file_b), request.models[1].state).mirror,
            nullptr);
}

// A tile that has to be opened takes as long as a turn: others are served between two of them.
TEST(CertificateRequests, OneFileIsLookedForATurn) {
  const BakedModel terrain = test::bake_named("terrain"), aircraft = test::bake_named("aircraft");
  Desk desk(terrain, aircraft);
  const CertificateRequest known = desk.ask({}, {}, 0);
  const ContentHash elsewhere{0, 7};
  const auto with = [&](std::initializer_list<ContentHash> contents) {
    CertificateRequest request = known;
    for (const ContentHash& content : contents) {
      const bool is_there = content != elsewhere;
      request.models.push_back(is_there ? known.models[content == known.models[1].content]
                                        : CertificateRequest::Model{content, 0, {}});
    }
    request.models.erase(request.models.begin(), request.models.begin() + 2);
    return request;
  };
  const ContentHash a = known.models[0].content, b = known.models[1].content;
  struct Case {
    CertificateRequest request;
    std::size_t looks;
    bool is_begun;
    ContentHash not_of;
  };
  for (const Case& its : {Case{known, 2, true, {}}, Case{with({a, elsewhere}), 2, false, elsewhere},
                          Case{with({elsewhere, b}), 2, false, elsewhere},
                          Case{with({elsewhere, elsewhere}), 2, false, {}}}) {
    CertificateBeginner beginner(kPeer, its.request, desk.mirrors, desk.file_of());
    desk.looks = 0;
    std::optional<BegunCertificate> begun;
    for (std::size_t turns = 1; !begun; ++turns) {
      begun = beginner.next(1000);
      ASSERT_LE(desk.looks, turns);
    }
    EXPECT_EQ(desk.looks, its.looks);
    EXPECT_EQ(begun->maker.has_value(), its.is_begun) << begun->why_not;
    EXPECT_EQ(begun->content, its.not_of);
    EXPECT_EQ(begun->wants_regions, !its.is_begun);
  }
}

// A tile of a world is closed as long as its mirrors sleep, and is opened again for one that wakes.
TEST(Mirrors, ThatSleepKeepNoFileOpen) {
  const std::unique_ptr<test::TempFile> path =
      test::write_model(test::bake_mesh(generate_sphere(6, 1), 16));
  const auto open = [&] {
    return std::make_shared<ModelFile>(ModelFile::open(path->path()).value());
  };
  std::shared_ptr<ModelFile> file = open();
  const ContentHash content = file->content_hash();
  std::shared_ptr<Mirror> mirror = make_mirror(file, test::held_whole(file->header())).value();
  const std::uint64_t state = mirror->state();
  Mirrors mirrors;
  mirrors.keep(kPeer, mirror);
  const std::weak_ptr<ModelFile> still = file;
  file.reset();
  mirrors.sleep(content);
  EXPECT_FALSE(mirrors.is_asleep(kPeer, content)) << "somebody works on it";
  mirror.reset();
  mirrors.sleep({1, 2});
  EXPECT_FALSE(still.expired()) << "it is awake";
  mirrors.sleep(content);
  EXPECT_TRUE(mirrors.is_asleep(kPeer, content));
  EXPECT_TRUE(still.expired());
  file = open();
  Mirrors::Found found = mirrors.find(kPeer, file, state);
  ASSERT_FALSE(found.held.empty());
  EXPECT_EQ(make_mirror(file, std::move(found.held)).value()->state(), state);
}

// Who holds a large part of all that a server may keep awake loses its own place where that is
// short, and nobody else's.
TEST(Mirrors, OfOneThatHoldsMuchDisplaceNoOthers) {
  const std::unique_ptr<test::TempFile> path =
      test::write_model(test::bake_mesh(generate_terrain(280, 7), 16));
  ModelFile file = ModelFile::open(path->path()).value();
  ASSERT_GT(file.header().split_count(), Mirrors::kMaxAwakeSplits / Mirrors::kShares);
  const std::vector<std::uint8_t> whole = test::held_whole(file.header());
  const std::uint64_t all = make_mirror(test::lent(file), whole).value()->state();
  Mirrors mirrors;
  const std::uint64_t nothing = Mirror(test::lent(file)).state();
  constexpr std::uint64_t kGreedy = 1, kFirst = 100;
  // The share that is left.
  constexpr std::size_t kOthers = Mirrors::kMaxAwakeSplits / Mirrors::kSplitsAMirror *
                                  (Mirrors::kShares - 1) / Mirrors::kShares;
  for (std::uint64_t peer = kFirst; peer < kFirst + kOthers; ++peer)
    ASSERT_NE(mirrors.find(peer, test::lent(file), nothing).mirror, nullptr);
  for (int i = 0; i < 3; ++i) {
    ASSERT_EQ(mirrors.find(kGreedy, test::lent(file), all).mirror, nullptr) << "it is to tell";
    mirrors.keep(kGreedy, make_mirror(test::lent(file), whole).value());
    EXPECT_EQ(mirrors.awake_count(), kOthers + 1);
    ASSERT_NE(mirrors.find(kFirst, test::lent(file), nothing).mirror, nullptr);
    EXPECT_EQ(mirrors.awake_count(), kOthers);
    EXPECT_EQ(mirrors.asleep_bytes(), 0U);
  }
  EXPECT_EQ(mirrors.find(kGreedy, test::lent(file), all).mirror, nullptr);
}

TEST(Mirrors, OfMoreThanSoManyTheOneThatWasLongestUnusedIsForgotten) {
  const std::unique_ptr<test::TempFile> path =
      test::write_model(test::bake_mesh(generate_sphere(6, 1), 16));
  ModelFile file = ModelFile::open(path->path()).value();
  ASSERT_LT(file.header().split_count() * Mirrors::kMaxMirrors, Mirrors::kMaxSplits);
  const std::vector<std::uint8_t> whole = test::held_whole(file.header());
  const std::uint64_t all = make_mirror(test::lent(file), whole).value()->state();
  Mirrors mirrors;
  const auto is_known = [&](std::uint64_t peer) {
    Mirrors::Found found = mirrors.find(peer, test::lent(file), all);
    if (!found.held.empty())
      mirrors.keep(peer,
                   found.mirror = make_mirror(test::lent(file), std::move(found.held)).value());
    return found.mirror != nullptr;
  };
  for (std::uint64_t peer = 0; peer < Mirrors::kMaxMirrors; ++peer)
    mirrors.keep(peer, make_mirror(test::lent(file), whole).value());
  EXPECT_TRUE(is_known(0)) << "and so it was used last";
  mirrors.keep(Mirrors::kMaxMirrors, make_mirror(test::lent(file), whole).value());
  EXPECT_TRUE(is_known(0));
  EXPECT_TRUE(is_known(2));
  EXPECT_FALSE(is_known(1));
}

// Half-spaces are told where they are cheaper than what they spare. Of a ground and its cast nearly
// all is needed: then the certificate is all splits, and no dearer than these.
TEST(CertificateMakers, SpareOnlyWhatIsCheaperSpared) {
  const BakedModel ground = test::bake_mesh(generate_terrain(64, 42), 16),
                   cast = test::bake_mesh(generate_terrain(64, 42), 24);
  std::size_t whole = 0;
  for (const BakedModel* model : {&ground, &cast}) {
    std::vector<VertexId> all;
    for (std::uint32_t v = 0; v < model->header.vertex_count; ++v)
      if (!model->store.is_root({v})) all.push_back({v});
    for (const auto& batch : encode_batches(model->header, model->store,
                                            treelet_of(model->store, all), BoxPolicy::kCutNodes))
      whole += batch.size() + kSealBytes;
  }
  Desk desk(ground, cast);
  Motion above;
  above.pose.translation_m = {5, 3, 2};
  BegunCertificate begun = desk.begin(desk.ask({}, above, 0));
  ASSERT_TRUE(begun.maker) << begun.why_not;
  desk.answer(*begun.maker);
  constexpr std::size_t kHeads = 100;  // of one batch more, and where batches end
  EXPECT_LT(desk.bytes, whole + kHeads)
      << desk.splits << " splits, " << desk.told.size() << " half-spaces";
}

// The first batch of the second model is made to fit beside the last one of the first.
TEST(CertificateMakers, FillDatagramsWithBatchesOfBothModels) {
  const BakedModel ground = test::bake_mesh(generate_terrain(64, 42), 16),
                   cast = test::bake_mesh(generate_terrain(48, 42), 16);
  for (const double height_m : {8.0, 32.0, 64.0, 128.0, 256.0, 512.0}) {
    Motion above;
    above.pose.translation_m = {5, 3, height_m};
    Desk desk(ground, cast);
    BegunCertificate begun = desk.begin(desk.ask({}, above, 0));
    ASSERT_TRUE(begun.maker) << begun.why_not;
    desk.answer(*begun.maker);
    // What is left free: of a batch less than a record's size, and what is not worth joining.
    constexpr std::size_t kFilled = kMaxSealedBytes - 120;
    EXPECT_LE(desk.datagrams, (desk.bytes + kFilled - 1) / kFilled) << "at " << height_m << " m";
  }
}

// Which of the two bodies a request names first makes no difference to what comes.
TEST(CertificateMakers, SendTheSameWhicheverBodyIsNamedFirst) {
  const BakedModel ground = test::bake_mesh(generate_terrain(64, 42), 16),
                   cast = test::bake_mesh(generate_terrain(48, 42), 16);
  for (const double height_m : {4.0, 8.0, 16.0}) {
    Motion above;
    above.pose.translation_m = {5, 3, height_m};
    Desk first(ground, cast), second(cast, ground);
    BegunCertificate begun = first.begin(first.ask({}, above, 0)),
                     turned = second.begin(second.ask(above, {}, 0));
    ASSERT_TRUE(begun.maker && turned.maker);
    first.answer(*begun.maker);
    second.answer(*turned.maker);
    EXPECT_GT(first.told.size(), 100U);
    // The same to the byte, but for what is rounded in the frame of the one or the other.
    const auto bytes = static_cast<double>(first.bytes);
    EXPECT_NEAR(static_cast<double>(second.bytes), bytes, 0.004 * bytes)
        << "at " << height_m << " m";
  }
}

// Two terrains that lie in each other: what one request may bring ends before what they need does.
TEST(CertificateMakers, SendSoManySplitsForARequestAndThePeerAsksOn) {
  const BakedModel terrain = test::bake_mesh(generate_terrain(200, 7), 16);
  Desk desk(terrain, terrain);
  Motion aside;
  aside.pose.translation_m = {1, 2, 0.5};
  std::vector<std::size_t> sent;
  for (std::size_t before = 0; sent.empty() || sent.back() > 0; before = desk.splits) {
    ASSERT_LT(sent.size(), 20U) << "it never ends";
    BegunCertificate begun = desk.begin(desk.ask({}, aside, 0));
    ASSERT_TRUE(begun.maker) << begun.why_not;
    desk.answer(*begun.maker);
    sent.push_back(desk.splits - before);
  }
  EXPECT_GT(sent.size(), 2U);
  for (std::size_t i = 0; i < sent.size(); ++i)
    EXPECT_LT(sent[i], CertificateMaker::kMaxSplits * 11 / 10) << "request " << i;
}

/// Closed: a tip in the origin, a ring at that height, and a tip above it.
IndexedMesh make_spindle(std::uint32_t sides, double height_m) {
  IndexedMesh spindle{{{0, 0, 0}, {0, 0, 2 * height_m}}, {}};
  for (std::uint32_t i = 0; i < sides; ++i) {
    const double angle = 2 * std::numbers::pi * i / sides;
    spindle.positions_m.push_back({std::cos(angle), std::sin(angle), height_m});
    const std::uint32_t one = 2 + i, next = 2 + (i + 1) % sides;
    spindle.faces.push_back({0, next, one});
    spindle.faces.push_back({1, one, next});
  }
  return spindle;
}

// Two solids, tip to tip: each face there touches each, so the peer's own query would take forty
// times the tests that an answer may.
TEST(CertificateMakers, EndAfterSoManyTests) {
  constexpr std::uint32_t kSides = 20'000;
  static_assert(std::uint64_t{kSides} * kSides == 40 * CertificateMaker::kMaxTests);
  const BakedModel up = test::bake_mesh(make_spindle(kSides, 1)),
                   down = test::bake_mesh(make_spindle(kSides, -1));
  Desk desk(up, down);
  CertificateRequest request = desk.ask({}, {}, 0);
  for (const auto& [model, file] :
       {std::pair(&request.models[0], &desk.file_a), {&request.models[1], &desk.file_b}}) {
    model->held = test::held_whole(file->header());
    model->state = make_mirror(test::lent(*file), model->held).value()->state();
  }
  request.pairs[0].solid_a = true;
  BegunCertificate begun = desk.begin(request);
  ASSERT_TRUE(begun.maker) << begun.why_not;
  EXPECT_EQ(desk.answer(*begun.maker), 0U) << "all is held";
  // The query is asked with 0.2, 0.8, 3.2 and 12.8 million tests, and not again with more; six
  // rounds are for the rest.
  EXPECT_EQ(desk.rounds, 10U);
}

TEST(CertificateRequests, SayWhatIsHeldAsItIsOrAreSentAway) {
  const BakedModel terrain = test::bake_named("terrain"), aircraft = test::bake_named("aircraft");
  Desk desk(terrain, aircraft);
  CertificateRequest request = desk.ask({}, {}, 0);
  request.models[0].state ^= 1;
  request.models[0].held = held_nodes(desk.a).bits;
  EXPECT_TRUE(desk.begin(request).wants_regions) << "another state";
  request.models[0].held = {1, 2, 3};
  EXPECT_TRUE(desk.begin(request).wants_regions) << "no state of this model";
  request = desk.ask({}, {}, 0);
  request.models[0].content.low ^= 1;
  EXPECT_TRUE(desk.begin(request).wants_regions) << "another model";
}

// Anyone may ask, so a word that the model does not bear out ends no publisher.
TEST(CertificateRequests, OfOpenSurfacesAsSolidsAreSentAway) {
  const BakedModel terrain = test::bake_named("terrain"), aircraft = test::bake_named("aircraft");
  Desk desk(terrain, aircraft);
  Motion far;
  far.pose.translation_m = {0, 0, 1e6};
  CertificateRequest request = desk.ask({}, far, 0);
  request.pairs[0].solid_a = true;
  const BegunCertificate begun = desk.begin(request);
  EXPECT_FALSE(begun.maker);
  EXPECT_TRUE(begun.wants_regions);
  EXPECT_NE(begun.why_not.find("boundary edges"), std::string::npos) << begun.why_not;
}

TEST(CertificateRequests, ComeBackAsTheyWerePacked) {
  Random random(4);
  CertificateRequest request;
  request.horizon_s = 0.5F;
  request.margin_m = 0.25F;
  request.models = {{{1, 2}, 3, {}}, {{4, 5}, 6, {7, 8, 9}}};
  for (int i = 0; i < 3; ++i) {
    request.pairs.push_back(relative(random_motion(random, {}), random_motion(random, {})));
    request.pairs.back().b = 1;
    request.pairs.back().solid_b = i == 1;
  }
  const std::vector<std::uint8_t> bytes = pack_certificate(request);
  const Result<CertificateRequest> back = unpack_certificate(bytes);
  ASSERT_TRUE(back.is_ok()) << back.status().message();
  EXPECT_EQ(pack_certificate(back.value()), bytes);
  EXPECT_EQ(back.value().models[1].held, request.models[1].held);
  EXPECT_TRUE(back.value().pairs[1].solid_b);
  for (std::size_t length = 0; length < bytes.size(); ++length)
    EXPECT_FALSE(unpack_certificate(std::span(bytes).first(length)).is_ok()) << length;
  std::vector<std::uint8_t> longer = bytes;
  longer.push_back(0);
  EXPECT_FALSE(unpack_certificate(longer).is_ok());
}

TEST(CertificateRequests, WhatRestsTakesNoVelocities) {
  CertificateRequest request;
  request.models = {{{1, 2}, 3, {}}, {{4, 5}, 6, {}}};
  request.pairs = {relative({}, {})};
  const std::vector<std::uint8_t> at_rest = pack_certificate(request);
  EXPECT_EQ(at_rest.size(), 91U);
  request.pairs[0].angular_velocity_radps[2] = -0.0F;
  std::vector<std::uint8_t> moving = pack_certificate(request);
  EXPECT_EQ(moving.size(), at_rest.size() + 24);
  const Result<CertificateRequest> back = unpack_certificate(moving);
  ASSERT_TRUE(back.is_ok()) << back.status().message();
  EXPECT_EQ(pack_certificate(back.value()), moving);
  // Each request has one form.
  ASSERT_EQ(moving.back(), 0x80);
  moving.back() = 0;
  EXPECT_FALSE(unpack_certificate(moving).is_ok());
  std::vector<std::uint8_t> of_later_flags = at_rest;
  of_later_flags[at_rest.size() - 29] |= 8;
  EXPECT_FALSE(unpack_certificate(of_later_flags).is_ok());
}

TEST(CertificateRequests, OutOfRangeAreRefused) {
  CertificateRequest good;
  good.models = {{{1, 2}, 3, {}}};
  good.pairs = {relative({}, {})};
  ASSERT_TRUE(check_request(good).is_ok());
  const auto is_refused = [&](const auto& change) {
    CertificateRequest bad = good;
    change(bad);
    return !check_request(bad).is_ok();
  };
  const float nan = std::nanf("");
  EXPECT_TRUE(is_refused([](auto& r) { r.pairs.clear(); }));
  EXPECT_TRUE(is_refused([](auto& r) { r.pairs.resize(kMaxAskedPairs + 1, r.pairs[0]); }));
  EXPECT_TRUE(is_refused([](auto& r) { r.models.resize(kMaxAskedModels + 1, r.models[0]); }));
  EXPECT_TRUE(is_refused([](auto& r) { r.pairs[0].b = 1; }));
  EXPECT_TRUE(is_refused([](auto& r) { r.models.push_back(r.models[0]); }));
  EXPECT_TRUE(is_refused([&](auto& r) { r.horizon_s = nan; }));
  EXPECT_TRUE(is_refused([](auto& r) { r.margin_m = -1; }));
  EXPECT_TRUE(is_refused([](auto& r) { r.pairs[0].rotation[0] = 2; }));
  EXPECT_TRUE(is_refused([&](auto& r) { r.pairs[0].rotation[1] = nan; }));
  EXPECT_TRUE(is_refused([&](auto& r) { r.pairs[0].translation_m[2] = nan; }));
  EXPECT_TRUE(is_refused([](auto& r) { r.pairs[0].angular_velocity_radps[0] = 1e30F; }));
}

}  // namespace
}  // namespace nearmesh
