// SPDX-License-Identifier: Apache-2.0
#include "dds_channel.hpp"

#include <chrono>
#include <map>
#include <utility>

#include "core/base/hash.hpp"
#include "dds_peers.hpp"
#include "idl/dds/rejoin_watch.hpp"

namespace nearmesh::publisher {

using wire::SessionId;

namespace {

/// Announcements are rare and must get through.
constexpr std::chrono::seconds kAnnounceDeadline{2};
/// How often a name that another publisher has for other content is told.
constexpr std::chrono::seconds kConflictPeriod{30};
constexpr std::size_t kMaxRivals = 256;

}  // namespace

class DdsChannel::Impl {
 public:
  explicit Impl(const DdsChannelOptions& options)
      : options_(options),
        names_(options.transport.prefix),
        hello_listener_(mailbox_, names_.hello),
        header_listener_(mailbox_, names_.mesh_header),
        status_listener_(mailbox_, names_.process_status),
        rival_listener_(mailbox_, names_.hello),
        peers_(mailbox_, names_.region_subscription, names_.split_batch, options.max_peers,
               options.transport.heartbeat_s) {}

  Status start();
  Status open();
  void announce(const wire::Hello& hello, const std::vector<wire::MeshHeader>& headers);
  Inbox take();
  void tell(const wire::ProcessStatus& status);
  DdsPeers& peers() { return peers_; }
  wire::Mailbox& mailbox() { return mailbox_; }

 private:
  template <class Type, class Message>
  bool write_patiently(wire::fdds::DataWriter& writer, const Message& message);
  void rejoin();
  void withdraw_headers(const std::vector<wire::MeshHeader>& kept);
  void listen_for_rivals(wire::fdds::Topic* hello);
  void take_rivals();
  void note_rival(wire::Hello hello, const wire::Handle& writer);
  void find_conflicts();

  DdsChannelOptions options_;
  wire::TopicNames names_;
  wire::Mailbox mailbox_;
  wire::WriterListener hello_listener_, header_listener_, status_listener_;
  wire::ReaderListener rival_listener_;
  DdsPeers peers_;
  std::map<wire::Handle, wire::Hello> rivals_;  ///< other publishers, by their writer
  wire::HelloMemory rival_memory_;
  bool has_news_of_rivals_ = false;
  std::chrono::steady_clock::time_point told_conflicts_{};
  std::map<std::uint64_t, std::string> announced_headers_;  ///< content hash to name
  SessionId own_id_ = 0;                                    ///< known with the first announcement
  wire::Hello hello_;  ///< what was announced last, for a rejoin
  std::vector<wire::MeshHeader> headers_;
  wire::fdds::DataWriter* hello_writer_ = nullptr;
  wire::fdds::DataWriter* header_writer_ = nullptr;
  wire::fdds::DataWriter* status_writer_ = nullptr;
  wire::fdds::DataReader* rival_reader_ = nullptr;
  std::unique_ptr<wire::Bus> bus_;  ///< last: goes first, while the listeners still live
  std::unique_ptr<wire::RejoinWatch> rejoin_watch_;
};

Status DdsChannel::Impl::start() {
  rejoin_watch_ = std::make_unique<wire::RejoinWatch>(mailbox_, options_.transport);
  return open();
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
  // The reader first: a peer that hears of us can be heard.
  NEARMESH_RETURN_IF_ERROR(peers_.open(*bus_));
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
  listen_for_rivals(hello.value());
  return Status::ok();
}

/// Nothing is served through it, so it may fail.
void DdsChannel::Impl::listen_for_rivals(wire::fdds::Topic* hello) {
  auto reader = bus_->add_reader(hello, wire::reader_qos(wire::kHelloDelivery), rival_listener_);
  rival_reader_ = reader.is_ok() ? reader.value() : nullptr;
  if (!reader.is_ok())
    mailbox_.complain("other publishers with other models of the same names will go unnoticed: " +
                      reader.status().message());
}

void DdsChannel::Impl::take_rivals() {
  if (rival_reader_ == nullptr) return;
  const bool more = wire::drain<wire::HelloType>(
      *rival_reader_, mailbox_, kMaxRivals,
      [this](wire::Hello&& hello, const wire::Handle& writer, wire::Microseconds) {
        if (wire::have_one_participant(writer, hello_writer_->get_instance_handle())) return;
        rival_memory_.heard(hello, writer);
        note_rival(std::move(hello), writer);
      });
  if (more) mailbox_.wake();
  for (const auto& event : rival_listener_.take_matches()) {
    if (event.gone) {
      rivals_.erase(event.writer);
      rival_memory_.lost(event.writer);
    } else if (const wire::Hello* known = rival_memory_.found(event.writer)) {
      note_rival(*known, event.writer);
    }
  }
}

void DdsChannel::Impl::note_rival(wire::Hello hello, const wire::Handle& writer) {
  if (rivals_.size() >= kMaxRivals && !rivals_.contains(writer)) return;
  rivals_[writer] = std::move(hello);
  has_news_of_rivals_ = true;
}

/// Peers take whichever they hear first, so both sides should know; told again while it lasts.
void DdsChannel::Impl::find_conflicts() {
  const auto now = std::chrono::steady_clock::now();
  if (!has_news_of_rivals_ && now - told_conflicts_ < kConflictPeriod) return;
  has_news_of_rivals_ = false;
  told_conflicts_ = now;
  for (const auto& [writer, rival] : rivals_)
    for (const wire::Hello::Model& theirs : rival.models)
      for (const wire::Hello::Model& ours : hello_.models)
        if (theirs.name == ours.name && theirs.content_hash != ours.content_hash)
          mailbox_.complain("model " + ours.name + ": publisher " +
                            wire::partition_of(rival.publisher) + " serves other content, " +
                            to_hex(theirs.content_hash) + ", under that name; here it is " +
                            to_hex(ours.content_hash) +
                            "; peers take either: rename or replace one file");
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
  if (&hello != &hello_) hello_ = hello;
  if (&headers != &headers_) headers_ = headers;
  if (bus_ == nullptr) return;  // told when this process has joined again
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

/// When the watch says so: as a new participant, with the same session. Every peer starts
/// afresh.
void DdsChannel::Impl::rejoin() {
  bus_.reset();
  peers_.forget();
  announced_headers_.clear();
  rivals_.clear();
  (void)rival_listener_.take_matches();
  if (const Status status = open(); !status.is_ok()) {
    mailbox_.complain("could not join again: " + status.message());
    bus_.reset();
    rejoin_watch_->try_again();
    return;
  }
  if (own_id_ != 0) announce(hello_, headers_);
}

Inbox DdsChannel::Impl::take() {
  if (rejoin_watch_->take_due()) rejoin();
  if (bus_ == nullptr) return {peers_.take_lost(), {}};
  take_rivals();
  find_conflicts();
  return peers_.take([this](const wire::RegionSubscription& message) {
    return own_id_ == 0 || message.publisher == own_id_;  // else for another publisher
  });
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
Inbox DdsChannel::take() { return impl_->take(); }
bool DdsChannel::send(SessionId peer, const wire::SplitBatchMessage& batch) {
  return impl_->peers().send(peer, batch);
}
void DdsChannel::tell(const wire::ProcessStatus& status) { impl_->tell(status); }
void DdsChannel::wait(double seconds) { impl_->mailbox().wait(seconds); }
std::vector<std::string> DdsChannel::take_complaints() {
  return impl_->mailbox().take_complaints();
}

}  // namespace nearmesh::publisher
