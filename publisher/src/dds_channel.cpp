// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/publisher/dds_channel.hpp"

#include <chrono>
#include <map>
#include <utility>

#include "nearmesh/wire/dds_support.hpp"

namespace nearmesh::publisher {

using wire::Handle;
using wire::Microseconds;
using wire::SessionId;

namespace {

/// One call does not starve batches; what remains is taken by the next.
constexpr std::size_t kMaxTaken = 1024;
/// Announcements are rare and must get through.
constexpr std::chrono::seconds kAnnounceDeadline{2};
/// A recorder hears batches best-effort, so it must have found a new peer's writer before the first of them: without the
/// first, none of what that peer answers can be proved. Peers that are not recorded do not wait.
constexpr std::chrono::milliseconds kRecorderGrace{100};

}  // namespace

class DdsChannel::Impl {
 public:
  explicit Impl(const DdsChannelOptions& options)
      : options_(options),
        names_(options.transport.prefix),
        hello_listener_(mailbox_, names_.hello),
        header_listener_(mailbox_, names_.mesh_header),
        status_listener_(mailbox_, names_.process_status),
        subscription_listener_(mailbox_, names_.region_subscription) {}

  Status start();
  Status open();
  void announce(const wire::Hello& hello, const std::vector<wire::MeshHeader>& headers);
  std::vector<wire::RegionSubscription> take_subscriptions();
  std::vector<SessionId> take_lost_peers();
  bool send(SessionId peer, const wire::SplitBatchMessage& batch);
  void tell(const wire::ProcessStatus& status);
  wire::Mailbox& mailbox() { return mailbox_; }

 private:
  struct Peer {
    std::unique_ptr<wire::WriterListener> listener;
    wire::fdds::DataWriter* writer = nullptr;
    Handle subscriptions;  ///< the peer's writer, by which its participant is known
    std::chrono::steady_clock::time_point added = std::chrono::steady_clock::now();
  };

  template <class Type, class Message>
  bool write_patiently(wire::fdds::DataWriter& writer, const Message& message);
  void rejoin();
  void withdraw_headers(const std::vector<wire::MeshHeader>& kept);
  bool admit(SessionId peer, const Handle& writer, Microseconds received);
  bool add_peer(SessionId peer, const Handle& writer);

  DdsChannelOptions options_;
  wire::TopicNames names_;
  wire::Mailbox mailbox_;
  wire::WriterListener hello_listener_, header_listener_, status_listener_;
  wire::ReaderListener subscription_listener_;
  std::map<SessionId, Peer> peers_;
  wire::SessionBook book_;
  std::map<std::uint64_t, std::string> announced_headers_;  ///< content hash to name
  bool complained_of_limit_ = false;
  SessionId own_id_ = 0;  ///< known with the first announcement
  wire::Hello hello_;     ///< what was announced last, for a rejoin
  std::vector<wire::MeshHeader> headers_;
  std::vector<SessionId> lost_by_stop_;
  wire::fdds::DataWriter* hello_writer_ = nullptr;
  wire::fdds::DataWriter* header_writer_ = nullptr;
  wire::fdds::DataWriter* status_writer_ = nullptr;
  wire::fdds::DataReader* subscription_reader_ = nullptr;
  wire::fdds::Topic* batch_topic_ = nullptr;
  std::unique_ptr<wire::Bus> bus_;  ///< last: goes first, while the listeners still live
  std::unique_ptr<wire::StopDetector> stops_;
};

Status DdsChannel::Impl::start() {
  NEARMESH_RETURN_IF_ERROR(open());
  stops_ = std::make_unique<wire::StopDetector>(mailbox_, options_.transport.lease_s);
  return Status::ok();
}

Status DdsChannel::Impl::open() {
  if (options_.header_bytes_per_s < 100'000 || options_.header_bytes_per_s > 1'000'000'000)
    return {StatusCode::kInvalidArgument,
            "header_bytes_per_s: expected 100000 to 1000000000, found " +
                std::to_string(options_.header_bytes_per_s)};
  wire::BusOptions bus_options;
  bus_options.transport = options_.transport;
  bus_options.participant_name = "nearmesh publisher";
  bus_options.header_bytes_per_s = options_.header_bytes_per_s;
  auto bus = wire::Bus::open(bus_options, mailbox_);
  if (!bus.is_ok()) return bus.status();
  bus_ = std::move(bus).value();

  auto hello = bus_->add_topic<wire::HelloType>(names_.hello);
  if (!hello.is_ok()) return hello.status();
  auto header = bus_->add_topic<wire::MeshHeaderType>(names_.mesh_header);
  if (!header.is_ok()) return header.status();
  auto subscription = bus_->add_topic<wire::RegionSubscriptionType>(names_.region_subscription);
  if (!subscription.is_ok()) return subscription.status();
  auto batch = bus_->add_topic<wire::SplitBatchType>(names_.split_batch);
  if (!batch.is_ok()) return batch.status();
  batch_topic_ = batch.value();

  // The reader first: a peer that hears of us can be heard.
  auto reader =
      bus_->add_reader(subscription.value(), wire::reader_qos(wire::kRegionSubscriptionDelivery),
                       subscription_listener_);
  if (!reader.is_ok()) return reader.status();
  subscription_reader_ = reader.value();
  const double heartbeat_s = options_.transport.heartbeat_s;
  auto header_writer =
      bus_->add_writer(header.value(), wire::mesh_header_writer_qos(heartbeat_s), header_listener_);
  if (!header_writer.is_ok()) return header_writer.status();
  header_writer_ = header_writer.value();
  auto hello_writer = bus_->add_writer(
      hello.value(), wire::writer_qos(wire::kHelloDelivery, heartbeat_s), hello_listener_);
  if (!hello_writer.is_ok()) return hello_writer.status();
  hello_writer_ = hello_writer.value();
  auto status = bus_->add_topic<wire::ProcessStatusType>(names_.process_status);
  if (!status.is_ok()) return status.status();
  auto status_writer =
      bus_->add_writer(status.value(), wire::writer_qos(wire::kProcessStatusDelivery, heartbeat_s),
                       status_listener_);
  if (!status_writer.is_ok()) return status_writer.status();
  status_writer_ = status_writer.value();
  return Status::ok();
}

/// Tries again while Fast DDS says TIMEOUT, which in 2.9 it also says without need.
template <class Type, class Message>
bool DdsChannel::Impl::write_patiently(wire::fdds::DataWriter& writer, const Message& message) {
  if (Status status = check(message); !status.is_ok()) {
    mailbox_.complain(writer.get_topic()->get_name() + ": not sent: " + status.message());
    return false;
  }
  const auto deadline = std::chrono::steady_clock::now() + kAnnounceDeadline;
  for (;;) {
    const wire::WriteResult result = wire::write_message<Type>(writer, message, mailbox_);
    if (result != wire::WriteResult::kFull) return result == wire::WriteResult::kTaken;
    if (std::chrono::steady_clock::now() >= deadline) break;
    mailbox_.wait(0.002);
  }
  mailbox_.complain(writer.get_topic()->get_name() + ": not sent: no room for 2 s");
  return false;
}

void DdsChannel::Impl::announce(const wire::Hello& hello,
                                const std::vector<wire::MeshHeader>& headers) {
  own_id_ = hello.publisher;
  if (bus_ == nullptr) return;
  if (&hello != &hello_) hello_ = hello;
  if (&headers != &headers_) headers_ = headers;
  withdraw_headers(headers);
  for (const wire::MeshHeader& header : headers) {
    const auto known = announced_headers_.find(header.content_hash);
    if (known != announced_headers_.end() && known->second == header.name) continue;
    if (write_patiently<wire::MeshHeaderType>(*header_writer_, header))
      announced_headers_[header.content_hash] = header.name;
  }
  write_patiently<wire::HelloType>(*hello_writer_, hello);
  mailbox_.wake();  // waiting for room may have taken a wake-up that was meant for wait()
}

/// Latecomers shall not get headers of models that are no longer served.
void DdsChannel::Impl::withdraw_headers(const std::vector<wire::MeshHeader>& kept) {
  std::erase_if(announced_headers_, [&](const auto& known) {
    for (const wire::MeshHeader& header : kept)
      if (header.content_hash == known.first) return false;
    wire::MeshHeaderType::Data data;
    data.content_hash(known.first);
    header_writer_->dispose(static_cast<wire::MeshHeaderType::Sample*>(&data),
                            eprosima::fastrtps::rtps::c_InstanceHandle_Unknown);
    return true;
  });
}

/// After the process was stopped: as a new participant, with the same session. Every peer starts
/// afresh.
void DdsChannel::Impl::rejoin() {
  for (const SessionId peer : book_.clear()) lost_by_stop_.push_back(peer);
  bus_.reset();
  peers_.clear();
  (void)subscription_listener_.take_matches();
  announced_headers_.clear();
  if (const Status status = open(); !status.is_ok()) {
    mailbox_.complain("could not join again after a stop: " + status.message());
    return;
  }
  if (own_id_ != 0) announce(hello_, headers_);
}

std::vector<wire::RegionSubscription> DdsChannel::Impl::take_subscriptions() {
  if (stops_->take_stop()) rejoin();
  if (bus_ == nullptr) return {};
  std::vector<wire::RegionSubscription> taken;
  const bool more = wire::drain<wire::RegionSubscriptionType>(
      *subscription_reader_, mailbox_, kMaxTaken,
      [&](wire::RegionSubscription&& message, const Handle& writer, Microseconds received) {
        if (own_id_ != 0 && message.publisher != own_id_) return;  // for another publisher
        if (admit(message.peer, writer, received)) taken.push_back(std::move(message));
      });
  if (more) mailbox_.wake();
  return taken;
}

bool DdsChannel::Impl::admit(SessionId peer, const Handle& writer, Microseconds received) {
  switch (book_.claim(peer, writer, received)) {
    case wire::SessionBook::Claim::kKnown:
      return true;
    case wire::SessionBook::Claim::kStale:
      return false;
    case wire::SessionBook::Claim::kTaken:
      mailbox_.complain(names_.region_subscription + ": sample of " + wire::name_of(writer) +
                        " dropped: peer " + wire::partition_of(peer) +
                        " speaks through another writer");
      return false;
    case wire::SessionBook::Claim::kNew:
      break;
  }
  if (add_peer(peer, writer)) return true;
  book_.release(peer);
  return false;
}

bool DdsChannel::Impl::add_peer(SessionId peer, const Handle& subscriptions) {
  if (peers_.size() >= options_.max_peers) {
    if (!std::exchange(complained_of_limit_, true))
      mailbox_.complain("peer " + wire::partition_of(peer) + " refused: there are " +
                        std::to_string(peers_.size()) + " already, the limit (max_peers)");
    return false;
  }
  Peer entry;
  entry.listener = std::make_unique<wire::WriterListener>(mailbox_, names_.split_batch);
  auto writer = bus_->add_writer(
      batch_topic_, wire::writer_qos(wire::kSplitBatchDelivery, options_.transport.heartbeat_s),
      *entry.listener, wire::partition_of(peer));
  if (!writer.is_ok()) {
    mailbox_.complain("peer " + wire::partition_of(peer) +
                      " refused: " + writer.status().message());
    return false;
  }
  entry.writer = writer.value();
  entry.subscriptions = subscriptions;
  peers_.emplace(peer, std::move(entry));
  return true;
}

std::vector<SessionId> DdsChannel::Impl::take_lost_peers() {
  std::vector<SessionId> lost = std::exchange(lost_by_stop_, {});
  for (const auto& event : subscription_listener_.take_matches()) {
    if (!event.gone) {
      book_.welcome(event.writer);
      continue;
    }
    const std::optional<SessionId> peer = book_.forget(event.writer, event.when);
    if (!peer) continue;
    const auto found = peers_.find(*peer);
    bus_->remove_writer(found->second.writer);
    peers_.erase(found);
    complained_of_limit_ = false;
    lost.push_back(*peer);
  }
  return lost;
}

bool DdsChannel::Impl::send(SessionId peer, const wire::SplitBatchMessage& batch) {
  const auto found = peers_.find(peer);
  if (found == peers_.end()) return false;
  const Peer& entry = found->second;
  // By the peer itself: recorders listen to all partitions, and may be matched before it.
  if (!entry.listener->is_matched_with_participant_of(entry.subscriptions)) return false;
  if (std::chrono::steady_clock::now() - entry.added < kRecorderGrace &&
      entry.listener->is_matched_beside_participant_of(entry.subscriptions))
    return false;
  if (Status status = check(batch); !status.is_ok()) {
    mailbox_.complain(names_.split_batch + ": not sent: " + status.message());
    return true;
  }
  return wire::write_message<wire::SplitBatchType>(*entry.writer, batch, mailbox_) ==
         wire::WriteResult::kTaken;
}

void DdsChannel::Impl::tell(const wire::ProcessStatus& status) {
  if (bus_ == nullptr) return;
  if (const Status checked = check(status); !checked.is_ok()) {
    mailbox_.complain(names_.process_status + ": not sent: " + checked.message());
    return;
  }
  static_cast<void>(
      wire::write_message<wire::ProcessStatusType>(*status_writer_, status, mailbox_));
}

Result<std::unique_ptr<DdsChannel>> DdsChannel::create(const DdsChannelOptions& options) {
  auto impl = std::make_unique<Impl>(options);
  NEARMESH_RETURN_IF_ERROR(impl->start());
  return std::unique_ptr<DdsChannel>(new DdsChannel(std::move(impl)));
}

DdsChannel::DdsChannel(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
DdsChannel::~DdsChannel() = default;

void DdsChannel::announce(const wire::Hello& hello, const std::vector<wire::MeshHeader>& headers) {
  impl_->announce(hello, headers);
}
std::vector<wire::RegionSubscription> DdsChannel::take_subscriptions() {
  return impl_->take_subscriptions();
}
std::vector<SessionId> DdsChannel::take_lost_peers() { return impl_->take_lost_peers(); }
bool DdsChannel::send(SessionId peer, const wire::SplitBatchMessage& batch) {
  return impl_->send(peer, batch);
}
void DdsChannel::tell(const wire::ProcessStatus& status) { impl_->tell(status); }
void DdsChannel::wait(double seconds) { impl_->mailbox().wait(seconds); }
std::vector<std::string> DdsChannel::take_complaints() {
  return impl_->mailbox().take_complaints();
}

}  // namespace nearmesh::publisher
