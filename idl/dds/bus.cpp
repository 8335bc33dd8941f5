// SPDX-License-Identifier: Apache-2.0
#include "bus.hpp"

#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>

#include <algorithm>
#include <sstream>
#include <utility>

#include "dds_transport.hpp"
#include "discovery_listener.hpp"
#include "door_watch.hpp"
#include "endpoint_names.hpp"
#include "idl/messages/process_name.hpp"
#include "nearmesh/idl/dds/door.hpp"
#include "room.hpp"
#include "routes.hpp"

namespace nearmesh::wire {

namespace {

constexpr std::uint32_t kMostPerPeer = 120;  ///< ports of a domain, two each
constexpr int kMostSessions = 256;           ///< on one participant of a host's

Status check_options(const TransportOptions& options) {
  if (const Status named = check_process_name(name_of_process(options.name)); !named.is_ok())
    return {named.code(), "name: " + named.message()};
  NEARMESH_RETURN_IF_ERROR(check_prefix(options.prefix));
  if (options.domain > kMaxDomain)
    return {StatusCode::kInvalidArgument, "domain: expected at most " + std::to_string(kMaxDomain) +
                                              ", found " + std::to_string(options.domain)};
  if (options.participants_per_peer < 1 || options.participants_per_peer > kMostPerPeer)
    return {StatusCode::kInvalidArgument, "participants_per_peer: expected 1 to " +
                                              std::to_string(kMostPerPeer) + ", found " +
                                              std::to_string(options.participants_per_peer)};
  const auto refuse = [](const std::string& option, const std::string& expected, double found_s) {
    return Status{StatusCode::kInvalidArgument,
                  option + ": expected " + expected + ", found " + std::to_string(found_s) + " s"};
  };
  const std::string announcement = std::to_string(options.announcement_s) + " s";
  for (const auto& [option, value_s] : {std::pair{"announcement_s", options.announcement_s},
                                        {"heartbeat_s", options.heartbeat_s},
                                        {"identity_period_s", options.identity_period_s}})
    if (!(value_s > 0)) return refuse(option, "more than 0", value_s);
  if (!(options.lease_s >= 2 * options.announcement_s))
    return refuse("lease_s", "at least twice announcement_s, " + announcement, options.lease_s);
  if (!(options.silence_s > options.announcement_s))
    return refuse("silence_s", "more than announcement_s, " + announcement, options.silence_s);
  return Status::ok();
}

}  // namespace

Result<std::unique_ptr<Bus>> Bus::open(const BusOptions& options, Mailbox& mailbox) {
  NEARMESH_RETURN_IF_ERROR(check_options(options.transport));
  std::unique_ptr<Bus> bus(new Bus);
  bus->names_ = options.names ? options.names : TopicNames(options.transport.prefix);
  bus->heartbeat_s_ = options.transport.heartbeat_s;
  bus->silence_s_ = options.transport.silence_s;
  if (options.host_participant != nullptr) {
    bus->participant_ = options.host_participant;
    bus->door_ = door_watch_of(bus->participant_->get_qos());
    bus->add_routes();
    return bus;
  }
  // From scratch, not from the default profile: an XML file meant for other programs must not reach
  // us.
  fdds::DomainParticipantQos qos;
  qos.name(announced_name(options.transport.name));
  speak_as_2_9(qos);
  NEARMESH_RETURN_IF_ERROR(set_transport(options.transport, qos));
  if (!options.transport.security.empty()) {
    NEARMESH_RETURN_IF_ERROR(add_identity(qos, options.transport.security, options.transport.domain,
                                          options.transport.prefix));
    bus->refusal_hint_ = "; its permissions may not allow it: " + options.transport.security;
  }
  if (kHasFlowControllers && options.header_bytes_per_s > 0) {
    auto flow = std::make_shared<rtps::FlowControllerDescriptor>();
    flow->name = kPacedFlow;
    flow->period_ms = 10;
    flow->max_bytes_per_period =
        std::max(options.header_bytes_per_s / 100,
                 static_cast<std::int32_t>(2 * datagram_bytes(options.transport)));
    qos.flow_controllers().push_back(flow);
  }
  // On a secured bus announcements are not encrypted, and no door looks for it.
  if (options.bodies && options.transport.security.empty())
    if (auto told = user_data_of(*options.bodies)) qos.user_data().setValue(*told);
  add_door(qos, options.transport.identity_period_s);
  bus->discovery_ = std::make_unique<DiscoveryListener>(mailbox, options);
  // No status goes to the participant's listener: data events belong to the endpoints' own.
  bus->participant_ = fdds::DomainParticipantFactory::get_instance()->create_participant(
      options.transport.domain, qos, bus->discovery_.get(), fdds::StatusMask::none());
  if (bus->participant_ == nullptr)
    return Status{StatusCode::kIo, "Fast DDS could not create a participant in domain " +
                                       std::to_string(options.transport.domain) +
                                       bus->refusal_hint_};
  bus->is_own_ = true;
  bus->discovery_->set_own(participant_of(bus->participant_->get_instance_handle()));
  bus->add_routes();
  bus->door_ = door_watch_of(bus->participant_->get_qos());
  bus->door_->set_mailbox(&mailbox);
  // Fast DDS makes a participant that finds no ports all the same: most others would never find it.
  if (options.transport.transport != Transport::kTcp && bus->door_->own_ports() < 2)
    return Status{
        StatusCode::kIo,
        "cannot join: all " + std::to_string(kPlacesPerDomain) + " places of domain " +
            std::to_string(options.transport.domain) +
            " on this machine are taken (UDP ports from " +
            std::to_string(qos.wire_protocol().port.getUnicastPort(options.transport.domain, 0)) +
            " on): end programs that are not needed, or take another domain or machine"};
  return bus;
}

Bus::~Bus() {
  if (participant_ == nullptr) return;
  if (is_own_) door_->set_mailbox(nullptr);
  while (!writers_.empty()) remove_writer(writers_.back());
  while (!readers_.empty()) remove_reader(readers_.back());
  for (fdds::ContentFilteredTopic* topic : routed_)
    participant_->delete_contentfilteredtopic(topic);
  // Refused, rightly, while another session on the host's participant uses them.
  participant_->unregister_content_filter_factory(kRoutesFilter);
  for (const auto& [name, topic] : topics_)
    if (topic != nullptr) participant_->delete_topic(topic);
  // Refused, rightly, while another session on the host's participant uses the type.
  for (const std::string& type : types_) participant_->unregister_type(type);
  if (is_own_) fdds::DomainParticipantFactory::get_instance()->delete_participant(participant_);
}

bool Bus::has_found_others() const { return !is_own_ || discovery_->has_found_others(); }

/// Another session on the host's participant may have done so.
void Bus::add_routes() {
  if (participant_->lookup_content_filter_factory(kRoutesFilter) == nullptr)
    participant_->register_content_filter_factory(kRoutesFilter, &routes_filters());
}

Result<fdds::ContentFilteredTopic*> Bus::add_routed(fdds::Topic* topic) {
  // Of readers whose filters have one name and expression, wherever they are, a writer tells one
  // result: that of whom it asked first.
  std::ostringstream participant;
  participant << participant_->guid().guidPrefix;
  const std::string name = topic->get_name() + "#" + participant.str();
  fdds::ContentFilteredTopic* routed = nullptr;
  for (int i = 0; i < kMostSessions && routed == nullptr; ++i) {  // of one participant
    const std::string its = name + "#" + std::to_string(i);
    if (participant_->lookup_topicdescription(its) == nullptr)
      routed = participant_->create_contentfilteredtopic(its, topic, kRoutesExpression, {},
                                                         kRoutesFilter);
  }
  if (routed == nullptr)
    return Status{StatusCode::kIo,
                  "Fast DDS could not create the routed topic of " + topic->get_name()};
  routed_.push_back(routed);
  return routed;
}

Result<fdds::Topic*> Bus::add_topic(const std::string& name, const fdds::TypeSupport& type,
                                    bool (*is_ours)(const fdds::TypeSupport&)) {
  const std::string type_name = type.get_type_name();
  fdds::Topic*& topic = topics_[name];
  if (topic == nullptr) {
    NEARMESH_RETURN_IF_ERROR(add_type(type, is_ours));
    // find_topic counts its users, so every session deletes what it got and the last one removes
    // the topic.
    topic = participant_->find_topic(name, Duration(0, 0));
    if (topic == nullptr) topic = participant_->create_topic(name, type_name, fdds::TopicQos{});
    if (topic == nullptr) topic = participant_->find_topic(name, Duration(0, 0));
  }
  if (topic == nullptr)
    return Status{StatusCode::kIo, "Fast DDS could not create the topic " + name};
  if (topic->get_type_name() != type_name)
    return Status{StatusCode::kConflict, "topic " + name + " exists on the participant with type " +
                                             topic->get_type_name()};
  return topic;
}

Status Bus::add_type(const fdds::TypeSupport& type, bool (*is_ours)(const fdds::TypeSupport&)) {
  const std::string type_name = type.get_type_name();
  fdds::TypeSupport found = participant_->find_type(type_name);
  if (found.empty()) {
    // Another session on the host's participant may be faster; then its type is found.
    participant_->register_type(type, type_name);
    found = participant_->find_type(type_name);
  }
  if (found.empty() || !is_ours(found))
    return {StatusCode::kConflict,
            "type " + type_name + " is registered on the participant by other code"};
  types_.push_back(type_name);
  return Status::ok();
}

Result<fdds::DataWriter*> Bus::add_writer(fdds::Topic* topic, const fdds::DataWriterQos& wanted,
                                          WriterListener& listener, const std::string& partition) {
  fdds::DataWriterQos qos = wanted;
  if (!kHasFlowControllers) {
    qos.publish_mode() = {};
    qos.publish_mode().kind = fdds::SYNCHRONOUS_PUBLISH_MODE;
  }
  // Not the participant's default, which the host may have changed.
  fdds::PublisherQos publisher_qos;
  if (!partition.empty()) publisher_qos.partition().push_back(partition.c_str());
  fdds::Publisher* publisher =
      participant_->create_publisher(publisher_qos, nullptr, fdds::StatusMask::none());
  fdds::DataWriter* writer =
      publisher == nullptr ? nullptr : publisher->create_datawriter(topic, qos, &listener);
  if (writer != nullptr) {
    writers_.push_back(writer);
    return writer;
  }
  if (publisher != nullptr) participant_->delete_publisher(publisher);
  return Status{StatusCode::kIo,
                "Fast DDS could not create a writer of " + topic->get_name() + refusal_hint_};
}

Result<fdds::DataReader*> Bus::add_reader(fdds::TopicDescription* topic,
                                          const fdds::DataReaderQos& qos, ReaderListener& listener,
                                          const std::string& partition) {
  fdds::SubscriberQos subscriber_qos;
  listener.watch_life_signs(door_, silence_s_);
  if (!partition.empty()) subscriber_qos.partition().push_back(partition.c_str());
  fdds::Subscriber* subscriber = participant_->create_subscriber(
      subscriber_qos, &listener, fdds::StatusMask::data_on_readers());
  fdds::DataReader* reader =
      subscriber == nullptr ? nullptr : subscriber->create_datareader(topic, qos, &listener);
  if (reader != nullptr) {
    readers_.push_back(reader);
    return reader;
  }
  if (subscriber != nullptr) participant_->delete_subscriber(subscriber);
  return Status{StatusCode::kIo,
                "Fast DDS could not create a reader of " + topic->get_name() + refusal_hint_};
}

void Bus::tell_moved(const fdds::DataWriter& writer, const std::vector<std::string>& bodies) {
  if (door_ == nullptr) return;
  const Handle handle = writer.get_instance_handle();
  std::uint32_t entity = 0;
  for (int i = 12; i < 16; ++i) entity = entity << 8 | handle.value[i];
  door_->tell_moved(entity, bodies);
}

void drop_samples(fdds::DataWriter& writer) {
  std::size_t dropped = 0;
  writer.clear_history(&dropped);
}

void Bus::remove_writer(fdds::DataWriter* writer) {
  std::erase(writers_, writer);
  drop_samples(*writer);
  auto* publisher = const_cast<fdds::Publisher*>(writer->get_publisher());
  publisher->delete_datawriter(writer);
  participant_->delete_publisher(publisher);
}

void Bus::remove_reader(fdds::DataReader* reader) {
  std::erase(readers_, reader);
  auto* subscriber = const_cast<fdds::Subscriber*>(reader->get_subscriber());
  subscriber->delete_datareader(reader);
  participant_->delete_subscriber(subscriber);
}

void tell_of_process(const TransportOptions& options, const DoorWatch* door,
                     ProcessStatus& status) {
  if (!options.name.empty()) status.name = options.name;
  status.has_door = door != nullptr;
  if (door != nullptr) status.door_refused = door->refused();
}

Status identity_of(const DoorWatch* door) {
  const std::string ended = door == nullptr ? "" : door->own_end();
  if (ended.empty()) return Status::ok();
  return {StatusCode::kConflict, ended};
}

}  // namespace nearmesh::wire
