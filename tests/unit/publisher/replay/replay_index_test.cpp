// SPDX-License-Identifier: Apache-2.0
// What holds at a moment of a recording, against a scan from its begin; and recordings that cannot
// be played.
#include "publisher/replay/replay_index.hpp"

#include <filesystem>

#include "replay_world.hpp"

namespace nearmesh {
namespace {

using namespace test;
using publisher::ReplayIndex;
using Ids = std::vector<std::int64_t>;

class ReplayIndexTest : public ::testing::Test {
 protected:
  TempFile file{".db3"};
  std::unique_ptr<RecordingReader> recording;

  std::unique_ptr<ReplayIndex> build(const std::vector<std::string>& topics = {}) {
    recording = RecordingReader::open(file.path()).value();
    auto built = ReplayIndex::build(*recording, topics, {});
    EXPECT_TRUE(built.is_ok()) << built.status().message();
    return std::move(built).value();
  }
  std::string refusal(const std::vector<std::string>& topics = {}) {
    recording = RecordingReader::open(file.path()).value();
    const auto built = ReplayIndex::build(*recording, topics, {});
    return built.is_ok() ? "" : built.status().message();
  }
};

TEST_F(ReplayIndexTest, LatchedIsTheLatestOfEachKey) {
  record_flight(file.path());
  const auto index = build();
  EXPECT_EQ(index->publishers(), std::set<wire::SessionId>{kPublisher});
  EXPECT_EQ(index->peers(), (std::set<wire::SessionId>{kPeer, kOther}));
  std::map<std::string, std::int64_t> latest;
  struct Asked {
    std::int64_t id = 0;
    std::uint32_t request = 0;
  };
  std::map<std::pair<std::string, ContentHash>, Asked> open;
  std::size_t most_open = 0;
  const auto check = [&](std::int64_t id, const RecordedMessage& message) {
    Ids expected;
    for (const auto& [key, at] : latest) expected.push_back(at);
    for (const auto& [key, asked] : open) expected.push_back(asked.id);
    most_open = std::max(most_open, open.size());
    std::sort(expected.begin(), expected.end());
    EXPECT_EQ(index->latched(id), expected) << "at " << id;
    const publisher::ReplayStream& stream = index->streams()[index->stream_of(message.writer)];
    switch (stream.topic) {
      case wire::place_of<wire::Hello>():
        latest["hello"] = id;
        break;
      case wire::place_of<wire::MeshHeader>():
        latest["header " + wire::decode_payload<wire::MeshHeader>(message.cdr).value().name] = id;
        break;
      case wire::place_of<wire::BodyPoses>():
      case wire::place_of<wire::BodyDirectory>():
        latest[std::to_string(stream.topic) + wire::record_key(stream.topic, message.cdr)] = id;
        break;
      case wire::place_of<wire::RegionSubscription>(): {
        const auto asked = wire::decode_payload<wire::RegionSubscription>(message.cdr).value();
        if (asked.request != 0)
          open[{wire::partition_of(asked.peer), asked.content_hash}] = {id, asked.request};
        break;
      }
      case wire::place_of<wire::SplitBatchMessage>(): {
        const auto sent = wire::decode_payload<wire::SplitBatchMessage>(message.cdr).value();
        // What was asked of several models at once is under none.
        for (const ContentHash& content : {sent.content_hash, ContentHash{}}) {
          const auto at = open.find({stream.partition, content});
          if (sent.last && at != open.end() && at->second.request == sent.request) open.erase(at);
        }
        break;
      }
      default:
        break;
    }
    return !::testing::Test::HasFailure();
  };
  ASSERT_TRUE(recording->read(1, recording->message_count() + 1, check).is_ok());
  EXPECT_EQ(latest.size(), 7U);
  EXPECT_GT(most_open, 0U);
}

TEST_F(ReplayIndexTest, NotYetIsWhatWasSaidFirstBetween) {
  SessionFile session(file.path());
  session.add(0, wire::BodyPoses{.peer = kPeer, .part = 1});
  session.add(1, wire::BodyPoses{.peer = kPeer, .part = 2});
  session.add(2, wire::BodyPoses{.peer = kPeer, .part = 1});
  session.add(3, wire::BodyPoses{.peer = kPeer, .part = 3});
  session.close();
  const auto index = build();
  EXPECT_EQ(index->not_yet(1, 5), (Ids{1, 2, 4}));
  EXPECT_EQ(index->not_yet(2, 4), Ids{2});
  EXPECT_EQ(index->not_yet(3, 4), Ids{});
}

TEST_F(ReplayIndexTest, HellosOfOnePublisherAreOneStream) {
  const wire::Hello hello{.publisher = kPublisher}, other{.publisher = kPublisher + 1};
  SessionFile session(file.path());
  session.add(0, hello, 1);
  session.add(1, other, 2);
  session.add(2, hello, 3);  // the same publisher as a new participant
  session.close();
  const auto index = build();
  EXPECT_EQ(index->latched(4), (Ids{2, 3}));
  EXPECT_EQ(index->stream_of(2), index->stream_of(0));
  EXPECT_NE(index->stream_of(1), index->stream_of(0));
}

TEST_F(ReplayIndexTest, PosesOfTwoPeersHoldBoth) {
  SessionFile session(file.path());
  for (int i = 0; i < 3; ++i)
    for (const wire::SessionId peer : {kPeer, kOther})
      session.add(i, wire::BodyPoses{.peer = peer, .part = 1});
  session.close();
  const auto index = build();
  EXPECT_EQ(index->peers(), (std::set<wire::SessionId>{kPeer, kOther}));
  EXPECT_EQ(index->latched(5), (Ids{3, 4}));
}

TEST_F(ReplayIndexTest, PartsHoldOn) {
  const std::string part = part_path(file.path(), 1);
  record_flight(file.path(), {.second_part = part});
  recording = RecordingReader::open(file.path()).value();
  ASSERT_EQ(recording->parts(), 2U);
  const auto whole = ReplayIndex::build(*recording, {}, {}).value();
  const Ids held = whole->latched(recording->message_count() + 1);
  EXPECT_GE(held.size(), 5U);
  std::filesystem::remove(part);
}

TEST_F(ReplayIndexTest, OnlyWantedTopicsArePlayed) {
  record_flight(file.path());
  const auto index = build({"body_poses", "hello"});
  for (const publisher::ReplayStream& stream : index->streams())
    EXPECT_TRUE(stream.carries<wire::BodyPoses>() || stream.carries<wire::Hello>());
  EXPECT_EQ(index->streams().size(), 3U);
  EXPECT_TRUE(index->details().empty());
  EXPECT_EQ(index->latched(recording->message_count() + 1).size(), 3U);
}

TEST_F(ReplayIndexTest, BatchesBeforeTheirHeaderAreNotLost) {
  const auto [hello, headers] = announcement();
  const TempFile flight(".db3");
  record_flight(flight.path());
  const auto flown = RecordingReader::open(flight.path()).value();
  SessionFile session(file.path());
  const auto names = wire::TopicNames("recorded");
  std::uint32_t batches = 0;
  ASSERT_TRUE(flown
                  ->read(1, flown->message_count() + 1,
                         [&](std::int64_t, const RecordedMessage& message) {
                           if (flown->topics()[flown->writers()[message.writer].topic].name ==
                               names.of<wire::SplitBatchMessage>()) {
                             const auto sent =
                                 wire::decode_payload<wire::SplitBatchMessage>(message.cdr).value();
                             session.add(0, kPeer, sent);
                             batches += 1 + static_cast<std::uint32_t>(sent.joined.size());
                           }
                           return true;
                         })
                  .is_ok());
  for (const wire::MeshHeader& header : headers) session.add(1, header);
  session.close();
  const auto index = build();
  ASSERT_GT(batches, 10U);
  ASSERT_EQ(index->details().size(), 2U);
  ASSERT_TRUE(index->take_batches(*recording, 3).is_ok());
  EXPECT_FALSE(index->has_all_batches());
  ASSERT_TRUE(index->take_batches(*recording, batches).is_ok());
  EXPECT_TRUE(index->has_all_batches());
  for (const auto& [hash, detail] : index->details()) EXPECT_GT(detail.known_splits(), 50U);
}

TEST_F(ReplayIndexTest, FaultySamplesHaveNoEffectButTheirPlace) {
  SessionFile session(file.path());
  session.add_bytes(0, {1, 2, 3});
  session.add(1, wire::BodyPoses{.peer = kPeer, .part = 0xffffffff});
  session.add(2, wire::BodyPoses{.peer = kPeer});
  session.close();
  const auto index = build();
  EXPECT_EQ(index->latched(4), Ids{3});
  EXPECT_EQ(index->streams().size(), 2U);
}

TEST_F(ReplayIndexTest, FaultySamplesWithAKeyHoldNothing) {
  const std::vector<std::uint8_t> out_of_limits =
      wire::encode_payload(wire::BodyPoses{.peer = kPeer, .part = 0xffffffff});
  record_bytes(file.path(), {{wire::place_of<wire::BodyPoses>(), "one", {1, 2, 3}},
                             {wire::place_of<wire::BodyPoses>(), "two", out_of_limits},
                             {wire::place_of<wire::BodyDirectory>(), "one", {1, 2, 3}},
                             {wire::place_of<wire::WatchedBodies>(), "one", {1, 2, 3}}});
  const auto index = build();
  ASSERT_EQ(recording->keys().size(), 4U);
  EXPECT_EQ(index->streams().size(), 3U);
  EXPECT_EQ(index->not_yet(1, 5), Ids{});
  EXPECT_EQ(index->latched(5), Ids{});
  EXPECT_TRUE(index->peers().empty());
}

TEST_F(ReplayIndexTest, WhatFollowsAFaultySampleOfAKeyHolds) {
  const std::vector<std::uint8_t> pose =
      wire::encode_payload(wire::BodyPoses{.peer = kPeer, .part = 1});
  const wire::TopicPlace topic = wire::place_of<wire::BodyPoses>();
  const std::string key = wire::record_key(topic, pose);
  ASSERT_FALSE(key.empty());
  record_bytes(file.path(), {{topic, key, {1, 2, 3}},
                             {topic, key, {0, 1, 0, 0}},
                             {topic, key, pose},
                             {topic, key, pose}});
  const auto index = build();
  EXPECT_EQ(index->peers(), std::set<wire::SessionId>{kPeer});
  EXPECT_EQ(index->not_yet(1, 5), Ids{3});
  EXPECT_EQ(index->latched(3), Ids{});
  EXPECT_EQ(index->latched(4), Ids{3});
  EXPECT_EQ(index->latched(5), Ids{4});
}

TEST_F(ReplayIndexTest, SaysWhyARecordingCannotBePlayed) {
  SessionFile(file.path()).close();
  EXPECT_EQ(refusal(), "the recording holds no messages");
  const TempFile old(".db3");
  std::remove(file.path().c_str());
  for (const std::uint32_t version : {wire::kWireVersion - 1U, wire::kWireVersion + 1U}) {
    SessionFile other(file.path(), 0, version);
    other.add_bytes(0, {1});
    other.close();
    EXPECT_EQ(refusal(), wire::check_recorded_version(version).message());
    std::remove(file.path().c_str());
  }
  SessionFile poses(file.path());
  poses.add(0, wire::BodyPoses{.peer = kPeer, .part = 1});
  poses.close();
  EXPECT_EQ(refusal({"split_batch"}),
            "topic split_batch: not in the recording, which has body_poses");
}

TEST_F(ReplayIndexTest, CanBeEndedWhileItReads) {
  record_flight(file.path());
  recording = RecordingReader::open(file.path()).value();
  int told = 0;
  const auto index = ReplayIndex::build(*recording, {}, [&](double share) {
    EXPECT_GE(share, 0);
    EXPECT_LE(share, 1);
    ++told;
    return false;
  });
  EXPECT_TRUE(index.is_ok());
  EXPECT_EQ(told, 1);
}

}  // namespace
}  // namespace nearmesh
