// SPDX-License-Identifier: Apache-2.0
#pragma once
// Channels that keep what is sent, as a recorder on the bus would have heard it: each wraps another
// and writes every sample, encoded as on the wire, to a recording, under times of a virtual clock.
// For sessions without DDS, faster than real time.

#include <map>
#include <memory>
#include <string>
#include <tuple>
#include <utility>

#include "core/base/stopwatch.hpp"
#include "nearmesh/core/recording/recording.hpp"
#include "nearmesh/idl/dds/payload.hpp"
#include "nearmesh/idl/messages/topics.hpp"
#include "nearmesh/subscriber/peer/channel.hpp"
#include "publisher/serve/channel.hpp"

namespace nearmesh::test {

/// Writes a recording as the recorder does.
class Tape {
 public:
  Tape(std::unique_ptr<RecordingWriter> writer, const std::string& prefix)
      : writer_(std::move(writer)) {
    const wire::TopicNames names(prefix);
    for (wire::TopicPlace place = 0; place < wire::kTopicCount; ++place)
      if (const wire::TopicFacts& topic = wire::kTopicFacts[place]; topic.is_recorded)
        topics_[place] = value_of(writer_->add_topic({names.at(place), std::string(topic.type)}));
  }

  std::int64_t now_ns = 0;          ///< the virtual clock
  std::int64_t delay_ns = 200'000;  ///< from a sample's source to its receiver
  std::uint64_t lose_every = 0;     ///< of each writer's poses one in so many is not heard; 0: none
  Status status;                    ///< the first failure; nothing is written after it

  void put(wire::SessionId by, const wire::Hello& m) { add(by, "", m); }
  void put(wire::SessionId by, const wire::MeshHeader& m) {
    const std::int64_t id = add(by, "", m);
    keep(writer_->add_model({m.content_hash, m.name, id}));
  }
  void put(wire::SessionId by, const wire::RegionSubscription& m) { add(by, "", m); }
  void put(wire::SessionId by, wire::SessionId peer, const wire::SplitBatchMessage& m) {
    add(by, wire::partition_of(peer), m);
  }
  void put(wire::SessionId by, const wire::BodyDirectory& m) { add(by, "", m); }
  void put(wire::SessionId by, const wire::BodyPoses& m) {
    Writer& writer = writer_of(by, wire::place_of<wire::BodyPoses>(), "");
    if (lose_every != 0 && writer.sequence % lose_every == lose_every - 1) {
      const RecordingGap gap{writer.index, ++writer.sequence, 1, now_ns + delay_ns};
      if (status.is_ok()) keep(writer_->add_gap(gap));
      return;
    }
    add(by, "", m);
  }
  void put(wire::SessionId by, const wire::NearPoses& m) { add(by, "", m); }
  void put(wire::SessionId by, const wire::BodyPromises& m) { add(by, "", m); }
  void put(wire::SessionId by, const wire::ContactReport& m) { add(by, "", m); }
  /// The next so many are not heard.
  void miss_reports(wire::SessionId by, std::uint64_t count) {
    Writer& writer = writer_of(by, wire::place_of<wire::ContactReport>(), "");
    keep(writer_->add_gap({writer.index, writer.sequence + 1, count, now_ns}));
    writer.sequence += count;
  }
  void put(wire::SessionId by, const wire::HeldDetail& m) { add(by, "", m); }
  void put(wire::SessionId by, const wire::WatchedBodies& m) { add(by, "", m); }
  void put(wire::SessionId by, const wire::BoundsReport& m) { add(by, "", m); }
  [[nodiscard]] Status close() {
    keep(writer_->close());
    return status;
  }
  [[nodiscard]] std::uint64_t messages() const { return messages_; }
  [[nodiscard]] double append_s() const { return append_s_; }  ///< spent in the writer

 private:
  struct Writer {
    std::uint32_t index = 0;
    std::uint64_t sequence = 0;
  };
  void keep(const Status& found) {
    if (status.is_ok()) status = found;
  }
  template <class T>
  T value_of(const Result<T>& result) {
    keep(result.status());
    return result.is_ok() ? result.value() : T{};
  }
  Writer& writer_of(wire::SessionId by, wire::TopicPlace topic, const std::string& partition) {
    const auto [at, is_new] = writers_.try_emplace(std::tuple(by, topic, partition));
    if (is_new) {
      // A GUID as DDS has it: of the participant, then of the endpoint.
      EndpointGuid guid{};
      for (std::size_t i = 0; i < 8; ++i) guid[i] = static_cast<std::uint8_t>(by >> (56 - 8 * i));
      guid[14] = static_cast<std::uint8_t>(writers_.size());
      guid[15] = 0x02;
      at->second.index = value_of(writer_->add_writer({topics_.at(topic), guid, partition}));
    }
    return at->second;
  }
  template <class Message>
  std::int64_t add(wire::SessionId by, const std::string& partition, const Message& message) {
    constexpr wire::TopicPlace kTopic = wire::place_of<Message>();
    if (!status.is_ok()) return 0;
    RecordedMessage recorded{.received_ns = now_ns + delay_ns, .source_ns = now_ns};
    recorded.cdr = wire::encode_payload(message);
    const Stopwatch watch;
    Writer& writer = writer_of(by, kTopic, partition);
    recorded.writer = writer.index;
    recorded.sequence = ++writer.sequence;
    const std::int64_t id =
        value_of(writer_->append(recorded, wire::record_key(kTopic, recorded.cdr)));
    append_s_ += watch.seconds();
    ++messages_;
    return id;
  }

  std::unique_ptr<RecordingWriter> writer_;
  std::map<wire::TopicPlace, std::uint32_t> topics_;
  std::map<std::tuple<wire::SessionId, wire::TopicPlace, std::string>, Writer> writers_;
  std::uint64_t messages_ = 0;
  double append_s_ = 0;
};

class TapedPublisher final : public publisher::Channel {
 public:
  TapedPublisher(std::unique_ptr<publisher::Channel> inner, wire::SessionId id, Tape& tape)
      : inner_(std::move(inner)), id_(id), tape_(tape) {}
  void announce(const wire::Hello& hello, const std::vector<wire::MeshHeader>& headers) override {
    tape_.put(id_, hello);
    for (const wire::MeshHeader& header : headers) tape_.put(id_, header);
    inner_->announce(hello, headers);
  }
  publisher::Inbox take() override { return inner_->take(); }
  bool send(wire::SessionId peer, const wire::SplitBatchMessage& batch) override {
    if (!inner_->send(peer, batch)) return false;
    tape_.put(id_, peer, batch);
    return true;
  }
  void wait(double seconds) override { inner_->wait(seconds); }

 private:
  std::unique_ptr<publisher::Channel> inner_;
  const wire::SessionId id_;
  Tape& tape_;
};

class TapedPeer final : public subscriber::Channel {
 public:
  TapedPeer(std::unique_ptr<subscriber::Channel> inner, Tape& tape)
      : inner_(std::move(inner)), tape_(tape) {}
  wire::SessionId own_id() const override { return inner_->own_id(); }
  void send(const wire::RegionSubscription& message) override { pass(message); }
  void send(const wire::BodyPoses& message) override { pass(message); }
  void send(const wire::BodyDirectory& message) override { pass(message); }
  void promise(const wire::BodyPromises& message) override {
    tape_.put(own_id(), message);
    inner_->promise(message);
  }
  void send_near(const wire::NearPoses& message) override {
    tape_.put(own_id(), message);
    inner_->send_near(message);
  }
  void want(const wire::WantedPoses& message) override { inner_->want(message); }
  bool has_recorder() const override { return true; }
  void send(const wire::ContactReport& message) override { pass(message); }
  void tell_held(const wire::HeldDetail& message) override {
    tape_.put(own_id(), message);
    inner_->tell_held(message);
  }
  void tell_watched(const wire::WatchedBodies& message) override {
    tape_.put(own_id(), message);
    inner_->tell_watched(message);
  }
  void tell_bounds(const wire::BoundsReport& message) override {
    tape_.put(own_id(), message);
    inner_->tell_bounds(message);
  }
  Inbox take() override { return inner_->take(); }

 private:
  template <class Message>
  void pass(const Message& message) {
    tape_.put(own_id(), message);
    inner_->send(message);
  }
  std::unique_ptr<subscriber::Channel> inner_;
  Tape& tape_;
};

}  // namespace nearmesh::test
