// SPDX-License-Identifier: Apache-2.0
#include "ros2_endpoints.hpp"

#include <algorithm>
#include <utility>

#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>

#include "idl/dds/bus.hpp"
#include "idl/dds/dds_transport.hpp"
#include "idl/dds/endpoint_names.hpp"
#include "idl/dds/qos.hpp"
#include "idl/messages/process_name.hpp"
#include "nearmesh/idl/dds/door.hpp"

namespace nearmesh::subscriber {
namespace {

using wire::fdds::DomainParticipantFactory;

/// ROS 2's own programs send datagrams of that size, and Fast DDS reads none that are larger than
/// what it sends.
constexpr std::uint32_t kDatagramBytes = 65500;

/// "tf2_msgs/msg/TFMessage": "tf2_msgs::msg::dds_::TFMessage_".
std::string dds_type(const std::string& type) {
  std::string name;
  const std::size_t last = type.rfind('/');
  for (std::size_t i = 0; i < type.size(); ++i) {
    if (i == last) name += "::dds_";
    name += type[i] == '/' ? std::string("::") : std::string(1, type[i]);
  }
  return name + "_";
}

}  // namespace

bool CdrType::write(const void* data, wire::Payload& payload) {
  const Data& from = *static_cast<const Data*>(data);
  if (from.size() > payload.max_size || from.size() < 4) return false;
  std::copy(from.begin(), from.end(), payload.data);
  payload.length = static_cast<std::uint32_t>(from.size());
  payload.encapsulation = payload.data[1];
  return true;
}

bool CdrType::read(wire::Payload& payload, void* data) {
  static_cast<Data*>(data)->assign(payload.data, payload.data + payload.length);
  return true;
}

/// Who is called what.
class Ros2Endpoints::Names : public wire::FindingListener {
 public:
  explicit Names(wire::Mailbox& mailbox) : mailbox_(mailbox) {}
  void participant_found(const wire::FoundParticipant& found) override {
    const auto guid = wire::rtps::iHandle2GUID(found.participant);
    wire::ParticipantKey key;
    std::copy_n(guid.guidPrefix.value, key.size(), key.begin());
    mailbox_.meet(key, found.is_gone ? "" : found.name);
  }

 private:
  wire::Mailbox& mailbox_;
};

Status Ros2Endpoints::join(const wire::TransportOptions& wanted) {
  wire::TransportOptions transport = wanted;
  if (transport.transport != wire::Transport::kUdpOnly) {
    if (transport.transport == wire::Transport::kSameHost && transport.interface.empty())
      transport.interface = "127.0.0.1";
    if (transport.transport == wire::Transport::kTcp) transport.initial_peers.clear();
    transport.transport = wire::Transport::kLan;
  }
  if (!transport.security.empty())
    return {StatusCode::kUnsupported,
            "ros2: what goes to ROS 2 goes out in the clear; expected no security"};
  if (transport.domain > wire::kMaxDomain)
    return {StatusCode::kInvalidArgument,
            "ros2 domain: expected at most 232, found " + std::to_string(transport.domain)};
  heartbeat_s_ = transport.heartbeat_s;
  wire::fdds::DomainParticipantQos qos;
  qos.name(kNamed + wire::name_of_process(transport.name));
  wire::speak_as_2_9(qos);
  NEARMESH_RETURN_IF_ERROR(wire::set_transport(transport, qos));
  for (const auto& descriptor : qos.transport().user_transports)
    if (auto* udp = dynamic_cast<wire::rtps::UDPv4TransportDescriptor*>(descriptor.get()))
      udp->maxMessageSize = kDatagramBytes;
  wire::add_door(qos);
  names_ = std::make_unique<Names>(mailbox_);
  participant_ = DomainParticipantFactory::get_instance()->create_participant(
      transport.domain, qos, names_.get(), wire::fdds::StatusMask::none());
  if (participant_ == nullptr)
    return {StatusCode::kIo, "Fast DDS could not create a participant in domain " +
                                 std::to_string(transport.domain) + " for ROS 2"};
  return Status::ok();
}

Ros2Endpoints::Ros2Endpoints(wire::Mailbox& mailbox) : mailbox_(mailbox) {}

Ros2Endpoints::~Ros2Endpoints() {
  if (participant_ == nullptr) return;
  for (const Writer& made : writers_)
    if (made.writer != nullptr) wire::drop_samples(*made.writer);
  participant_->delete_contained_entities();
  DomainParticipantFactory::get_instance()->delete_participant(participant_);
}

wire::fdds::Topic* Ros2Endpoints::topic_of(const std::string& topic, const std::string& type) {
  const std::string name = "rt" + topic, of_type = dds_type(type);
  if (auto* known = participant_->lookup_topicdescription(name))
    return dynamic_cast<wire::fdds::Topic*>(known);
  if (participant_->find_type(of_type).empty())
    participant_->register_type(wire::fdds::TypeSupport(new CdrType(of_type)), of_type);
  return participant_->create_topic(name, of_type, wire::fdds::TopicQos{});
}

Result<Ros2Endpoints::Writer*> Ros2Endpoints::add_writer(const std::string& topic,
                                                         const std::string& type,
                                                         const wire::Delivery& delivery) {
  wire::fdds::Topic* const of = topic_of(topic, type);
  auto* publisher = participant_->create_publisher(wire::fdds::PublisherQos{}, nullptr,
                                                   wire::fdds::StatusMask::none());
  Writer& added = writers_.emplace_back(mailbox_);
  if (of != nullptr && publisher != nullptr)
    added.writer =
        publisher->create_datawriter(of, wire::writer_qos(delivery, heartbeat_s_), &added.listener);
  if (added.writer == nullptr)
    return Status{StatusCode::kIo, "Fast DDS could not create a writer of " + topic};
  return &added;
}

Result<Ros2Endpoints::Reader*> Ros2Endpoints::add_reader(const std::string& topic,
                                                         const std::string& type,
                                                         const wire::Delivery& delivery) {
  wire::fdds::Topic* const of = topic_of(topic, type);
  Reader& added = readers_.emplace_back(mailbox_);
  auto* subscriber = participant_->create_subscriber(wire::fdds::SubscriberQos{}, &added.listener,
                                                     wire::fdds::StatusMask::data_on_readers());
  if (of != nullptr && subscriber != nullptr)
    added.reader = subscriber->create_datareader(of, wire::reader_qos(delivery), &added.listener);
  if (added.reader == nullptr)
    return Status{StatusCode::kIo, "Fast DDS could not create a reader of " + topic};
  return &added;
}

bool Ros2Endpoints::write(Writer& writer, std::vector<std::uint8_t> cdr) {
  const wire::ReturnCode code = writer.writer->write(&cdr, wire::rtps::c_InstanceHandle_Unknown);
  if (!wire::is_ok(code) && !wire::is_timeout(code))
    mailbox_.complain(writer.writer->get_topic()->get_name() +
                      ": write failed: " + wire::name_of(code));
  return wire::is_ok(code);
}

bool Ros2Endpoints::take(Reader& reader, std::vector<std::uint8_t>& cdr) {
  wire::fdds::SampleInfo info;
  cdr.clear();
  if (!wire::is_ok(reader.reader->take_next_sample(&cdr, &info))) return false;
  const bool is_ours =
      wire::participant_name(info.publication_handle, mailbox_).starts_with(kNamed) ||
      wire::have_one_participant(info.publication_handle, reader.reader->get_instance_handle());
  if (!info.valid_data || is_ours) cdr.clear();
  return true;
}

}  // namespace nearmesh::subscriber
