// SPDX-License-Identifier: Apache-2.0
#pragma once
// A flight on the memory bus as a recording, and an outlet that plays it on another.

#include "publisher/replay/replay.hpp"
#include "session_file.hpp"
#include "tests/unit/subscriber/peer/world.hpp"

namespace nearmesh::test {

constexpr wire::SessionId kOther = 0xb2, kLive = 0xc1, kLateLive = 0xc2;
constexpr double kFrame_s = 0.05;

/// As Service announces the two models.
inline std::pair<wire::Hello, std::vector<wire::MeshHeader>> announcement() {
  wire::Hello hello{.publisher = kPublisher};
  std::vector<wire::MeshHeader> headers;
  for (const auto& [name, served] :
       {std::pair("terrain", &terrain()), std::pair("aircraft", &aircraft())}) {
    const ModelFile file = served->open();
    const auto bytes = file.header_bytes();
    hello.models.push_back({name, file.content_hash(), file.mesh_bytes()});
    headers.push_back(
        {.name = name, .content_hash = file.content_hash(), .bytes = {bytes.begin(), bytes.end()}});
  }
  return {hello, headers};
}

struct RecordOptions {
  bool batches = true;
  int segments = 2;         ///< of 8 frames
  std::string second_part;  ///< a file that the second half goes to
};

/// Two peers that each move an aircraft, and ask about all pairs. Out: seconds that were flown.
inline double record_flight(const std::string& path, const RecordOptions& options = {}) {
  auto file = std::make_unique<SessionFile>(path);
  World world;
  double now_s = 0;
  world.start_publisher();
  world.bus.batch_filter = [&](wire::SessionId peer, wire::SplitBatchMessage& batch) {
    if (options.batches) file->add(now_s, peer, batch);
    return true;
  };
  const auto [hello, headers] = announcement();
  for (const wire::MeshHeader& header : headers) file->add(now_s, header);
  file->add(now_s, hello);
  // Nothing is lost: what is asked for twice would depend on the machine's speed.
  const SessionOptions patient{.request_timeout_s = 60};
  const auto one = world.make_peer(patient, kPeer, true, false);
  const auto two = world.make_peer(patient, kOther, false, true);
  const Flight flight = make_flight(5, options.segments);
  std::size_t asked = 0;
  for (std::size_t frame = 0; frame < flight.frames(); ++frame) {
    if (frame == flight.frames() / 2 && !options.second_part.empty()) {
      file->close();
      file = std::make_unique<SessionFile>(options.second_part, 1);
    }
    now_s = static_cast<double>(frame) * kFrame_s;
    const auto fly = [&](Session& session, wire::SessionId peer, BodyId body,
                         const std::string& model, const Motion& motion) {
      if (frame == 0)
        file->add(now_s,
                  wire::BodyDirectory{.peer = peer, .bodies = {{0, session.name_of(body), model}}});
      file->add(now_s,
                wire::BodyPoses{.peer = peer, .frame = frame, .bodies = {{0, now_s, motion}}});
      for (int round = 0; round < 10; ++round) {
        world.round(session, frame,
                    round == 0 ? std::vector<Session::OwnMotion>{{body, motion}}
                               : std::vector<Session::OwnMotion>{});
        for (; asked < world.bus.subscriptions.size(); ++asked)
          file->add(now_s, world.bus.subscriptions[asked]);
        for (const wire::ContactReport& report : std::exchange(world.bus.reports, {}))
          file->add(now_s, report);
        now_s += 0.001;
      }
    };
    fly(*one, kPeer, kOne, "aircraft", flight.one[frame]);
    fly(*two, kOther, kTwo, "aircraft", flight.two[frame]);
  }
  EXPECT_GT(world.judge.certified(), 0U);
  file->close();
  return now_s;
}

/// A sample as its bytes, whatever they are, and the key that it is recorded under.
struct KeyedBytes {
  wire::TopicPlace topic = 0;
  std::string key;
  std::vector<std::uint8_t> cdr;
};

/// One each second, by a writer for each topic. A recorder of today gives no key to what does not
/// decode; one of another build, and damage, may leave it.
inline void record_bytes(const std::string& path, const std::vector<KeyedBytes>& samples) {
  const wire::TopicNames names("recorded");
  const auto file =
      RecordingWriter::create(path, {7, 0, wire::kWireVersion, "recorded", "idl"}).value();
  std::map<wire::TopicPlace, std::uint32_t> writers;
  std::uint64_t sequence = 0;
  for (const KeyedBytes& sample : samples) {
    const auto [by, is_new] = writers.try_emplace(sample.topic, 0);
    if (is_new) {
      const std::string type(wire::kTopicFacts[sample.topic].type);
      const std::uint32_t topic = file->add_topic({names.at(sample.topic), type}).value();
      by->second =
          file->add_writer({topic, EndpointGuid{static_cast<std::uint8_t>(topic + 1)}, ""}).value();
    }
    const std::int64_t ns =
        SessionFile::kBegin_ns + static_cast<std::int64_t>(sequence) * 1'000'000'000;
    const RecordedMessage message{.writer = by->second,
                                  .sequence = ++sequence,
                                  .received_ns = ns,
                                  .source_ns = ns,
                                  .cdr = sample.cdr};
    ASSERT_TRUE(file->append(message, sample.key).is_ok());
  }
  ASSERT_TRUE(file->close().is_ok());
}

/// Plays into a memory bus, where the recorded publisher has an end for what live peers ask.
class MemoryOutlet final : public publisher::ReplayOutlet {
 public:
  MemoryOutlet(MemoryBus& bus, const publisher::ReplayIndex& index)
      : bus_(bus), index_(index), end_(bus.make_publisher(kPublisher)) {}

  using Key = std::pair<std::uint32_t, std::string>;
  std::map<Key, std::vector<std::uint8_t>> latched;  ///< what a late joiner gets
  std::vector<std::pair<std::uint32_t, std::vector<std::uint8_t>>> published;  ///< all of it
  std::vector<wire::SplitBatchMessage> answers;                                ///< to live peers
  std::uint64_t refused_bytes = 0;  ///< of answers that refuse
  bool restart = false;

  bool publish(std::uint32_t stream, const std::vector<std::uint8_t>& cdr) override {
    published.emplace_back(stream, cdr);
    if (const std::string key = deliver(stream, cdr); !key.empty()) latched[{stream, key}] = cdr;
    return true;
  }
  void withdraw(std::uint32_t stream, const std::vector<std::uint8_t>& cdr) override {
    latched.erase({stream, key_of(stream, cdr)});
  }
  bool take_restart() override { return std::exchange(restart, false); }
  publisher::Inbox take() override { return end_->take(); }
  bool send(wire::SessionId peer, const wire::SplitBatchMessage& batch) override {
    answers.push_back(batch);
    if (batch.refused && !batch.wants_regions) refused_bytes += batch.bytes.size();
    return end_->send(peer, batch);
  }
  void wait(double) override {}
  std::vector<std::string> take_complaints() override { return {}; }

  /// As DDS tells a late joiner; who has it already is not disturbed.
  void tell_latched() {
    for (const auto& [key, cdr] : latched) deliver(key.first, cdr);
  }

 private:
  std::string key_of(std::uint32_t stream, const std::vector<std::uint8_t>& cdr) const {
    switch (index_.streams()[stream].topic) {
      case wire::place_of<wire::Hello>():
        return wire::partition_of(wire::decode_payload<wire::Hello>(cdr).value().publisher);
      case wire::place_of<wire::MeshHeader>():
        return wire::key_of(wire::decode_payload<wire::MeshHeader>(cdr).value().content_hash);
      case wire::place_of<wire::BodyPoses>():
      case wire::place_of<wire::BodyDirectory>():
        return wire::record_key(index_.streams()[stream].topic, cdr);
      default:
        return "";
    }
  }
  std::string deliver(std::uint32_t stream, const std::vector<std::uint8_t>& cdr) {
    const wire::TopicPlace topic = index_.streams()[stream].topic;
    if (topic == wire::place_of<wire::Hello>())
      bus_.inject(wire::decode_payload<wire::Hello>(cdr).value());
    if (topic == wire::place_of<wire::MeshHeader>())
      bus_.inject(*index_.publishers().begin(),
                  wire::decode_payload<wire::MeshHeader>(cdr).value());
    if (topic == wire::place_of<wire::BodyDirectory>())
      bus_.tell(wire::decode_payload<wire::BodyDirectory>(cdr).value());
    if (topic == wire::place_of<wire::BodyPoses>())
      bus_.inject(wire::decode_payload<wire::BodyPoses>(cdr).value());
    return key_of(stream, cdr);
  }

  MemoryBus& bus_;
  const publisher::ReplayIndex& index_;
  std::unique_ptr<publisher::Channel> end_;
};

/// A recording that is played to live peers, with a clock of its own.
class ReplayWorld {
 public:
  explicit ReplayWorld(const std::string& path, publisher::PlayheadOptions options = {},
                       bool loop = false)
      : recording(RecordingReader::open(path).value()),
        index(publisher::ReplayIndex::build(*recording, {}, {}).value()),
        outlet(world.bus, *index),
        replay(*recording, *index, outlet,
               publisher::Playhead::create(*recording, options, 0).value(), loop) {
    EXPECT_TRUE(replay.begin().is_ok());
  }

  World world;
  std::unique_ptr<RecordingReader> recording;
  std::unique_ptr<publisher::ReplayIndex> index;
  MemoryOutlet outlet;
  publisher::Replay replay;
  double now_s = 0;

  std::unique_ptr<Session> join(wire::SessionId id = kLive) {
    auto session = world.make_peer(quick_options(), id, false, false);
    outlet.tell_latched();
    return session;
  }
  void step(double seconds = 0.005) {
    now_s += seconds;
    const Status status = replay.step(now_s);
    EXPECT_TRUE(status.is_ok()) << status.message();
  }
  void play_to(double time_s, Session* live = nullptr) {
    while (replay.playhead().time_s(now_s) < time_s && !replay.playhead().at_end()) {
      step();
      if (live != nullptr) world.round(*live, frame());
    }
  }
  /// Until nothing changes any more. The replay should be paused.
  FrameReport settle(Session& live) {
    FrameReport report;
    for (int i = 0; i < 100; ++i) {
      step(0.05);
      report = world.round(live, frame());
    }
    return report;
  }

 private:
  /// Of live peers, whose clock is the recording's: their frames are as long as those recorded.
  [[nodiscard]] std::uint64_t frame() {
    return static_cast<std::uint64_t>(replay.playhead().time_s(now_s) / kFrame_s);
  }
};

}  // namespace nearmesh::test
