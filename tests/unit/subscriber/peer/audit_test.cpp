// SPDX-License-Identifier: Apache-2.0
// Audits: a publisher that lies with care, against peers that ask for blocks with their proof.

#include <cstdio>
#include <filesystem>
#include <thread>

#include "core/base/hash.hpp"
#include "core/demand/answer.hpp"
#include "local_host.hpp"
#include "subscriber/peer/detail_cache.hpp"
#include "world.hpp"

namespace nearmesh::test {
namespace {

constexpr wire::SessionId kLiar = kPublisher + 1;

/// The model, but for one face turned round in a share of the splits: a lie that no box speaks
/// against, and that changes no answer of these flights.
SplitStore turned(const BakedModel& model, double share, std::uint64_t seed) {
  SplitStore lie(model.header);
  Random random(seed);
  for (const VertexId u : all_splits(model.store)) {
    SplitRecord record{.node = model.store.node_of(u), .split = u};
    for (std::size_t k = 0; k < 3; ++k)
      record.offset[k] = model.store.position(u)[static_cast<int>(k)] -
                         model.store.position(record.node.first)[static_cast<int>(k)];
    if (record.left().size > 1) record.left_box = model.store.box_code(record.left());
    if (record.right().size > 1) record.right_box = model.store.box_code(record.right());
    const SplitFaces own = model.store.faces(u);
    std::vector<SplitFace> faces(own.begin(), own.end());
    if (!faces.empty() && random.unit() < share) faces.front().flipped = !faces.front().flipped;
    EXPECT_TRUE(lie.insert(record, faces).is_ok());
  }
  return lie;
}

/// What a publisher does that lies of the ground: true header, true aircraft, other splits.
class Audit : public testing::Test {
 protected:
  World world;

  enum class Proves { kTruth, kNothing, kAnotherBlock };
  void start_liar(wire::SessionId id, double share, Proves proves, std::uint64_t seed = 1) {
    world.start_publisher(id);
    stores_.push_back(std::make_unique<SplitStore>(turned(terrain().model, share, seed)));
    files_.push_back(std::make_unique<ModelFile>(terrain().open()));
    world.service(id).add_answerer(
        files_.back()->content_hash(),
        [&store = *stores_.back(), &file = *files_.back(), proves,
         content = files_.back()->content_hash()](
            const RegionRequest& request) -> Result<publisher::Service::Parts> {
          const NodeSpan asked = proves == Proves::kAnotherBlock ? file.header().roots.front().node
                                                                 : request.attach.front();
          auto batches = request.is_audit() ? file.prove(asked)
                                            : answer_request(file.header(), store, request,
                                                             [](NodeSpan) { return Status::ok(); });
          if (request.is_audit() && proves == Proves::kNothing) batches.value().clear();
          NEARMESH_RETURN_IF_ERROR(batches);
          return publisher::Service::Parts([whole = std::move(batches).value(),
                                            content]() mutable -> Result<publisher::Service::Part> {
            return publisher::Service::Part{content, std::move(whole), true};
          });
        });
  }
  static SessionOptions options(std::uint64_t seed, double audit_s = 1e-9) {
    SessionOptions quick = quick_options();
    quick.audit_s = audit_s;
    quick.audit_seed = seed;
    return quick;
  }
  [[nodiscard]] std::uint64_t audits_of_ground() const {
    return static_cast<std::uint64_t>(std::count_if(
        world.bus.subscriptions.begin(), world.bus.subscriptions.end(), [](const auto& asked) {
          return asked.region.is_audit() && asked.content_hash == terrain().open().content_hash();
        }));
  }
  /// Frames until a line with that, at most so many.
  std::size_t frames_until(Session& session, const std::string& part, std::size_t most) {
    const Flight flight = make_flight(1);
    std::size_t frames = 0;
    while (frames < most && !world.has_complaint(part) && !HasFailure()) {
      const std::size_t at = frames % flight.frames();
      world.fly_frame(session, at, {{kOne, flight.one[at]}, {kTwo, flight.two[at]}}, 20);
      ++frames;
    }
    return frames;
  }

  /// The liar is named within so many frames.
  void expect_unproved(Session& session, std::size_t most) {
    frames_until(session, "does not prove what it sent, 3 audits in a row", most);
    EXPECT_TRUE(world.has_complaint("model terrain: publisher " + to_hex(kLiar) +
                                    " does not prove what it sent, 3 audits in a row"));
  }

 private:
  std::vector<std::unique_ptr<SplitStore>> stores_;
  std::vector<std::unique_ptr<ModelFile>> files_;
};

TEST_F(Audit, OfAPublisherThatTellsTheTruthFindsNothing) {
  world.start_publisher();
  const auto session = world.make_peer(options(1));
  for (std::uint64_t seed = 1; seed <= 3; ++seed)
    EXPECT_EQ(world.fly(*session, make_flight(seed)), 40U);
  EXPECT_GT(session->stats().audits, 100U);
  EXPECT_TRUE(world.complaints.empty()) << world.complaints.front();
  std::printf("%llu audits, %.0f bytes each\n",
              static_cast<unsigned long long>(session->stats().audits),
              static_cast<double>(session->stats().audit_bytes) /
                  static_cast<double>(session->stats().audits));
}

TEST_F(Audit, IsOffUnlessAskedFor) {
  start_liar(kLiar, 0.5, Proves::kTruth);
  const auto session = world.make_peer();
  EXPECT_EQ(world.fly(*session, make_flight(1)), 40U);
  EXPECT_EQ(session->stats().audit_bytes, 0U);
  EXPECT_TRUE(world.complaints.empty());
}

TEST_F(Audit, FindsWhoLiesInOnePercentOfWhatItSends) {
  start_liar(kLiar, 0.01, Proves::kTruth);
  const auto session = world.make_peer(options(1));
  frames_until(*session, "audit of the block", 2000);
  const std::string line = "model terrain: publisher " + to_hex(kLiar) +
                           " contradicts the model, its detail is forgotten and it is not asked "
                           "again: audit of the block of node [";
  ASSERT_TRUE(world.has_complaint(line));
  EXPECT_TRUE(world.has_complaint(" was told with hash "));
  EXPECT_TRUE(world.has_complaint(", the content has "));
  const auto& told = world.bus.statuses[kPeer].complaints;
  for (int i = 0; i < 2000 && told.empty(); ++i) {
    static_cast<void>(world.round(*session));
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  EXPECT_TRUE(std::any_of(told.begin(), told.end(), [&](const std::string& said) {
    return said.find("audit of the block") != std::string::npos;
  })) << "in the status too";
  std::printf("found by audit %llu\n", static_cast<unsigned long long>(audits_of_ground()));
  // Nobody else is there: nothing is certified about the ground any more. One that tells the truth
  // is asked then.
  world.start_publisher();
  EXPECT_EQ(world.fly(*session, make_flight(2)), 40U);
}

TEST_F(Audit, WhoProvesNothingIsNotAskedAgain) {
  start_liar(kLiar, 0.01, Proves::kNothing);
  const auto session = world.make_peer(options(1));
  expect_unproved(*session, 200);
  world.start_publisher();
  EXPECT_EQ(world.fly(*session, make_flight(2)), 40U);
}

// It proves the block of the first split, of which it told the truth, whatever it is asked about.
TEST_F(Audit, AnotherBlockProvesNothingOfWhatWasAsked) {
  start_liar(kLiar, 0.01, Proves::kAnotherBlock);
  const auto session = world.make_peer(options(1));
  expect_unproved(*session, 400);
  EXPECT_FALSE(world.has_complaint("contradicts"));
}

// Else the next session would begin with what the liar told.
TEST_F(Audit, WhatWhoProvesNothingToldIsNotKeptForTheNextSession) {
  const TempFile beside(".cache");
  const std::string folder = beside.path() + ".folder";
  SessionOptions with_cache = options(1);
  with_cache.cache_folder = folder;
  start_liar(kLiar, 0.01, Proves::kNothing);
  const auto session = world.make_peer(with_cache);
  frames_until(*session, "does not prove what it sent, 3 audits in a row", 200);
  ASSERT_TRUE(world.has_complaint("does not prove what it sent, 3 audits in a row"));
  ASSERT_TRUE(session->write_cache().is_ok());
  const auto kept = subscriber::read_cached(folder, terrain().open().content_hash());
  ASSERT_TRUE(kept.is_ok());
  EXPECT_FALSE(kept.value().has_value());
  std::filesystem::remove_all(folder);
}

/// How many audits it takes, by what share of the splits is false.
TEST_F(Audit, IsMeasured) {
  for (const double share : {0.1, 0.01, 0.001}) {
    std::vector<std::uint64_t> audits;
    for (std::uint64_t seed = 1; seed <= 9; ++seed) {
      world.complaints.clear();
      world.bus.subscriptions.clear();
      start_liar(kLiar, share, Proves::kTruth, seed);
      const auto session = world.make_peer(options(seed));
      frames_until(*session, "audit of the block", 600);
      audits.push_back(audits_of_ground());
      world.stop_publisher(kLiar);
    }
    std::sort(audits.begin(), audits.end());
    std::printf("%g of the splits false: found by audit %llu (least %llu, most %llu)\n", share,
                static_cast<unsigned long long>(audits[4]),
                static_cast<unsigned long long>(audits.front()),
                static_cast<unsigned long long>(audits.back()));
    if (share >= 0.01) {
      EXPECT_LT(audits[4], 100U);
    }
  }
}

}  // namespace
}  // namespace nearmesh::test
