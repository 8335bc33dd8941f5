// SPDX-License-Identifier: Apache-2.0
// A session on the memory bus is recorded and proved; recordings that were tampered with are found
// out.
#include "subscriber/recorded/verify.hpp"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <limits>

#include "nearmesh/idl/dds/payload.hpp"
#include "nearmesh/idl/messages/topics.hpp"
#include "subscriber/peer/replicas.hpp"
#include "tests/support/folder.hpp"
#include "tests/unit/subscriber/peer/world.hpp"

namespace nearmesh {
namespace {

using namespace test;
using subscriber::DetailFolder;
using subscriber::Difference;
using subscriber::VerifyReport;

constexpr wire::SessionId kOther = 0xb2;

/// What a recorder would keep, in order; to be spoilt and written.
struct Recorded {
  struct Batch {
    wire::SessionId peer;
    wire::SplitBatchMessage message;
  };
  struct Item {
    std::optional<Batch> batch;
    std::optional<wire::ContactReport> report;
    std::optional<wire::HeldDetail> held;
    std::optional<wire::RegionSubscription> asked;
  };
  std::vector<Item> items;
  std::vector<wire::MeshHeader> headers;

  /// As a recorder heard it that came after so many items.
  [[nodiscard]] Recorded from(std::size_t first) const {
    return {{items.begin() + static_cast<std::ptrdiff_t>(first), items.end()}, headers};
  }
  [[nodiscard]] std::size_t answers() const {
    return static_cast<std::size_t>(std::count_if(items.begin(), items.end(), [](const Item& item) {
      return item.report && item.report->asked;
    }));
  }
};

class Verify : public ::testing::Test {
 protected:
  static wire::MeshHeader header_of(const ServedModel& served) {
    const ModelFile file = served.open();
    const auto bytes = file.header_bytes();
    return {.name = &served == &terrain() ? "terrain" : "aircraft",
            .content_hash = file.content_hash(),
            .bytes = {bytes.begin(), bytes.end()}};
  }
  /// The headers of both models now, and each batch as the publisher of the world sends it.
  static void record_detail(World& world, Recorded& recorded) {
    for (const ServedModel* served : {&terrain(), &aircraft()})
      recorded.headers.push_back(header_of(*served));
    world.bus.batch_filter = [&](wire::SessionId peer, wire::SplitBatchMessage& batch) {
      recorded.items.push_back({.batch = Recorded::Batch{peer, batch}});
      return true;
    };
  }
  static void take_reports(World& world, Recorded& recorded) {
    for (wire::RegionSubscription& asked : world.bus.subscriptions)
      recorded.items.push_back({.asked = std::move(asked)});
    world.bus.subscriptions.clear();
    for (wire::ContactReport& report : world.bus.reports)
      recorded.items.push_back({.report = std::move(report)});
    world.bus.reports.clear();
  }
  static void take_reports_and_held(World& world, Recorded& recorded) {
    take_reports(world, recorded);
    for (wire::HeldDetail& held : world.bus.held)
      recorded.items.push_back({.held = std::move(held)});
    world.bus.held.clear();
  }
  /// Two peers that fly, each on its own, over the same ground. A recorder comes in each of these
  /// frames.
  Recorded record(SessionOptions options = quick_options(),
                  const std::set<std::size_t>& comings = {}, double budget_s = 1) {
    Recorded recorded;
    World world;
    world.judges = !options.any && options.max_pairs == kAllPairs && options.max_tests > 1000;
    world.start_publisher();
    record_detail(world, recorded);
    world.on_report = [&](const FrameReport&) { take_reports_and_held(world, recorded); };
    const Flight flight = make_flight(5), other_flight = make_flight(6);
    const auto one = world.make_peer(options);
    const auto other = world.make_peer(options, kOther);
    // In turns, several rounds a frame, so that answers change while batches come.
    std::size_t frame = 0;
    for (std::size_t i = 0; i < flight.frames(); ++i, ++frame) {
      if (comings.contains(i)) world.bus.bring_recorder();
      world.fly_frame(*one, frame, {{kOne, flight.one[i]}, {kTwo, flight.two[i]}}, 20, budget_s);
      world.fly_frame(*other, frame, {{kOne, other_flight.one[i]}, {kTwo, other_flight.two[i]}}, 20,
                      budget_s);
      for (int k = 0; goes_away && i == flight.frames() / 2 && k < 10; ++k) {
        frame += 40;  // 2 s
        Motion high, higher;
        high.pose.translation_m[2] = 50e3;
        higher.pose.translation_m[2] = 90e3;
        for (Session* session : {one.get(), other.get()})
          world.fly_frame(*session, frame, {{kOne, high}, {kTwo, higher}}, 20, budget_s);
      }
    }
    return recorded;
  }
  bool goes_away = false;  ///< in the middle: far from all for 20 s

  /// One peer moves "one" and is killed; the other, whose reports these are, asks on for three
  /// seconds.
  Recorded record_killed() {
    Recorded recorded;
    World world;
    world.start_publisher();
    record_detail(world, recorded);
    auto mover = world.make_peer(quick_options(), kOther, true, false);
    const auto watcher = world.make_peer(quick_options(), kPeer, false, true);
    const Flight flight = make_flight(5);
    constexpr std::size_t kKilled = 20;
    world.bus.keep_quiet = true;
    for (std::size_t i = 0; i < kKilled + 60; ++i) {
      const std::size_t at = std::min(i, flight.frames() - 1);
      if (i == kKilled) mover.reset();
      if (mover != nullptr) world.round(*mover, i, {{kOne, flight.one[at]}});
      world.bus.reports.clear();
      world.on_report = [&](const FrameReport&) { take_reports(world, recorded); };
      world.fly_frame(*watcher, i, {{kTwo, flight.two[at]}}, 20);
      world.on_report = nullptr;
    }
    return recorded;
  }

  /// The host hears where "one" is on a topic of its own, in floats, and hands it in: until
  /// `silent`, and again three seconds later. No pose of it is on the bus.
  Recorded record_heard(
      std::size_t silent,
      std::set<std::pair<std::array<double, 9>, std::array<double, 3>>>& heard_poses) {
    Recorded recorded;
    World world;
    world.start_publisher();
    record_detail(world, recorded);
    world.on_report = [&](const FrameReport&) { take_reports(world, recorded); };
    const auto peer = world.make_peer(quick_options(), kPeer, false, true);
    const Flight flight = make_flight(5);
    for (std::size_t i = 0; i < silent + 70; ++i) {
      const std::size_t at = std::min(i, flight.frames() - 1);
      if (i < silent || i >= silent + 60) {
        Session::HeardPose heard{kOne, static_cast<double>(i) * 0.05, flight.one[at]};
        for (double& x : heard.motion.pose.rotation) x = static_cast<float>(x);
        const Pose pose = orthonormal(heard.motion.pose);
        heard_poses.insert({pose.rotation, pose.translation_m});
        EXPECT_TRUE(peer->hear(std::span(&heard, 1)).is_ok());
      }
      world.fly_frame(*peer, i, {{kTwo, flight.two[at]}}, 20);
    }
    return recorded;
  }

  VerifyReport verify(const Recorded& recorded, unsigned threads = 1,
                      DetailFolder* models = nullptr) {
    const std::string path = folder_ + "/" + std::to_string(files_++) + ".db3";
    const wire::TopicNames names("prefix");
    auto writer =
        RecordingWriter::create(path, {1, 0, wire::kWireVersion, "prefix", "idl"}).value();
    const auto add = [&](const std::string& topic, const std::string& partition) {
      return writer->add_writer({writer->add_topic({topic, "type"}).value(), {}, partition})
          .value();
    };
    const std::uint32_t headers = add(names.of<wire::MeshHeader>(), ""),
                        reports = add(names.of<wire::ContactReport>(), ""),
                        held = add(names.of<wire::HeldDetail>(), ""),
                        asked = add(names.of<wire::RegionSubscription>(), "");
    const std::uint32_t batches =
        writer->add_topic({names.of<wire::SplitBatchMessage>(), "type"}).value();
    std::map<wire::SessionId, std::uint32_t> writers;
    const auto append = [&](std::uint32_t by, std::vector<std::uint8_t> cdr) {
      EXPECT_TRUE(writer->append({.writer = by, .cdr = std::move(cdr)}).is_ok());
    };
    for (const wire::MeshHeader& header : recorded.headers) append(headers, encode_payload(header));
    for (const Recorded::Item& item : recorded.items) {
      if (item.report) append(reports, encode_payload(*item.report));
      if (item.held) append(held, encode_payload(*item.held));
      if (item.asked) append(asked, encode_payload(*item.asked));
      if (!item.batch) continue;
      const auto [at, is_new] = writers.try_emplace(item.batch->peer, 0);
      if (is_new)
        at->second =
            writer->add_writer({batches, {}, wire::partition_of(item.batch->peer)}).value();
      append(at->second, encode_payload(item.batch->message));
    }
    EXPECT_TRUE(writer->close().is_ok());
    const auto reader = RecordingReader::open(path).value();
    const auto report = subscriber::verify(*reader, {.threads = threads, .models = models});
    EXPECT_TRUE(report.is_ok()) << report.status().message();
    return report.value();
  }

  /// A folder with the files of both models, or of one.
  std::unique_ptr<DetailFolder> models(bool with_terrain = true) {
    const std::string path = folder_ + "/models" + std::to_string(files_++);
    std::filesystem::create_directory(path);
    std::filesystem::copy_file(aircraft().open().path(), path + "/aircraft.spm");
    if (with_terrain) std::filesystem::copy_file(terrain().open().path(), path + "/terrain.spm");
    auto opened = DetailFolder::open(path);
    EXPECT_TRUE(opened.is_ok()) << opened.status().message();
    return std::move(opened).value();
  }

  const test::Folder scratch_;
  const std::string folder_ = scratch_.path();
  int files_ = 0;
};

/// The place of the first thing that a peer said it held.
std::size_t find_held(const Recorded& recorded) {
  std::size_t at = 0;
  while (at < recorded.items.size() && !recorded.items[at].held) ++at;
  EXPECT_LT(at, recorded.items.size());
  return at;
}

std::size_t find_report(const Recorded& recorded,
                        const std::function<bool(const wire::ContactReport&)>& which) {
  for (std::size_t i = 0; i < recorded.items.size(); ++i)
    if (recorded.items[i].report && which(*recorded.items[i].report)) return i;
  ADD_FAILURE() << "no such report";
  return 0;
}

using Spoil = std::function<void(wire::ContactReport&)>;

/// After the report stand copies of it, each spoilt in its own way: what it was about is the same
/// then.
Recorded with_spoilt(Recorded recorded, std::size_t at, const std::vector<Spoil>& spoils) {
  std::vector<Recorded::Item> copies(spoils.size(), recorded.items.at(at));
  for (std::size_t i = 0; i < spoils.size(); ++i) spoils[i](*copies[i].report);
  recorded.items.insert(recorded.items.begin() + static_cast<std::ptrdiff_t>(at) + 1,
                        copies.begin(), copies.end());
  return recorded;
}

void expect_sum(const VerifyReport& r) {
  EXPECT_EQ(
      r.verified + r.different + r.not_asked + r.put_off + r.lacking + r.gave_up + r.malformed,
      r.reports);
}

TEST_F(Verify, EveryAnswerComesOutAgain) {
  const Recorded recorded = record();
  const VerifyReport one = verify(recorded), two = verify(recorded, 2);
  EXPECT_EQ(one.different, 0U);
  EXPECT_EQ(one.lacking + one.gave_up + one.malformed, 0U);
  EXPECT_GT(one.verified, 200U);
  EXPECT_EQ(one.verified + one.not_asked, one.reports);
  EXPECT_EQ(one.peers, 2U);
  EXPECT_GT(one.batches, 10U);
  EXPECT_EQ(one.digest, two.digest);
  EXPECT_EQ(one.verified, two.verified);
  // Answers of all kinds that streaming has.
  std::set<std::uint8_t> statuses;
  for (const Recorded::Item& item : recorded.items)
    if (item.report && item.report->asked) statuses.insert(item.report->status);
  EXPECT_GE(statuses.size(), 3U);
}

TEST_F(Verify, ShowsTheFirstAnswerThatDiffers) {
  Recorded recorded = record();
  const std::size_t at = find_report(
      recorded, [](const wire::ContactReport& r) { return r.pairs.size() > 1 && r.frame > 3; });
  wire::ContactReport& spoilt = *recorded.items[at].report;
  const auto lost = spoilt.pairs.front();
  spoilt.pairs.front()[0].index += 1000;
  spoilt.answer_digest ^= 1;
  const VerifyReport found = verify(recorded);
  expect_sum(found);
  EXPECT_EQ(found.different, 1U);
  ASSERT_EQ(found.differences.size(), 1U);
  const Difference& first = found.differences[0];
  EXPECT_EQ(first.message, static_cast<std::int64_t>(recorded.headers.size() + at + 1));
  EXPECT_FALSE(first.state);
  EXPECT_EQ(first.recorded.frame, spoilt.frame);
  EXPECT_EQ(first.only_recorded, std::vector{spoilt.pairs.front()});
  EXPECT_EQ(first.only_found, std::vector{lost});
}

TEST_F(Verify, FindsAPoseThatWasChanged) {
  Recorded recorded = record();
  const std::size_t at = find_report(recorded, [](const wire::ContactReport& r) {
    return r.asked && r.status == 1 && r.frame > 3;
  });
  recorded.items[at].report->a.pose.translation_m[2] += 1e4;  // what touched is far away
  EXPECT_EQ(verify(recorded).different, 1U);
}

// A bound may be sought longer than is the default, and is proved then; more than can be proved is
// found.
TEST_F(Verify, FindsAClearanceThatIsTooLarge) {
  for (const double factor : {1.0, 0.5, 1 / kClearanceShare * 1.01}) {
    Recorded recorded = record();
    const std::size_t at = find_report(recorded, [](const wire::ContactReport& r) {
      return r.asked && r.status == 0 && r.clearance_m > 0 && r.frame > 3;
    });
    recorded.items[at].report->clearance_m *= factor;
    const VerifyReport found = verify(recorded);
    EXPECT_EQ(found.different, factor > 1 ? 1U : 0U) << factor;
    expect_sum(found);
  }
}

// Of what the budget put off nothing was claimed; it is counted apart.
TEST_F(Verify, WhatWasPutOffIsCountedApart) {
  Recorded recorded = record(quick_options(), {}, 0);
  const VerifyReport found = verify(recorded);
  expect_sum(found);
  EXPECT_EQ(found.different, 0U);
  EXPECT_GT(found.put_off, 100U);
  EXPECT_GT(found.verified, 100U);
  EXPECT_EQ(found.cut, 0U);
  const std::size_t at =
      find_report(recorded, [](const wire::ContactReport& r) { return r.put_off; });
  recorded.items[at].report->status = 0;
  EXPECT_EQ(verify(recorded).different, 1U);
  recorded.items[at].report->status = 3;
  recorded.items[at].report->answer_digest ^= 1;
  EXPECT_EQ(verify(recorded).different, 1U);
}

/// What a report may not say where nothing could be known: each a lie by itself.
std::vector<Spoil> claims() {
  using Report = wire::ContactReport;
  return {
      [](Report& r) { r.status = 0; },
      [](Report& r) { r.status = 2; },
      [](Report& r) { r.pair_count = 1'000'000; },
      [](Report& r) {
        r.pair_count = wire::kMaxReportPairs;
        r.pairs.assign(wire::kMaxReportPairs, {FaceKey{VertexId{1}, 0}, FaceKey{VertexId{2}, 0}});
      },
      [](Report& r) { r.clearance_m = 1000; },
      [](Report& r) { r.uncertainty_m = 0.25; },
      [](Report& r) { r.uncertainty_m = 0; },
      [](Report& r) { r.answer_digest ^= 1; }};
}

TEST_F(Verify, WhatHasNoAnswerClaimsNothing) {
  // As a session says it before a header has come.
  wire::ContactReport not_asked{.peer = kPeer, .body_a = "ground", .body_b = "one", .frame = 3};
  not_asked.status = static_cast<std::uint8_t>(AnswerStatus::kUncertain);
  not_asked.uncertainty_m = std::numeric_limits<double>::max();
  not_asked.answer_digest = digest(nothing_known());
  Recorded flown = record();
  flown.items.push_back({.report = not_asked});
  struct Kind {
    const char* name;
    Recorded recorded;
    std::function<bool(const wire::ContactReport&)> is_it;
    const char* why;
  };
  const Kind kinds[] = {{"not asked", std::move(flown),
                         [](const wire::ContactReport& r) {
                           return !r.asked && !r.put_off && r.b.stamp.mover == wire::Mover::kNone;
                         },
                         "nothing was asked; and yet recorded "},
                        {"put off", record(quick_options(), {}, 0),
                         [](const wire::ContactReport& r) { return r.put_off; },
                         "not asked within the budget; and yet recorded "},
                        {"stale", record_killed(),
                         [](const wire::ContactReport& r) {
                           return r.b.stamp.mover == wire::Mover::kThere &&
                                  age_s(r.b.stamp, r.time_s) > 2;
                         },
                         "more than 2 s; and yet recorded "}};
  for (const Kind& kind : kinds) {
    SCOPED_TRACE(kind.name);
    const VerifyReport kept = verify(kind.recorded);
    EXPECT_EQ(kept.different, 0U);
    const std::vector<Spoil> all = claims();
    const VerifyReport found =
        verify(with_spoilt(kind.recorded, find_report(kind.recorded, kind.is_it), all));
    expect_sum(found);
    EXPECT_EQ(found.different, all.size());
    EXPECT_EQ(found.verified + found.not_asked + found.put_off,
              kept.verified + kept.not_asked + kept.put_off);
    for (const Difference& difference : found.differences)
      EXPECT_NE(difference.what.find(kind.why), std::string::npos) << difference.what;
  }
}

// A report that says of itself that it has nothing to rest on, and is made up from nothing.
TEST_F(Verify, AMadeUpReportWithoutAnAnswerIsFound) {
  Recorded recorded = record();
  wire::ContactReport forged{.peer = kPeer, .body_a = "ground", .body_b = "one", .frame = 3};
  forged.clearance_m = 1000;
  recorded.items.push_back({.report = forged});
  const VerifyReport found = verify(recorded);
  expect_sum(found);
  EXPECT_EQ(found.different, 1U);
  ASSERT_EQ(found.differences.size(), 1U);
  EXPECT_NE(found.differences[0].what.find("nothing was asked; and yet recorded free"),
            std::string::npos)
      << found.differences[0].what;
}

// What the host's options ended is proved pair by pair: whatever the options were, which the report
// does not tell.
TEST_F(Verify, WhatWasCutIsProvedAsFarAsItGoes) {
  for (const int how : {0, 1, 2, 3}) {
    SCOPED_TRACE(how);
    SessionOptions options = quick_options();
    if (how == 0) options.any = true;
    if (how == 1) options.max_pairs = 2;
    if (how == 2) options.max_pairs = 0;
    if (how == 3) options.max_tests = 300;
    Recorded recorded = record(options);
    const VerifyReport found = verify(recorded);
    expect_sum(found);
    EXPECT_EQ(found.different, 0U);
    EXPECT_GT(found.cut, 3U);
    EXPECT_GT(found.verified, found.cut);
    const auto is_cut = [](const wire::ContactReport& r) { return r.cut && r.pair_count > 0; };
    const std::size_t at = find_report(recorded, is_cut);
    ASSERT_LT(at, recorded.items.size());
    wire::ContactReport& report = *recorded.items[at].report;
    const wire::ContactReport kept = report;
    report.a.pose.translation_m[2] += 1e4;  // what touched is far away
    EXPECT_EQ(verify(recorded).different, 1U);
    report = kept;
    report.status = 0;
    EXPECT_EQ(verify(recorded).different, 1U);
    report = kept;
    if (report.status == 1 && how != 0) {
      report.pair_count += 2;
      EXPECT_EQ(verify(recorded).different, 1U);
    }
    report = kept;
    if (kept.pairs.empty()) continue;
    report = kept;
    report.pairs.front()[0] = {VertexId{123456789}, 77};
    EXPECT_EQ(verify(recorded).different, 1U);
    report = kept;
    report.pairs.front()[0].index = 1U << 30U;
    EXPECT_EQ(verify(recorded).different, 1U);
  }
}

// Of each status that a cut answer has in these flights, with a bound or without.
TEST_F(Verify, WhatACutAnswerSaysBesidesItsPairsIsProved) {
  using Report = wire::ContactReport;
  using Kind = std::pair<AnswerStatus, bool>;  // and whether it has a bound
  std::set<Kind> seen;
  for (const int how : {0, 1, 2, 3}) {
    SessionOptions options = quick_options();
    if (how == 0) options.any = true;
    if (how == 1) options.max_pairs = 2;
    if (how == 2) options.max_pairs = 0;
    if (how == 3) options.max_tests = 300;
    const Recorded recorded = record(options);
    const VerifyReport kept = verify(recorded);
    ASSERT_EQ(kept.different, 0U) << how;
    std::map<Kind, std::size_t> first;  // place of such a report
    for (std::size_t i = 0; i < recorded.items.size(); ++i)
      if (const auto& report = recorded.items[i].report; report && report->asked && report->cut)
        first.emplace(Kind(static_cast<AnswerStatus>(report->status),
                           report->uncertainty_m < std::numeric_limits<double>::max()),
                      i);
    for (const auto& [kind, at] : first) {
      const auto& [status, has_bound] = kind;
      SCOPED_TRACE("options " + std::to_string(how) + ", " + to_string(status) +
                   (has_bound ? ", with a bound" : ""));
      seen.insert(kind);
      std::vector<Spoil> spoils = {[](Report& r) { r.pair_count += 1'000'000; },
                                   [](Report& r) { r.clearance_m = 1; },
                                   [](Report& r) { r.uncertainty_m = 1e-6; }};
      if (has_bound && status != AnswerStatus::kContact)
        spoils.emplace_back([](Report& r) { r.uncertainty_m /= 2; });
      if (status == AnswerStatus::kPartial) {
        spoils.emplace_back([](Report& r) {
          r.pair_count = 0;
          r.pairs.clear();
        });
        if (has_bound) spoils.emplace_back([](Report& r) { ++r.pair_count; });
      }
      const VerifyReport found = verify(with_spoilt(recorded, at, spoils));
      expect_sum(found);
      EXPECT_EQ(found.different, spoils.size());
      EXPECT_EQ(found.verified, kept.verified);
      EXPECT_EQ(found.cut, kept.cut);
    }
  }
  EXPECT_TRUE(seen.contains({AnswerStatus::kContact, true}));
  EXPECT_TRUE(seen.contains({AnswerStatus::kPartial, false})) << "max_tests";
  EXPECT_TRUE(seen.contains({AnswerStatus::kUncertain, true})) << "any";
  EXPECT_TRUE(seen.contains({AnswerStatus::kUncertain, false})) << "max_tests";
}

TEST_F(Verify, FindsABatchThatWasChanged) {
  Recorded recorded = record();
  for (Recorded::Item& item : recorded.items)
    if (item.batch && item.batch->peer == kOther && item.batch->message.bytes.size() > 100) {
      item.batch->message.bytes[60] ^= 0x10;
      break;
    }
  const VerifyReport found = verify(recorded);
  expect_sum(found);
  ASSERT_GT(found.different, 0U);
  for (const Difference& difference : found.differences)
    EXPECT_EQ(difference.recorded.peer, kOther);
}

TEST_F(Verify, LostBatchLeavesTheRestOfThatPeerUncompared) {
  Recorded recorded = record();
  std::size_t seen = 0;
  std::erase_if(recorded.items, [&](const Recorded::Item& item) {
    return item.batch && item.batch->peer == kPeer && ++seen == 5;
  });
  const VerifyReport found = verify(recorded);
  expect_sum(found);
  EXPECT_EQ(found.different, 0U);
  EXPECT_GT(found.lacking, 20U);
  EXPECT_GT(found.verified, 100U);  // the other peer, and what came before
}

TEST_F(Verify, WithoutAHeaderNothingIsCompared) {
  Recorded recorded = record();
  recorded.headers.clear();
  const VerifyReport found = verify(recorded);
  expect_sum(found);
  EXPECT_EQ(found.verified + found.different, 0U);
  EXPECT_GT(found.lacking, 200U);
}

TEST_F(Verify, AnswersThatAgeMadeUncertainComeOutAgain) {
  const Recorded recorded = record_killed();
  std::uint64_t aged = 0;
  for (const Recorded::Item& item : recorded.items)
    if (item.report && item.report->b.stamp.mover == wire::Mover::kThere &&
        age_s(item.report->b.stamp, item.report->time_s) > 2) {
      EXPECT_EQ(item.report->status, static_cast<std::uint8_t>(AnswerStatus::kUncertain));
      EXPECT_FALSE(item.report->asked);
      ++aged;
    }
  EXPECT_GT(aged, 15U);
  const VerifyReport found = verify(recorded);
  expect_sum(found);
  EXPECT_EQ(found.different, 0U);
  EXPECT_EQ(found.verified + found.not_asked, found.reports);
  EXPECT_LT(found.not_asked, 60U);
}

TEST_F(Verify, FindsAnAnswerThatAnAgedPoseDoesNotAllow) {
  const Recorded recorded = record_killed();
  const std::size_t at = find_report(recorded, [](const wire::ContactReport& r) {
    return r.asked && r.body_b == "one" && r.status == 0 && r.frame > 10;
  });
  ASSERT_EQ(verify(recorded).different, 0U);
  const auto first_difference = [&](const std::function<void(wire::ContactReport&)>& spoil) {
    Recorded spoilt = recorded;
    spoil(*spoilt.items[at].report);
    const VerifyReport found = verify(spoilt);
    expect_sum(found);
    EXPECT_EQ(found.different, 1U);
    return found.differences.empty() ? std::string() : found.differences[0].what;
  };
  EXPECT_NE(first_difference([](wire::ContactReport& r) {
              r.b.stamp.time_s -= 2.5;
            }).find("s old, more than 2 s; and yet recorded free"),
            std::string::npos);
  EXPECT_NE(first_difference([](wire::ContactReport& r) {
              r.b.stamp.mover = wire::Mover::kSilent;
            }).find("the peer that moves body one gives no sign of life; and yet"),
            std::string::npos);
  // Nobody asks about a body without a pose.
  EXPECT_NE(first_difference([](wire::ContactReport& r) {
              r.b.stamp.mover = wire::Mover::kNone;
            }).find("no pose of body one has come; and yet recorded free"),
            std::string::npos);
  // An uncertain answer for age, said to be something else.
  const std::size_t aged = find_report(recorded, [](const wire::ContactReport& r) {
    return r.b.stamp.mover == wire::Mover::kThere && age_s(r.b.stamp, r.time_s) > 2;
  });
  Recorded spoilt = recorded;
  spoilt.items[aged].report->status = 0;
  EXPECT_EQ(verify(spoilt).different, 1U);
}

// Poses that the host heard elsewhere are in no message of the bus: a report carries them, so its
// answer is proved as others are.
TEST_F(Verify, AnswersAboutPosesThatTheHostHeardComeOutAgain) {
  std::set<std::pair<std::array<double, 9>, std::array<double, 3>>> heard;
  const Recorded recorded = record_heard(40, heard);
  std::map<std::uint8_t, int> asked;
  int aged = 0;
  for (const Recorded::Item& item : recorded.items) {
    if (!item.report || (item.report->body_a != "one" && item.report->body_b != "one")) continue;
    const bool is_a = item.report->body_a == "one";
    const wire::ContactReport::Asked& one = is_a ? item.report->a : item.report->b;
    if (item.report->asked) {
      ++asked[item.report->status];
      EXPECT_TRUE(heard.contains({one.pose.rotation, one.pose.translation_m}));
    } else if (age_s(one.stamp, item.report->time_s) > 2) {
      EXPECT_EQ(item.report->status, static_cast<std::uint8_t>(AnswerStatus::kUncertain));
      ++aged;
    }
  }
  EXPECT_GT(asked[0], 20);  // free
  EXPECT_GT(asked[1], 5);   // contact
  EXPECT_GT(aged, 15);
  const VerifyReport found = verify(recorded);
  expect_sum(found);
  EXPECT_EQ(found.different, 0U);
  EXPECT_EQ(found.lacking + found.gave_up + found.malformed, 0U);
  EXPECT_EQ(found.verified + found.not_asked, found.reports);
  EXPECT_GT(found.verified, recorded.answers());  // those that age made uncertain, too

  // What was said of such a pose must be so.
  const std::size_t at = find_report(recorded, [](const wire::ContactReport& r) {
    return r.asked && r.status == 1 && (r.body_a == "one" || r.body_b == "one");
  });
  Recorded spoilt = recorded;
  wire::ContactReport& report = *spoilt.items[at].report;
  (report.body_a == "one" ? report.a : report.b).pose.translation_m[2] += 1e4;
  EXPECT_EQ(verify(spoilt).different, 1U);
}

// Where nobody listened for it.
TEST_F(Verify, GivenUpDetailIsSaidAndNotCompared) {
  SessionOptions options = quick_options();
  options.max_held_splits = 300;
  const VerifyReport found = verify(record(options));
  expect_sum(found);
  EXPECT_EQ(found.different, 0U);
  EXPECT_GT(found.gave_up, 10U);
  EXPECT_GT(found.verified, 10U);
}

TEST_F(Verify, WhatFollowsDetailThatWasGivenUpIsProvedWithoutFiles) {
  SessionOptions options = quick_options();
  options.max_held_splits = 300;
  const Recorded all = record(options, {0});
  std::set<std::uint32_t> eras;
  for (const Recorded::Item& item : all.items)
    if (item.held) eras.insert(item.held->era);
  ASSERT_GT(eras.size(), 3U);
  const VerifyReport found = verify(all, 2);
  expect_sum(found);
  EXPECT_EQ(found.different, 0U) << found.differences.front().what;
  EXPECT_EQ(found.gave_up + found.lacking, 0U);
  EXPECT_EQ(found.verified, all.answers());
  // One of the times was not heard: until the next nothing is claimed.
  Recorded unheard = all;
  std::uint32_t lost = 0;
  for (Recorded::Item& item : unheard.items)
    if (item.held && item.held->peer == kPeer && item.held->era > 0 &&
        std::exchange(lost, item.held->era) == 0)
      item.held.reset();
  ASSERT_GT(lost, 0U);
  const VerifyReport some = verify(unheard);
  expect_sum(some);
  EXPECT_EQ(some.different, 0U);
  EXPECT_GT(some.gave_up + some.lacking, 0U);
  const auto folder = models();
  const VerifyReport with_files = verify(unheard, 1, folder.get());
  EXPECT_EQ(with_files.different, 0U);
  EXPECT_GT(with_files.gave_up, 0U);
  EXPECT_GE(with_files.verified, some.verified);
}

TEST_F(Verify, WhatFollowsModelsThatNothingWasNearIsProvedWithoutFiles) {
  goes_away = true;
  const Recorded all = record(quick_options(), {0});
  std::size_t emptied = 0;
  for (const Recorded::Item& item : all.items)
    emptied += item.held && item.held->era > 0 && item.held->applied_batches > 0 ? 1 : 0;
  EXPECT_GE(emptied, 4U) << "the ground and the aircraft, of two peers";
  const VerifyReport found = verify(all, 2);
  expect_sum(found);
  EXPECT_EQ(found.different, 0U) << found.differences.front().what;
  EXPECT_EQ(found.gave_up + found.lacking, 0U);
  EXPECT_EQ(found.verified, all.answers());
}

// ---- recorders that come late -------------------------------------------------------------------

TEST_F(Verify, ALateRecorderProvesWhatFollowsWithTheModelsFiles) {
  const Recorded all = record(quick_options(), {12});
  const VerifyReport whole = verify(all);
  const Recorded late = all.from(find_held(all));
  ASSERT_GT(late.answers(), 100U);
  ASSERT_LT(late.answers(), all.answers() - 50);
  const auto folder = models();
  const VerifyReport found = verify(late, 2, folder.get());
  expect_sum(found);
  // The peer that comes second in the frame spoke up to then of what the recorder does not know.
  EXPECT_EQ(found.different, 0U) << found.differences.front().what;
  EXPECT_EQ(found.verified, late.answers());
  EXPECT_EQ(found.answers(), late.answers());
  EXPECT_TRUE(found.wanted.empty());
  EXPECT_TRUE(found.complaints.empty());
  EXPECT_EQ(whole.verified, all.answers());
}

// It was in no batch that a recorder could hear.
TEST_F(Verify, WhatCameOutOfACacheIsSaidAndProvedWithTheModelsFiles) {
  SessionOptions options = quick_options();
  options.cache_folder = folder_ + "/cache";
  static_cast<void>(record(options));
  const Recorded all = record(options, {0});
  const VerifyReport without = verify(all);
  expect_sum(without);
  EXPECT_EQ(without.different, 0U);
  EXPECT_EQ(without.wanted.size(), 2U);
  const auto folder = models();
  const VerifyReport found = verify(all, 2, folder.get());
  expect_sum(found);
  EXPECT_EQ(found.different, 0U) << found.differences.front().what;
  EXPECT_EQ(found.verified, all.answers());
}

TEST_F(Verify, ALateRecordingWithoutFilesSaysWhichItWants) {
  const Recorded all = record(quick_options(), {12});
  const Recorded late = all.from(find_held(all));
  const VerifyReport none = verify(late);
  expect_sum(none);
  EXPECT_EQ(none.verified + none.different, 0U);
  EXPECT_EQ(none.lacking, late.answers());
  ASSERT_EQ(none.wanted.size(), 2U);
  EXPECT_EQ(none.wanted.at(terrain().open().content_hash()).name, "terrain");
  EXPECT_EQ(none.wanted.at(aircraft().open().content_hash()).name, "aircraft");
  EXPECT_EQ(none.wanted.at(aircraft().open().content_hash()).reports, none.lacking);

  const auto folder = models(false);
  const VerifyReport some = verify(late, 1, folder.get());
  EXPECT_GT(some.verified, 20U);  // of the two aircraft
  EXPECT_EQ(some.different, 0U);
  ASSERT_EQ(some.wanted.size(), 1U);
  EXPECT_EQ(some.wanted.begin()->second.name, "terrain");
  EXPECT_EQ(some.wanted.begin()->second.reports, some.lacking);
}

TEST_F(Verify, NoHeaderNeedsToBeRecordedWhereTheFilesAre) {
  const Recorded all = record(quick_options(), {12});
  Recorded late = all.from(find_held(all));
  late.headers.clear();
  const auto folder = models();
  const VerifyReport found = verify(late, 1, folder.get());
  EXPECT_EQ(found.verified, late.answers());
}

TEST_F(Verify, ARecorderThatWasAwayGoesOnFromWhereItCameBack) {
  const Recorded all = record(quick_options(), {0, 20});
  std::size_t away = all.items.size() / 3, back = away;
  while (!all.items[back].held) ++back;
  Recorded recorded = all;
  recorded.items.erase(recorded.items.begin() + static_cast<std::ptrdiff_t>(away),
                       recorded.items.begin() + static_cast<std::ptrdiff_t>(back));
  ASSERT_LT(recorded.answers(), all.answers() - 20);
  const auto folder = models();
  const VerifyReport found = verify(recorded, 1, folder.get());
  EXPECT_EQ(found.verified, recorded.answers());
  EXPECT_EQ(found.different, 0U);
  // Without files as far as it was away.
  const VerifyReport without = verify(recorded);
  EXPECT_GT(without.verified, 50U);
  EXPECT_GT(without.lacking, 20U);
  EXPECT_EQ(without.verified + without.lacking, recorded.answers());
  EXPECT_TRUE(without.wanted.contains(terrain().open().content_hash()));
}

// Batches and what is said come by different ways: either may be recorded earlier than it was sent.
TEST_F(Verify, WhatIsHeldAndBatchesMayComeInAnyOrder) {
  const Recorded all = record(quick_options(), {3, 12, 13});
  const auto folder = models();
  const std::size_t first = find_held(all);
  for (const std::size_t by : {1U, 4U, 30U}) {
    for (const bool later : {false, true}) {
      SCOPED_TRACE(std::to_string(by) + (later ? " later" : " earlier"));
      Recorded shifted = all.from(first);
      auto& items = shifted.items;
      std::vector<std::size_t> places;
      for (std::size_t i = 0; i < items.size(); ++i)
        if (items[i].held) places.push_back(i);
      if (later) std::reverse(places.begin(), places.end());
      for (const std::size_t at : places) {
        const auto begin = items.begin();
        const auto place = [&](std::size_t i) { return begin + static_cast<std::ptrdiff_t>(i); };
        if (later)
          std::rotate(place(at), place(at + 1), place(std::min(at + by + 1, items.size())));
        else
          std::rotate(place(at < by ? 0 : at - by), place(at), place(at + 1));
      }
      const VerifyReport found = verify(shifted, 1, folder.get());
      expect_sum(found);
      EXPECT_EQ(found.different, 0U);
      EXPECT_EQ(found.verified, shifted.answers());
    }
  }
}

TEST_F(Verify, WithoutBatchesThatCameAfterwardsNothingIsClaimed) {
  const Recorded all = record(quick_options(), {4});
  Recorded late = all.from(find_held(all));
  std::size_t seen = 0;
  std::erase_if(late.items, [&](const Recorded::Item& item) {
    return item.batch && item.batch->peer == kPeer && ++seen == 2;
  });
  ASSERT_GT(seen, 2U);
  const auto folder = models();
  const VerifyReport found = verify(late, 1, folder.get());
  expect_sum(found);
  EXPECT_EQ(found.different, 0U);
  EXPECT_GT(found.verified, 50U);
  EXPECT_GT(found.lacking, 20U);
}

TEST_F(Verify, WhatIsHeldIsTakenForNothingElseThanItWas) {
  const Recorded all = record(quick_options(), {12});
  const Recorded late = all.from(find_held(all));
  const auto folder = models();
  const auto spoilt = [&](const std::function<void(wire::HeldDetail&)>& spoil) {
    Recorded recorded = late;
    for (Recorded::Item& item : recorded.items)
      if (item.held) spoil(*item.held);
    return verify(recorded, 1, folder.get());
  };
  for (const VerifyReport& found :
       {spoilt([](wire::HeldDetail& held) { held.state_digest ^= 1; }),
        spoilt([](wire::HeldDetail& held) { held.box_digest ^= 1; }),
        spoilt([](wire::HeldDetail& held) { held.nodes.pop_back(); })}) {
    EXPECT_EQ(found.verified + found.different, 0U);
    EXPECT_EQ(found.lacking, late.answers());
    EXPECT_EQ(found.complaints.size(), 4U);  // two peers, two models
    EXPECT_TRUE(found.wanted.empty());
  }
}

// The publisher that was lost for a while counts the peer's batches from 1 again.
TEST_F(Verify, FollowsAPublisherThatCountsAnew) {
  Recorded recorded = record();
  std::vector<wire::SplitBatchMessage*> batches;
  for (Recorded::Item& item : recorded.items)
    if (item.batch && item.batch->peer == kPeer) batches.push_back(&item.batch->message);
  // Between two requests, not while both are answered.
  const auto by_request = [](const auto* x, const auto* y) { return x->request < y->request; };
  auto anew = batches.begin() + 2;
  while (anew != batches.end() &&
         (*std::min_element(anew, batches.end(), by_request))->request <=
             (*std::max_element(batches.begin(), anew, by_request))->request)
    ++anew;
  const std::ptrdiff_t earlier = anew - batches.begin();
  ASSERT_GT(batches.end() - anew, earlier);  // beyond the numbers of before
  for (std::uint32_t number = 1; anew != batches.end(); ++anew) {
    (*anew)->sequence = number;
    number = last_sequence(**anew) + 1;
  }
  const VerifyReport found = verify(recorded);
  EXPECT_EQ(found.verified, recorded.answers());
  EXPECT_EQ(found.different + found.lacking, 0U);
}

// A recorder hears several ways: an answer may come to it before the request.
TEST_F(Verify, WhoWasAskedIsHeardThoughTheRequestIsRecordedLate) {
  Recorded recorded = record();
  // Each request goes behind the first batch that answers it.
  for (std::size_t i = recorded.items.size(); i-- > 0;) {
    if (!recorded.items[i].asked) continue;
    const wire::RegionSubscription asked = *recorded.items[i].asked;
    for (std::size_t k = i + 1; k < recorded.items.size(); ++k) {
      const auto& batch = recorded.items[k].batch;
      if (!batch || batch->peer != asked.peer || batch->message.request != asked.request) continue;
      const auto at = recorded.items.begin();
      std::rotate(at + static_cast<std::ptrdiff_t>(i), at + static_cast<std::ptrdiff_t>(i) + 1,
                  at + static_cast<std::ptrdiff_t>(k) + 1);
      break;
    }
  }
  const VerifyReport found = verify(recorded);
  EXPECT_EQ(found.verified, recorded.answers());
  EXPECT_EQ(found.different + found.lacking, 0U);
}

// Anybody can write batches to a peer: good ones, of whatever numbers, that the peer does not take
// in.
TEST_F(Verify, BatchesOfWhomNobodyAskedCountForNothing) {
  constexpr wire::SessionId kStranger = 0xc1;
  Recorded recorded;
  World world;
  world.start_publisher();
  record_detail(world, recorded);
  const auto session = world.make_peer();
  std::vector<wire::SplitBatchMessage> good;
  const auto record = world.bus.batch_filter;
  world.bus.batch_filter = [&](wire::SessionId peer, wire::SplitBatchMessage& batch) {
    if (!batch.bytes.empty() && !batch.refused) good.push_back(batch);
    return record(peer, batch);
  };
  std::size_t strange = 0;
  world.on_report = [&](const FrameReport&) {
    take_reports(world, recorded);
    for (std::size_t i = good.size() / 2; i < good.size(); ++i) {
      wire::SplitBatchMessage batch = good[i];
      batch.publisher = kStranger;
      batch.sequence = static_cast<std::uint32_t>(7 * ++strange);
      world.bus.inject(kPeer, batch);
      recorded.items.push_back({.batch = Recorded::Batch{kPeer, std::move(batch)}});
    }
  };
  const Flight flight = make_flight(5);
  for (std::size_t i = 0; i < flight.frames(); ++i)
    world.fly_frame(*session, i, {{kOne, flight.one[i]}, {kTwo, flight.two[i]}}, 20);
  EXPECT_GT(strange, 50U);
  const VerifyReport found = verify(recorded);
  EXPECT_EQ(found.different + found.lacking + found.gave_up, 0U);
  EXPECT_EQ(found.verified, recorded.answers());
}

// More than may wait, of who was asked: what follows is proved from what the peer says then that it
// holds.
TEST_F(Verify, WhatFindsNoPlaceBeginsAnEra) {
  Recorded recorded;
  World world;
  world.start_publisher();
  record_detail(world, recorded);
  world.on_report = [&](const FrameReport&) { take_reports_and_held(world, recorded); };
  std::uint32_t flood = 0, sent = 0;
  const auto record = world.bus.batch_filter;
  world.bus.batch_filter = [&](wire::SessionId peer, wire::SplitBatchMessage& batch) {
    batch.sequence += flood;
    sent = last_sequence(batch);
    return record(peer, batch);
  };
  const auto session = world.make_peer();
  world.bus.bring_recorder();
  const Flight flight = make_flight(5);
  const std::size_t middle = flight.frames() / 2;
  for (std::size_t i = 0; i < flight.frames(); ++i) {
    if (i == middle) {
      wire::SplitBatchMessage batch{.publisher = kPublisher,
                                    .content_hash = terrain().open().content_hash(),
                                    .request = 1,
                                    .bytes = {1, 2, 3}};
      for (; flood < subscriber::WaitingBatches::kMostOfOne + 100; ++flood) {
        batch.sequence = sent + flood + 1;
        world.bus.inject(kPeer, batch);
        recorded.items.push_back({.batch = Recorded::Batch{kPeer, batch}});
      }
      EXPECT_GT(world.round(*session, i, {}, 0).batches_waiting, 0U);
    }
    world.fly_frame(*session, i, {{kOne, flight.one[i]}, {kTwo, flight.two[i]}}, 200);
  }
  const auto folder = models();
  const VerifyReport found = verify(recorded, 1, folder.get());
  EXPECT_EQ(found.different, 0U);
  // The last is proved again.
  Recorded end = recorded;
  std::erase_if(end.items, [&](const Recorded::Item& item) {
    return item.report && item.report->frame + 5 < flight.frames();
  });
  const VerifyReport late = verify(end, 1, folder.get());
  EXPECT_GT(late.verified, 0U);
  EXPECT_EQ(late.verified, end.answers());
}

TEST_F(Verify, ReportsThatNeverCameAreCounted) {
  const std::string path = folder_ + "/gaps.db3";
  const wire::TopicNames names("prefix");
  auto writer = RecordingWriter::create(path, {1, 0, wire::kWireVersion, "prefix", "idl"}).value();
  const auto add = [&](const auto& topic, const std::string& name) {
    return writer->add_writer({writer->add_topic({name, std::string(topic.type)}).value(), {}, ""})
        .value();
  };
  const std::uint32_t reports =
      add(wire::topic_of<wire::ContactReport>(), names.of<wire::ContactReport>());
  const std::uint32_t poses = add(wire::topic_of<wire::BodyPoses>(), names.of<wire::BodyPoses>());
  ASSERT_TRUE(writer->add_gap({reports, 1, 9, 0}).is_ok());
  ASSERT_TRUE(writer->add_gap({reports, 20, 3, 0}).is_ok());
  ASSERT_TRUE(writer->add_gap({poses, 20, 100, 0}).is_ok());
  ASSERT_TRUE(writer->append({.writer = reports, .cdr = {1, 2, 3}}).is_ok());
  ASSERT_TRUE(writer->close().is_ok());
  const auto reader = RecordingReader::open(path).value();
  const VerifyReport found = subscriber::verify(*reader, {}).value();
  EXPECT_EQ(found.before, 9U);
  EXPECT_EQ(found.missing, 3U);
  EXPECT_EQ(found.malformed, 1U);
  EXPECT_EQ(found.answers(), 0U);
}

TEST_F(Verify, AFolderWithoutModelsIsRefusedAndFilesThatAreNoneAreTold) {
  EXPECT_EQ(DetailFolder::open(folder_ + "/none").status().code(), StatusCode::kNotFound);
  std::ofstream(folder_ + "/junk.spm") << "junk";
  std::ofstream(folder_ + "/notes.txt") << "none of ours";
  const auto opened = DetailFolder::open(folder_);
  ASSERT_TRUE(opened.is_ok());
  ASSERT_EQ(opened.value()->complaints().size(), 1U);
  EXPECT_NE(opened.value()->complaints()[0].find("junk.spm"), std::string::npos);
  EXPECT_FALSE(opened.value()->lend({0, 7}, [](ModelFile&) { ADD_FAILURE(); }));
}

}  // namespace
}  // namespace nearmesh
