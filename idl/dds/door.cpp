// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/idl/dds/door.hpp"

#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <exception>
#include <filesystem>
#include <memory>
#include <mutex>
#include <new>
#include <optional>
#include <set>
#include <utility>
#include <vector>

#include "door_watch.hpp"
#include "fastdds_api.hpp"
#include "idl/security/security_folder.hpp"

namespace nearmesh::wire {
namespace {

using rtps::IPLocator;
using rtps::Locator_t;
using rtps::octet;
using Descriptor = rtps::TransportDescriptorInterface;

/// The lease that Fast DDS is told: its own timers shall not end any. Its timer may meet the
/// removal of the participant for another reason, and then an assertion ends the process.
constexpr std::uint32_t kForever_s = 365U * 24 * 3600;

constexpr std::uint32_t kLargestDatagramBytes = 65535;

/// What ChainingTransport wants to be made of.
struct Below final : rtps::ChainingTransportDescriptor {
  using ChainingTransportDescriptor::ChainingTransportDescriptor;
  [[nodiscard]] rtps::TransportInterface* create_transport() const override { return nullptr; }
};

/// A port of this machine that nobody else has meanwhile.
class OwnPort {
 public:
  OwnPort() : socket_(socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
    sockaddr_in place{};
    place.sin_family = AF_INET;
    socklen_t size = sizeof place;
    auto* const bytes = reinterpret_cast<sockaddr*>(&place);
    if (bind(socket_, bytes, size) == 0 && getsockname(socket_, bytes, &size) == 0)
      port_ = ntohs(place.sin_port);
  }
  ~OwnPort() {
    if (socket_ >= 0) close(socket_);
  }
  OwnPort(const OwnPort&) = delete;
  OwnPort& operator=(const OwnPort&) = delete;
  /// 0: there is none to have.
  [[nodiscard]] std::uint16_t port() const { return port_; }

 private:
  int socket_;
  std::uint16_t port_ = 0;
};

/// One transport with a door: what comes in passes it. What goes out by UDP does so, too: without
/// statistics, and paced.
class Door final : public ChainedTransport, private LeaseEnd {
 public:
  Door(std::shared_ptr<Descriptor> below, std::shared_ptr<DoorWatch> watch)
      : ChainedTransport(Below(below)), below_(std::move(below)), watch_(std::move(watch)) {}
  ~Door() override { close(); }

  [[nodiscard]] Descriptor* get_configuration() override { return below_.get(); }

  bool OpenOutputChannel(rtps::SendResourceList& senders, const Locator_t& locator) override {
    reaching_out();
    return is_udp(locator.kind) ? outgoing_.open(*low_level_transport_, senders, locator)
                                : low_level_transport_->OpenOutputChannel(senders, locator);
  }
  /// By TCP Fast DDS names itself by the port that it listens at, or by its process. Fast DDS 3.1
  /// takes no connection of such a name from an address where it ever knew one, be that long closed
  /// (bind_socket() in its TCPTransportInterface.cpp; mended in eProsima/Fast-DDS pull request
  /// 6378): who comes back is another. The sockets listen already, and where is told already.
  void reaching_out() override {
    if (!watch_->answers_by_connection() || name_) return;
    name_.emplace();
    auto* const tcp =
        dynamic_cast<rtps::TCPTransportDescriptor*>(low_level_transport_->get_configuration());
    if (tcp != nullptr && name_->port() != 0) tcp->listening_ports.assign(1, name_->port());
  }
  /// The door has set them.
  [[nodiscard]] bool takes_places_as_told() const override {
    return watch_->answers_by_connection();
  }
  /// A datagram that was cut to the size of our own would be refused, and its first part was all
  /// that Fast DDS ever read of it.
  bool OpenInputChannel(const Locator_t& locator, rtps::TransportReceiverInterface* receiver,
                        std::uint32_t max_message_bytes) override {
    if (!is_udp(locator.kind))
      return ChainingTransport::OpenInputChannel(locator, receiver, max_message_bytes);
    const bool is_open = ChainingTransport::OpenInputChannel(
        locator, receiver, std::max(max_message_bytes, kLargestDatagramBytes));
    if (!IPLocator::isMulticast(locator) && is_new_port(locator.port) && is_open)
      watch_->note_own_port();
    return is_open;
  }
  bool CloseInputChannel(const Locator_t& locator) override {
    close();
    return ChainingTransport::CloseInputChannel(locator);
  }

  void receive(rtps::TransportReceiverInterface* next, const octet* data, std::uint32_t size,
               const Locator_t& local, const Locator_t& remote) override {
    try {
      judge(*next, data, size, local, remote);
    } catch (const std::bad_alloc&) {
      // Lost as on the way: what counts is sent again.
      watch_->complain_of_memory();
    }
  }

 private:
  void judge(rtps::TransportReceiverInterface& next, const octet* data, std::uint32_t size,
             const Locator_t& local, const Locator_t& remote) {
    if (local.kind == LOCATOR_KIND_SHM) size -= std::min(size, kSharedMemoryRoom);
    MessageSource from{is_udp(remote.kind),
                       is_udp(remote.kind) ? IPLocator::getPhysicalPort(remote) : std::uint16_t{0}};
    // Of TCP `local` is what Fast DDS knows the connection by.
    if (watch_->answers_by_connection()) from.connection = place_of(local);
    std::span<const std::uint8_t> message(data, size);
    std::vector<std::uint8_t> of_next;
    for (std::size_t speakers = 1;; ++speakers) {
      RtpsVerdict verdict = watch_->check(message, from);
      if (!verdict.refusal && !verdict.is_kept_out) let_in(next, message, verdict, local, remote);
      if (verdict.next_speaker_at == 0) return;
      if (speakers == kMaxSpeakers) {
        watch_->count(DoorRefusal::kSource);
        return;
      }
      of_next = rtps_of_next_speaker(message, verdict);
      message = of_next;
    }
  }

  void let_in(rtps::TransportReceiverInterface& next, std::span<const std::uint8_t> message,
              RtpsVerdict& verdict, const Locator_t& local, const Locator_t& remote) {
    if (verdict.announcement && !verdict.announcement->leaves && watch_->ends_leases()) {
      remember_way_in(next, local, remote);
      prolong_lease(*verdict.announcement, verdict.changes);
    }
    // A copy where it is not handed on as it came: in shared memory others read the same bytes.
    std::unique_ptr<RtpsCopy> copy;
    std::span<const std::uint8_t> passed = message.first(verdict.size);
    if (RtpsCopy::is_needed(verdict)) {
      copy = take_copy();
      passed = copy->of(passed, verdict);
    }
    // Taken before any lock of Fast DDS, always.
    std::unique_lock<std::mutex> introduction;
    if (verdict.introduces) introduction = std::unique_lock(watch_->introductions());
    try {
      next.OnDataReceived(passed.data(), static_cast<std::uint32_t>(passed.size()), local, remote);
    } catch (const std::exception&) {
      // Say of memory that a malformed message asked for: the message is lost, the process goes on.
      watch_->count(DoorRefusal::kParameters);
    }
    if (copy) give_back(std::move(copy));
  }

  /// Of a port that another program has Fast DDS says the second time that it is open.
  bool is_new_port(std::uint32_t port) {
    const std::lock_guard lock(mutex_);
    return tried_ports_.insert(port).second;
  }

  /// Several threads receive: as many copies are made as are in use at once, and kept.
  std::unique_ptr<RtpsCopy> take_copy() {
    {
      const std::lock_guard lock(copies_mutex_);
      if (!copies_.empty()) {
        std::unique_ptr<RtpsCopy> copy = std::move(copies_.back());
        copies_.pop_back();
        return copy;
      }
    }
    return std::make_unique<RtpsCopy>();
  }
  void give_back(std::unique_ptr<RtpsCopy> copy) {
    const std::lock_guard lock(copies_mutex_);
    copies_.push_back(std::move(copy));
  }

  void remember_way_in(rtps::TransportReceiverInterface& next, const Locator_t& local,
                       const Locator_t& remote) {
    {
      const std::lock_guard lock(mutex_);
      if (!closed_) {
        next_ = &next;
        local_ = local;
        remote_ = remote;
      }
    }
    if (!is_added_) {
      watch_->add(this);  // twice is once
      is_added_ = true;
    }
  }

  static void prolong_lease(const RtpsAnnouncement& announcement,
                            std::vector<RtpsChange>& changes) {
    for (std::uint32_t i = 0; i < 8; ++i)
      changes.push_back({static_cast<std::uint32_t>(announcement.lease_at) + i,
                         i < 4 ? static_cast<std::uint8_t>(
                                     kForever_s >> (8 * (announcement.little_endian ? i : 3 - i)))
                               : std::uint8_t{0}});
  }

  /// Called by the watch's thread.
  void end(std::span<const std::uint8_t> farewell) override {
    const std::lock_guard lock(mutex_);
    if (closed_ || next_ == nullptr) return;
    try {
      next_->OnDataReceived(farewell.data(), static_cast<std::uint32_t>(farewell.size()), local_,
                            remote_);
    } catch (const std::bad_alloc&) {
      throw;  // this message asks for nothing much: memory is short, and the watch tells it again
    } catch (const std::exception&) {
      watch_->count(DoorRefusal::kParameters);
    }
  }

  /// When this returns the watch uses nothing of this transport any more.
  void close() {
    {
      const std::lock_guard lock(mutex_);
      closed_ = true;
    }
    watch_->remove(this);
  }

  static RtpsPlace place_of(const Locator_t& locator) {
    RtpsPlace place{locator.kind, locator.port, {}};
    std::copy_n(locator.address, place.address.size(), place.address.begin());
    return place;
  }

  const std::shared_ptr<Descriptor> below_;
  const std::shared_ptr<DoorWatch> watch_;
  OutgoingFilter outgoing_{
      [this](std::span<const std::uint8_t> message, OutgoingFilter::Places& places) {
        if (watch_->paces()) watch_->leave_out(message, places, place_of);
        return size_without_statistics(message);
      }};
  std::optional<OwnPort> name_;
  std::mutex copies_mutex_;
  std::vector<std::unique_ptr<RtpsCopy>> copies_;  ///< that nobody uses now
  std::mutex mutex_;
  bool closed_ = false;
  std::set<std::uint32_t> tried_ports_;
  std::atomic<bool> is_added_ = false;
  rtps::TransportReceiverInterface* next_ = nullptr;  ///< where announcements go
  Locator_t local_, remote_;
};

/// What tells a descriptor with a door from others.
struct HasDoor {
  std::shared_ptr<DoorWatch> watch;

 protected:
  ~HasDoor() = default;
};

/// A descriptor of the same kind, since Fast DDS asks what kind it is, whose transports have a
/// door.
template <class Below>
struct DoorDescriptor final : Below, HasDoor {
  DoorDescriptor(const Below& below, std::shared_ptr<DoorWatch> shared)
      : Below(below), HasDoor{std::move(shared)} {}
  [[nodiscard]] rtps::TransportInterface* create_transport() const override {
    return new Door(std::make_shared<Below>(static_cast<const Below&>(*this)), watch);
  }
};

/// For transports that Fast DDS does not know by kind: a host's own.
struct AnyDoorDescriptor final : rtps::ChainingTransportDescriptor, HasDoor {
  AnyDoorDescriptor(std::shared_ptr<Descriptor> below, std::shared_ptr<DoorWatch> shared)
      : ChainingTransportDescriptor(std::move(below)), HasDoor{std::move(shared)} {}
  [[nodiscard]] rtps::TransportInterface* create_transport() const override {
    return new Door(low_level_descriptor, watch);
  }
};

/// nullptr: it is of another kind.
template <class Below>
std::shared_ptr<Descriptor> with_door_if(const Descriptor& below,
                                         const std::shared_ptr<DoorWatch>& watch) {
  const auto* known = dynamic_cast<const Below*>(&below);
  if (known == nullptr) return nullptr;
  return std::make_shared<DoorDescriptor<Below>>(*known, watch);
}

std::shared_ptr<Descriptor> with_door(const std::shared_ptr<Descriptor>& below,
                                      const std::shared_ptr<DoorWatch>& watch) {
  for (const auto make :
       {with_door_if<rtps::UDPv4TransportDescriptor>, with_door_if<rtps::UDPv6TransportDescriptor>,
        with_door_if<rtps::TCPv4TransportDescriptor>, with_door_if<rtps::TCPv6TransportDescriptor>,
        with_door_if<rtps::SharedMemTransportDescriptor>})
    if (auto made = make(*below, watch)) return made;
  return std::make_shared<AnyDoorDescriptor>(below, watch);
}

/// As Fast DDS 2.9 makes its built-in ones.
void name_builtin_transports(fdds::DomainParticipantQos& qos) {
  if (!qos.transport().use_builtin_transports) return;
  qos.transport().use_builtin_transports = false;
  auto udp = std::make_shared<rtps::UDPv4TransportDescriptor>();
  udp->sendBufferSize = qos.transport().send_socket_buffer_size;
  udp->receiveBufferSize = qos.transport().listen_socket_buffer_size;
  auto shared = std::make_shared<rtps::SharedMemTransportDescriptor>();
  shared->segment_size(2 * std::max(qos.transport().send_socket_buffer_size,
                                    qos.transport().listen_socket_buffer_size));
  shared->max_message_size(udp->max_message_size());
  qos.transport().user_transports.push_back(udp);
  qos.transport().user_transports.push_back(shared);
}

/// Whether all transports are of one kind.
template <class Transport>
bool all_are(const fdds::DomainParticipantQos& qos) {
  const auto& transports = qos.transport().user_transports;
  return std::all_of(transports.begin(), transports.end(), [](const auto& transport) {
    return dynamic_cast<const Transport*>(transport.get()) != nullptr;
  });
}

double seconds_of(const Duration& duration) { return duration.seconds + 1e-9 * duration.nanosec; }

/// The path of a file that a property of authentication names; "" for none.
std::string file_of(const fdds::DomainParticipantQos& qos, const std::string& property) {
  constexpr std::string_view kScheme = "file://";
  const std::string* value = rtps::PropertyPolicyHelper::find_property(
      qos.properties(), "dds.sec.auth.builtin.PKI-DH." + property);
  return value != nullptr && value->starts_with(kScheme) ? value->substr(kScheme.size()) : "";
}

/// nullptr: it has no identity, or files that are wrong, which Fast DDS refuses.
std::unique_ptr<IdentityBook> identities_of(const fdds::DomainParticipantQos& qos) {
  IdentityPaths paths{file_of(qos, "identity_ca"), file_of(qos, "identity_certificate"),
                      file_of(qos, "identity_crl")};
  if (paths.authority.empty() || paths.certificate.empty()) return nullptr;
  if (paths.revocations.empty())
    paths.revocations =
        (std::filesystem::path(paths.certificate).parent_path() / kRevocations).string();
  auto book = IdentityBook::open(paths);
  return book.is_ok() ? std::move(book).value() : nullptr;
}

const HasDoor* door_of(const Descriptor* descriptor) {
  return dynamic_cast<const HasDoor*>(descriptor);
}

}  // namespace

void add_door(fdds::DomainParticipantQos& qos, double identity_period_s) {
  name_builtin_transports(qos);
  const auto& discovery = qos.wire_protocol().builtin.discovery_config;
  const bool is_plain = discovery.discoveryProtocol == DiscoveryProtocol::SIMPLE;
  const DoorRules rules{
      .is_plain = is_plain,
      .by_udp_alone = all_are<rtps::UDPTransportDescriptor>(qos),
      .by_tcp_alone = all_are<rtps::TCPTransportDescriptor>(qos),
      .announcement_s = seconds_of(discovery.leaseDuration_announcementperiod),
      .identity_period_s = identity_period_s,
      .bodies = is_plain ? told_bodies_in(qos.user_data().getValue()) : std::nullopt};
  std::shared_ptr<DoorWatch> watch;
  for (auto& transport : qos.transport().user_transports) {
    if (door_of(transport.get()) != nullptr) continue;
    if (watch == nullptr) watch = std::make_shared<DoorWatch>(rules, identities_of(qos));
    transport = with_door(transport, watch);
  }
}

std::shared_ptr<DoorWatch> door_watch_of(const fdds::DomainParticipantQos& qos) {
  const auto& transport = qos.transport();
  if (transport.use_builtin_transports) return nullptr;
  std::shared_ptr<DoorWatch> watch;
  for (const auto& descriptor : transport.user_transports) {
    const HasDoor* door = door_of(descriptor.get());
    if (door == nullptr) return nullptr;
    watch = door->watch;
  }
  return watch;
}

bool has_door(const fdds::DomainParticipant& participant) {
  return door_watch_of(participant.get_qos()) != nullptr;
}

}  // namespace nearmesh::wire
