// SPDX-License-Identifier: Apache-2.0
#pragma once
// Joining the bus: a participant and all that is made on it, which is removed again. For the rooms
// named dds alone.

#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/topic/ContentFilteredTopic.hpp>
#include <fastdds/dds/topic/Topic.hpp>

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "listeners.hpp"
#include "mailbox.hpp"
#include "nearmesh/idl/dds/transport_options.hpp"
#include "nearmesh/idl/messages/topics.hpp"
#include "qos.hpp"
#include "told_bodies.hpp"
#include "type_support.hpp"

namespace nearmesh::wire {

class DiscoveryListener;
class DoorWatch;

struct BusOptions {
  TransportOptions transport;
  fdds::DomainParticipant* host_participant = nullptr;  ///< used as it is, instead of an own one
  std::int32_t header_bytes_per_s = 0;  ///< above 0: makes the flow controller kPacedFlow
  std::optional<TopicNames> names;      ///< where topics are called otherwise than the prefix says
  /// All bodies that the host will ever name, where it knows them: of an own participant others'
  /// doors are told (told_bodies.hpp). More than kMaxToldBodies are not told.
  std::optional<BodyNames> bodies;
  struct Found {
    Handle endpoint;
    std::string topic, partition;  ///< "" for none
    bool gone = false;
  };
  /// Told of every writer elsewhere that is found, before any of its samples comes, or goes; not
  /// with a host's participant. Called by threads of Fast DDS.
  std::function<void(const Found& found)> on_writer;
  /// The same of readers.
  std::function<void(const Found& found)> on_reader;
};

/// To be called before a writer is deleted. Fast DDS before 2.13 resets the samples of a writer
/// that it deletes while a heartbeat may look for gaps between them, and then neither thread ever
/// ends (its pull request 4076).
void drop_samples(fdds::DataWriter& writer);

/// A participant, own or the host's, and everything made on it; the destructor removes that, and
/// only that. Threads: one. Listeners must outlive the bus.
class Bus {
 public:
  /// Of an own participant check_room() first (room.hpp), before a thread is made for it.
  /// Errors: kInvalidArgument (prefix, interface, domain, security); kIo when Fast DDS refuses.
  [[nodiscard]] static Result<std::unique_ptr<Bus>> open(const BusOptions& options,
                                                         Mailbox& mailbox);
  ~Bus();
  Bus(const Bus&) = delete;
  Bus& operator=(const Bus&) = delete;

  /// A Subscriber or Publisher of its own in the partition ("" for none) with one endpoint of the
  /// message's topic: name, type and QoS are those of the table. Errors: kConflict when the host
  /// has another type or topic under the name; kIo.
  template <class Message, class Type = TypeOf<Message>>
  [[nodiscard]] Result<fdds::DataReader*> reader(ReaderListener& listener,
                                                 const std::string& partition = "",
                                                 Hearing hearing = Hearing::kAsPromised) {
    const auto topic = add_topic<Type>(names_->of<Message>());
    NEARMESH_RETURN_IF_ERROR(topic);
    fdds::TopicDescription* heard = topic.value();
    if (topic_of<Message>().delivery.is_routed && hearing != Hearing::kAll) {
      const auto routed = add_routed(topic.value());
      NEARMESH_RETURN_IF_ERROR(routed);
      heard = routed.value();
    }
    return add_reader(heard, reader_qos(topic_of<Message>().delivery, hearing), listener,
                      partition);
  }
  template <class Message>
  [[nodiscard]] Result<fdds::DataWriter*> writer(WriterListener& listener,
                                                 const std::string& partition = "") {
    const auto topic = add_topic<TypeOf<Message>>(names_->of<Message>());
    NEARMESH_RETURN_IF_ERROR(topic);
    return add_writer(topic.value(), writer_qos(topic_of<Message>().delivery, heartbeat_s_),
                      listener, partition);
  }
  void remove_writer(fdds::DataWriter* writer);
  void remove_reader(fdds::DataReader* reader);
  [[nodiscard]] const TopicNames& names() const { return *names_; }
  /// Poses that this writer tells are of these bodies alone (PoseHearers).
  void tell_moved(const fdds::DataWriter& writer, const std::vector<std::string>& bodies);
  /// Of the participant; nullptr: a host's, without one.
  [[nodiscard]] const std::shared_ptr<DoorWatch>& door() const { return door_; }
  /// Whether a writer or reader of another participant was ever found, since this was opened: one
  /// that only announces itself may not be within reach. True of a host's participant. Any thread.
  [[nodiscard]] bool has_found_others() const;

 private:
  Bus() = default;
  void add_routes();
  template <class Type>
  Result<fdds::Topic*> add_topic(const std::string& name) {
    fdds::TypeSupport type(new Type);
    return add_topic(name, type, [](const fdds::TypeSupport& found) {
      return dynamic_cast<const Type*>(found.get()) != nullptr;
    });
  }
  Result<fdds::Topic*> add_topic(const std::string& name, const fdds::TypeSupport& type,
                                 bool (*is_ours)(const fdds::TypeSupport&));
  Status add_type(const fdds::TypeSupport& type, bool (*is_ours)(const fdds::TypeSupport&));
  Result<fdds::ContentFilteredTopic*> add_routed(fdds::Topic* topic);
  Result<fdds::DataReader*> add_reader(fdds::TopicDescription* topic,
                                       const fdds::DataReaderQos& qos, ReaderListener& listener,
                                       const std::string& partition);
  Result<fdds::DataWriter*> add_writer(fdds::Topic* topic, const fdds::DataWriterQos& qos,
                                       WriterListener& listener, const std::string& partition);

  std::unique_ptr<DiscoveryListener> discovery_;
  fdds::DomainParticipant* participant_ = nullptr;
  bool is_own_ = false;
  std::string refusal_hint_;  ///< for messages, where security is on
  std::vector<fdds::DataWriter*> writers_;
  std::vector<fdds::DataReader*> readers_;
  std::map<std::string, fdds::Topic*> topics_;
  std::vector<fdds::ContentFilteredTopic*> routed_;
  std::vector<std::string> types_;
  std::optional<TopicNames> names_;
  double heartbeat_s_ = 0;
  double silence_s_ = 0;
  std::shared_ptr<DoorWatch> door_;
};

/// Adds to a process's status the name that it was given, and what the door knows.
void tell_of_process(const TransportOptions& options, const DoorWatch* door, ProcessStatus& status);

/// kConflict once this program's own identity does not count any more: then it hears nobody.
[[nodiscard]] Status identity_of(const DoorWatch* door);

}  // namespace nearmesh::wire
