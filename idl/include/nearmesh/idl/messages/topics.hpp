// SPDX-License-Identifier: Apache-2.0
#pragma once
// API (docs/api.md).
// The table of topics: what each is called, what it carries, how it is delivered, who may write and
// read it, whether it is recorded and under which key. Names, QoS, security documents, recorder and
// replay follow from it. No Fast DDS here. A new topic is one entry here, one struct with its check
// (messages.hpp, nearmesh.idl), one codec (idl/dds/codec.hpp).

#include <array>
#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <optional>
#include <string>
#include <string_view>
#include <tuple>
#include <type_traits>
#include <utility>
#include <vector>

#include "nearmesh/idl/messages/messages.hpp"

namespace nearmesh::wire {

/// What a program is on a secured bus.
enum class Role : std::uint8_t { kPublisher, kSubscriber, kRecorder };
class Roles {
 public:
  constexpr Roles(std::initializer_list<Role> roles) {
    for (const Role role : roles) bits_ |= bit(role);
  }
  [[nodiscard]] constexpr bool has(Role role) const { return (bits_ & bit(role)) != 0; }

 private:
  static constexpr unsigned bit(Role role) { return 1U << static_cast<unsigned>(role); }
  unsigned bits_ = 0;
};

/// What a topic promises its readers.
struct Delivery {
  /// All samples are kept until every reader has them, and a full history is seen at once as
  /// "cannot be taken now"; else the newest, so that one frozen reader does not stop the others.
  bool keeps_all = false;
  int depth = 1;            ///< samples kept per key; of keeps_all in total
  bool is_latched = false;  ///< whoever joins later gets what is kept
  bool is_reliable = true;  ///< a lost datagram is repaired within a heartbeat
  /// Each peer writes it and each hears it, and what is lost is soon said anew: heartbeats go with
  /// no sample, and come each second. All readers answer each, so that many on a busy machine would
  /// be occupied with nothing else.
  bool is_said_again = false;
  /// Its writer chooses who gets which sample (idl/dds/routes.hpp); a recorder gets them all.
  bool is_routed = false;
  /// Large, and asked for by many at once: a burst would drown the link and its own repairs.
  bool is_paced = false;
};

/// What the table says of a topic, whatever its messages are.
struct TopicFacts {
  std::string_view name;  ///< last part of its name on the bus
  std::string_view type;  ///< of the generated type, as it is announced
  Delivery delivery;
  Roles writers;
  Roles readers;
  /// Who overhears it: a publisher its rivals, a recorder the peers. Named behind what it reads in
  /// its permissions.
  Roles listeners{};
  bool has_partitions = false;  ///< each reader hears its own partition alone
  /// Readers are few: each writer also signs for each of them apart, so that none can forge it to
  /// another.
  bool signs_for_each = false;
  /// Its name carries the wire version, so that layouts of two versions never meet.
  bool is_versioned = true;
  bool is_recorded = false;
  /// Recorded once for each process and name: who took part. Never replayed: it speaks of processes
  /// that are not there.
  bool tells_who = false;
};

template <class Carried>
struct Topic : TopicFacts {
  using Message = Carried;
  /// The key under which a sample is recorded (RecordingWriter::append), so that what holds at a
  /// moment is found without reading all; "" for a sample that holds nothing, nullptr where none
  /// does.
  std::string (*key)(const Message&) = nullptr;
};

/// 16 hexadecimal digits.
[[nodiscard]] std::string key_of(std::uint64_t id);
/// 32 of them.
[[nodiscard]] std::string key_of(const ContentHash& content);
/// Of a part of a peer's bodies.
[[nodiscard]] std::string key_of(SessionId peer, std::uint32_t part);

inline constexpr std::tuple kTopics{
    // The latest state of each publisher. Not versioned: one of another version must be heard in
    // order to be refused loudly.
    Topic<Hello>{{.name = "hello",
                  .type = "nearmesh::wire_types::HelloSample",
                  .delivery = {.is_latched = true},
                  .writers = {Role::kPublisher},
                  .readers = {Role::kSubscriber, Role::kRecorder},
                  .listeners = {Role::kPublisher},
                  .is_versioned = false,
                  .is_recorded = true},
                 [](const Hello& m) { return key_of(m.publisher); }},
    // Immutable per content hash.
    Topic<MeshHeader>{{.name = "mesh_header",
                       .type = "nearmesh::wire_types::MeshHeaderSample",
                       .delivery = {.is_latched = true, .is_paced = true},
                       .writers = {Role::kPublisher},
                       .readers = {Role::kSubscriber, Role::kRecorder},
                       .is_recorded = true},
                      [](const MeshHeader& m) { return key_of(m.content_hash); }},
    // A stream to one peer through its own writer, so keeping all stalls nobody else, and nothing
    // is lost. The depth is more than the credit window ever lets out.
    Topic<SplitBatchMessage>{{.name = "split_batch",
                              .type = "nearmesh::wire_types::SplitBatchSample",
                              .delivery = {.keeps_all = true, .depth = 256},
                              .writers = {Role::kPublisher},
                              .readers = {Role::kSubscriber, Role::kRecorder},
                              .has_partitions = true,
                              .signs_for_each = true,
                              .is_recorded = true},
                             [](const SplitBatchMessage& m) { return key_of(m.content_hash); }},
    // A stream of requests. Not latched: a restarted publisher must not answer old ones. What is
    // displaced while it waits unread is asked for again.
    Topic<RegionSubscription>{{.name = "region_subscription",
                               .type = "nearmesh::wire_types::RegionSubscriptionSample",
                               .delivery = {.depth = 256},
                               .writers = {Role::kSubscriber},
                               .readers = {Role::kPublisher},
                               .listeners = {Role::kRecorder},
                               .signs_for_each = true,
                               .is_recorded = true},
                              [](const RegionSubscription& m) {
                                return m.request == 0 ? std::string() : key_of(m.peer);
                              }},
    // The latest poses of each part of a mover's bodies; latched for recorders. Peers hear them
    // with best effort, for a lost one would hold up the next until it is repaired; those at rest
    // are said again.
    Topic<BodyPoses>{{.name = "body_poses",
                      .type = "nearmesh::wire_types::BodyPosesSample",
                      .delivery = {.is_latched = true, .is_said_again = true},
                      .writers = {Role::kSubscriber},
                      .readers = {Role::kSubscriber},
                      .listeners = {Role::kRecorder},
                      .is_recorded = true},
                     [](const BodyPoses& m) { return key_of(m.peer, m.part); }},
    // Of bodies of which promises are made: to those who want them, and to recorders. Peers hear
    // them with best effort: the next is newer, and nobody has to be told of what went to others.
    Topic<NearPoses>{{.name = "near_poses",
                      .type = "nearmesh::wire_types::BodyPosesSample",
                      .delivery = {.depth = 16, .is_routed = true},
                      .writers = {Role::kSubscriber},
                      .readers = {Role::kSubscriber},
                      .listeners = {Role::kRecorder},
                      .is_recorded = true},
                     [](const NearPoses& m) { return key_of(m.peer, m.part); }},
    // To the movers that they name. Said again, so what is lost does not matter.
    Topic<WantedPoses>{{.name = "wanted_poses",
                        .type = "nearmesh::wire_types::WantedPosesSample",
                        .delivery = {.is_routed = true},
                        .writers = {Role::kSubscriber},
                        .readers = {Role::kSubscriber}}},
    // The latest promises of each part of a mover's bodies.
    Topic<BodyPromises>{{.name = "body_promises",
                         .type = "nearmesh::wire_types::BodyPromisesSample",
                         .delivery = {.is_latched = true, .is_said_again = true},
                         .writers = {Role::kSubscriber},
                         .readers = {Role::kSubscriber},
                         .listeners = {Role::kRecorder},
                         .is_recorded = true},
                        [](const BodyPromises& m) { return key_of(m.peer, m.part); }},
    // Who these bodies are. Poses and promises count once it has come.
    Topic<BodyDirectory>{{.name = "body_directory",
                          .type = "nearmesh::wire_types::BodyDirectorySample",
                          .delivery = {.is_latched = true, .is_said_again = true},
                          .writers = {Role::kSubscriber},
                          .readers = {Role::kSubscriber},
                          .listeners = {Role::kRecorder},
                          .is_recorded = true},
                         [](const BodyDirectory& m) { return key_of(m.peer, m.part); }},
    // The latest answer for each pair, renewed every frame: nothing holds.
    Topic<ContactReport>{{.name = "contact_report",
                          .type = "nearmesh::wire_types::ContactReportSample",
                          .delivery = {},
                          .writers = {Role::kSubscriber},
                          .readers = {},
                          .listeners = {Role::kRecorder},
                          .signs_for_each = true,
                          .is_recorded = true}},
    // Which bodies each peer knows of that watches all pairs; latched, so that whoever comes to
    // record can prove what follows, and some that were replaced while it came: the first reports
    // may be about these.
    Topic<WatchedBodies>{{.name = "watched_bodies",
                          .type = "nearmesh::wire_types::WatchedBodiesSample",
                          .delivery = {.depth = 16, .is_latched = true},
                          .writers = {Role::kSubscriber},
                          .readers = {},
                          .listeners = {Role::kRecorder},
                          .signs_for_each = true,
                          .is_recorded = true},
                         [](const WatchedBodies& m) { return key_of(m.peer, m.part); }},
    // What bounds prove free, a sample a frame: nothing holds. Some seconds of them are kept, for
    // each is another answer.
    Topic<BoundsReport>{{.name = "bounds_report",
                         .type = "nearmesh::wire_types::BoundsReportSample",
                         .delivery = {.depth = 64},
                         .writers = {Role::kSubscriber},
                         .readers = {},
                         .listeners = {Role::kRecorder},
                         .signs_for_each = true,
                         .is_recorded = true}},
    // What a peer holds of each model, said anew to each recorder that comes.
    Topic<HeldDetail>{
        {.name = "held_detail",
         .type = "nearmesh::wire_types::HeldDetailSample",
         .delivery = {},
         .writers = {Role::kSubscriber},
         .readers = {},
         .listeners = {Role::kRecorder},
         .signs_for_each = true,
         .is_recorded = true},
        [](const HeldDetail& m) { return key_of(m.peer) + "/" + key_of(m.content_hash); }},
    // What each process said last of itself; who asks later gets it at once.
    Topic<ProcessStatus>{{.name = "process_status",
                          .type = "nearmesh::wire_types::ProcessStatusSample",
                          .delivery = {.is_latched = true, .is_said_again = true},
                          .writers = {Role::kPublisher, Role::kSubscriber},
                          .readers = {Role::kSubscriber},
                          .listeners = {Role::kRecorder},
                          .is_recorded = true,
                          .tells_who = true},
                         [](const ProcessStatus& m) { return key_of(m.session); }},
    // A self-test's samples, each once.
    Topic<Echo>{{.name = "echo",
                 .type = "nearmesh::wire_types::EchoSample",
                 .delivery = {.depth = 64},
                 .writers = {Role::kSubscriber},
                 .readers = {Role::kSubscriber}}},
    Topic<Probe>{{.name = "probe",
                  .type = "nearmesh::wire_types::EchoSample",
                  .delivery = {.depth = 64, .is_reliable = false},
                  .writers = {Role::kSubscriber},
                  .readers = {Role::kSubscriber}}},
};

// --- The table, walked

inline constexpr std::size_t kTopicCount = std::tuple_size_v<decltype(kTopics)>;

template <class Message>
[[nodiscard]] constexpr const Topic<Message>& topic_of() {
  return std::get<Topic<Message>>(kTopics);
}

/// use(topic) of each, in order.
template <class Use>
constexpr void for_each_topic(Use use) {
  std::apply([&use](const auto&... topics) { (use(topics), ...); }, kTopics);
}

/// A topic where its message is not known: its place in the table.
using TopicPlace = std::size_t;

inline constexpr std::array<TopicFacts, kTopicCount> kTopicFacts = std::apply(
    [](const auto&... topics) {
      return std::array<TopicFacts, kTopicCount>{static_cast<const TopicFacts&>(topics)...};
    },
    kTopics);

/// Names of those that are recorded, in order: "hello", and so on.
[[nodiscard]] std::vector<std::string> recorded_topics();

template <class Message>
[[nodiscard]] constexpr TopicPlace place_of() {
  TopicPlace place = 0, found = kTopicCount;
  for_each_topic([&](const auto& topic) {
    if (std::is_same_v<typename std::decay_t<decltype(topic)>::Message, Message>) found = place;
    ++place;
  });
  return found;
}

/// use(topic) of the one at `place`; it gives the same type for all.
template <class Use>
auto visit_topic(TopicPlace place, Use use) {
  using Out = decltype(use(std::get<0>(kTopics)));
  std::optional<Out> out;
  TopicPlace at = 0;
  for_each_topic([&](const auto& topic) {
    if (at++ == place) out.emplace(use(topic));
  });
  return std::move(*out);
}

// --- Names on the bus

/// The topics' names on one bus.
class TopicNames {
 public:
  /// `version`: "*" for a pattern of every wire version.
  explicit TopicNames(std::string_view prefix,
                      std::string_view version = std::to_string(kWireVersion));

  template <class Message>
  [[nodiscard]] const std::string& of() const {
    return names_[place_of<Message>()];
  }
  [[nodiscard]] const std::string& at(TopicPlace place) const { return names_[place]; }
  [[nodiscard]] std::optional<TopicPlace> find(std::string_view name) const;
  void rename(TopicPlace place, std::string name) { names_[place] = std::move(name); }

 private:
  std::array<std::string, kTopicCount> names_;
};

/// The partition in which one peer's batches travel: 16 hexadecimal digits.
[[nodiscard]] std::string partition_of(SessionId peer);
/// Whose partition that is; 0 where it is nobody's.
[[nodiscard]] SessionId peer_of(std::string_view partition);

/// DDS stays silent when two programs use one topic with different types, or topics of different
/// wire versions. Returns one line about a remote endpoint that cannot talk to us, or nothing when
/// it can or is none of ours. `program`: what its process is called; "": that is not known.
[[nodiscard]] std::optional<std::string> judge_remote_endpoint(std::string_view prefix,
                                                               std::string_view topic,
                                                               std::string_view type,
                                                               std::string_view program);

/// A fresh session id, never 0: 64 bits from the operating system.
[[nodiscard]] SessionId make_session_id();

inline constexpr std::size_t kMaxPrefixBytes = 100;
/// Errors: kInvalidArgument unless the prefix is 1 to 100 of [A-Za-z0-9_/-] without '/' at an end.
[[nodiscard]] Status check_prefix(std::string_view prefix);

}  // namespace nearmesh::wire
