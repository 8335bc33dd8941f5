// SPDX-License-Identifier: Apache-2.0
#pragma once
// Recordings made by tests: messages in, a file out.

#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <memory>
#include <string>
#include <tuple>

#include "nearmesh/core/recording/recording.hpp"
#include "nearmesh/idl/dds/payload.hpp"
#include "nearmesh/idl/messages/topics.hpp"

namespace nearmesh::test {

/// One file of a recording, or one part of several.
class SessionFile {
 public:
  static constexpr std::int64_t kBegin_ns = 1'700'000'000'000'000'000;

  explicit SessionFile(const std::string& path, std::uint32_t part = 0,
                       std::uint32_t wire_version = wire::kWireVersion)
      : names_("recorded"),
        writer_(RecordingWriter::create(path, {7, part, wire_version, "recorded", "idl"}).value()) {
  }

  void add(double time_s, const wire::Hello& m, int by = 0) { put(time_s, by, "", m); }
  void add(double time_s, const wire::MeshHeader& m, int by = 0) {
    put(time_s, by, "", m);
    EXPECT_TRUE(writer_->add_model({m.content_hash, m.name, last_}).is_ok());
  }
  void add(double time_s, const wire::RegionSubscription& m) {
    put(time_s, 1000 + int(m.peer), "", m);
  }
  void add(double time_s, wire::SessionId peer, const wire::SplitBatchMessage& m) {
    put(time_s, 2000 + int(peer), wire::partition_of(peer), m);
  }
  void add(double time_s, const wire::BodyPoses& m) { put(time_s, 3000 + int(m.peer), "", m); }
  void add(double time_s, const wire::BodyDirectory& m) { put(time_s, 5000 + int(m.peer), "", m); }
  void add(double time_s, const wire::ContactReport& m) { put(time_s, 4000 + int(m.peer), "", m); }
  void add(double time_s, const wire::WatchedBodies& m) { put(time_s, 6000 + int(m.peer), "", m); }
  void add(double time_s, const wire::BoundsReport& m) { put(time_s, 7000 + int(m.peer), "", m); }
  /// Bytes of any kind, as a contact report of writer 0.
  void add_bytes(double time_s, std::vector<std::uint8_t> cdr) {
    put_bytes(time_s, wire::place_of<wire::ContactReport>(), 0, "", std::move(cdr));
  }
  void add_gap(std::uint64_t count) {
    EXPECT_TRUE(writer_->add_gap({0, 1, count, kBegin_ns}).is_ok());
  }
  [[nodiscard]] std::int64_t last() const { return last_; }
  void close() { EXPECT_TRUE(writer_->close().is_ok()); }

 private:
  template <class Message>
  void put(double time_s, int by, const std::string& partition, const Message& m) {
    put_bytes(time_s, wire::place_of<Message>(), by, partition, encode_payload(m));
  }
  void put_bytes(double time_s, wire::TopicPlace topic, int by, const std::string& partition,
                 std::vector<std::uint8_t> cdr) {
    const auto [at, is_new_topic] = topics_.try_emplace(topic, 0);
    if (is_new_topic) {
      const std::string type(wire::kTopicFacts[topic].type);
      at->second = writer_->add_topic({names_.at(topic), type}).value();
    }
    const auto [who, is_new] = writers_.try_emplace({topic, by, partition}, 0);
    EndpointGuid guid{};
    guid[0] = static_cast<std::uint8_t>(by & 0xff);
    guid[1] = static_cast<std::uint8_t>(by >> 8);
    if (is_new) who->second = writer_->add_writer({at->second, guid, partition}).value();
    const std::int64_t ns = kBegin_ns + std::llround(time_s * 1e9);
    const std::string key = wire::record_key(topic, cdr);
    const auto id = writer_->append({.writer = who->second,
                                     .sequence = ++sequences_[who->second],
                                     .received_ns = ns,
                                     .source_ns = ns,
                                     .cdr = std::move(cdr)},
                                    key);
    ASSERT_TRUE(id.is_ok()) << id.status().message();
    last_ = id.value();
  }

  const wire::TopicNames names_;
  std::unique_ptr<RecordingWriter> writer_;
  std::map<wire::TopicPlace, std::uint32_t> topics_;
  std::map<std::tuple<wire::TopicPlace, int, std::string>, std::uint32_t> writers_;
  std::map<std::uint32_t, std::uint64_t> sequences_;
  std::int64_t last_ = 0;
};

}  // namespace nearmesh::test
