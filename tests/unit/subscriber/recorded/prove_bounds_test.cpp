// SPDX-License-Identifier: Apache-2.0
// Sessions that watch all pairs are recorded, and what bounds proved free is proved again; what was forged, lost or said by strangers is
// found out.
#include "subscriber/recorded/prove_bounds.hpp"

#include <unistd.h>

#include <algorithm>
#include <filesystem>

#include "core/broadphase/free_pairs.hpp"
#include "core/world/pages.hpp"
#include "core/world/world_folder.hpp"
#include "nearmesh/subscriber/peer/local_channel.hpp"
#include "subscriber/recorded/verify.hpp"
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

  ProveBounds() {
    std::string name = ::testing::TempDir() + "nearmesh_bounds_XXXXXX";
    EXPECT_NE(::mkdtemp(name.data()), nullptr);
    folder_ = name;
    world_.start_publisher();
  }
  ~ProveBounds() override { std::filesystem::remove_all(folder_); }

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
  /// What the peers say of frames in which bodies fly, rest, jump, are not heard of for a while, come and go.
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
  std::string folder_;
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

// A pair that bounds do not prove free and that nobody answered for must not be passed over.
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
  // Those of before a recorder came are not missed, and neither are those that end with the recording.
  KeptSamples late = without([&](const auto& report) { return report.frame < lost.frame; });
  EXPECT_GT(prove(late).unreported, 0U);
  EXPECT_EQ(prove(late, kFirst).unreported, 0U);
  KeptSamples cut(kept_.begin(), kept_.begin() + static_cast<std::ptrdiff_t>(middle));
  EXPECT_EQ(prove(cut).unreported, 0U);
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
    if (!sample.batch.bytes.empty() || sample.as<wire::BoundsReport>() != nullptr ||
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
  // One has flown, had bodies that went, and other orders; both end with the same bodies in the same places.
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
    if (sample.batch.bytes.empty()) without.push_back(sample);
  const BoundsProof less = prove(without);
  EXPECT_GT(less.unprovable, 5U) << reasons_of(less);
  EXPECT_EQ(less.wrong, 0U);
}

TEST_F(ProveBounds, FarBodiesCostSixtyFourBytesAFrame) {
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
  EXPECT_EQ(wire::encode_payload(*last).size(), 64U);
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
