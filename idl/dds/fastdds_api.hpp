// SPDX-License-Identifier: Apache-2.0
#pragma once
// Fast DDS 2.9 and 3.1 under one set of names: all that differs between them is here and in
// cmake/NearmeshIdl.cmake, so no other file asks for a version. For the rooms named dds, and for
// tests.

#if __has_include(<fastdds/rtps/common/Locator.hpp>)
#define NEARMESH_FASTDDS 3
#include <fastcdr/Cdr.h>
#include <fastcdr/FastBuffer.h>
#include <fastdds/config.hpp>
#include <fastdds/dds/core/ReturnCode.hpp>
#include <fastdds/dds/core/Time_t.hpp>
#include <fastdds/rtps/attributes/RTPSParticipantAttributes.hpp>
#include <fastdds/rtps/common/CdrSerialization.hpp>
#include <fastdds/rtps/common/Guid.hpp>
#include <fastdds/rtps/common/InstanceHandle.hpp>
#include <fastdds/rtps/common/SerializedPayload.hpp>
#include <fastdds/rtps/common/Time_t.hpp>
#include <fastdds/rtps/transport/ChainingTransport.hpp>
#include <fastdds/rtps/transport/ChainingTransportDescriptor.hpp>
#include <fastdds/rtps/transport/TCPv4TransportDescriptor.hpp>
#include <fastdds/rtps/transport/TCPv6TransportDescriptor.hpp>
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.hpp>
#include <fastdds/rtps/transport/UDPv6TransportDescriptor.hpp>
#include <fastdds/rtps/transport/shared_mem/SharedMemTransportDescriptor.hpp>
#include <fastdds/utils/IPLocator.hpp>
#include <fastdds/utils/md5.hpp>
#else
#define NEARMESH_FASTDDS 2
#include <fastcdr/Cdr.h>
#include <fastcdr/FastBuffer.h>
#include <fastdds/rtps/attributes/ServerAttributes.h>
#include <fastdds/rtps/common/Guid.h>
#include <fastdds/rtps/common/InstanceHandle.h>
#include <fastdds/rtps/common/SerializedPayload.h>
#include <fastdds/rtps/common/Time_t.h>
#include <fastdds/rtps/network/SenderResource.h>
#include <fastdds/rtps/transport/ChainingTransport.h>
#include <fastdds/rtps/transport/ChainingTransportDescriptor.h>
#include <fastdds/rtps/transport/TCPv4TransportDescriptor.h>
#include <fastdds/rtps/transport/TCPv6TransportDescriptor.h>
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>
#include <fastdds/rtps/transport/UDPv6TransportDescriptor.h>
#include <fastdds/rtps/transport/shared_mem/SharedMemTransportDescriptor.h>
#include <fastrtps/config.h>
#include <fastrtps/types/TypesBase.h>
#include <fastrtps/utils/IPLocator.h>
#include <fastrtps/utils/md5.h>
#endif

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/domain/DomainParticipantListener.hpp>
#include <fastdds/dds/domain/qos/DomainParticipantQos.hpp>
#include <fastdds/dds/topic/TopicDataType.hpp>
#include <functional>
#include <memory>
#include <new>
#include <span>
#include <string>
#include <vector>

namespace nearmesh::wire {

namespace fdds = eprosima::fastdds::dds;
#if NEARMESH_FASTDDS == 3
namespace rtps = eprosima::fastdds::rtps;
using ReturnCode = fdds::ReturnCode_t;
using Duration = fdds::Duration_t;
using DiscoveryProtocol = rtps::DiscoveryProtocol;
using Md5 = eprosima::fastdds::MD5;
using LocatorsIterator = rtps::LocatorsIterator;
inline constexpr const char* kFastDdsVersion = FASTDDS_VERSION_STR;
#else
namespace rtps {
using namespace eprosima::fastrtps::rtps;
using namespace eprosima::fastdds::rtps;
}  // namespace rtps
using ReturnCode = eprosima::fastrtps::types::ReturnCode_t;
using Duration = eprosima::fastrtps::Duration_t;
using DiscoveryProtocol = eprosima::fastrtps::rtps::DiscoveryProtocol_t;
using Md5 = ::MD5;
using LocatorsIterator = eprosima::fastrtps::rtps::LocatorsIterator;
inline constexpr const char* kFastDdsVersion = FASTRTPS_VERSION_STR;
#endif

/// What it tells of its release (RtpsAnnouncement::release). Secured participants of before 3 and
/// of 3 do not find each other.
#if NEARMESH_FASTDDS == 3
inline constexpr int kToldRelease = 3;
#else
inline constexpr int kToldRelease = 0;
#endif

using Handle = rtps::InstanceHandle_t;
using Payload = rtps::SerializedPayload_t;

inline constexpr std::uint32_t kMaxDomain = 232;  ///< beyond it ports are none

// --- Return codes

[[nodiscard]] inline std::uint32_t number_of(const ReturnCode& code) {
#if NEARMESH_FASTDDS == 3
  return static_cast<std::uint32_t>(code);
#else
  return code();
#endif
}
[[nodiscard]] inline bool is_ok(const ReturnCode& code) { return number_of(code) == 0; }
[[nodiscard]] inline bool is_timeout(const ReturnCode& code) { return number_of(code) == 10; }
/// What a filter's factory answers to what it does not make.
[[nodiscard]] inline ReturnCode unsupported() {
#if NEARMESH_FASTDDS == 3
  return fdds::RETCODE_UNSUPPORTED;
#else
  return ReturnCode::RETCODE_UNSUPPORTED;
#endif
}

// --- Addresses

/// Fast DDS 3 lists the machine's addresses once for all participants of a process, and anew only
/// when the settings of one are set: of a short-lived one here, on loopback in the last domain. 2.9
/// lists them for each participant.
inline void list_addresses_again() {
#if NEARMESH_FASTDDS == 3
  fdds::DomainParticipantQos qos;
  qos.transport().use_builtin_transports = false;
  auto udp = std::make_shared<rtps::UDPv4TransportDescriptor>();
  udp->interfaceWhiteList.push_back("127.0.0.1");
  qos.transport().user_transports.push_back(udp);
  auto* const factory = fdds::DomainParticipantFactory::get_instance();
  fdds::DomainParticipant* const participant = factory->create_participant(kMaxDomain, qos);
  if (participant == nullptr) return;  // as will be said by whoever joins
  static_cast<void>(participant->set_qos(participant->get_qos()));
  static_cast<void>(factory->delete_participant(participant));
#endif
}

// --- QoS

/// Where a participant has a flow controller, Fast DDS 3.1 announces it from another thread, and an
/// assertion ends the process when newcomers make it do so again before that thread has run
/// (StatelessWriter::unsent_changes_reset). There headers go out at once.
inline constexpr bool kHasFlowControllers = NEARMESH_FASTDDS == 2;

template <class WriterQos>
void set_heartbeat_period(WriterQos& qos, double seconds) {
#if NEARMESH_FASTDDS == 3
  qos.reliable_writer_qos().times.heartbeat_period = Duration(seconds);
#else
  qos.reliable_writer_qos().times.heartbeatPeriod = Duration(seconds);
#endif
}

/// Fast DDS 3 finds a server by its place alone, 2.9 by the name of the first too.
inline void add_discovery_server(fdds::DomainParticipantQos& qos, const rtps::Locator_t& locator) {
  auto& config = qos.wire_protocol().builtin.discovery_config;
  config.discoveryProtocol = DiscoveryProtocol::CLIENT;
#if NEARMESH_FASTDDS == 3
  config.m_DiscoveryServers.push_back(locator);
#else
  rtps::RemoteServerAttributes server;
  rtps::get_server_client_default_guidPrefix(0, server.guidPrefix);
  server.metatrafficUnicastLocatorList.push_back(locator);
  config.m_DiscoveryServers.push_back(server);
#endif
}

/// What Fast DDS 3 does beyond 2.9 by itself: nobody asks here what types look like, and each who
/// did would be two more writers and readers for all to match; and names of algorithms in the words
/// of the standard, which 2.9 does not know.
inline void speak_as_2_9(fdds::DomainParticipantQos& qos) {
#if NEARMESH_FASTDDS == 3
  auto& properties = qos.properties().properties();
  properties.emplace_back("fastdds.type_propagation", "disabled");
  for (const char* plugin : {"auth.builtin.PKI-DH", "access.builtin.Access-Permissions"})
    properties.emplace_back("dds.sec." + std::string(plugin) + ".transmit_algorithms_as_legacy",
                            "true");
#else
  static_cast<void>(qos);
#endif
}

// --- Discovery

/// What discovery tells of a participant.
struct FoundParticipant {
  Handle participant;
  std::string name;
  bool is_new = false, is_gone = false;
};

/// What discovery tells of a reader or a writer.
struct FoundEndpoint {
  Handle endpoint;
  std::string topic, type;
  std::vector<std::string> partitions;
  fdds::ReliabilityQosPolicyKind reliability{};
  fdds::DurabilityQosPolicyKind durability{};
  bool is_new = false, is_gone = false;
};

/// A participant's listener that is told what others are there. Called by threads of Fast DDS.
class FindingListener : public fdds::DomainParticipantListener {
 public:
  virtual void participant_found(const FoundParticipant&) {}
  virtual void writer_found(const FoundEndpoint&) {}
  virtual void reader_found(const FoundEndpoint&) {}

#if NEARMESH_FASTDDS == 3
  void on_participant_discovery(fdds::DomainParticipant*, rtps::ParticipantDiscoveryStatus why,
                                const fdds::ParticipantBuiltinTopicData& found, bool&) final {
    using Status = rtps::ParticipantDiscoveryStatus;
    participant_found({Handle(found.guid), found.participant_name.to_string(),
                       why == Status::DISCOVERED_PARTICIPANT,
                       why == Status::REMOVED_PARTICIPANT || why == Status::DROPPED_PARTICIPANT});
  }
  void on_data_writer_discovery(fdds::DomainParticipant*, rtps::WriterDiscoveryStatus why,
                                const fdds::PublicationBuiltinTopicData& found, bool&) final {
    writer_found(endpoint_of(found, why));
  }
  void on_data_reader_discovery(fdds::DomainParticipant*, rtps::ReaderDiscoveryStatus why,
                                const fdds::SubscriptionBuiltinTopicData& found, bool&) final {
    reader_found(endpoint_of(found, why));
  }

 private:
  static bool is_new(rtps::WriterDiscoveryStatus why) {
    return why == rtps::WriterDiscoveryStatus::DISCOVERED_WRITER;
  }
  static bool is_new(rtps::ReaderDiscoveryStatus why) {
    return why == rtps::ReaderDiscoveryStatus::DISCOVERED_READER;
  }
  static bool is_gone(rtps::WriterDiscoveryStatus why) {
    return why == rtps::WriterDiscoveryStatus::REMOVED_WRITER;
  }
  static bool is_gone(rtps::ReaderDiscoveryStatus why) {
    return why == rtps::ReaderDiscoveryStatus::REMOVED_READER;
  }
  template <class Found, class Why>
  static FoundEndpoint endpoint_of(const Found& found, Why why) {
    return {Handle(found.guid),
            found.topic_name.to_string(),
            found.type_name.to_string(),
            found.partition.names(),
            found.reliability.kind,
            found.durability.kind,
            is_new(why),
            is_gone(why)};
  }
#else
  void on_participant_discovery(fdds::DomainParticipant*,
                                rtps::ParticipantDiscoveryInfo&& found) final {
    using Info = rtps::ParticipantDiscoveryInfo;
    participant_found(
        {Handle(found.info.m_guid), found.info.m_participantName.to_string(),
         found.status == Info::DISCOVERED_PARTICIPANT,
         found.status == Info::REMOVED_PARTICIPANT || found.status == Info::DROPPED_PARTICIPANT});
  }
  void on_publisher_discovery(fdds::DomainParticipant*, rtps::WriterDiscoveryInfo&& found) final {
    using Info = rtps::WriterDiscoveryInfo;
    writer_found(endpoint_of(found.info, found.status == Info::DISCOVERED_WRITER,
                             found.status == Info::REMOVED_WRITER));
  }
  void on_subscriber_discovery(fdds::DomainParticipant*, rtps::ReaderDiscoveryInfo&& found) final {
    using Info = rtps::ReaderDiscoveryInfo;
    reader_found(endpoint_of(found.info, found.status == Info::DISCOVERED_READER,
                             found.status == Info::REMOVED_READER));
  }

 private:
  template <class Info>
  static FoundEndpoint endpoint_of(const Info& found, bool is_new, bool is_gone) {
    const auto& qos = found.m_qos;
    return {Handle(found.guid()),
            found.topicName().to_string(),
            found.typeName().to_string(),
            qos.m_partition.names(),
            qos.m_reliability.kind,
            qos.m_durability.kind,
            is_new,
            is_gone};
  }
#endif
};

// --- Types

/// `Base` is TopicDataType, or generated from IDL. What Fast DDS calls comes out as these
/// functions, which may be called too.
template <class Base>
class OfEitherVersion : public Base {
 public:
  [[nodiscard]] virtual void* make_data() = 0;
  virtual void delete_made(void* data) = 0;
  /// At most so many bytes: Fast CDR 2 also counts what aligns the elements of an empty sequence,
  /// and does not write it.
  [[nodiscard]] virtual std::uint32_t size_of(const void* data) = 0;
  [[nodiscard]] virtual bool write(const void* data, Payload& payload) = 0;
  [[nodiscard]] virtual bool read(Payload& payload, void* data) = 0;
  [[nodiscard]] virtual bool key_of(const void* data, Handle& handle, bool force_md5) = 0;

#if NEARMESH_FASTDDS == 3
  using Representation = fdds::DataRepresentationId_t;
  void* create_data() final { return make_data(); }
  void delete_data(void* data) final { delete_made(data); }
  std::uint32_t calculate_serialized_size(const void* const data, Representation) final {
    return size_of(data);
  }
  bool serialize(const void* const data, Payload& payload, Representation) final {
    return write(data, payload);
  }
  bool deserialize(Payload& payload, void* data) final { return read(payload, data); }
  bool compute_key(Payload& payload, Handle& handle, bool force_md5) final {
    void* const data = make_data();
    const bool found = read(payload, data) && key_of(data, handle, force_md5);
    delete_made(data);
    return found;
  }
  bool compute_key(const void* const data, Handle& handle, bool force_md5) final {
    return key_of(data, handle, force_md5);
  }
  void register_type_object_representation() final {}

 protected:
  void describe(const std::string& name, std::uint32_t max_bytes, bool is_keyed) {
    this->set_name(name);
    this->max_serialized_type_size = max_bytes;
    this->is_compute_key_provided = is_keyed;
  }
  [[nodiscard]] bool has_key() const { return this->is_compute_key_provided; }
#else
  OfEitherVersion() {
    this->auto_fill_type_object(false);
    this->auto_fill_type_information(false);
  }
  void* createData() final { return make_data(); }
  void deleteData(void* data) final { delete_made(data); }
  std::function<std::uint32_t()> getSerializedSizeProvider(void* data) final {
    return [this, data] { return size_of(data); };
  }
  bool serialize(void* data, Payload* payload) final { return write(data, *payload); }
  bool deserialize(Payload* payload, void* data) final { return read(*payload, data); }
  bool getKey(void* data, Handle* handle, bool force_md5) final {
    return key_of(data, *handle, force_md5);
  }

 protected:
  void describe(const std::string& name, std::uint32_t max_bytes, bool is_keyed) {
    this->setName(name.c_str());
    this->m_typeSize = max_bytes;
    this->m_isGetKeyDefined = is_keyed;
  }
  [[nodiscard]] bool has_key() const { return this->m_isGetKeyDefined; }
#endif
};

/// Of a generated type, as its own code does it. Throws what Fast CDR throws.
template <class Sample>
[[nodiscard]] std::size_t generated_size(const Sample& sample) {
  constexpr std::size_t kEncapsulation = 4;
#if NEARMESH_FASTDDS == 3
  eprosima::fastcdr::CdrSizeCalculator calculator(eprosima::fastcdr::CdrVersion::XCDRv1);
  std::size_t alignment = 0;
  return kEncapsulation + calculator.calculate_serialized_size(sample, alignment);
#else
  return kEncapsulation + Sample::getCdrSerializedSize(sample);
#endif
}

/// In plain CDR, as 2.9 writes it. Out: the bytes written.
template <class Sample>
std::size_t generated_write(const Sample& sample, std::span<std::uint8_t> out) {
  using eprosima::fastcdr::Cdr;
  eprosima::fastcdr::FastBuffer buffer(reinterpret_cast<char*>(out.data()), out.size());
#if NEARMESH_FASTDDS == 3
  Cdr cdr(buffer, Cdr::DEFAULT_ENDIAN, eprosima::fastcdr::CdrVersion::XCDRv1);
  cdr.set_encoding_flag(eprosima::fastcdr::EncodingAlgorithmFlag::PLAIN_CDR);
  cdr.serialize_encapsulation();
  cdr << sample;
  cdr.set_dds_cdr_options({0, 0});
  return cdr.get_serialized_data_length();
#else
  Cdr cdr(buffer, Cdr::DEFAULT_ENDIAN, Cdr::DDS_CDR);
  cdr.serialize_encapsulation();
  sample.serialize(cdr);
  return cdr.getSerializedDataLength();
#endif
}

/// The bytes of the key, big-endian. Out: how many.
template <class Sample>
std::size_t generated_key(const Sample& sample, std::span<std::uint8_t> out) {
  using eprosima::fastcdr::Cdr;
  eprosima::fastcdr::FastBuffer buffer(reinterpret_cast<char*>(out.data()), out.size());
#if NEARMESH_FASTDDS == 3
  Cdr key(buffer, Cdr::BIG_ENDIANNESS, eprosima::fastcdr::CdrVersion::XCDRv1);
  key.set_encoding_flag(eprosima::fastcdr::EncodingAlgorithmFlag::PLAIN_CDR);
  serialize_key(key, sample);  // of eprosima::fastcdr, by its first argument
  return key.get_serialized_data_length();
#else
  Cdr key(buffer, Cdr::BIG_ENDIANNESS);
  sample.serializeKey(key);
  return key.getSerializedDataLength();
#endif
}

/// Of the type generated from nearmesh::MODULE::SAMPLE.
#if NEARMESH_FASTDDS == 3
#define NEARMESH_MAX_KEY_BYTES(module, Sample) \
  std::size_t { nearmesh_##module##_##Sample##_max_key_cdr_typesize }
#else
#define NEARMESH_MAX_KEY_BYTES(module, Sample) \
  ::nearmesh::module::Sample::getKeyMaxCdrSerializedSize()
#endif

/// The generated code's own reading of a sample. Out: its bytes were well formed.
template <class Support>
[[nodiscard]] bool generated_read(Support& support, Payload& payload, void* data) {
#if NEARMESH_FASTDDS == 3
  return support.Support::deserialize(payload, data);
#else
  return support.Support::deserialize(&payload, data);
#endif
}

// --- Transports

/// Bytes at the end of each message that comes through shared memory: room for statistics, which
/// Fast DDS 3.1 leaves in and does not write. Other transports send what was written alone.
inline constexpr std::uint32_t kSharedMemoryRoom = NEARMESH_FASTDDS == 3 ? 60 : 0;

/// Whether locators of that kind are reached by UDP.
[[nodiscard]] inline bool is_udp(std::int32_t locator_kind) {
  return locator_kind == LOCATOR_KIND_UDPv4 || locator_kind == LOCATOR_KIND_UDPv6;
}

/// What a participant sends through one transport, less what is left out.
class OutgoingFilter {
 public:
  using Places = std::vector<rtps::Locator_t>;
  /// Takes away places to which the message does not go. Out: how many of its bytes go. Called with
  /// the participant's senders locked.
  using LeaveOut =
      std::function<std::size_t(std::span<const std::uint8_t> message, Places& places)>;

  explicit OutgoingFilter(LeaveOut leave_out) : leave_out_(std::move(leave_out)) {}

  /// In the place of transport.OpenOutputChannel(senders, locator). The transport looks for its own
  /// senders in the list that it is given, so it has one of its own, behind a sender of ours.
  bool open(rtps::TransportInterface& transport, rtps::SendResourceList& senders,
            const rtps::Locator_t& locator) {
    if (!transport.IsLocatorSupported(locator)) return false;
    if (sender_ == nullptr) {
      auto made = std::make_unique<Sender>(transport.kind(), *this);
      sender_ = made.get();
      senders.push_back(std::move(made));
    }
    return transport.OpenOutputChannel(sender_->below, locator);
  }

 private:
  using Message = std::span<const std::uint8_t>;
  using Deadline = std::chrono::steady_clock::time_point;

  struct Sender final : rtps::SenderResource {
    Sender(std::int32_t kind, OutgoingFilter& owner) : SenderResource(kind), filter(owner) {
#if NEARMESH_FASTDDS == 3
      send_buffers_lambda_ = [this](const std::vector<rtps::NetworkBuffer>& pieces, std::uint32_t,
                                    LocatorsIterator* begin, LocatorsIterator* end,
                                    const Deadline& deadline) {
        try {
          joined.clear();
          for (const rtps::NetworkBuffer& piece : pieces) {
            const auto* bytes = static_cast<const std::uint8_t*>(piece.buffer);
            joined.insert(joined.end(), bytes, bytes + piece.size);
          }
        } catch (const std::bad_alloc&) {
          return true;  // all lose it, as they may lose any datagram
        }
        return send_to(joined, *begin, *end, deadline);
      };
#else
      send_lambda_ = [this](const rtps::octet* data, std::uint32_t size, LocatorsIterator* begin,
                            LocatorsIterator* end, const Deadline& deadline) {
        return send_to({data, size}, *begin, *end, deadline);
      };
#endif
    }
    ~Sender() override { filter.sender_ = nullptr; }
    void add_locators_to_list(rtps::LocatorList_t& locators) const override {
      for (const auto& one : below) one->add_locators_to_list(locators);
    }
    bool send_to(Message message, LocatorsIterator& begin, LocatorsIterator& end,
                 const Deadline& deadline) {
      places.clear();
      try {
        for (; !(begin == end); ++begin) places.push_back(*begin);
      } catch (const std::bad_alloc&) {
        // The others lose it, as they may lose any datagram.
      }
      message = message.first(filter.leave_out_(message, places));
      if (places.empty()) return true;
      bool sent = true;
      for (const auto& one : below) {
        eprosima::fastdds::rtps::Locators first(places.cbegin()), last(places.cend());
        sent &= send_by(*one, message, first, last, deadline);
      }
      return sent;
    }
#if NEARMESH_FASTDDS == 3
    bool send_by(SenderResource& one, Message message, LocatorsIterator& begin,
                 LocatorsIterator& end, const Deadline& deadline) {
      const auto size = static_cast<std::uint32_t>(message.size());
      whole[0] = {message.data(), size};
      return one.send(whole, size, &begin, &end, deadline);
    }
    std::vector<std::uint8_t> joined;           ///< the message that is sent
    std::vector<rtps::NetworkBuffer> whole{1};  ///< the same, less what is left out
#else
    static bool send_by(SenderResource& one, Message message, LocatorsIterator& begin,
                        LocatorsIterator& end, const Deadline& deadline) {
      return one.send(message.data(), static_cast<std::uint32_t>(message.size()), &begin, &end,
                      deadline);
    }
#endif

    OutgoingFilter& filter;
    rtps::SendResourceList below;
    Places places;  ///< of the message that is sent
  };

  const LeaveOut leave_out_;
  Sender* sender_ = nullptr;  ///< the participant's, which ends it
};

/// What is between Fast DDS and a transport, and sees what comes in: receive(). What goes out
/// passes.
class ChainedTransport : public rtps::ChainingTransport {
 public:
  using ChainingTransport::ChainingTransport;
  /// Called before Fast DDS reaches out to anybody, each time; it has its senders locked.
  virtual void reaching_out() {}
  /// Whether others are where they say; else one on this machine is taken to be on loopback.
  [[nodiscard]] virtual bool takes_places_as_told() const { return false; }
  using ChainingTransport::transform_remote_locator;
#if NEARMESH_FASTDDS == 3
  bool transform_remote_locator(const rtps::Locator_t& remote, rtps::Locator_t& result,
                                bool remote_localhost, bool local_localhost) const final {
    result = remote;
    return (takes_places_as_told() && IsLocatorSupported(remote)) ||
           ChainingTransport::transform_remote_locator(remote, result, remote_localhost,
                                                       local_localhost);
  }
  bool send(rtps::SenderResource* low, const std::vector<rtps::NetworkBuffer>& buffers,
            std::uint32_t bytes, LocatorsIterator* begin, LocatorsIterator* end,
            const std::chrono::steady_clock::time_point& timeout) final {
    return low->send(buffers, bytes, begin, end, timeout);
  }
  // ChainingTransport leaves these to their defaults, by which no connection of TCP is ever opened.
  // By UDP each place of them is one of OpenOutputChannel(), which may have a filter.
  bool OpenOutputChannels(rtps::SendResourceList& senders,
                          const rtps::LocatorSelectorEntry& to) final {
    reaching_out();
    return is_udp(low_level_transport_->kind())
               ? ChainingTransport::OpenOutputChannels(senders, to)
               : low_level_transport_->OpenOutputChannels(senders, to);
  }
  void CloseOutputChannels(rtps::SendResourceList& senders,
                           const rtps::LocatorSelectorEntry& to) final {
    low_level_transport_->CloseOutputChannels(senders, to);
  }
  void shutdown() final { low_level_transport_->shutdown(); }
#else
  bool transform_remote_locator(const rtps::Locator_t& remote,
                                rtps::Locator_t& result) const final {
    result = remote;
    return (takes_places_as_told() && IsLocatorSupported(remote)) ||
           ChainingTransport::transform_remote_locator(remote, result);
  }
  bool send(rtps::SenderResource* low, const rtps::octet* data, std::uint32_t size,
            LocatorsIterator* begin, LocatorsIterator* end,
            const std::chrono::steady_clock::time_point& timeout) final {
    return low->send(data, size, begin, end, timeout);
  }
#endif
};

}  // namespace nearmesh::wire
