// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/wire/dds_support.hpp"

#include <arpa/inet.h>
#include <ifaddrs.h>
#include <netinet/in.h>
#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <ctime>
#include <sstream>

#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>
#include <fastrtps/utils/IPLocator.h>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>

#include "dds_security.hpp"

namespace nearmesh::wire {

namespace {

using eprosima::fastrtps::Duration_t;
using eprosima::fastrtps::rtps::IPLocator;
using eprosima::fastrtps::rtps::Locator_t;
using eprosima::fastrtps::types::ReturnCode_t;

/// Below the usual MTU with room for IP, UDP and a tunnel: nothing fragments at IP level, where one
/// lost fragment costs the whole datagram.
constexpr std::uint32_t kMaxDatagramBytes = 1400;
/// With security: Fast DDS 2.9 sends each step of the handshake, some 6 KB of certificates and permissions, in one datagram
/// of at most this. The kernel cuts it, and also a full batch (1,535 bytes with its protection).
constexpr std::uint32_t kMaxSecuredDatagramBytes = 8192;
/// A header of a megabyte arrives as one burst. The kernel may grant less.
constexpr std::uint32_t kSocketBufferBytes = 4U << 20;
constexpr std::uint32_t kMaxDomain = 232;
constexpr const char* kDiscoveryMulticast = "239.255.0.1";

/// The address of an interface given by name or address.
Result<std::string> resolve_interface(const std::string& wanted) {
  ifaddrs* list = nullptr;
  if (getifaddrs(&list) != 0) return Status{StatusCode::kIo, "getifaddrs failed"};
  std::string found, known;
  for (const ifaddrs* entry = list; entry != nullptr; entry = entry->ifa_next) {
    if (entry->ifa_addr == nullptr || entry->ifa_addr->sa_family != AF_INET) continue;
    char text[INET_ADDRSTRLEN] = {};
    const auto* address = reinterpret_cast<const sockaddr_in*>(entry->ifa_addr);
    inet_ntop(AF_INET, &address->sin_addr, text, sizeof text);
    known += std::string(known.empty() ? "" : ", ") + entry->ifa_name + " " + text;
    if (found.empty() && (wanted == text || wanted == entry->ifa_name)) found = text;
  }
  freeifaddrs(list);
  if (!found.empty()) return found;
  return Status{StatusCode::kInvalidArgument,
                "interface \"" + wanted + "\": expected one of " + known};
}

/// Port 0: Fast DDS asks the ports of the first participants there.
Status add_peer(const std::string& address, std::uint32_t port,
                eprosima::fastrtps::rtps::LocatorList_t& peers) {
  in_addr parsed{};
  if (inet_pton(AF_INET, address.c_str(), &parsed) != 1)
    return {StatusCode::kInvalidArgument,
            "initial peer \"" + address + "\": expected an IPv4 address"};
  Locator_t locator;
  IPLocator::setIPv4(locator, address);
  locator.port = port;
  peers.push_back(locator);
  return Status::ok();
}

std::uint32_t datagram_bytes(const TransportOptions& options) {
  return options.security.empty() ? kMaxDatagramBytes : kMaxSecuredDatagramBytes;
}

Status set_transport(const TransportOptions& options, fdds::DomainParticipantQos& qos) {
  // UDP only. Shared memory leaves files in /dev/shm when a process is killed, fails between users,
  // takes 10 MB a participant, and is not faster for samples of our size.
  qos.transport().use_builtin_transports = false;
  auto udp = std::make_shared<eprosima::fastdds::rtps::UDPv4TransportDescriptor>();
  udp->maxMessageSize = datagram_bytes(options);
  udp->sendBufferSize = kSocketBufferBytes;
  udp->receiveBufferSize = kSocketBufferBytes;
  udp->maxInitialPeersRange = options.participants_per_peer;
  auto& peers = qos.wire_protocol().builtin.initialPeersList;
  const std::uint32_t multicast_port = qos.wire_protocol().port.getMulticastPort(options.domain);
  for (const std::string& peer : options.initial_peers)
    NEARMESH_RETURN_IF_ERROR(add_peer(peer, 0, peers));
  if (!options.interface.empty()) {
    Result<std::string> address = resolve_interface(options.interface);
    if (!address.is_ok()) return address.status();
    udp->interfaceWhiteList.push_back(address.value());
    // Multicast works on loopback too when the socket is bound to it, even without any route. The
    // unicast search beside it is for machines that forbid multicast; alone it would miss
    // processes that have made many participants, whose ports lie ever higher.
    if (address.value().starts_with("127."))
      NEARMESH_RETURN_IF_ERROR(add_peer(address.value(), 0, peers));
  }
  // Naming peers replaces the multicast search, so that must then be named too.
  if (!peers.empty())
    NEARMESH_RETURN_IF_ERROR(add_peer(kDiscoveryMulticast, multicast_port, peers));
  qos.transport().user_transports.push_back(udp);
  return Status::ok();
}

Status check_options(const TransportOptions& options) {
  NEARMESH_RETURN_IF_ERROR(check_prefix(options.prefix));
  if (options.domain > kMaxDomain)
    return {StatusCode::kInvalidArgument, "domain: expected at most " + std::to_string(kMaxDomain) +
                                              ", found " + std::to_string(options.domain)};
  if (!(options.announcement_s > 0) || !(options.lease_s >= 2 * options.announcement_s) ||
      !(options.heartbeat_s > 0))
    return {StatusCode::kInvalidArgument,
            "lease: expected at least twice the announcement period, all above 0"};
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

eprosima::fastrtps::rtps::GuidPrefix_t prefix_of(const Handle& endpoint) {
  return eprosima::fastrtps::rtps::iHandle2GUID(endpoint).guidPrefix;
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

// --- Mailbox

void Mailbox::wake() {
  {
    const std::lock_guard lock(mutex_);
    awake_ = true;
  }
  condition_.notify_all();
}

void Mailbox::wait(double seconds) {
  std::unique_lock lock(mutex_);
  condition_.wait_for(lock, std::chrono::duration<double>(seconds), [this] { return awake_; });
  awake_ = false;
}

void Mailbox::complain(std::string line) {
  // Names that others chose are in it, and it goes to terminals and logs.
  line.resize(std::min(line.size(), kMaxLine));
  std::replace_if(
      line.begin(), line.end(), [](char c) { return c < 0x20 || c > 0x7e; }, '?');
  {
    const std::lock_guard lock(mutex_);
    if (complaints_.size() < kMaxComplaints)
      complaints_.push_back(std::move(line));
    else
      ++dropped_complaints_;
    awake_ = true;
  }
  condition_.notify_all();
}

std::vector<std::string> Mailbox::take_complaints() {
  const std::lock_guard lock(mutex_);
  std::vector<std::string> taken = std::exchange(complaints_, {});
  if (const std::uint64_t more = std::exchange(dropped_complaints_, 0); more > 0)
    taken.push_back(std::to_string(more) + " more complaints were not kept");
  return taken;
}

bool Mailbox::has_complaints() {
  const std::lock_guard lock(mutex_);
  return !complaints_.empty();
}

// --- Listeners

std::vector<ReaderListener::Match> ReaderListener::take_matches() {
  const std::lock_guard lock(mutex_);
  return std::exchange(matches_, {});
}

void ReaderListener::on_data_on_readers(fdds::Subscriber*) { mailbox_.wake(); }
void ReaderListener::on_data_available(fdds::DataReader*) { mailbox_.wake(); }

void ReaderListener::on_subscription_matched(fdds::DataReader*,
                                             const fdds::SubscriptionMatchedStatus& status) {
  {
    const std::lock_guard lock(mutex_);
    matches_.push_back({status.last_publication_handle, now_us(), status.current_count_change < 0});
  }
  mailbox_.wake();
}

void ReaderListener::on_requested_incompatible_qos(
    fdds::DataReader*, const fdds::RequestedIncompatibleQosStatus& status) {
  mailbox_.complain(incompatible(topic_, status.last_policy_id));
}

void WriterListener::forget_readers() {
  const std::lock_guard lock(mutex_);
  readers_.clear();
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
    if (status.current_count_change > 0) readers_.insert(status.last_subscription_handle);
    if (status.current_count_change < 0) readers_.erase(status.last_subscription_handle);
  }
  mailbox_.wake();
}

void WriterListener::on_offered_incompatible_qos(fdds::DataWriter*,
                                                 const fdds::OfferedIncompatibleQosStatus& status) {
  mailbox_.complain(incompatible(topic_, status.last_policy_id));
}

/// Reports endpoints that DDS would ignore in silence.
class Bus::DiscoveryListener : public fdds::DomainParticipantListener {
 public:
  DiscoveryListener(Mailbox& mailbox, const BusOptions& options)
      : mailbox_(mailbox), prefix_(options.transport.prefix), on_writer_(options.on_writer) {}

  void on_publisher_discovery(fdds::DomainParticipant*,
                              eprosima::fastrtps::rtps::WriterDiscoveryInfo&& found) override {
    if (found.status != eprosima::fastrtps::rtps::WriterDiscoveryInfo::DISCOVERED_WRITER) return;
    judge(found.info.topicName().to_string(), found.info.typeName().to_string());
    if (!on_writer_) return;
    const std::vector<std::string> partitions = found.info.m_qos.m_partition.names();
    on_writer_(Handle(found.info.guid()), partitions.empty() ? "" : partitions.front());
  }
  void on_subscriber_discovery(fdds::DomainParticipant*,
                               eprosima::fastrtps::rtps::ReaderDiscoveryInfo&& found) override {
    if (found.status == eprosima::fastrtps::rtps::ReaderDiscoveryInfo::DISCOVERED_READER)
      judge(found.info.topicName().to_string(), found.info.typeName().to_string());
  }

 private:
  static constexpr std::size_t kMaxKnown = 256;

  /// Each line once: every endpoint of another version would say the same.
  void judge(const std::string& topic, const std::string& type) {
    std::optional<std::string> line = judge_remote_endpoint(prefix_, topic, type);
    if (!line) return;
    {
      const std::lock_guard lock(mutex_);
      if (said_.size() >= kMaxKnown || !said_.insert(*line).second) return;
    }
    mailbox_.complain(std::move(*line));
  }

  Mailbox& mailbox_;
  std::string prefix_;
  const std::function<void(const Handle&, const std::string&)> on_writer_;
  std::mutex mutex_;
  std::set<std::string> said_;
};

// --- SessionBook

SessionBook::Claim SessionBook::claim(SessionId session, const Handle& writer,
                                      Microseconds received) {
  const auto gone = gone_.find(writer);
  if (gone != gone_.end() && received <= gone->second) return Claim::kStale;
  const auto by_writer = writers_.find(writer);
  if (by_writer != writers_.end())
    return by_writer->second == session ? Claim::kKnown : Claim::kTaken;
  if (sessions_.contains(session)) return Claim::kTaken;
  writers_.emplace(writer, session);
  sessions_.emplace(session, writer);
  return Claim::kNew;
}

std::optional<SessionId> SessionBook::forget(const Handle& writer, Microseconds when) {
  gone_[writer] = when;
  if (gone_.size() > kMaxGone)
    gone_.erase(std::min_element(gone_.begin(), gone_.end(),
                                 [](const auto& a, const auto& b) { return a.second < b.second; }));
  const auto found = writers_.find(writer);
  if (found == writers_.end()) return std::nullopt;
  const SessionId session = found->second;
  sessions_.erase(session);
  writers_.erase(found);
  return session;
}

void SessionBook::release(SessionId session) {
  const auto found = sessions_.find(session);
  if (found == sessions_.end()) return;
  writers_.erase(found->second);
  sessions_.erase(found);
}

std::vector<SessionId> SessionBook::clear() {
  std::vector<SessionId> known;
  for (const auto& [session, writer] : sessions_) known.push_back(session);
  *this = {};
  return known;
}

// --- StopDetector

StopDetector::StopDetector(Mailbox& mailbox, double lease_s)
    : mailbox_(mailbox), thread_([this, lease_s] { watch(lease_s); }) {}

StopDetector::~StopDetector() {
  {
    const std::lock_guard lock(mutex_);
    ending_ = true;
  }
  condition_.notify_all();
  thread_.join();
}

void StopDetector::watch(double lease_s) {
  // The one clock that also counts while the machine is suspended.
  const auto now_s = [] {
    timespec time{};
    clock_gettime(CLOCK_BOOTTIME, &time);
    return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
  };
  const std::chrono::duration<double> period(lease_s / 8);
  std::unique_lock lock(mutex_);
  for (double last = now_s(); !ending_;) {
    condition_.wait_for(lock, period, [this] { return ending_; });
    const double now = now_s();
    if (now - last > 0.75 * lease_s) {
      stopped_ = true;
      mailbox_.wake();
    }
    last = now;
  }
}

// --- Bus

Result<std::unique_ptr<Bus>> Bus::open(const BusOptions& options, Mailbox& mailbox) {
  NEARMESH_RETURN_IF_ERROR(check_options(options.transport));
  std::unique_ptr<Bus> bus(new Bus);
  if (options.host_participant != nullptr) {
    bus->participant_ = options.host_participant;
    return bus;
  }
  // From scratch, not from the default profile: an XML file meant for other programs must not reach
  // us.
  fdds::DomainParticipantQos qos;
  qos.name(options.participant_name);
  NEARMESH_RETURN_IF_ERROR(set_transport(options.transport, qos));
  if (!options.transport.security.empty()) {
    NEARMESH_RETURN_IF_ERROR(set_security(options.transport, qos));
    bus->refusal_hint_ = "; its permissions may not allow it: " + options.transport.security;
  }
  auto& discovery = qos.wire_protocol().builtin.discovery_config;
  discovery.leaseDuration = Duration_t(options.transport.lease_s);
  discovery.leaseDuration_announcementperiod = Duration_t(options.transport.announcement_s);
  if (options.header_bytes_per_s > 0) {
    auto flow = std::make_shared<eprosima::fastdds::rtps::FlowControllerDescriptor>();
    flow->name = kHeaderFlow;
    flow->period_ms = 10;
    flow->max_bytes_per_period =
        std::max(options.header_bytes_per_s / 100,
                 static_cast<std::int32_t>(2 * datagram_bytes(options.transport)));
    qos.flow_controllers().push_back(flow);
  }
  bus->discovery_ = std::make_unique<DiscoveryListener>(mailbox, options);
  // No status goes to the participant's listener: data events belong to the endpoints' own.
  bus->participant_ = fdds::DomainParticipantFactory::get_instance()->create_participant(
      options.transport.domain, qos, bus->discovery_.get(), fdds::StatusMask::none());
  if (bus->participant_ == nullptr)
    return Status{StatusCode::kIo, "Fast DDS could not create a participant in domain " +
                                       std::to_string(options.transport.domain) +
                                       bus->refusal_hint_};
  bus->is_own_ = true;
  return bus;
}

Bus::~Bus() {
  if (participant_ == nullptr) return;
  while (!writers_.empty()) remove_writer(writers_.back());
  while (!readers_.empty()) remove_reader(readers_.back());
  for (fdds::Topic* topic : topics_) participant_->delete_topic(topic);
  // Refused, rightly, while another session on the host's participant uses the type.
  for (const std::string& type : types_) participant_->unregister_type(type);
  if (is_own_) fdds::DomainParticipantFactory::get_instance()->delete_participant(participant_);
}

Result<fdds::Topic*> Bus::add_topic(const std::string& name, const fdds::TypeSupport& type,
                                    bool (*is_ours)(const fdds::TypeSupport&)) {
  const std::string type_name = type.get_type_name();
  fdds::TypeSupport found = participant_->find_type(type_name);
  if (found.empty()) {
    // Another session on the host's participant may be faster; then its type is found.
    participant_->register_type(type, type_name);
    found = participant_->find_type(type_name);
  }
  if (found.empty() || !is_ours(found))
    return Status{StatusCode::kConflict,
                  "type " + type_name + " is registered on the participant by other code"};
  types_.push_back(type_name);
  // find_topic counts its users, so every session deletes what it got and the last one removes the
  // topic.
  fdds::Topic* topic = participant_->find_topic(name, Duration_t(0, 0));
  if (topic == nullptr) topic = participant_->create_topic(name, type_name, fdds::TopicQos{});
  if (topic == nullptr) topic = participant_->find_topic(name, Duration_t(0, 0));
  if (topic == nullptr)
    return Status{StatusCode::kIo, "Fast DDS could not create the topic " + name};
  topics_.push_back(topic);
  if (topic->get_type_name() != type_name)
    return Status{StatusCode::kConflict, "topic " + name + " exists on the participant with type " +
                                             topic->get_type_name()};
  return topic;
}

Result<fdds::DataWriter*> Bus::add_writer(fdds::Topic* topic, const fdds::DataWriterQos& qos,
                                          WriterListener& listener, const std::string& partition) {
  fdds::PublisherQos
      publisher_qos;  // not the participant's default, which the host may have changed
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

Result<fdds::DataReader*> Bus::add_reader(fdds::Topic* topic, const fdds::DataReaderQos& qos,
                                          ReaderListener& listener, const std::string& partition) {
  fdds::SubscriberQos subscriber_qos;
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

void Bus::remove_writer(fdds::DataWriter* writer) {
  std::erase(writers_, writer);
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

const char* name_of(const ReturnCode_t& code) {
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
  return code() < kNames.size() ? kNames[code()] : "unknown";
}

std::string name_of(const Handle& endpoint) {
  std::ostringstream text;
  text << eprosima::fastrtps::rtps::iHandle2GUID(endpoint);
  return text.str();
}

}  // namespace nearmesh::wire
