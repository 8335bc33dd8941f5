// SPDX-License-Identifier: Apache-2.0
// Sessions that watch all pairs are recorded, and what bounds proved free is proved again; what was
// forged, lost or said by strangers is found out.
#include "subscriber/recorded/prove_bounds.hpp"

#include <algorithm>
#include <ctime>
#include <filesystem>

#include "core/broadphase/free_pairs.hpp"
#include "core/query/answer.hpp"
#include "core/world/pages.hpp"
#include "core/world/world_folder.hpp"
#include "nearmesh/subscriber/peer/local_channel.hpp"
#include "subscriber/recorded/pose_tape.hpp"
#include "subscriber/recorded/verify.hpp"
#include "tests/support/folder.hpp"
#include "tests/support/kept_channel.hpp"
#include "tests/unit/subscriber/peer/world.hpp"

namespace nearmesh {
namespace {

using namespace test;
using subscriber::BoundsProof;

constexpr wire::SessionId kPeers = 3, kFirst = 0xb1;
constexpr double kFrame_s = 0.05;

class ProveBounds : public ::testing::Test {
 protected:
  struct Peer {
    std::unique_ptr<Session> session;
    std::vector<std::pair<BodyId, Motion>> bodies;
    std::uint64_t made = 0;
  };

  ProveBounds() { world_.start_publisher(); }

  Motion anywhere() {
    const BakedModel& ground = terrain().model;
    Motion motion;
    motion.pose.rotation = random_rotation(random_);
    motion.pose.translation_m =
        position_m(ground.header, ground.store, {random_.below(ground.header.vertex_count)});
    motion.pose.translation_m[2] += random_.between(0, 400);
    for (double& v : motion.linear_velocity_mps) v = random_.between(-60, 60);
    for (double& w : motion.angular_velocity_radps) w = random_.between(-2, 2);
    if (random_.unit() < 0.2) motion = {.pose = motion.pose};  // at rest
    return motion;
  }
  void add_body(Peer& peer, std::size_t of) {
    const std::string name = "p" + std::to_string(of) + "/" + std::to_string(++peer.made);
    peer.bodies.emplace_back(peer.session
                                 ->add_body({.name = name,
                                             .model = "aircraft",
                                             .own = true,
                                             .group = 1U << random_.below(2),
                                             .mask = random_.unit() < 0.2 ? 1U : ~0U})
                                 .value(),
                             anywhere());
  }
  Peer make_peer(std::size_t i, subscriber::SessionOptions options) {
    Peer peer{.session = std::make_unique<Session>(
                  std::make_unique<KeptChannel>(world_.bus.make_peer(kFirst + i), kept_), options)};
    Session& session = *peer.session;
    session.watch_all();
    session.discover_bodies();
    EXPECT_TRUE(
        session.place_body(session.add_body({.name = "ground", .model = "terrain"}).value(), {})
            .is_ok());
    for (int k = 0; k < 9; ++k) add_body(peer, i);
    return peer;
  }
  /// What the peers say of frames in which bodies fly, rest, jump, are not heard of for a while,
  /// come and go.
  void fly(std::uint64_t frames, std::size_t count = kPeers) {
    std::vector<Peer> peers;
    for (std::size_t i = 0; i < count; ++i)
      peers.push_back(make_peer(
          i, {.max_pose_age_s = 4 * kFrame_s - 0.001, .lookahead_s = 0.2, .margin_m = 1}));
    world_.on_report = [&](const FrameReport& report) { said_ += report.free_by_bounds.pairs; };
    for (std::uint64_t frame = 0; frame < frames; ++frame) {
      world_.round(*peers.front().session, frame);  // who serves has its turn there
      for (std::size_t i = 0; i < count; ++i) {
        Peer& peer = peers[i];
        const double luck = random_.unit();
        if (luck < 0.1) {
          add_body(peer, i);
        } else if (luck < 0.2 && peer.bodies.size() > 2) {
          EXPECT_TRUE(peer.session->remove_body(peer.bodies.back().first).is_ok());
          peer.bodies.pop_back();
        }
        std::vector<Session::OwnMotion> own;
        for (auto& [body, motion] : peer.bodies) {
          motion.pose = moved(motion, kFrame_s);
          if (random_.unit() < 0.05) motion = anywhere();
          if (random_.unit() < 0.6) own.push_back({body, motion});
        }
        const auto report =
            peer.session->update(frame, static_cast<double>(frame) * kFrame_s, own, 1);
        ASSERT_TRUE(report.is_ok()) << report.status().message();
        said_ += report.value().free_by_bounds.pairs;
      }
    }
  }
  BoundsProof prove(const KeptSamples& samples, wire::SessionId unheard = 0) {
    const std::string path = folder_ + "/" + std::to_string(++files_) + ".db3";
    write_samples(samples, path, unheard);
    const auto recording = RecordingReader::open(path);
    EXPECT_TRUE(recording.is_ok());
    Result<BoundsProof> proof = subscriber::prove_bounds(*recording.value());
    EXPECT_TRUE(proof.is_ok()) << proof.status().message();
    const BoundsProof& found = proof.value();
    EXPECT_EQ(found.reports, found.proved + found.wrong + found.unprovable + found.malformed);
    return std::move(proof).value();
  }
  [[nodiscard]] KeptSamples::iterator a_report() {
    std::vector<KeptSamples::iterator> all;
    for (auto at = kept_.begin(); at != kept_.end(); ++at)
      if (at->as<wire::BoundsReport>() != nullptr) all.push_back(at);
    EXPECT_GT(all.size(), 4U);
    return all[all.size() / 2];
  }
  template <class Change>
  BoundsProof prove_changed(const Change& change) {
    const auto at = a_report();
    const wire::BoundsReport before = *at->as<wire::BoundsReport>();
    change(*at->as<wire::BoundsReport>());
    BoundsProof proof = prove(kept_);
    *at->as<wire::BoundsReport>() = before;
    return proof;
  }

  World world_;
  Random random_{11};
  KeptSamples kept_;
  std::uint64_t said_ = 0;
  const test::Folder scratch_;
  const std::string folder_ = scratch_.path();
  int files_ = 0;
};

std::string reasons_of(const BoundsProof& proof) {
  std::string all;
  for (const auto& [what, count] : proof.why_not) all += std::to_string(count) + ": " + what + "\n";
  for (const auto& one : proof.wrong_ones) all += one.what + "\n";
  return all;
}

TEST_F(ProveBounds, AllThatPeersSayWhoHearEachOtherIsProved) {
  fly(60);
  const BoundsProof proof = prove(kept_);
  EXPECT_GT(proof.reports, 150U);
  EXPECT_EQ(proof.proved, proof.reports) << reasons_of(proof);
  EXPECT_EQ(proof.pairs, said_);
  EXPECT_EQ(proof.proved_pairs, said_);
  EXPECT_NE(proof.digest, 0U);
  EXPECT_GT(proof.near_pairs, 50U);
  EXPECT_EQ(proof.unreported, 0U) << proof.first_unreported;
}

// A pair that bounds do not prove free and that nobody answered for must not be passed over. Of a
// mover's bodies some may be known by samples of before a lost one, others by samples of after it:
// its last number does not tell.
TEST_F(ProveBounds, WhatRestsOnPosesBesideLostOnesIsProved) {
  world_.bus.on_poses = {.lose = 0.1};
  fly(60);
  const BoundsProof proof = prove(kept_);
  EXPECT_GT(proof.reports, 150U);
  EXPECT_EQ(proof.proved, proof.reports) << reasons_of(proof);
  std::size_t posed = 0;
  for (const KeptSample& sample : kept_)
    if (const auto* report = sample.as<wire::BoundsReport>())
      for (const wire::BoundsReport::Heard& heard : report->heard) posed += heard.posed.size();
  EXPECT_GT(posed, 200U);
}

TEST_F(ProveBounds, NearPairsWithoutAReportAreFound) {
  fly(30, 1);
  const BoundsProof whole = prove(kept_);
  ASSERT_EQ(whole.unreported, 0U) << whole.first_unreported;
  std::set<std::uint64_t> bounded;  // frames
  for (const KeptSample& sample : kept_)
    if (const auto* bounds = sample.as<wire::BoundsReport>()) bounded.insert(bounds->frame);
  std::vector<std::size_t> places;
  for (std::size_t i = 0; i < kept_.size(); ++i)
    if (const auto* report = kept_[i].as<wire::ContactReport>())
      if (bounded.contains(report->frame) && report->frame < *bounded.rbegin() && report->asked)
        places.push_back(i);
  ASSERT_GT(places.size(), 20U);
  const std::size_t middle = places[places.size() / 2];
  const wire::ContactReport lost = *kept_[middle].as<wire::ContactReport>();
  const auto without = [&](const auto& is_lost) {
    KeptSamples some;
    for (const KeptSample& sample : kept_) {
      const auto* report = sample.as<wire::ContactReport>();
      if (report == nullptr || !is_lost(*report)) some.push_back(sample);
    }
    return some;
  };
  const auto is_it = [&](const wire::ContactReport& report) {
    return report.frame == lost.frame && report.body_a == lost.body_a &&
           report.body_b == lost.body_b;
  };
  // A frame that is updated twice has two reports of what bounds prove.
  const auto is_one_frames = [](const BoundsProof& proof) {
    return proof.unreported == 1 || proof.unreported == 2;
  };
  const BoundsProof one = prove(without(is_it));
  EXPECT_TRUE(is_one_frames(one)) << one.unreported;
  EXPECT_EQ(one.near_pairs, whole.near_pairs);
  EXPECT_NE(one.first_unreported.find(lost.body_a), std::string::npos) << one.first_unreported;
  // Of another time it is none of that frame's.
  KeptSamples moved = kept_;
  for (KeptSample& sample : moved)
    if (auto* report = sample.as<wire::ContactReport>(); report != nullptr && is_it(*report))
      report->time_s += 1;
  EXPECT_TRUE(is_one_frames(prove(moved)));
  EXPECT_EQ(prove(without([](const auto&) { return true; })).unreported, whole.near_pairs);
  // Those of before a recorder came are not missed, and neither are those that end with the
  // recording.
  KeptSamples late = without([&](const auto& report) { return report.frame < lost.frame; });
  EXPECT_GT(prove(late).unreported, 0U);
  EXPECT_EQ(prove(late, kFirst).unreported, 0U);
  KeptSamples cut(kept_.begin(), kept_.begin() + static_cast<std::ptrdiff_t>(middle));
  EXPECT_EQ(prove(cut).unreported, 0U);
}

// Who could not ask says so, and that is a report; who claims something all the same has said
// nothing.
TEST_F(ProveBounds, WhatClaimsWithoutAnAnswerIsNoReportOfANearPair) {
  fly(30, 1);
  const BoundsProof whole = prove(kept_);
  ASSERT_GT(whole.near_pairs, 0U);
  ASSERT_EQ(whole.unreported, 0U) << whole.first_unreported;
  const auto prove_with = [&](const auto& change) {
    KeptSamples changed = kept_;
    for (KeptSample& sample : changed)
      if (auto* report = sample.as<wire::ContactReport>()) {
        wire::ContactReport unknown;
        unknown.peer = report->peer;
        unknown.body_a = report->body_a;
        unknown.body_b = report->body_b;
        unknown.frame = report->frame;
        unknown.time_s = report->time_s;
        unknown.status = static_cast<std::uint8_t>(AnswerStatus::kUncertain);
        unknown.uncertainty_m = std::numeric_limits<double>::max();
        unknown.answer_digest = digest(nothing_known());
        change(unknown);
        *report = unknown;
      }
    return prove(changed);
  };
  EXPECT_EQ(prove_with([](auto&) {}).unreported, 0U);
  const auto expect_none = [&](const char* what, const auto& claim) {
    const BoundsProof proof = prove_with(claim);
    EXPECT_EQ(proof.near_pairs, whole.near_pairs) << what;
    EXPECT_EQ(proof.unreported, whole.near_pairs) << what;
  };
  expect_none("free", [](auto& report) {
    report.status = 0;
    report.clearance_m = 1000;
  });
  expect_none("clearance", [](auto& report) { report.clearance_m = 1000; });
  expect_none("put off", [](auto& report) {
    report.put_off = true;
    report.pair_count = 1;
  });
}

// Put off is told once, until the pair is asked again.
TEST_F(ProveBounds, APairThatWasPutOffHasItsReport) {
  std::vector<Peer> peers;
  peers.push_back(make_peer(0, {.lookahead_s = 2, .margin_m = 200}));
  Session& session = *peers[0].session;
  for (std::uint64_t frame = 0; frame < 30; ++frame) {
    std::vector<Session::OwnMotion> own;
    for (auto& [body, motion] : peers[0].bodies) own.push_back({body, motion});
    world_.bus.tick();
    world_.service().step(static_cast<double>(frame));
    ASSERT_TRUE(session.update(frame, static_cast<double>(frame) * kFrame_s, own, 0).is_ok());
  }
  std::size_t put_off = 0;
  for (const KeptSample& sample : kept_)
    if (const auto* report = sample.as<wire::ContactReport>()) put_off += report->put_off ? 1 : 0;
  const BoundsProof proof = prove(kept_);
  EXPECT_GT(put_off, 10U);
  EXPECT_GT(proof.near_pairs, 2 * put_off);
  EXPECT_EQ(proof.unreported, 0U) << proof.first_unreported;
}

TEST_F(ProveBounds, AnyForgedBoundIsFoundWrong) {
  fly(20, 1);
  ASSERT_EQ(prove(kept_).wrong, 0U);
  const auto expect_wrong = [&](const char* what, const auto& change) {
    const BoundsProof proof = prove_changed(change);
    EXPECT_EQ(proof.wrong, 1U) << what << "\n" << reasons_of(proof);
    EXPECT_EQ(proof.proved, proof.reports - 1) << what;
    EXPECT_EQ(proof.wrong_ones.size(), 1U) << what;
  };
  const auto above = [](float& number) {
    number = std::nextafter(number, std::numeric_limits<float>::max());
  };
  expect_wrong("pairs", [](wire::BoundsReport& report) { ++report.pairs; });
  expect_wrong("all pairs", [](wire::BoundsReport& report) { report.pairs = 0xffffffffU; });
  expect_wrong("clearance", [&](wire::BoundsReport& report) { above(report.clearance_m); });
  expect_wrong("horizon", [&](wire::BoundsReport& report) { above(report.horizon_s); });
  expect_wrong("digest", [](wire::BoundsReport& report) { ++report.places_digest; });
  const BoundsProof modest = prove_changed([](wire::BoundsReport& report) {
    report.clearance_m /= 2;  // less than is proved is true
    report.horizon_s = 0;
  });
  EXPECT_EQ(modest.proved, modest.reports) << reasons_of(modest);
}

TEST_F(ProveBounds, WhatRestsOnAPoseThatIsNotRecordedIsNotProvableAndNeverWrong) {
  fly(30);
  for (const std::size_t every : {60, 2}) {
    KeptSamples some;
    std::size_t at = 0;
    for (const KeptSample& sample : kept_)
      if (sample.as<wire::BodyPoses>() == nullptr || ++at % every != 0) some.push_back(sample);
    const BoundsProof proof = prove(some);
    EXPECT_EQ(proof.wrong, 0U) << reasons_of(proof);
    EXPECT_GT(proof.unprovable, 0U);
    EXPECT_EQ(proof.proved > 0, every == 60) << proof.proved;
    EXPECT_GT(proof.why_not.size(), 0U);
  }
}

TEST_F(ProveBounds, WithoutHeadersNamesOrWatchedBodiesNothingIsProvable) {
  fly(10);
  const auto without = [&](const auto& is_left_out) {
    KeptSamples some;
    for (const KeptSample& sample : kept_)
      if (!is_left_out(sample)) some.push_back(sample);
    const BoundsProof proof = prove(some);
    EXPECT_EQ(proof.unprovable, proof.reports) << reasons_of(proof);
    EXPECT_GT(proof.reports, 0U);
  };
  without([](const KeptSample& s) { return s.as<wire::MeshHeader>() != nullptr; });
  without([](const KeptSample& s) { return s.as<wire::BodyDirectory>() != nullptr; });
  without([](const KeptSample& s) { return s.as<wire::WatchedBodies>() != nullptr; });
}

TEST_F(ProveBounds, AStrangersReportIsNotThePeers) {
  fly(20, 1);
  const auto own = a_report();
  KeptSample forged = *own;
  forged.by = 0xee;
  forged.as<wire::BoundsReport>()->pairs += 5;
  kept_.insert(own, forged);
  const BoundsProof proof = prove(kept_);
  EXPECT_EQ(proof.unprovable, 1U);
  EXPECT_EQ(proof.wrong, 0U) << reasons_of(proof);
  EXPECT_EQ(proof.proved, proof.reports - 1);
}

TEST_F(ProveBounds, PosesOfAStrangerInThePeersNameAreNotItsOwn) {
  fly(20, 1);
  KeptSamples all;
  for (const KeptSample& sample : kept_) {
    all.push_back(sample);
    if (sample.as<wire::BodyPoses>() == nullptr && sample.as<wire::BodyDirectory>() == nullptr)
      continue;
    all.push_back(sample);
    all.back().by = 0xee;
    if (wire::BodyPoses* poses = all.back().as<wire::BodyPoses>())
      for (wire::BodyPoses::Body& body : poses->bodies) body.motion.pose.translation_m[0] += 1;
  }
  const BoundsProof proof = prove(all);
  EXPECT_EQ(proof.proved, proof.reports) << reasons_of(proof);
  // Where the peer's own are not there, nothing is certain.
  std::erase_if(all, [&](const KeptSample& sample) {
    return sample.by != 0xee && sample.as<wire::BodyPoses>() != nullptr;
  });
  const BoundsProof without = prove(all);
  EXPECT_EQ(without.unprovable, without.reports) << reasons_of(without);
}

TEST_F(ProveBounds, ARecorderThatComesLateProvesWhatFollows) {
  fly(40);
  // What is latched comes to it first: the last of each part.
  const std::size_t begin = kept_.size() / 2;
  std::map<std::string, KeptSample> latched;
  for (std::size_t i = 0; i < begin; ++i) {
    const KeptSample& sample = kept_[i];
    if (sample.is_batch() || sample.as<wire::BoundsReport>() != nullptr ||
        sample.as<wire::ContactReport>() != nullptr)
      continue;
    std::visit(
        [&]<class Message>(const Message& message) {
          if constexpr (!std::is_same_v<Message, wire::BoundsReport> &&
                        !std::is_same_v<Message, wire::ContactReport>)
            latched[wire::topic_of<Message>().name.data() +
                    wire::topic_of<Message>().key(message)] = sample;
        },
        sample.message);
  }
  KeptSamples late;
  for (const auto& [key, sample] : latched) late.push_back(sample);
  std::stable_sort(late.begin(), late.end(), [](const KeptSample& a, const KeptSample& b) {
    const auto *one = a.as<wire::BodyPoses>(), *two = b.as<wire::BodyPoses>();
    return one != nullptr && two != nullptr ? one->sequence < two->sequence
                                            : one == nullptr && two != nullptr;
  });
  late.insert(late.end(), kept_.begin() + static_cast<std::ptrdiff_t>(begin), kept_.end());
  const BoundsProof proof = prove(late);
  EXPECT_GT(proof.reports, 50U);
  EXPECT_GE(proof.proved + 3, proof.reports) << reasons_of(proof);
  EXPECT_EQ(proof.wrong, 0U) << reasons_of(proof);
}

TEST_F(ProveBounds, VerifyCountsThemApart) {
  fly(10, 1);
  ++a_report()->as<wire::BoundsReport>()->pairs;
  const std::string path = folder_ + "/session.db3";
  write_samples(kept_, path);
  const auto recording = RecordingReader::open(path);
  ASSERT_TRUE(recording.is_ok());
  const auto report = subscriber::verify(*recording.value(), {.threads = 2});
  ASSERT_TRUE(report.is_ok());
  EXPECT_GT(report.value().reports, 0U);
  EXPECT_EQ(report.value().lacking, 0U);
  EXPECT_EQ(report.value().different, 0U);
  EXPECT_EQ(report.value().bounds.wrong, 1U);
  EXPECT_GT(report.value().bounds.proved, 5U);
}

TEST_F(ProveBounds, WhatASessionSaysDoesNotDependOnWhatWasBefore) {
  // One has flown, had bodies that went, and other orders; both end with the same bodies in the
  // same places.
  std::vector<Motion> last;
  for (int i = 0; i < 8; ++i) last.push_back(anywhere());
  const auto end_of = [&](bool has_flown) {
    KeptSamples said;
    Session session(std::make_unique<KeptChannel>(world_.bus.make_peer(kFirst), said),
                    {.lookahead_s = 0.2});
    session.watch_all();
    std::map<std::size_t, BodyId> ids;
    const auto add = [&](std::size_t i) {
      ids[i] = session.add_body({.name = "b" + std::to_string(i), .model = "aircraft", .own = true})
                   .value();
    };
    if (has_flown) {
      for (std::size_t i = 8; i > 0; --i) add(i - 1);
      for (std::uint64_t frame = 0; frame < 20; ++frame) {
        world_.round(session, frame);
        std::vector<Session::OwnMotion> own;
        for (const auto& [i, id] : ids) own.push_back({id, anywhere()});
        EXPECT_TRUE(session.update(frame, static_cast<double>(frame) * kFrame_s, own, 1).is_ok());
      }
      EXPECT_TRUE(session.remove_body(ids[3]).is_ok());
      add(3);
    } else {
      for (std::size_t i = 0; i < 8; ++i) add(i);
      for (std::uint64_t frame = 0; frame < 5; ++frame) world_.round(session, frame);
    }
    std::vector<Session::OwnMotion> own;
    for (const auto& [i, id] : ids) own.push_back({id, last[i]});
    EXPECT_TRUE(session.update(50, 50 * kFrame_s, own, 1).is_ok());
    const auto at = std::find_if(said.rbegin(), said.rend(), [](const KeptSample& sample) {
      return sample.as<wire::BoundsReport>() != nullptr;
    });
    const wire::BoundsReport* report = at->as<wire::BoundsReport>();
    EXPECT_EQ(report->frame, 50U);
    return std::tuple(report->pairs, report->clearance_m, report->horizon_s, report->places_digest);
  };
  EXPECT_EQ(end_of(true), end_of(false));
}

/// One tile, and aircraft over it; the world's first page comes as detail does.
TEST_F(ProveBounds, WhatIsFreeOfAWorldIsProvedWithItsFirstPage) {
  const std::string world = folder_ + "/world";
  std::filesystem::create_directories(world + "/tiles");
  constexpr CommonLattice kLattice{.exponent = -7};
  const IndexedMesh valley = generate_terrain(10, 5);
  CleanResult clean = clean_mesh(valley, {.lattice = kLattice}).value();
  PlacedTile tile{.place = clean.mesh.grid.lattice_cells, .faces = clean.mesh.faces.size()};
  clean.mesh.grid = {.exponent = kLattice.exponent};
  for (const GridPoint& p : clean.mesh.positions)
    for (std::size_t k = 0; k < 3; ++k)
      tile.extent[k] = std::max<std::int64_t>(tile.extent[k], p.v[k]);
  const TempFile file;
  const BakedModel baked = bake(clean.mesh, 0, {.base_faces = 4}).value();
  ASSERT_TRUE(write_model_file(baked.header, baked.store, baked.numbers, file.path()).is_ok());
  tile.content = ModelFile::open(file.path()).value().content_hash();
  std::filesystem::copy_file(file.path(), WorldFolder::tile_path(world, tile.content));
  ASSERT_TRUE(write_world(make_pages(kLattice, 21, {tile}).value(), world).is_ok());

  auto channel = std::make_unique<subscriber::LocalChannel>();
  ASSERT_TRUE(channel->add_world("valley", world).is_ok());
  ASSERT_TRUE(channel->add_model("aircraft", aircraft().open()).is_ok());
  Session session(std::make_unique<KeptChannel>(std::move(channel), kept_), {.lookahead_s = 0.2});
  session.watch_all();
  const BodyId ground = session.add_body({.name = "ground", .model = "valley"}).value();
  ASSERT_TRUE(session.place_body(ground, {}).is_ok());
  std::vector<Session::OwnMotion> own;
  for (int i = 0; i < 4; ++i) {
    own.push_back(
        {session.add_body({.name = "b" + std::to_string(i), .model = "aircraft", .own = true})
             .value(),
         {}});
    auto& at_m = own.back().motion.pose.translation_m;
    at_m = valley.positions_m[60];
    if (i > 0) at_m[2] += 3000.0 * i;
  }
  FrameReport report;
  for (std::uint64_t frame = 0; frame < 10; ++frame)
    report = session.update(frame, static_cast<double>(frame) * kFrame_s, own, 1).value();
  ASSERT_EQ(report.free_by_bounds.pairs, 9U);  // one of the ten is near the ground
  const BoundsProof proof = prove(kept_);
  EXPECT_EQ(proof.proved, proof.reports) << reasons_of(proof);
  KeptSamples without;
  for (const KeptSample& sample : kept_)
    if (!sample.is_batch()) without.push_back(sample);
  const BoundsProof less = prove(without);
  EXPECT_GT(less.unprovable, 5U) << reasons_of(less);
  EXPECT_EQ(less.wrong, 0U);
}

// ---- robots -------------------------------------------------------------------------------------

/// One peer moves a robot whose poses take several samples, another watches all.
class ProveRobots : public ProveBounds {
 protected:
  void fly_robot(std::size_t count, std::uint64_t frames) {
    world_.judges = false;  // bodies have other names here
    Session mover(std::make_unique<KeptChannel>(world_.bus.make_peer(kFirst), kept_),
                  quick_options());
    Session looker(std::make_unique<KeptChannel>(world_.bus.make_peer(kFirst + 1), kept_),
                   quick_options());
    looker.watch_all();
    looker.discover_bodies();
    std::vector<BodyId> links;
    for (std::size_t i = 0; i < count; ++i)
      links.push_back(
          mover.add_body({.name = "arm/" + std::to_string(i), .model = "aircraft", .own = true})
              .value());
    ASSERT_TRUE(mover.link_bodies(links).is_ok());
    for (std::uint64_t frame = 0; frame < frames; ++frame) {
      std::vector<Session::OwnMotion> motions;
      for (std::size_t i = 0; i < count; ++i) {
        Motion motion;
        motion.pose.translation_m = {1000.0 * static_cast<double>(i % 16),
                                     1000.0 * static_cast<double>(i / 16),
                                     static_cast<double>(frame)};
        motion.linear_velocity_mps = {0, 0, 20};
        motions.push_back({links[i], motion});
      }
      world_.round(mover, frame, motions);
      world_.round(looker, frame);
    }
  }
};

TEST_F(ProveRobots, AllThatIsSaidOfThemIsProved) {
  fly_robot(20, 40);  // three parts
  const BoundsProof proof = prove(kept_);
  EXPECT_GT(proof.reports, 30U);
  EXPECT_EQ(proof.proved, proof.reports) << reasons_of(proof);
  EXPECT_EQ(proof.proved_pairs, 190 * proof.reports);
}

// The peer rested on an instant before, the recording has the whole one.
TEST_F(ProveRobots, WhatThePeerHeardInPartIsProved) {
  world_.bus.on_poses = {.lose = 0.1};
  fly_robot(20, 60);
  const BoundsProof proof = prove(kept_);
  EXPECT_EQ(proof.proved, proof.reports) << reasons_of(proof);
}

// Two updates of one time, of both parts; who had heard three of the four samples rested on the
// first update.
TEST(LinksOfRecordings, OfTwoUpdatesOfOneTimeAreNotMixed) {
  subscriber::PoseSamples samples(1);
  for (std::uint32_t sequence = 1; sequence <= 4; ++sequence) {
    wire::BodyPoses poses{.part = (sequence - 1) % 2, .sequence = sequence};
    for (std::uint32_t i = 0; i < wire::kBodiesPerPart; ++i)
      poses.bodies.push_back({.number = poses.part * wire::kBodiesPerPart + i, .time_s = 1});
    samples.take(std::move(poses), 0);
  }
  const auto links = samples.find_links(0, 2 * wire::kBodiesPerPart, 3);
  EXPECT_EQ(links.size(), 2 * wire::kBodiesPerPart);
  for (const auto& [number, found] : links)
    EXPECT_TRUE(found.is_of(1 + number / wire::kBodiesPerPart)) << number;
}

// The last whole instant is looked for once, not for each link again: of the most that a robot may
// have that took 256 times as long.
TEST_F(ProveRobots, ManyLinksAreProvedInLittleTime) {
  fly_robot(wire::kMaxLinks, 70);
  const std::clock_t begun = std::clock();  // processor time: others may hold up this process
  const BoundsProof proof = prove(kept_);
  EXPECT_LT(std::clock() - begun, 3 * CLOCKS_PER_SEC);
  EXPECT_GT(proof.reports, 60U);
  EXPECT_EQ(proof.proved, proof.reports) << reasons_of(proof);
}

// ---- promises -----------------------------------------------------------------------------------

constexpr double kPromisedSpeed_mps = 110;

/// Peers whose bodies keep promises, and who watch the pairs of their own.
class ProvePromises : public ProveBounds {
 protected:
  /// Slower than promised; some rest.
  Motion somewhere(double side_m) {
    Motion motion;
    motion.pose.rotation = random_rotation(random_);
    for (double& x : motion.pose.translation_m) x = random_.between(0, side_m);
    motion.pose.translation_m[2] = random_.between(300, 420);
    turn_off(motion);
    return motion;
  }
  void turn_off(Motion& motion) {
    for (double& v : motion.linear_velocity_mps) v = random_.between(-60, 60);
    for (double& w : motion.angular_velocity_radps) w = random_.between(-0.5, 0.5);
    if (random_.unit() < 0.2) motion = {.pose = motion.pose};
  }
  struct Flown {
    std::unique_ptr<Session> session;
    KeptChannel* channel = nullptr;
    std::vector<std::pair<BodyId, Motion>> bodies;
    std::uint64_t made = 0;
  };
  void add_promised(Flown& peer, std::size_t of, double side_m) {
    const std::string name = "q" + std::to_string(of) + "/" + std::to_string(++peer.made);
    // One of three makes no promises.
    const double speed_mps = peer.made % 3 == 2 && mixes_ ? 0 : kPromisedSpeed_mps;
    peer.bodies.emplace_back(
        peer.session
            ->add_body({.name = name, .model = "aircraft", .own = true, .max_speed_mps = speed_mps})
            .value(),
        somewhere(side_m));
  }
  void fly_promised(std::uint64_t frames, std::size_t count, std::size_t bodies, double side_m) {
    std::vector<Flown> peers(count);
    for (std::size_t i = 0; i < count; ++i) {
      auto channel = std::make_unique<KeptChannel>(world_.bus.make_peer(kFirst + i), kept_);
      peers[i].channel = channel.get();
      peers[i].session = std::make_unique<Session>(
          std::move(channel), subscriber::SessionOptions{.max_pose_age_s = 4 * kFrame_s - 0.001,
                                                         .lookahead_s = 0.2,
                                                         .promise_s = 1,
                                                         .margin_m = 1});
      Session& session = *peers[i].session;
      session.watch_own();
      session.discover_bodies();
      EXPECT_TRUE(
          session.place_body(session.add_body({.name = "ground", .model = "terrain"}).value(), {})
              .is_ok());
      for (std::size_t k = 0; k < bodies; ++k) add_promised(peers[i], i, side_m);
    }
    for (std::uint64_t frame = 0; frame < frames; ++frame) {
      world_.bus.tick();
      world_.service().step(static_cast<double>(frame + 1));
      for (std::size_t i = 0; i < count; ++i) {
        Flown& peer = peers[i];
        if (on_frame_) on_frame_(peer, frame);
        if (comes_and_goes_ && random_.unit() < 0.1) {
          EXPECT_TRUE(peer.session->remove_body(peer.bodies.back().first).is_ok());
          peer.bodies.pop_back();
          add_promised(peer, i, side_m);
        }
        std::vector<Session::OwnMotion> own;
        for (auto& [body, motion] : peer.bodies) {
          if (frame > 0) motion.pose = moved(motion, kFrame_s);
          if (random_.unit() < 0.05) turn_off(motion);
          own.push_back({body, motion});
        }
        const auto report =
            peer.session->update(frame, static_cast<double>(frame) * kFrame_s, own, 1);
        ASSERT_TRUE(report.is_ok()) << report.status().message();
        said_ += report.value().free_by_bounds.pairs;
        by_promise_ += report.value().promised;
      }
    }
  }
  [[nodiscard]] std::uint64_t posed() const {
    std::uint64_t count = 0;
    for (const KeptSample& sample : kept_)
      if (const auto* report = sample.as<wire::BoundsReport>())
        for (const auto& heard : report->heard) count += heard.posed.size();
    return count;
  }
  template <class Message>
  [[nodiscard]] std::vector<std::size_t> places_of() const {
    std::vector<std::size_t> places;
    for (std::size_t i = 0; i < kept_.size(); ++i)
      if (kept_[i].as<Message>() != nullptr) places.push_back(i);
    return places;
  }

  bool mixes_ = true, comes_and_goes_ = true;
  std::function<void(Flown&, std::uint64_t)> on_frame_;
  std::uint64_t by_promise_ = 0;
};

TEST_F(ProvePromises, AllThatPeersSayOfOwnPairsIsProved) {
  fly_promised(80, 4, 6, 2500);
  EXPECT_GT(by_promise_, 1000U);
  EXPECT_GT(posed(), 100U);
  const BoundsProof proof = prove(kept_);
  EXPECT_GT(proof.reports, 300U);
  EXPECT_EQ(proof.proved, proof.reports) << reasons_of(proof);
  EXPECT_GT(said_, 20'000U);
  EXPECT_EQ(proof.broken, 0U) << proof.first_broken;
  EXPECT_GT(proof.near_pairs, 50U);
  EXPECT_EQ(proof.unreported, 0U) << proof.first_unreported;
}

/// As sessions number them that have said so much before: what follows the highest is 1 again. 0 is
/// no number.
std::uint32_t number_after(std::uint32_t sequence, std::uint32_t before) {
  if (sequence == 0) return 0;
  constexpr std::uint64_t kNumbers = std::numeric_limits<std::uint32_t>::max();
  return static_cast<std::uint32_t>((std::uint64_t{sequence} - 1 + before) % kNumbers) + 1;
}
KeptSamples after(KeptSamples samples, std::uint32_t before) {
  const auto shift = [before](std::uint32_t& sequence) {
    sequence = number_after(sequence, before);
  };
  for (KeptSample& sample : samples) {
    if (auto* poses = sample.as<wire::BodyPoses>()) shift(poses->sequence);
    if (auto* near = sample.as<wire::NearPoses>()) shift(near->sequence);
    if (auto* promises = sample.as<wire::BodyPromises>()) shift(promises->sequence);
    if (auto* report = sample.as<wire::BoundsReport>())
      for (wire::BoundsReport::Heard& heard : report->heard) {
        shift(heard.poses);
        shift(heard.promises);
        shift(heard.near);
        for (wire::BoundsReport::Heard::Posed& posed : heard.posed) shift(posed.sequence);
      }
  }
  return samples;
}

// A mover of many bodies comes to the highest number in a day. What follows it was said later, and
// nothing is missing between them.
TEST_F(ProvePromises, NumbersThatBeginAgainAreProvedAsThoseBefore) {
  fly_promised(80, 4, 6, 2500);
  EXPECT_GT(posed(), 100U);
  const BoundsProof whole = prove(kept_);
  ASSERT_EQ(whole.proved, whole.reports) << reasons_of(whole);
  for (const std::uint32_t left : {1, 7, 40, 200}) {
    const BoundsProof proof = prove(after(kept_, std::numeric_limits<std::uint32_t>::max() - left));
    EXPECT_EQ(proof.proved, proof.reports) << left << "\n" << reasons_of(proof);
    EXPECT_EQ(proof.digest, whole.digest) << left;
    EXPECT_EQ(proof.broken, 0U) << left;
  }
}

TEST_F(ProvePromises, WhereNumbersBeginAgainAForgedPoseIsWrongAndALostOneIsNot) {
  fly_promised(20, 1, 6, 4000);
  const std::vector<std::size_t> near = places_of<wire::NearPoses>();
  ASSERT_GT(near.size(), 10U);
  const std::size_t middle = near[near.size() / 2];
  // Numbers end before it, and after it.
  for (const std::size_t left : {near.size() / 2 - 1, near.size() / 2, near.size() / 2 + 1}) {
    const auto before =
        std::numeric_limits<std::uint32_t>::max() - static_cast<std::uint32_t>(left);
    ASSERT_EQ(prove(after(kept_, before)).wrong, 0U);
    KeptSamples forged = after(kept_, before);
    for (wire::BodyPoses::Body& body : forged[middle].as<wire::NearPoses>()->bodies)
      body.motion.pose.translation_m[1] += 1e-3;
    EXPECT_EQ(prove(forged).wrong, 1U) << left;
    KeptSamples lost = after(kept_, before);
    lost.erase(lost.begin() + static_cast<std::ptrdiff_t>(middle));
    EXPECT_EQ(prove(lost).wrong, 0U) << left;
    EXPECT_EQ(prove(lost).unprovable, 1U) << left;
  }
}

TEST_F(ProvePromises, OfAHundredPeersAllIsProved) {
  mixes_ = comes_and_goes_ = false;
  fly_promised(30, 100, 3, 30'000);
  EXPECT_GT(by_promise_, 500'000U);
  const BoundsProof proof = prove(kept_);
  EXPECT_GT(proof.reports, 2800U);
  EXPECT_EQ(proof.proved, proof.reports) << reasons_of(proof);
  EXPECT_EQ(proof.proved_pairs, proof.pairs);
  EXPECT_GT(proof.proved_pairs, 2'000'000U);
  EXPECT_EQ(proof.unreported, 0U) << proof.first_unreported;
}

TEST_F(ProvePromises, WhatRestsOnALostPromiseIsNotProvableAndNeverWrong) {
  fly_promised(60, 3, 4, 4000);
  const BoundsProof whole = prove(kept_);
  ASSERT_EQ(whole.proved, whole.reports) << reasons_of(whole);
  const std::vector<std::size_t> promises = places_of<wire::BodyPromises>();
  ASSERT_GT(promises.size(), 4U);
  KeptSamples some = kept_;
  some.erase(some.begin() + static_cast<std::ptrdiff_t>(promises[promises.size() / 2]));
  const BoundsProof one = prove(some);
  EXPECT_EQ(one.wrong, 0U) << reasons_of(one);
  EXPECT_GT(one.unprovable, 5U);
  EXPECT_GT(one.proved, one.reports / 2);
  std::erase_if(some, [](const KeptSample& s) { return s.as<wire::BodyPromises>() != nullptr; });
  const BoundsProof none = prove(some);
  EXPECT_EQ(none.wrong, 0U) << reasons_of(none);
  // But for those that rest on none.
  EXPECT_LT(none.proved, 5U);
  EXPECT_EQ(none.unprovable, none.reports - none.proved);
}

TEST_F(ProvePromises, WhatPeersNeverHeardIsNotHeldAgainstThem) {
  world_.bus.on_promises = {.lose = 0.3, .repeat = 0.2, .max_delay = 5};
  world_.bus.on_poses = {.lose = 0.2, .repeat = 0.2, .max_delay = 2};
  fly_promised(80, 3, 5, 2500);
  const BoundsProof proof = prove(kept_);
  EXPECT_EQ(proof.wrong, 0U) << reasons_of(proof);
  EXPECT_GT(proof.proved, 10U);
  EXPECT_EQ(proof.broken, 0U) << proof.first_broken;
}

TEST_F(ProvePromises, AForgedPromiseIsFoundWrong) {
  fly_promised(60, 3, 4, 4000);
  const std::vector<std::size_t> promises = places_of<wire::BodyPromises>();
  for (const std::int64_t quanta : {1, 3, 100}) {
    KeptSamples forged = kept_;
    auto& promise = *forged[promises[promises.size() / 2]].as<wire::BodyPromises>();
    for (wire::BodyPromises::Body& body : promise.bodies) body.place[0] += quanta;
    const BoundsProof proof = prove(forged);
    // Who built on it built on another one.
    EXPECT_GT(proof.unprovable, 5U);
    EXPECT_EQ(proof.wrong, 0U) << reasons_of(proof);
    if (quanta < 3) continue;
    EXPECT_GT(proof.broken, 0U);
    EXPECT_NE(proof.first_broken.find("from its promised place"), std::string::npos)
        << proof.first_broken;
  }
}

TEST_F(ProvePromises, AForgedReportIsFoundWrong) {
  fly_promised(40, 3, 4, 4000);
  ASSERT_EQ(prove(kept_).unprovable, 0U);
  const auto expect_wrong = [&](const char* what, const auto& change) {
    const BoundsProof proof = prove_changed(change);
    EXPECT_EQ(proof.wrong, 1U) << what << "\n" << reasons_of(proof);
    EXPECT_EQ(proof.proved, proof.reports - 1) << what;
  };
  expect_wrong("pairs", [](wire::BoundsReport& report) { ++report.pairs; });
  expect_wrong("clearance", [](wire::BoundsReport& report) {
    report.clearance_m = std::nextafter(report.clearance_m, 1e9F);
  });
  expect_wrong("horizon", [](wire::BoundsReport& report) { report.horizon_s = 1e9F; });
  const auto expect_unprovable = [&](const char* what, const auto& change) {
    const BoundsProof proof = prove_changed(change);
    EXPECT_EQ(proof.unprovable, 1U) << what << "\n" << reasons_of(proof);
    EXPECT_EQ(proof.proved, proof.reports - 1) << what;
  };
  const auto every = [](wire::BoundsReport& report, const auto& change) {
    for (wire::BoundsReport::Heard& heard : report.heard) change(heard);
  };
  using Heard = wire::BoundsReport::Heard;
  expect_unprovable("promises", [&](wire::BoundsReport& report) {
    every(report, [](Heard& heard) { heard.promises = 1; });
  });
  expect_unprovable("no promises", [&](wire::BoundsReport& report) {
    every(report, [](Heard& heard) { heard.promises = 0; });
  });
  expect_unprovable("digest", [](wire::BoundsReport& report) { ++report.places_digest; });
  expect_unprovable("movers", [](wire::BoundsReport& report) { report.heard.pop_back(); });
}

// Of a peer that hears nobody all that it says follows from its own poses.
TEST_F(ProvePromises, AForgedPoseOfAnOwnBodyIsFoundWrong) {
  fly_promised(20, 1, 6, 4000);
  ASSERT_EQ(prove(kept_).wrong, 0U);
  const std::vector<std::size_t> near = places_of<wire::NearPoses>();
  ASSERT_GT(near.size(), 10U);
  KeptSamples forged = kept_;
  for (wire::BodyPoses::Body& body : forged[near[near.size() / 2]].as<wire::NearPoses>()->bodies)
    body.motion.pose.translation_m[1] += 1e-3;
  const BoundsProof proof = prove(forged);
  EXPECT_EQ(proof.wrong, 1U) << reasons_of(proof);
  KeptSamples lost = kept_;
  lost.erase(lost.begin() + static_cast<std::ptrdiff_t>(near[near.size() / 2]));
  EXPECT_EQ(prove(lost).unprovable, 1U);
  EXPECT_EQ(prove(lost).wrong, 0U);
}

TEST_F(ProvePromises, PosesGoOutOnceSomebodyRecords) {
  comes_and_goes_ = false;
  on_frame_ = [](Flown& peer, std::uint64_t frame) {
    peer.channel->records = frame >= 20;
    peer.channel->recorder_comes = frame == 20;
  };
  fly_promised(40, 2, 4, 20'000);
  std::uint64_t before = 0, after = 0;
  for (const KeptSample& sample : kept_)
    if (const auto* poses = sample.as<wire::NearPoses>()) ++(poses->frame < 20 ? before : after);
  EXPECT_EQ(before, 0U);
  EXPECT_GE(after, 40U);
  const BoundsProof proof = prove(kept_);
  EXPECT_EQ(proof.wrong, 0U) << reasons_of(proof);
  EXPECT_GE(proof.unprovable, 36U);
  EXPECT_EQ(proof.proved + proof.unprovable, proof.reports);
  EXPECT_EQ(proof.proved, 40U) << reasons_of(proof);
}

TEST_F(ProveBounds, WhatTheHostHeardElsewhereIsNotProvable) {
  Session session(std::make_unique<KeptChannel>(world_.bus.make_peer(kFirst), kept_),
                  {.lookahead_s = 0.2});
  session.watch_all();
  const BodyId own = session.add_body({.name = "own", .model = "aircraft", .own = true}).value(),
               other = session.add_body({.name = "other", .model = "aircraft"}).value();
  Motion far;
  far.pose.translation_m[0] = 5000;
  for (std::uint64_t frame = 0; frame < 6; ++frame) {
    const std::vector<Session::HeardPose> heard = {
        {.body = other, .time_s = static_cast<double>(frame) * kFrame_s, .motion = far}};
    if (frame >= 2) {
      ASSERT_TRUE(session.hear(heard).is_ok());
    }
    world_.round(session, frame, {{own, Motion{}}});
  }
  const BoundsProof proof = prove(kept_);
  EXPECT_GT(proof.reports, 2U);
  EXPECT_EQ(proof.unprovable, proof.reports) << reasons_of(proof);
}

TEST_F(ProveBounds, FarBodiesCostSixtyBytesAFrame) {
  Session session(std::make_unique<KeptChannel>(world_.bus.make_peer(kFirst), kept_),
                  {.lookahead_s = 0.2});
  session.watch_all();
  std::vector<Session::OwnMotion> own;
  for (int i = 0; i < 100; ++i) {
    const BodyId id =
        session.add_body({.name = "b" + std::to_string(i), .model = "aircraft", .own = true})
            .value();
    own.push_back({id, {}});
    own.back().motion.pose.translation_m[0] = 1000.0 * i;
  }
  for (std::uint64_t frame = 0; frame < 5; ++frame) world_.round(session, frame, own);
  const wire::BoundsReport* last = kept_.back().as<wire::BoundsReport>();
  ASSERT_NE(last, nullptr);
  EXPECT_EQ(last->pairs, 4950U);
  EXPECT_LE(wire::encode_payload(*last).size(), 60U);
  // And what it watches is said once.
  EXPECT_EQ(
      std::count_if(kept_.begin(), kept_.end(),
                    [](const KeptSample& s) { return s.as<wire::WatchedBodies>() != nullptr; }),
      2);
}

TEST(FloatAtMost, IsNoMoreThanTheNumberAndTheNextFloatIs) {
  Random random(5);
  for (int i = 0; i < 1000; ++i) {
    const double number =
        random.between(0, 1) / 3 * std::ldexp(1.0, static_cast<int>(random.below(60)));
    const float down = float_at_most(number);
    EXPECT_LE(double{down}, number);
    EXPECT_GT(double{std::nextafter(down, std::numeric_limits<float>::infinity())}, number);
  }
  EXPECT_EQ(float_at_most(1e300), std::numeric_limits<float>::max());
  EXPECT_EQ(float_at_most(0), 0);
}

}  // namespace
}  // namespace nearmesh
