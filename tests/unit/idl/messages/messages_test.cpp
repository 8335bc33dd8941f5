// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/idl/messages/messages.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>

#include "core/base/digest.hpp"
#include "core/base/hash.hpp"
#include "core/base/random.hpp"
#include "nearmesh/core/spm/detail/codec.hpp"
#include "tests/unit/idl/dds/samples.hpp"

namespace nearmesh::wire {
namespace {

using namespace test;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();

template <class Message>
struct Spoiled {
  const char* expected;  ///< in the complaint
  std::function<void(Message&)> spoil;
};

/// The valid message passes; each spoiled one is refused with a line that names the field.
template <class Message>
void expect_refusals(const Message& valid, const std::vector<Spoiled<Message>>& cases) {
  EXPECT_TRUE(check(valid).is_ok()) << check(valid).message();
  for (const auto& spoiled : cases) {
    Message message = valid;
    spoiled.spoil(message);
    const Status status = check(message);
    EXPECT_EQ(status.code(), StatusCode::kInvalidArgument) << spoiled.expected;
    EXPECT_NE(status.message().find(spoiled.expected), std::string::npos)
        << spoiled.expected << ": " << status.message();
  }
}

TEST(CheckMessage, RefusesHelloOutsideItsLimits) {
  expect_refusals<Hello>(
      valid_hello(),
      {{"publisher", [](Hello& m) { m.publisher = 0; }},
       {"name", [](Hello& m) { m.name = "a\nb"; }},
       {"name", [](Hello& m) { m.name = std::string(kMaxNameBytes + 1, 'x'); }},
       {"models", [](Hello& m) { m.models.resize(kMaxModels + 1, m.models[0]); }},
       {"name", [](Hello& m) { m.models[1].name = ""; }},
       {"name", [](Hello& m) { m.models[1].name = std::string(kMaxNameBytes + 1, 'x'); }},
       {"name", [](Hello& m) { m.models[1].name = "a\nb"; }},
       {"name", [](Hello& m) { m.models[1].name = std::string("a\0b", 3); }},
       {"name", [](Hello& m) { m.models[1].name = "m\xc3\xa9"; }},
       {"name", [](Hello& m) { m.models[1].name = " blank"; }},
       {"no content", [](Hello& m) { m.models[1].content_hash = {}; }},
       {"twice", [](Hello& m) { m.models[1].name = "bunny"; }}});
}

TEST(CheckMessage, TakesNamesUpToTheLimit) {
  Hello message = valid_hello();
  message.models[0].name = std::string(kMaxNameBytes, '~');
  EXPECT_TRUE(check(message).is_ok());
}

TEST(CheckMessage, RefusesHeaderOutsideItsLimits) {
  expect_refusals<MeshHeader>(
      valid_header(),
      {{"name", [](MeshHeader& m) { m.name = ""; }},
       {"no bytes", [](MeshHeader& m) { m.bytes.clear(); }},
       {"header bytes", [](MeshHeader& m) { m.bytes.resize(kMaxHeaderBytes + 1); }}});
}

TEST(CheckMessage, OfTenThousandHeadersWithOneBitChangedNoneIsAccepted) {
  Random random(1);
  MeshHeader valid = valid_header();
  valid.bytes.resize(3000);
  for (std::uint8_t& byte : valid.bytes) byte = static_cast<std::uint8_t>(random.next());
  valid.content_hash = digest_of(valid.bytes);
  ASSERT_TRUE(check(valid).is_ok());
  std::size_t accepted = 0;
  for (int i = 0; i < 10'000; ++i) {
    MeshHeader message = valid;
    const std::uint32_t bit =
        random.below(static_cast<std::uint32_t>(valid.bytes.size() * 8 + 128));
    if (bit < 64) {
      message.content_hash.high ^= std::uint64_t{1} << bit;
    } else if (bit < 128) {
      message.content_hash.low ^= std::uint64_t{1} << (bit - 64);
    } else {
      message.bytes[bit / 8 - 16] ^= static_cast<std::uint8_t>(1U << bit % 8);
    }
    accepted += check(message).is_ok() ? 1 : 0;
  }
  EXPECT_EQ(accepted, 0U);
}

TEST(CheckMessage, AHeaderProvesItsOwnContent) {
  MeshHeader other_bytes = valid_header(), other_content = valid_header();
  other_bytes.bytes[2] ^= 4;
  other_content.content_hash.high ^= 4;
  for (const MeshHeader& message : {other_bytes, other_content}) {
    EXPECT_EQ(check(message).code(), StatusCode::kCorrupt);
    EXPECT_NE(check(message).message().find(to_hex(message.content_hash)), std::string::npos);
  }
}

TEST(CheckMessage, RefusesSubscriptionOutsideItsLimits) {
  using M = RegionSubscription;
  expect_refusals<M>(
      valid_subscription(),
      {{"peer", [](M& m) { m.peer = 0; }},
       {"publisher", [](M& m) { m.publisher = 0; }},
       {"priority", [](M& m) { m.priority = 2; }},
       {"window", [](M& m) { m.window_bytes = 0; }},
       {"window", [](M& m) { m.window_bytes = 1U << 31; }},
       {"max_splits", [](M& m) { m.region.max_splits = 0; }},
       {"max_splits", [](M& m) { m.region.max_splits = kMaxRequestSplits + 1; }},
       {"attach", [](M& m) { m.region.attach[1].size = 0; }},
       {"attach", [](M& m) { m.region.attach[1].first.value = 12; }},
       {"attach", [](M& m) { std::swap(m.region.attach[0], m.region.attach[2]); }},
       {"attach",
        [](M& m) {
          m.region.attach[2] = {VertexId{0xfffffff0}, 0x20};
        }},
       {"attach",
        [](M& m) {
          m.region.attach.assign(kMaxAttachNodes + 1, {VertexId{1}, 1});
        }},
       {"box 1", [](M& m) { m.region.region[1].box.lo[2] = 7; }},
       {"radius", [](M& m) { m.region.region[1].radius = -1; }},
       {"normal", [](M& m) { m.region.region[1].normal[0] = -128; }},
       {"slab", [](M& m) { m.region.region[1].slab_hi = -9; }},
       {"extent", [](M& m) { m.region.region[1].min_extent = -1; }},
       {"boxes", [](M& m) { m.region.region.assign(kMaxRegionBoxes + 1, m.region.region[0]); }},
       {"only credit", [](M& m) { m.request = 0; }}});
}

TEST(CheckMessage, TakesCreditWithoutRegion) {
  RegionSubscription message = valid_subscription();
  message.request = 0;
  message.region = {};
  message.region.max_splits = 0;
  EXPECT_TRUE(check(message).is_ok()) << check(message).message();
}

TEST(CheckMessage, RefusesBatchOutsideItsLimits) {
  using M = SplitBatchMessage;
  expect_refusals<M>(valid_batch(), {{"publisher", [](M& m) { m.publisher = 0; }},
                                     {"sequence", [](M& m) { m.sequence = 0; }},
                                     {"bytes", [](M& m) { m.bytes.resize(kMaxSealedBytes + 1); }},
                                     {"reason", [](M& m) { m.refused = true; }}});
}

TEST(CheckMessage, RefusesJoinedBatchesOutsideTheirLimits) {
  using M = SplitBatchMessage;
  expect_refusals<M>(valid_joined_batches(),
                     {{"bytes", [](M& m) { m.joined[1].bytes.resize(kMaxSealedBytes - 8); }},
                      {"bytes",
                       [](M& m) {
                         m.joined.resize(kMaxSealedBytes / kJoinBytes, {{1, 1}, {1}});
                       }},
                      {"no bytes", [](M& m) { m.joined[0].bytes.clear(); }},
                      {"joined", [](M& m) { m.is_piece = true; }},
                      {"joined", [](M& m) {
                         m.refused = true, m.bytes = {'n', 'o'};
                       }}});
}

SplitBatchMessage batch_of(const ContentHash& content, std::size_t bytes) {
  SplitBatchMessage message = valid_batch();
  message.is_piece = message.last = false;
  message.content_hash = content;
  message.bytes.assign(bytes, static_cast<std::uint8_t>(bytes));
  return message;
}

TEST(JoinedBatches, ComeApartAsTheyWere) {
  SplitBatchMessage sample = batch_of({1, 1}, 300), second = batch_of({2, 2}, 200),
                    third = batch_of({3, 3}, 100);
  third.last = true;
  EXPECT_TRUE(join(sample, second));
  EXPECT_TRUE(join(sample, third));
  EXPECT_EQ(sample_bytes(sample), 600 + 2 * kJoinBytes + kJoinSizeBytes);
  EXPECT_EQ(last_sequence(sample), 5U);
  EXPECT_TRUE(sample.last);
  const std::vector<SplitBatchMessage> apart = take_apart(std::move(sample));
  ASSERT_EQ(apart.size(), 3U);
  for (std::uint32_t i = 0; i < 3; ++i) {
    EXPECT_EQ(apart[i].content_hash, (ContentHash{i + 1, i + 1}));
    EXPECT_EQ(apart[i].bytes.size(), 300U - 100 * i);
    EXPECT_EQ(apart[i].sequence, 3 + i);
    EXPECT_EQ(apart[i].request, 7U);
    EXPECT_EQ(apart[i].last, i == 2);
    EXPECT_TRUE(apart[i].joined.empty());
  }
}

TEST(JoinedBatches, AreOfOneAnswerAndOneDatagram) {
  const auto is_joined = [](const std::function<void(SplitBatchMessage&)>& change_first,
                            const std::function<void(SplitBatchMessage&)>& change_next) {
    SplitBatchMessage first = batch_of({1, 1}, 500), next = batch_of({2, 2}, 400);
    change_first(first);
    change_next(next);
    const SplitBatchMessage before = next;
    const bool joined = join(first, next);
    if (!joined) {
      EXPECT_EQ(next.bytes, before.bytes);
      EXPECT_TRUE(first.joined.empty());
      EXPECT_FALSE(next.last);
    }
    return joined;
  };
  const auto as_it_is = [](SplitBatchMessage&) {};
  EXPECT_TRUE(is_joined(as_it_is, as_it_is));
  EXPECT_FALSE(is_joined(as_it_is, [](auto& m) { m.request = 8; }));
  EXPECT_FALSE(is_joined(as_it_is, [](auto& m) { m.publisher = 9; }));
  EXPECT_FALSE(is_joined([](auto& m) { m.last = true; }, as_it_is)) << "nothing follows the last";
  EXPECT_FALSE(is_joined([](auto& m) { m.is_piece = true; }, as_it_is));
  EXPECT_FALSE(is_joined(as_it_is, [](auto& m) { m.is_piece = true; }));
  EXPECT_FALSE(is_joined(as_it_is, [](auto& m) { m.refused = true; }));
  constexpr std::size_t kRoom = kMaxSealedBytes - 500 - kJoinBytes - kJoinSizeBytes;
  EXPECT_TRUE(is_joined(as_it_is, [](auto& m) { m.bytes.resize(kRoom); }));
  EXPECT_FALSE(is_joined(as_it_is, [](auto& m) { m.bytes.resize(kRoom + 1); }));
}

// "All is there" needs no batch of its own where one goes before it.
TEST(JoinedBatches, AnEmptyLastOneTakesNoBytes) {
  SplitBatchMessage sample = batch_of({1, 1}, 300), last = batch_of({2, 2}, 0);
  last.last = true;
  EXPECT_TRUE(join(sample, last));
  EXPECT_TRUE(sample.last);
  EXPECT_EQ(sample_bytes(sample), 300U);
  EXPECT_EQ(last_sequence(sample), sample.sequence);
}

// What is counted ahead is what goes out.
TEST(JoinedBatches, HaveTheRoomThatIsReckonedWith) {
  Random random(3);
  SampleRoom room;
  std::size_t reckoned = 0, sent = 0;
  std::vector<SplitBatchMessage> samples;
  for (int i = 0; i < 2000; ++i) {
    SplitBatchMessage next = batch_of({1, 1}, 1 + random.below(kMaxSealedBytes));
    if (i % 2 == 1 && room.left() > 0) next.bytes.resize(room.left());
    reckoned += room.add(next.bytes.size());
    if (samples.empty() || !join(samples.back(), next)) samples.push_back(std::move(next));
  }
  for (const SplitBatchMessage& sample : samples) sent += sample_bytes(sample) + kBatchFramingBytes;
  EXPECT_EQ(reckoned, sent);
  EXPECT_LT(samples.size(), 1300U);
}

TEST(CheckMessage, TakesRefusalWithPrintableReason) {
  SplitBatchMessage message = valid_batch();
  message.refused = true;
  message.bytes = {'n', 'o', ' ', '!'};
  EXPECT_TRUE(check(message).is_ok());
}

TEST(CheckMessage, RefusesPoseOutsideItsLimits) {
  using M = BodyPose;
  expect_refusals<M>(valid_pose(),
                     {{"peer", [](M& m) { m.peer = 0; }},
                      {"body", [](M& m) { m.body = ""; }},
                      {"time_s", [](M& m) { m.time_s = kInfinity; }},
                      {"pose of robot/arm-1: time_s", [](M& m) { m.time_s = 1.8e12; }},
                      {"robot/arm-1", [](M& m) { m.pose.rotation[4] = kNan; }},
                      {"robot/arm-1", [](M& m) { m.pose.translation_m[2] = -kInfinity; }},
                      {"linear", [](M& m) { m.linear_velocity_mps[0] = kNan; }},
                      {"angular", [](M& m) { m.angular_velocity_radps[2] = 1e300; }}});
}

TEST(CheckMessage, RefusesPosesOutsideTheirLimits) {
  using M = BodyPoses;
  EXPECT_TRUE(check(valid_poses()).is_ok());
  expect_refusals<M>(valid_poses(),
                     {{"peer", [](M& m) { m.peer = 0; }},
                      {"part", [](M& m) { m.part = 1U << 30; }},
                      {"out of place", [](M& m) { m.part = 2; }},
                      {"out of place", [](M& m) { m.bodies[1].number = 28; }},
                      {"out of place", [](M& m) { m.bodies[1].number = 21; }},
                      {"pose of body 27 of peer 000000000000002a: time_s",
                       [](M& m) { m.bodies[1].time_s = kNan; }},
                      {"27", [](M& m) { m.bodies[1].motion.pose.rotation[4] = 2; }},
                      {"21", [](M& m) { m.bodies[0].motion.pose.translation_m[0] = kNan; }},
                      {"linear", [](M& m) { m.bodies[0].motion.linear_velocity_mps[0] = kNan; }}});
}

TEST(CheckMessage, RefusesPromisesOutsideTheirLimits) {
  using M = BodyPromises;
  EXPECT_TRUE(check(valid_promises()).is_ok());
  expect_refusals<M>(valid_promises(),
                     {{"peer", [](M& m) { m.peer = 0; }},
                      {"out of place", [](M& m) { m.part = 3; }},
                      {"out of place", [](M& m) { std::swap(m.bodies[0], m.bodies[1]); }},
                      {"part", [](M& m) { m.part = 1U << 30; }},
                      {"from_s", [](M& m) { m.from_s = kNan; }},
                      {"from_s", [](M& m) { m.from_s = kInfinity; }},
                      {"from_s", [](M& m) { m.from_s = 1e12; }},
                      {"to hold up to 255 s, found 0 s", [](M& m) { m.steps = 0; }},
                      {"to hold up to 255 s, found 255.004 s", [](M& m) { m.steps = 65281; }},
                      {"quantum of 2^21", [](M& m) { m.quantum = 21; }},
                      {"quantum of 2^-21", [](M& m) { m.quantum = -21; }},
                      {"too far", [](M& m) { m.bodies[2].place[0] += 1; }},
                      {"too far", [](M& m) { m.bodies[2].place[1] -= 1; }}});
}

TEST(CheckMessage, RefusesWishesOutsideTheirLimits) {
  using M = WantedPoses;
  EXPECT_TRUE(check(valid_wanted()).is_ok());
  EXPECT_TRUE(check(M{.peer = 1, .mover = 2}).is_ok());
  EXPECT_TRUE(valid_wanted().wants(27));
  EXPECT_FALSE(valid_wanted().wants(26));
  EXPECT_FALSE(valid_wanted().wants(7));
  expect_refusals<M>(valid_wanted(), {{"peer", [](M& m) { m.peer = 0; }},
                                      {"mover", [](M& m) { m.mover = 0; }},
                                      {"part 3", [](M& m) { m.parts[1].places = 0; }},
                                      {"part 3", [](M& m) { m.parts[1].places = 0x80; }},
                                      {"part 0", [](M& m) { m.parts[1].part = 0; }},
                                      {"wanted parts", [](M& m) {
                                         m.parts.resize(257, {1, 1});
                                       }}});
}

TEST(Promise, HoldsFromItsBeginToItsEndAndGrowsWithTheSpeed) {
  const BodyPromises promises = valid_promises();
  BodyDirectory::Body who{.number = 70, .name = "a", .model = "m", .max_speed_mps = 10};
  const BodyPromise promise = promise_of(promises, promises.bodies[1], who);
  EXPECT_EQ(promise.place_m, (std::array<double, 3>{-12500, 0, 8}));
  EXPECT_FALSE(promise.radius_m(1.499));
  EXPECT_NEAR(promise.radius_m(1.5).value(), 0.125, 1e-12);
  EXPECT_NEAR(promise.radius_m(9.5).value(), 80.125, 1e-9);
  EXPECT_GE(promise.radius_m(9.5).value(), 80.125);
  EXPECT_FALSE(promise.radius_m(9.501));
  EXPECT_FALSE(promise.radius_m(kNan));
}

TEST(CheckMessage, RefusesDirectoriesOutsideTheirLimits) {
  using M = BodyDirectory;
  EXPECT_TRUE(check(valid_directory()).is_ok());
  EXPECT_TRUE(check(M{.peer = 1}).is_ok());
  expect_refusals<M>(valid_directory(),
                     {{"peer", [](M& m) { m.peer = 0; }},
                      {"out of place", [](M& m) { std::swap(m.bodies[0], m.bodies[1]); }},
                      {"body:", [](M& m) { m.bodies[0].name = ""; }},
                      {"body:", [](M& m) { m.bodies[0].name = std::string(64, 'a'); }},
                      {"model name", [](M& m) { m.bodies[0].model = "a\n"; }},
                      {"max_speed_mps", [](M& m) { m.bodies[0].max_speed_mps = -1; }},
                      {"max_speed_mps", [](M& m) { m.bodies[0].max_speed_mps = kNan; }},
                      {"max_speed_mps", [](M& m) { m.bodies[0].max_speed_mps = 1.1e6; }},
                      {"twice", [](M& m) { m.bodies[0].name = m.bodies[1].name; }}});
}

TEST(CheckMessage, TakesAReportOfEachStatus) {
  ContactReport report = valid_report();
  for (std::uint8_t status = 0; status <= 4; ++status) {
    report.status = status;
    EXPECT_TRUE(check(report).is_ok()) << int{status};
  }
}

TEST(CheckMessage, RefusesReportOutsideItsLimits) {
  using M = ContactReport;
  expect_refusals<M>(
      valid_report(),
      {{"peer", [](M& m) { m.peer = 0; }},
       {"body_a", [](M& m) { m.body_a = "\x7f"; }},
       {"body_b", [](M& m) { m.body_b = ""; }},
       {"time_s", [](M& m) { m.time_s = kNan; }},
       {"time of a pose", [](M& m) { m.b.stamp.time_s = kNan; }},
       {"max_age_s", [](M& m) { m.a.stamp.max_age_s = -1; }},
       {"max_age_s", [](M& m) { m.a.stamp.max_age_s = kNan; }},
       {"status", [](M& m) { m.status = 5; }},
       {"clearance", [](M& m) { m.clearance_m = -1; }},
       {"uncertainty", [](M& m) { m.uncertainty_m = kNan; }},
       {"pair_count", [](M& m) { m.pair_count = 1; }},
       {"world", [](M& m) { m.asked = false; }},
       {"tiles", [](M& m) { m.world->tiles.resize(kMaxReportTiles + 1); }},
       {"missing pages", [](M& m) { m.world->missing_pages.resize(kMaxReportPages + 1); }},
       {"pairs", [](M& m) {
          m.pair_count = 1000;
          m.pairs.resize(kMaxReportPairs + 1);
        }}});
}

TEST(CheckMessage, NamesBothVersionsWhenTheyDiffer) {
  const auto expect_unsupported = [](auto message) {
    message.wire_version = kWireVersion + 1;
    EXPECT_EQ(check(message).code(), StatusCode::kUnsupported);
    EXPECT_EQ(check(message).message(), "wire version 16, this build speaks 15");
  };
  expect_unsupported(valid_hello());
  expect_unsupported(valid_header());
  expect_unsupported(valid_subscription());
  expect_unsupported(valid_batch());
  expect_unsupported(valid_poses());
  expect_unsupported(valid_directory());
  expect_unsupported(valid_report());
  expect_unsupported(valid_watched());
  expect_unsupported(valid_bounds());
  expect_unsupported(valid_held());
  expect_unsupported(valid_status());
  expect_unsupported(valid_echo());
}

TEST(CheckMessage, RefusesWatchedBodiesOutsideTheirLimits) {
  using M = WatchedBodies;
  expect_refusals<M>(valid_watched(),
                     {{"peer", [](M& m) { m.peer = 0; }},
                      {"part", [](M& m) { m.part = 0xffffffffU; }},
                      {"edition", [](M& m) { m.edition = 0; }},
                      {"horizon_s", [](M& m) { m.horizon_s = kNan; }},
                      {"margin_m", [](M& m) { m.margin_m = -1; }},
                      {"mover", [](M& m) { m.runs[1].mover = 0; }},
                      {"runs: 0 bodies", [](M& m) { m.runs[1].count = 0; }},
                      {"runs: 65 bodies", [](M& m) { m.runs[0].count = kWatchedPerPart + 1; }},
                      {"runs: 4294967295 bodies", [](M& m) { m.runs[0].count = 0xffffffffU; }},
                      {"runs: 3 bodies", [](M& m) { m.runs[1].count = 3; }},  // 65 with the others
                      {"number 4294967295", [](M& m) { m.runs[1].first = 0xffffffffU; }},
                      {"no content", [](M& m) { m.runs[0].content = {}; }},
                      {"max_age_s", [](M& m) { m.runs[0].max_age_s = kNan; }},
                      {"body 69 of 000000000000002a twice",
                       [](M& m) {
                         m.runs[1].mover = 42;
                         m.runs[1].first = 69;
                       }},
                      {"body in place", [](M& m) { m.placed[0].name = "\x1b"; }},
                      {"ground: no content", [](M& m) { m.placed[0].content = {}; }},
                      {"tower/1", [](M& m) { m.placed[1].pose.rotation[4] = 2; }},
                      {"\"tower/1\" twice", [](M& m) { m.placed[0].name = m.placed[1].name; }},
                      {"placed", [](M& m) { m.placed.resize(kWatchedPerPart + 1, m.placed[0]); }}});
}

TEST(CheckMessage, RefusesBoundsOutsideTheirLimits) {
  using M = BoundsReport;
  expect_refusals<M>(
      valid_bounds(),
      {{"peer", [](M& m) { m.peer = 0; }},
       {"edition",
        [](M& m) {
          m.edition = 0;
          m.rests_on_more = false;
        }},
       {"time_s", [](M& m) { m.time_s = kNan; }},
       {"pairs", [](M& m) { m.pairs = 0; }},
       {"clearance_m", [](M& m) { m.clearance_m = -1; }},
       {"clearance_m", [](M& m) { m.clearance_m = std::numeric_limits<float>::infinity(); }},
       {"horizon_s", [](M& m) { m.horizon_s = std::nanf(""); }},
       {"posed: body 3 is not", [](M& m) { m.heard[2].posed[0].number = 3; }},
       {"posed",
        [](M& m) {
          for (std::uint32_t i = 0; i <= kMaxWatchedPosed; ++i) m.heard[0].posed.push_back({i, 1});
        }},
       {"heard", [](M& m) { m.heard.resize(kMaxWatchedMovers + 1); }}});
}

TEST(CheckMessage, RefusesWhatIsHeldOutsideItsLimits) {
  using M = HeldDetail;
  expect_refusals<M>(valid_held(), {{"peer", [](M& m) { m.peer = 0; }},
                                    {"model name", [](M& m) { m.model = ""; }},
                                    {"heard",
                                     [](M& m) {
                                       m.heard.resize(kMaxHeardPublishers + 1, {1, 1});
                                     }},
                                    {"publisher", [](M& m) { m.heard[1].publisher = 0; }},
                                    {"nodes", [](M& m) { m.nodes.resize(kMaxHeldBytes + 1); }}});
}

TEST(CheckMessage, RefusesStatusOutsideItsLimits) {
  using M = ProcessStatus;
  expect_refusals<M>(valid_status(),
                     {{"session", [](M& m) { m.session = 0; }},
                      {"name", [](M& m) { m.name = "\x1b[2J"; }},
                      {"moved", [](M& m) { m.moved.resize(kMaxStatusBodies + 1, "x"); }},
                      {"moved", [](M& m) { m.moved[0] = "two\nlines"; }},
                      {"bodies", [](M& m) { m.moved_bodies = 1; }},
                      {"bodies", [](M& m) { m.stale_bodies = 3; }},
                      {"oldest_body", [](M& m) { m.oldest_body = "\x07"; }},
                      {"oldest_age_s", [](M& m) { m.oldest_age_s = kNan; }},
                      {"host", [](M& m) { m.host = ""; }},
                      {"host", [](M& m) { m.host = "a\nb"; }},
                      {"uptime_s", [](M& m) { m.uptime_s = kNan; }},
                      {"bytes_per_s", [](M& m) { m.bytes_per_s = -1; }},
                      {"uncertainty_m", [](M& m) { m.uncertainty_m = kInfinity; }},
                      {"certified_pairs", [](M& m) { m.certified_pairs = 6; }},
                      {"models", [](M& m) { m.models.resize(kMaxModels + 1, m.models[0]); }},
                      {"name", [](M& m) { m.models[0].name = "\x1b[2J"; }},
                      {"holds", [](M& m) { m.models[1].held_splits = 1; }},
                      {"complaints", [](M& m) { m.complaints.resize(kMaxStatusLines + 1, "x"); }},
                      {"complaint", [](M& m) { m.complaints[0] = std::string(256, 'x'); }},
                      {"complaint", [](M& m) { m.complaints[0] = "two\nlines"; }}});
}

TEST(CheckMessage, RefusesEchoOutsideItsLimits) {
  expect_refusals<Echo>(valid_echo(),
                        {{"from", [](Echo& m) { m.from = 0; }},
                         {"bytes", [](Echo& m) { m.bytes.resize(kMaxEchoBytes + 1); }}});
}

TEST(CheckMessage, AnyLineFitsIntoAStatusOnceCut) {
  ProcessStatus status = valid_status();
  status.complaints = {status_line("tab\tand \xc3\xa9\n" + std::string(1000, 'x'))};
  EXPECT_TRUE(check(status).is_ok()) << check(status).message();
  EXPECT_EQ(status.complaints[0].substr(0, 12), "tab?and ???x");
}

}  // namespace
}  // namespace nearmesh::wire
