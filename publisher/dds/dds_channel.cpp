// SPDX-License-Identifier: Apache-2.0
#include "dds_channel.hpp"

#include <map>
#include <utility>

#include "dds_peers.hpp"
#include "idl/dds/rejoin_watch.hpp"
#include "idl/dds/room.hpp"
#include "idl/messages/process_name.hpp"

namespace nearmesh::publisher {

using wire::SessionId;

namespace {

constexpr std::size_t kMaxRivals = 256;  ///< hellos taken at a time

}  // namespace

class DdsChannel::Impl {
 public:
  explicit Impl(const DdsChannelOptions& options)
      : options_(options), peers_(mailbox_, options.max_peers) {}

  Status start();
  Status open();
  void announce(const wire::Hello& hello, const std::vector<wire::MeshHeader>& headers);
  Inbox take();
  void tell(wire::ProcessStatus& status);
  DdsPeers& peers() { return peers_; }
  std::string name_of(SessionId peer) const { return peers_.name_of(peer); }
  wire::Mailbox& mailbox() { return mailbox_; }
  Status identity() const {
    return bus_ == nullptr ? Status::ok() : wire::identity_of(bus_->door().get());
  }

 private:
  template <class Message>
  bool announce(wire::Writer<Message>& writer, const Message& message);
  Status rejoin();
  void withdraw_headers(const std::vector<wire::MeshHeader>& kept);
  void listen_for_rivals();
  void take_rivals(Inbox& inbox);
  void note_rival(wire::Hello hello, const wire::Handle& writer, wire::Microseconds received,
                  Inbox& inbox);

  DdsChannelOptions options_;
  wire::Mailbox mailbox_;
  wire::Writer<wire::Hello> hello_writer_{mailbox_};
  wire::Writer<wire::MeshHeader> header_writer_{mailbox_};
  wire::Writer<wire::ProcessStatus> status_writer_{mailbox_};
  wire::Reader<wire::Hello> rival_reader_{mailbox_};
  DdsPeers peers_;
  wire::SessionBook rivals_;            ///< other publishers
  std::vector<SessionId> lost_rivals_;  ///< with the bus before this one
  wire::HelloMemory rival_memory_;
  std::map<ContentHash, std::string> announced_headers_;  ///< content hash to name
  SessionId own_id_ = 0;                                  ///< known with the first announcement
  wire::Hello hello_;                                     ///< what was announced last, for a rejoin
  std::vector<wire::MeshHeader> headers_;
  std::unique_ptr<wire::Bus> bus_;  ///< last: goes first, while the listeners still live
  std::unique_ptr<wire::RejoinWatch> rejoin_watch_;
};

Status DdsChannel::Impl::start() {
  NEARMESH_RETURN_IF_ERROR(wire::check_room(options_.transport));
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
  bus_options.header_bytes_per_s = options_.header_bytes_per_s;
  bus_options.on_reader = [this](const auto& reader) { peers_.found(reader); };
  auto bus = wire::Bus::open(bus_options, mailbox_);
  NEARMESH_RETURN_IF_ERROR(bus);
  bus_ = std::move(bus).value();

  // The reader first: a peer that hears of us can be heard.
  NEARMESH_RETURN_IF_ERROR(peers_.open(*bus_));
  NEARMESH_RETURN_IF_ERROR(header_writer_.open(*bus_));
  NEARMESH_RETURN_IF_ERROR(hello_writer_.open(*bus_));
  NEARMESH_RETURN_IF_ERROR(status_writer_.open(*bus_));
  listen_for_rivals();
  return Status::ok();
}

/// Nothing is served through it, so it may fail.
void DdsChannel::Impl::listen_for_rivals() {
  if (const Status opened = rival_reader_.open(*bus_); !opened.is_ok())
    mailbox_.complain("other publishers with other models of the same names will go unnoticed: " +
                      opened.message());
}

void DdsChannel::Impl::take_rivals(Inbox& inbox) {
  if (!rival_reader_.is_open()) return;
  for (const auto& event : rival_reader_.take_matches()) {
    if (event.is_gone()) {
      rival_memory_.lost(event.writer);
      if (const auto lost = rivals_.forget(event.writer, event.when))
        inbox.lost_rivals.push_back(*lost);
      continue;
    }
    rivals_.welcome(event.writer);
    if (const wire::Hello* known = rival_memory_.found(event.writer))
      note_rival(*known, event.writer, wire::now_us(), inbox);
  }
  const bool more = rival_reader_.drain(
      kMaxRivals,
      [&](wire::Hello&& hello, const wire::Handle& writer, wire::Microseconds received) {
        const wire::Handle& own = hello_writer_.endpoint().get_instance_handle();
        if (wire::have_one_participant(writer, own)) return;
        rival_memory_.heard(hello, writer);
        note_rival(std::move(hello), writer, received, inbox);
      });
  if (more) mailbox_.wake();
}

/// Nobody is lost in the name of another, nor comes back by what he said before.
void DdsChannel::Impl::note_rival(wire::Hello hello, const wire::Handle& writer,
                                  wire::Microseconds received, Inbox& inbox) {
  using Claim = wire::SessionBook::Claim;
  const Claim claim = rivals_.claim(hello.publisher, writer, received);
  if (claim == Claim::kNew || claim == Claim::kKnown) inbox.rivals.push_back(std::move(hello));
}

/// Announcements are rare and must get through.
template <class Message>
bool DdsChannel::Impl::announce(wire::Writer<Message>& writer, const Message& message) {
  const std::string& topic = bus_->names().of<Message>();
  if (Status status = check(message); !status.is_ok()) {
    mailbox_.complain(topic + ": not sent: " + status.message());
    return false;
  }
  return wire::write_patiently(topic, mailbox_, [&] { return writer.write(message); });
}

void DdsChannel::Impl::announce(const wire::Hello& hello,
                                const std::vector<wire::MeshHeader>& headers) {
  own_id_ = hello.publisher;
  if (&hello != &hello_) hello_ = hello;
  hello_.name = wire::name_of_process(options_.transport.name);
  if (&headers != &headers_) headers_ = headers;
  if (bus_ == nullptr) return;  // told when this process has joined again
  withdraw_headers(headers);
  // Headers count only from who has announced them, so these wait less.
  static_cast<void>(announce(hello_writer_, hello_));
  for (const wire::MeshHeader& header : headers) {
    const auto known = announced_headers_.find(header.content_hash);
    if (known != announced_headers_.end() && known->second == header.name) continue;
    if (announce(header_writer_, header)) announced_headers_[header.content_hash] = header.name;
  }
}

/// Latecomers shall not get headers of models that are no longer served.
void DdsChannel::Impl::withdraw_headers(const std::vector<wire::MeshHeader>& kept) {
  std::erase_if(announced_headers_, [&](const auto& known) {
    for (const wire::MeshHeader& header : kept)
      if (header.content_hash == known.first) return false;
    wire::Writer<wire::MeshHeader>::Data data;
    data.content_hash(wire::words_of(known.first));
    header_writer_.dispose(data);
    return true;
  });
}

/// As a new participant, with the same session. Every peer starts afresh.
Status DdsChannel::Impl::rejoin() {
  peers_.forget();
  announced_headers_.clear();
  for (const SessionId rival : rivals_.clear()) lost_rivals_.push_back(rival);
  (void)rival_reader_.take_matches();
  return open();
}

Inbox DdsChannel::Impl::take() {
  if (rejoin_watch_->rejoin_if_due(bus_, [this] { return rejoin(); }) && own_id_ != 0)
    announce(hello_, headers_);
  if (bus_ == nullptr) {
    Inbox inbox;
    inbox.lost_peers = peers_.take_lost();
    return inbox;
  }
  Inbox inbox = peers_.take([this](const wire::RegionSubscription& message) {
    return own_id_ == 0 || message.publisher == own_id_;  // else for another publisher
  });
  inbox.lost_rivals = std::exchange(lost_rivals_, {});
  take_rivals(inbox);
  return inbox;
}

void DdsChannel::Impl::tell(wire::ProcessStatus& status) {
  if (bus_ == nullptr) return;
  wire::tell_of_process(options_.transport, bus_->door().get(), status);
  if (const Status checked = check(status); !checked.is_ok()) {
    mailbox_.complain(bus_->names().of<wire::ProcessStatus>() + ": not sent: " + checked.message());
    return;
  }
  static_cast<void>(status_writer_.write(status));
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
void DdsChannel::tell(wire::ProcessStatus& status) { impl_->tell(status); }
std::string DdsChannel::name_of(SessionId peer) const { return impl_->name_of(peer); }
Status DdsChannel::identity() const { return impl_->identity(); }
void DdsChannel::wait(double seconds) { impl_->mailbox().wait(seconds); }
std::vector<std::string> DdsChannel::take_complaints() {
  return impl_->mailbox().take_complaints();
}

}  // namespace nearmesh::publisher
