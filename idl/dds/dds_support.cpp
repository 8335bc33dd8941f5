// SPDX-License-Identifier: Apache-2.0
#include "dds_support.hpp"

#include <algorithm>
#include <array>
#include <atomic>
#include <sstream>

#include <fastdds/dds/domain/DomainParticipantFactory.hpp>

#include "dds_transport.hpp"
#include "door_watch.hpp"
#include "idl/messages/process_name.hpp"
#include "nearmesh/idl/dds/door.hpp"
#include "room.hpp"
#include "routes.hpp"

namespace nearmesh::wire {

namespace {

constexpr std::uint32_t kMaxDomain = 232;
constexpr std::uint32_t kMostPerPeer = 120;  ///< ports of a domain, two each
constexpr int kMostSessions = 256;           ///< on one participant of a host's

/// What Fast DDS calls a participant that was given no name.
constexpr const char* kUnnamed = "RTPSParticipant";

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

const char* policy_name(fdds::QosPolicyId_t id) {
  switch (id) {
    case fdds::DURABILITY_QOS_POLICY_ID:
      return "durability";
    case fdds::PRESENTATION_QOS_POLICY_ID:
      return "presentation";
    case fdds::DEADLINE_QOS_POLICY_ID:
      return "deadline";
    case fdds::LATENCYBUDGET_QOS_POLICY_ID:
      return "latency budget";
    case fdds::OWNERSHIP_QOS_POLICY_ID:
      return "ownership";
    case fdds::LIVELINESS_QOS_POLICY_ID:
      return "liveliness";
    case fdds::RELIABILITY_QOS_POLICY_ID:
      return "reliability";
    case fdds::DESTINATIONORDER_QOS_POLICY_ID:
      return "destination order";
    case fdds::DATAREPRESENTATION_QOS_POLICY_ID:
      return "data representation";
    case fdds::TYPECONSISTENCYENFORCEMENT_QOS_POLICY_ID:
      return "type consistency";
    case fdds::DISABLEPOSITIVEACKS_QOS_POLICY_ID:
      return "disabled positive acks";
    default:
      return "other";
  }
}

rtps::GuidPrefix_t prefix_of(const Handle& endpoint) {
  return rtps::iHandle2GUID(endpoint).guidPrefix;
}

ParticipantKey key_of(const Handle& endpoint) {
  const auto prefix = prefix_of(endpoint);
  ParticipantKey key;
  std::copy_n(prefix.value, key.size(), key.begin());
  return key;
}

/// How often life signs are looked for: each look asks for every writer.
constexpr std::chrono::milliseconds kLook{250};

const char* durability_name(fdds::DurabilityQosPolicyKind kind) {
  switch (kind) {
    case fdds::VOLATILE_DURABILITY_QOS:
      return "volatile";
    case fdds::TRANSIENT_LOCAL_DURABILITY_QOS:
      return "transient local";
    case fdds::TRANSIENT_DURABILITY_QOS:
      return "transient";
    default:
      return "persistent";
  }
}

const char* reliability_name(fdds::ReliabilityQosPolicyKind kind) {
  return kind == fdds::RELIABLE_RELIABILITY_QOS ? "reliable" : "best effort";
}

std::string incompatible(const std::string& topic, fdds::QosPolicyId_t id) {
  return topic +
         ": an endpoint elsewhere cannot be matched, its QoS is incompatible: " + policy_name(id) +
         " (policy " + std::to_string(static_cast<unsigned>(id)) + ")";
}

}  // namespace

Microseconds to_us(const Timestamp& time) { return time.to_ns() / 1000; }

Microseconds now_us() {
  Timestamp time;
  Timestamp::now(time);
  return to_us(time);
}

// --- Listeners

void ReaderListener::watch_life_signs(std::shared_ptr<const DoorWatch> door, double silence_s) {
  const std::lock_guard lock(mutex_);
  // Whoever was matched on the bus before is forgotten with it.
  silent_.clear();
  door_ = std::move(door);
  silence_s_ = silence_s;
}

std::vector<ReaderListener::Match> ReaderListener::take_matches() {
  const std::lock_guard lock(mutex_);
  look_for_life_signs();
  return std::exchange(matches_, {});
}

void ReaderListener::look_for_life_signs() {
  const auto now = std::chrono::steady_clock::now();
  if (door_ == nullptr || now - looked_ < kLook) return;
  looked_ = now;
  for (auto& [writer, was_silent] : silent_) {
    const std::optional<bool> is_silent = door_->is_silent(key_of(writer), silence_s_);
    if (!is_silent || *is_silent == was_silent) continue;
    was_silent = *is_silent;
    matches_.push_back({writer, now_us(),
                        !was_silent                        ? Mover::kThere
                        : door_->is_barred(key_of(writer)) ? Mover::kBarred
                                                           : Mover::kSilent});
  }
}

void ReaderListener::on_data_on_readers(fdds::Subscriber*) { mailbox_.wake(); }
void ReaderListener::on_data_available(fdds::DataReader*) { mailbox_.wake(); }

void ReaderListener::on_subscription_matched(fdds::DataReader*,
                                             const fdds::SubscriptionMatchedStatus& status) {
  {
    const std::lock_guard lock(mutex_);
    const Handle& writer = status.last_publication_handle;
    const bool is_gone = status.current_count_change < 0;
    const auto known = silent_.find(writer);
    // Told already.
    const bool is_news = known == silent_.end() || !is_gone || !known->second;
    if (is_gone) {
      silent_.erase(writer);
    } else {
      silent_[writer] = false;
    }
    const bool is_barred = is_gone && door_ != nullptr && door_->is_barred(key_of(writer));
    if (is_news)
      matches_.push_back({writer, now_us(),
                          !is_gone    ? Mover::kThere
                          : is_barred ? Mover::kBarred
                                      : Mover::kLeft});
  }
  mailbox_.wake();
}

void WriterListener::forget_readers() {
  const std::lock_guard lock(mutex_);
  readers_.clear();
}

bool WriterListener::take_came() {
  const std::lock_guard lock(mutex_);
  return std::exchange(came_, false);
}

bool WriterListener::has_readers() const {
  const std::lock_guard lock(mutex_);
  return !readers_.empty();
}

bool WriterListener::is_matched_with_participant_of(const Handle& endpoint) const {
  const std::lock_guard lock(mutex_);
  return std::any_of(readers_.begin(), readers_.end(), [&](const Handle& reader) {
    return prefix_of(reader) == prefix_of(endpoint);
  });
}

bool WriterListener::is_matched_beside_participant_of(const Handle& endpoint) const {
  const std::lock_guard lock(mutex_);
  return std::any_of(readers_.begin(), readers_.end(), [&](const Handle& reader) {
    return prefix_of(reader) != prefix_of(endpoint);
  });
}

void WriterListener::on_publication_matched(fdds::DataWriter*,
                                            const fdds::PublicationMatchedStatus& status) {
  {
    const std::lock_guard lock(mutex_);
    if (status.current_count_change > 0) {
      readers_.insert(status.last_subscription_handle);
      came_ = true;
    }
    if (status.current_count_change < 0) readers_.erase(status.last_subscription_handle);
  }
  mailbox_.wake();
}

/// Reports endpoints that DDS would ignore in silence.
class DiscoveryListener : public FindingListener {
 public:
  DiscoveryListener(Mailbox& mailbox, const BusOptions& options)
      : mailbox_(mailbox),
        prefix_(options.transport.prefix),
        names_(prefix_),
        on_writer_(options.on_writer),
        on_reader_(options.on_reader) {}

  void participant_found(const FoundParticipant& found) override {
    const std::string name = shown_participant(found.name);
    mailbox_.meet(key_of(found.participant), found.is_gone || name == kUnnamed ? "" : name);
  }
  [[nodiscard]] bool has_found_others() const { return has_found_others_; }
  /// Of the participant that this listens for, before it has endpoints: they are found, too.
  void set_own(const ParticipantKey& own) {
    const std::lock_guard lock(mutex_);
    own_ = own;
  }
  void writer_found(const FoundEndpoint& found) override {
    note(found);
    if (on_writer_) tell(on_writer_, found);
    if (!found.is_new) return;
    judge(found);
    judge_qos(found, true);
  }
  void reader_found(const FoundEndpoint& found) override {
    note(found);
    if (on_reader_) tell(on_reader_, found);
    if (!found.is_new) return;
    judge(found);
    judge_qos(found, false);
  }

  /// Of a mismatch in this policy a line was said, with both sides.
  static bool judges(fdds::QosPolicyId_t id) {
    return id == fdds::RELIABILITY_QOS_POLICY_ID || id == fdds::DURABILITY_QOS_POLICY_ID;
  }

 private:
  static constexpr std::size_t kMaxKnown = 256;

  void note(const FoundEndpoint& found) {
    const std::lock_guard lock(mutex_);
    if (key_of(found.endpoint) != own_) has_found_others_ = true;
  }

  using Tell = std::function<void(const BusOptions::Found&)>;
  static void tell(const Tell& use, const FoundEndpoint& found) {
    if (found.is_new || found.is_gone)
      use({found.endpoint, found.topic, found.partitions.empty() ? "" : found.partitions.front(),
           found.is_gone});
  }

  void judge(const FoundEndpoint& found) {
    if (std::optional<std::string> line = judge_remote_endpoint(
            prefix_, found.topic, found.type, participant_name(found.endpoint, mailbox_)))
      say(std::move(*line));
  }

  /// A writer must offer at least what readers request; ours all offer and request what their topic
  /// has.
  void judge_qos(const FoundEndpoint& found, bool is_writer) {
    const std::optional<TopicPlace> place = names_.find(found.topic);
    if (!place) return;
    const Delivery& delivery = kTopicFacts[*place].delivery;
    const auto too_little = [&](auto theirs, auto ours) {
      return is_writer ? theirs < ours : theirs > ours;
    };
    const auto line = [&](const char* policy, const char* theirs, const char* ours) {
      return found.topic + ": " + (is_writer ? "writer " : "reader ") +
             name_of(found.endpoint, mailbox_) + " cannot be matched: it " +
             (is_writer ? "offers " : "requests ") + policy + " " + theirs + ", this side " +
             (is_writer ? "requests " : "offers ") + ours + "; give it " + policy + " " + ours;
    };
    if (too_little(found.reliability, reliability_of(delivery)))
      say(line("reliability", reliability_name(found.reliability),
               reliability_name(reliability_of(delivery))));
    if (too_little(found.durability, durability_of(delivery)))
      say(line("durability", durability_name(found.durability),
               durability_name(durability_of(delivery))));
  }

  /// Each line once: every endpoint of another version would say the same. Where too many were said
  /// all may be said again: in weeks there are as many of programs that are gone, and who comes
  /// then shall not be refused in silence.
  void say(std::string line) {
    {
      const std::lock_guard lock(mutex_);
      if (said_.size() >= kMaxKnown && !said_.contains(line)) said_.clear();
      if (!said_.insert(line).second) return;
    }
    mailbox_.complain(std::move(line));
  }

  Mailbox& mailbox_;
  const std::string prefix_;
  const TopicNames names_;
  const Tell on_writer_, on_reader_;
  ParticipantKey own_{};
  std::atomic<bool> has_found_others_ = false;
  std::mutex mutex_;
  std::set<std::string> said_;
};

namespace {

/// A participant of a host's has no listener of ours.
template <class Parent>
bool was_judged(const Parent* parent, fdds::QosPolicyId_t id) {
  const fdds::DomainParticipantListener* listener = parent->get_participant()->get_listener();
  return DiscoveryListener::judges(id) &&
         dynamic_cast<const DiscoveryListener*>(listener) != nullptr;
}

}  // namespace

void ReaderListener::on_requested_incompatible_qos(
    fdds::DataReader* reader, const fdds::RequestedIncompatibleQosStatus& status) {
  if (!was_judged(reader->get_subscriber(), status.last_policy_id))
    mailbox_.complain(incompatible(topic_heard_by(*reader), status.last_policy_id));
}

void WriterListener::on_offered_incompatible_qos(fdds::DataWriter* writer,
                                                 const fdds::OfferedIncompatibleQosStatus& status) {
  if (!was_judged(writer->get_publisher(), status.last_policy_id))
    mailbox_.complain(incompatible(writer->get_topic()->get_name(), status.last_policy_id));
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

// --- Bus

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
  bus->discovery_->set_own(key_of(bus->participant_->get_instance_handle()));
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

const char* name_of(const ReturnCode& code) {
  static constexpr std::array<const char*, 14> kNames{"ok",
                                                      "error",
                                                      "unsupported",
                                                      "bad parameter",
                                                      "precondition not met",
                                                      "out of resources",
                                                      "not enabled",
                                                      "immutable policy",
                                                      "inconsistent policy",
                                                      "already deleted",
                                                      "timeout",
                                                      "no data",
                                                      "illegal operation",
                                                      "not allowed by security"};
  return number_of(code) < kNames.size() ? kNames[number_of(code)] : "unknown";
}

std::string topic_heard_by(const fdds::DataReader& reader) {
  const fdds::TopicDescription* topic = reader.get_topicdescription();
  const auto* routed = dynamic_cast<const fdds::ContentFilteredTopic*>(topic);
  return routed == nullptr ? topic->get_name() : routed->get_related_topic()->get_name();
}

bool have_one_participant(const Handle& a, const Handle& b) { return prefix_of(a) == prefix_of(b); }

std::string name_of(const Handle& endpoint) {
  std::ostringstream text;
  text << rtps::iHandle2GUID(endpoint);
  return text.str();
}

std::string participant_name(const Handle& endpoint, const Mailbox& mailbox) {
  return mailbox.name_of(key_of(endpoint));
}

std::string name_of(const Handle& endpoint, const Mailbox& mailbox) {
  const std::string name = participant_name(endpoint, mailbox);
  return name_of(endpoint) + (name.empty() ? "" : " (" + name + ")");
}

}  // namespace nearmesh::wire
