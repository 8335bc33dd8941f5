// SPDX-License-Identifier: Apache-2.0
// Recorded flights played to live peers on a memory bus: every answer is held against the full
// meshes.
#include "publisher/replay/replay.hpp"

#include <ctime>
#include <filesystem>
#include <fstream>
#include <limits>

#include "replay_world.hpp"
#include "session_hour.hpp"

namespace nearmesh {
namespace {

using namespace test;
using publisher::ReplayIndex;

class ReplayTest : public ::testing::Test {
 protected:
  TempFile file{".db3"};
};

TEST(LateTimes, QuantilesBoundWhatWasAdded) {
  publisher::LateTimes late;
  EXPECT_EQ(late.quantile(0.99), 0);
  double above_s = 0;
  for (const double s : {0.0, 1e-6, 3e-6, 4e-6, 7e-6, 8e-6, 100e-6, 0.0123, 1.0, 77.0}) {
    late.add(s);
    EXPECT_GT(late.quantile(1), s);
    EXPECT_LE(late.quantile(1), std::max(1.3 * s, s + 1.1e-6));
    EXPECT_GT(late.quantile(1), above_s);
    above_s = late.quantile(1);
  }
  EXPECT_GT(late.quantile(0.5), 7e-6);
  EXPECT_LE(late.quantile(0.5), 9e-6);
}

TEST_F(ReplayTest, AllSamplesComeOutUnchangedAndInOrder) {
  const double length_s = record_flight(file.path());
  ReplayWorld play(file.path(), {.rate = 4});
  play.play_to(length_s);
  std::vector<std::pair<std::uint32_t, std::vector<std::uint8_t>>> recorded;
  ASSERT_TRUE(play.recording
                  ->read(1, play.recording->message_count() + 1,
                         [&](std::int64_t, const RecordedMessage& message) {
                           recorded.emplace_back(play.index->stream_of(message.writer),
                                                 message.cdr);
                           return true;
                         })
                  .is_ok());
  EXPECT_GT(recorded.size(), 100U);
  EXPECT_EQ(play.outlet.published, recorded);
  EXPECT_TRUE(play.replay.is_done());
  EXPECT_EQ(play.replay.stats().messages(), recorded.size());
  EXPECT_NEAR(play.now_s, length_s / 4, 0.02);
  EXPECT_GT(play.replay.stats().late.quantile(0.99), 0);
  EXPECT_LT(play.replay.stats().late.quantile(0.99), 0.01);  // a step of this test's clock
}

TEST_F(ReplayTest, LivePeerIsAnsweredWithWhatWasDelivered) {
  const double length_s = record_flight(file.path());
  ReplayWorld play(file.path());
  const auto live = play.join();
  play.play_to(length_s, live.get());
  const Judge& judge = play.world.judge;
  EXPECT_GT(judge.free, 0U);
  EXPECT_GT(judge.contact, 0U);
  EXPECT_GT(judge.certified(), judge.uncertain + judge.partial);
  ASSERT_FALSE(play.outlet.answers.empty());
  EXPECT_TRUE(play.outlet.answers.back().last);
  EXPECT_GT(play.replay.stats().requests, 0U);
  EXPECT_EQ(play.replay.stats().live_peers, 1U);
  EXPECT_TRUE(play.world.complaints.empty()) << play.world.complaints.front();
}

// Batches are taken in while it plays; a live peer that asks before that is answered after it, as
// well as ever.
TEST_F(ReplayTest, LivePeersAreAnsweredOnceAllBatchesAreTakenIn) {
  write_session_hour(file.path(), {.length_s = 100, .rate_hz = 1, .terrain_cells = 32});
  const auto recording = RecordingReader::open(file.path()).value();
  const auto index = ReplayIndex::build(*recording, {}, {}).value();
  MemoryBus bus;
  class Asking final : public publisher::ReplayOutlet {
   public:
    publisher::Inbox inbox;
    std::vector<wire::SplitBatchMessage> answers;
    double waited_s = -1;
    bool publish(std::uint32_t, const std::vector<std::uint8_t>&) override { return true; }
    void withdraw(std::uint32_t, const std::vector<std::uint8_t>&) override {}
    bool take_restart() override { return false; }
    publisher::Inbox take() override { return std::exchange(inbox, {}); }
    bool send(wire::SessionId, const wire::SplitBatchMessage& batch) override {
      answers.push_back(batch);
      return true;
    }
    void wait(double seconds) override { waited_s = seconds; }
    std::vector<std::string> take_complaints() override { return {}; }
  } outlet;
  publisher::Replay replay(*recording, *index, outlet,
                           publisher::Playhead::create(*recording, {.start_s = 99}, 0).value(),
                           false);
  replay.playhead().pause(0);
  ASSERT_TRUE(replay.begin().is_ok());
  ASSERT_FALSE(index->has_all_batches());
  const auto& [content, detail] = *index->details().begin();
  for (const wire::SessionId peer : {kLive, kLateLive}) {
    wire::RegionSubscription asked{
        .peer = peer, .request = 1, .content_hash = content, .publisher = 1};
    asked.region.max_splits = kMaxRequestSplits;
    asked.region.region = {GridBox{{{0, 0, 0}}, {{1 << 21, 1 << 21, 1 << 21}}}};
    outlet.inbox.subscriptions.push_back(asked);
  }
  SpmHeader header;
  ASSERT_TRUE(
      recording
          ->read(1, 2,
                 [&](std::int64_t, const RecordedMessage& message) {
                   header = decode_header(
                                wire::decode_payload<wire::MeshHeader>(message.cdr).value().bytes)
                                .value();
                   return true;
                 })
          .is_ok());
  for (wire::RegionSubscription& asked : outlet.inbox.subscriptions)
    for (const BaseRoot& root : header.roots)
      if (root.node.size > 1) asked.region.attach.push_back(root.node);
  double now_s = 0;
  ASSERT_TRUE(replay.step(now_s).is_ok());
  ASSERT_FALSE(index->has_all_batches());
  outlet.inbox.lost_peers = {kLateLive};  // before it was answered
  replay.wait(0.02, now_s);
  EXPECT_EQ(outlet.waited_s, 0);  // there is something to do
  while (!index->has_all_batches()) {
    EXPECT_TRUE(outlet.answers.empty());
    ASSERT_TRUE(replay.step(now_s += 0.001).is_ok());
  }
  for (int i = 0; i < 10; ++i) ASSERT_TRUE(replay.step(now_s += 0.001).is_ok());
  replay.wait(0.02, now_s);
  EXPECT_EQ(outlet.waited_s, 0.02);
  ASSERT_FALSE(outlet.answers.empty());
  EXPECT_FALSE(outlet.answers.front().refused);
  EXPECT_EQ(replay.stats().requests, 1U);
}

TEST_F(ReplayTest, ALivePeerWithTheIdOfARecordedOneIsRefused) {
  const double length_s = record_flight(file.path());
  ReplayWorld play(file.path()), alone(file.path());
  const auto twin = play.join(kPeer), other = play.join(kLive);
  std::vector<std::string> complaints;
  while (!play.replay.playhead().at_end()) {
    play.play_to(play.replay.playhead().time_s(play.now_s) + 0.1, twin.get());
    play.world.round(*other);
    for (std::string& line : play.replay.take_complaints()) complaints.push_back(std::move(line));
  }
  alone.play_to(length_s);
  // Both sides say so, once here, and at each request there.
  ASSERT_EQ(complaints.size(), 1U);
  EXPECT_NE(
      complaints[0].find("peer " + wire::partition_of(kPeer) + " is live and in the recording"),
      std::string::npos)
      << complaints[0];
  const auto& heard = play.world.complaints;
  EXPECT_TRUE(std::any_of(heard.begin(), heard.end(), [](const std::string& line) {
    return line.find("a replayed session has a peer with the id") != std::string::npos;
  }));
  for (const wire::SplitBatchMessage& batch : play.outlet.answers)
    EXPECT_TRUE(check(batch).is_ok()) << check(batch).message();
  EXPECT_EQ(twin->stats().batch_bytes, play.outlet.refused_bytes);
  // What is played does not suffer, nor does another live peer.
  EXPECT_EQ(play.outlet.published, alone.outlet.published);
  EXPECT_GT(other->stats().batches, 0U);
}

TEST_F(ReplayTest, WhatWasNotRecordedStaysUncertain) {
  const double length_s = record_flight(file.path(), {.batches = false});
  ReplayWorld play(file.path());
  const auto live = play.join();
  std::uint64_t open = 0;
  play.world.on_report = [&](const FrameReport& report) {
    for (const PairAnswer& answer : report.answers) {
      if (!answer.reason.empty()) continue;
      // Never free by want of data: the judge checks that too, this says what there is instead.
      const bool touches = !play.world.judge.touching(answer, answer.pose_a, answer.pose_b).empty();
      if (!touches) continue;
      EXPECT_NE(answer.answer.status, AnswerStatus::kFree);
      open += answer.answer.status == AnswerStatus::kUncertain ? 1 : 0;
    }
  };
  play.play_to(length_s, live.get());
  EXPECT_GT(open, 20U);
  EXPECT_EQ(play.world.judge.contact, 0U);
  // Each request is answered, with nothing, and not more often than need be; once that regions are
  // to be asked for.
  ASSERT_GT(play.outlet.answers.size(), 1U);
  EXPECT_TRUE(play.outlet.answers.front().wants_regions);
  for (std::size_t i = 1; i < play.outlet.answers.size(); ++i) {
    const wire::SplitBatchMessage& answer = play.outlet.answers[i];
    EXPECT_TRUE(answer.last);
    EXPECT_FALSE(answer.refused);
    EXPECT_TRUE(answer.bytes.empty());
  }
  EXPECT_LT(play.outlet.answers.size(), 2 * (length_s / 0.1 + 1));
}

// With the models' files new trajectories get certified answers where no recorded peer was sent
// anything.
TEST_F(ReplayTest, FilesOfTheModelsAnswerWhatWasNotRecorded) {
  const double length_s = record_flight(file.path(), {.batches = false});
  const std::filesystem::path folder = file.path() + ".models";
  std::filesystem::create_directory(folder);
  std::filesystem::copy_file(terrain().open().path(), folder / "a.spm");
  std::filesystem::copy_file(aircraft().open().path(), folder / "b.spm");
  std::ofstream(folder / "c.spm") << "no model";
  const auto models = ModelFolder::open(folder.string()).value();
  EXPECT_EQ(models->complaints().size(), 1U);
  ReplayWorld play(file.path());
  EXPECT_EQ(play.replay.serve_from(*models).value(), 2U);
  const auto live = play.join();
  play.play_to(length_s, live.get());
  const Judge& judge = play.world.judge;
  EXPECT_GT(judge.free, 0U);
  EXPECT_GT(judge.contact, 20U);
  EXPECT_GT(judge.certified(), 20 * (judge.uncertain + judge.partial));
  EXPECT_TRUE(play.world.complaints.empty()) << play.world.complaints.front();
  std::filesystem::remove_all(folder);
}

TEST_F(ReplayTest, StateDependsOnTheMomentAlone) {
  const double length_s = record_flight(file.path());
  const double time_s = 0.55 * length_s;
  // Played to the moment, begun there, sought from both sides, and looped to.
  ReplayWorld played(file.path()), begun(file.path(), {.start_s = time_s}), forward(file.path()),
      back(file.path()), looped(file.path(), {}, true);
  const auto there = played.join();
  played.play_to(time_s, there.get());
  ASSERT_TRUE(forward.replay.seek(time_s, forward.now_s).is_ok());
  back.play_to(length_s);
  ASSERT_TRUE(back.replay.seek(0.1 * length_s, back.now_s).is_ok());
  ASSERT_TRUE(back.replay.seek(time_s, back.now_s).is_ok());
  while (looped.replay.stats().loops == 0) looped.step();
  looped.play_to(time_s);
  std::vector<ReplayWorld*> worlds{&played, &begun, &forward, &back, &looped};
  for (ReplayWorld* world : worlds) {
    world->replay.playhead().pause(world->now_s);
    // To the same message: steps of the clock are coarse.
    while (world->replay.playhead().next_id() < worlds[0]->replay.playhead().next_id())
      ASSERT_TRUE(world->replay.step_to_pose(world->now_s).is_ok());
  }
  const std::int64_t id =
      std::max_element(worlds.begin(), worlds.end(),
                       [](auto* a, auto* b) {
                         return a->replay.playhead().next_id() < b->replay.playhead().next_id();
                       })[0]
          ->replay.playhead()
          .next_id();
  for (ReplayWorld* world : worlds)
    while (world->replay.playhead().next_id() < id)
      ASSERT_TRUE(world->replay.step_to_pose(world->now_s).is_ok());

  std::vector<FrameReport> reports;
  for (ReplayWorld* world : worlds) {
    ASSERT_EQ(world->replay.playhead().next_id(), id);
    EXPECT_EQ(world->outlet.latched, played.outlet.latched);
    const auto late = world->join(kLateLive);
    reports.push_back(world->settle(*late));
    EXPECT_EQ(reports.back().state_digest, reports.front().state_digest);
    EXPECT_EQ(reports.back().answers_digest, reports.front().answers_digest);
  }
  // Who was there from the start has the same poses, and the same answers where they are certain.
  const FrameReport early = played.settle(*there);
  ASSERT_EQ(early.answers.size(), 3U);
  std::size_t certain = 0;
  for (std::size_t i = 0; i < 3; ++i) {
    const PairAnswer &a = early.answers[i], &b = reports.front().answers[i];
    EXPECT_EQ(a.pose_a.translation_m, b.pose_a.translation_m);
    EXPECT_EQ(a.pose_b.translation_m, b.pose_b.translation_m);
    if (!is_certified(b.answer.status)) continue;
    ++certain;
    EXPECT_EQ(a.answer.status, b.answer.status);
    EXPECT_EQ(a.answer.pairs, b.answer.pairs);
  }
  EXPECT_GT(certain, 0U);
}

TEST_F(ReplayTest, ASeekBackTakesBackWhatWasNotYetSaid) {
  SessionFile session(file.path());
  session.add(0, wire::BodyPoses{.peer = kPeer, .part = 0});
  session.add(1, wire::BodyPoses{.peer = kPeer, .part = 1});
  session.add(2, wire::BodyPoses{.peer = kPeer, .part = 0, .frame = 7});
  session.close();
  ReplayWorld play(file.path());
  play.play_to(2);
  EXPECT_EQ(play.outlet.latched.size(), 2U);
  ASSERT_TRUE(play.replay.seek(0.5, play.now_s).is_ok());
  ASSERT_EQ(play.outlet.latched.size(), 1U);
  EXPECT_EQ(
      wire::decode_payload<wire::BodyPoses>(play.outlet.latched.begin()->second).value().frame, 0U);
  // And when all endpoints are new, it is said again.
  play.outlet.latched.clear();
  play.outlet.restart = true;
  play.step(0.001);
  EXPECT_EQ(play.outlet.latched.size(), 1U);
}

TEST_F(ReplayTest, SeeksAndLoopsWhereAFaultySampleHasAKey) {
  const std::vector<std::uint8_t> pose =
      wire::encode_payload(wire::BodyPoses{.peer = kPeer, .part = 1});
  const wire::TopicPlace topic = wire::place_of<wire::BodyPoses>();
  const std::string key = wire::record_key(topic, pose);
  record_bytes(file.path(), {{wire::place_of<wire::WatchedBodies>(), "one", {1, 2, 3}},
                             {topic, key, pose},
                             {topic, key, pose}});
  ReplayWorld play(file.path(), {}, true);
  while (play.replay.stats().loops == 0) play.step();
  EXPECT_EQ(play.outlet.published.size(), 3U);
  EXPECT_EQ(play.outlet.latched.size(), 0U);
  ASSERT_TRUE(play.replay.seek(1.5, play.now_s).is_ok());
  EXPECT_EQ(play.outlet.latched.size(), 1U);
  ASSERT_TRUE(play.replay.seek(0, play.now_s).is_ok());
  EXPECT_EQ(play.outlet.latched.size(), 0U);
}

constexpr std::size_t kAll = std::numeric_limits<std::size_t>::max();

/// Everything that a peer with the base mesh alone may be sent at `end`, and the state that it
/// makes.
std::uint64_t state_of_answer(publisher::RecordedDetail& detail, const SpmHeader& header,
                              std::int64_t end) {
  RegionRequest request;
  request.max_splits = kMaxRequestSplits;
  request.region = {GridBox{{{0, 0, 0}}, {{1 << 21, 1 << 21, 1 << 21}}}};
  for (const BaseRoot& root : header.roots)
    if (root.node.size > 1) request.attach.push_back(root.node);
  const auto answer = detail.answer(request, end);
  EXPECT_TRUE(answer.is_ok()) << answer.status().message();
  RefinedMesh replica(header);
  for (const auto& bytes : answer.value()) {
    const auto batch = decode_batch(header, bytes);
    EXPECT_TRUE(batch.is_ok()) << batch.status().message();
    EXPECT_TRUE(replica.apply_batch(batch.value()).status.is_ok());
  }
  EXPECT_EQ(replica.parked_splits(), 0U);
  return replica.mesh().state_hash();
}

TEST_F(ReplayTest, AnswersHoldAllThatWasDeliveredByThenAndNothingOfTheFuture) {
  record_flight(file.path());
  const auto recording = RecordingReader::open(file.path()).value();
  const auto index = ReplayIndex::build(*recording, {}, {}).value();
  ASSERT_TRUE(index->take_batches(*recording, kAll).is_ok());
  const std::int64_t count = recording->message_count();
  std::set<std::uint64_t> states;
  for (const wire::MeshHeader& message : announcement().second) {
    const SpmHeader header = decode_header(message.bytes).value();
    // Forward and back, as a user seeks.
    for (const std::int64_t end : {count / 3, count + 1, std::int64_t{1}, count / 2, count / 5}) {
      RefinedMesh expected(header);
      ASSERT_TRUE(
          recording
              ->read(1, end,
                     [&](std::int64_t, const RecordedMessage& recorded) {
                       const std::uint32_t stream = index->stream_of(recorded.writer);
                       if (!index->streams()[stream].carries<wire::SplitBatchMessage>())
                         return true;
                       auto sample = wire::decode_payload<wire::SplitBatchMessage>(recorded.cdr);
                       for (const auto& batch : take_apart(std::move(sample).value()))
                         if (batch.content_hash == message.content_hash && !batch.bytes.empty())
                           static_cast<void>(
                               expected.apply_batch(decode_sealed(header, batch.bytes).value()));
                       return true;
                     })
              .is_ok());
      EXPECT_EQ(state_of_answer(index->details().at(message.content_hash), header, end),
                expected.mesh().state_hash())
          << message.name << " at " << end << " of " << count;
      states.insert(expected.mesh().state_hash());
    }
  }
  EXPECT_GT(states.size(), 3U);
}

TEST_F(ReplayTest, NodesThatTheRecordingDoesNotKnowAreLeftOut) {
  record_flight(file.path());
  const auto recording = RecordingReader::open(file.path()).value();
  const auto index = ReplayIndex::build(*recording, {}, {}).value();
  ASSERT_TRUE(index->take_batches(*recording, kAll).is_ok());
  const wire::MeshHeader message = announcement().second.front();
  const SpmHeader header = decode_header(message.bytes).value();
  RegionRequest request;
  request.region = {GridBox{{{0, 0, 0}}, {{1 << 21, 1 << 21, 1 << 21}}}};
  // The first root is known; of the second a part, which is no node in any case.
  const NodeSpan first = header.roots[0].node, second = header.roots[1].node;
  ASSERT_GT(first.size, 1U);
  ASSERT_GT(second.size, 3U);
  request.attach = {first, {{second.begin() + 1}, second.size - 1}};
  auto& detail = index->details().at(message.content_hash);
  const auto answer = detail.answer(request, recording->message_count() + 1);
  ASSERT_TRUE(answer.is_ok()) << answer.status().message();
  request.attach = {first};
  EXPECT_EQ(answer.value(), detail.answer(request, recording->message_count() + 1).value());
  request.attach = {{{header.vertex_count}, 2}};
  EXPECT_FALSE(detail.answer(request, 1).is_ok());
}

// nearmesh-bench-replay measures the same with ten times as many samples.
TEST_F(ReplayTest, SeeksAnywhereInAnHourInUnderASecond) {
  const HourFacts facts =
      write_session_hour(file.path(), {.rate_hz = 2, .terrain_cells = 64, .batch_period_s = 5});
  const auto recording = RecordingReader::open(file.path()).value();
  const auto index = ReplayIndex::build(*recording, {}, {}).value();
  ASSERT_TRUE(index->take_batches(*recording, kAll).is_ok());
  ASSERT_EQ(facts.messages, static_cast<std::uint64_t>(recording->message_count()));
  MemoryBus bus;
  MemoryOutlet outlet(bus, *index);
  publisher::Replay replay(*recording, *index, outlet,
                           publisher::Playhead::create(*recording, {}, 0).value(), false);
  ASSERT_TRUE(replay.begin().is_ok());
  const SpmHeader header = [&] {
    SpmHeader found;
    EXPECT_TRUE(
        recording
            ->read(1, 2,
                   [&](std::int64_t, const RecordedMessage& message) {
                     found = decode_header(
                                 wire::decode_payload<wire::MeshHeader>(message.cdr).value().bytes)
                                 .value();
                     return true;
                   })
            .is_ok());
    return found;
  }();
  for (const double time_s : {3599.0, 10.0, 1800.0, 3500.0, 0.0}) {
    const std::clock_t begun = std::clock();  // processor time: others may hold up this process
    ASSERT_TRUE(replay.seek(time_s, 0).is_ok());
    const std::uint64_t state =
        state_of_answer(index->details().begin()->second, header, replay.playhead().next_id());
    EXPECT_LT(std::clock() - begun, CLOCKS_PER_SEC) << "to " << time_s;
    // Twenty-two latched: header, hello, ten poses and directories; at the very begin none is
    // played yet.
    EXPECT_EQ(outlet.latched.size(), time_s > 0 ? 22U : 0U);
    EXPECT_EQ(state == RefinedMesh(header).mesh().state_hash(), time_s == 0) << time_s;
  }
}

TEST_F(ReplayTest, TwoFilesPlayAsOne) {
  const TempFile whole(".db3");
  const std::string second = part_path(file.path(), 1);
  const double length_s = record_flight(file.path(), {.second_part = second});
  record_flight(whole.path());
  ReplayWorld parts(file.path()), one(whole.path());
  EXPECT_EQ(parts.recording->parts(), 2U);
  parts.play_to(length_s);
  one.play_to(length_s);
  EXPECT_EQ(parts.index->streams().size(), one.index->streams().size());
  EXPECT_EQ(parts.outlet.published, one.outlet.published);
  std::remove(second.c_str());
}

}  // namespace
}  // namespace nearmesh
