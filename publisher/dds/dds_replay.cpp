// SPDX-License-Identifier: Apache-2.0
#include "dds_replay.hpp"

#include <utility>

#include "dds_peers.hpp"
#include "idl/dds/rejoin_watch.hpp"
#include "idl/dds/room.hpp"

namespace nearmesh::publisher {

using wire::SessionId;

namespace {

constexpr std::size_t kMaxPeers = 1000;
constexpr std::int32_t kHeaderBytesPerS = 4'000'000;  ///< as DdsChannelOptions

/// One DDS writer of recorded bytes, whatever its topic.
class RawWriter {
 public:
  virtual ~RawWriter() = default;
  virtual Status open(wire::Bus& bus, const std::string& partition) = 0;
  virtual wire::WriteResult write(const std::vector<std::uint8_t>& cdr) = 0;
  virtual void withdraw(const std::vector<std::uint8_t>& cdr) = 0;
};

template <class Message>
class TypedRawWriter final : public RawWriter {
 public:
  explicit TypedRawWriter(wire::Mailbox& mailbox) : writer_(mailbox) {}

  Status open(wire::Bus& bus, const std::string& partition) override {
    return writer_.open(bus, partition);
  }
  // The fields are read for the key. Bytes that do not decode have the key of an empty sample.
  wire::WriteResult write(const std::vector<std::uint8_t>& cdr) override {
    wire::read_cdr(type_, cdr, data_);
    data_.cdr = cdr;
    return writer_.write_sample(data_);
  }
  void withdraw(const std::vector<std::uint8_t>& cdr) override {
    wire::read_cdr(type_, cdr, data_);
    data_.cdr.clear();
    writer_.dispose(data_);
  }

 private:
  wire::Writer<Message> writer_;
  wire::TypeOf<Message> type_;
  typename wire::Writer<Message>::Data data_;
};

}  // namespace

class DdsReplay::Impl {
 public:
  Impl(const wire::TransportOptions& transport, const std::vector<ReplayStream>& streams,
       const wire::TopicNames& names)
      : transport_(transport), streams_(streams), names_(names), peers_(mailbox_, kMaxPeers) {}

  Status start() {
    NEARMESH_RETURN_IF_ERROR(wire::check_room(transport_));
    rejoin_watch_ = std::make_unique<wire::RejoinWatch>(mailbox_, transport_);
    return open();
  }
  bool publish(std::uint32_t stream, const std::vector<std::uint8_t>& cdr);
  void withdraw(std::uint32_t stream, const std::vector<std::uint8_t>& cdr) {
    if (bus_ != nullptr) writers_[stream]->withdraw(cdr);
  }
  bool take_restart();
  Status identity() const {
    return bus_ == nullptr ? Status::ok() : wire::identity_of(bus_->door().get());
  }
  Inbox take();
  DdsPeers& peers() { return peers_; }
  wire::Mailbox& mailbox() { return mailbox_; }

 private:
  Status open();
  Status add_writer(const ReplayStream& stream);

  const wire::TransportOptions transport_;
  const std::vector<ReplayStream> streams_;
  const wire::TopicNames names_;
  wire::Mailbox mailbox_;
  DdsPeers peers_;
  std::vector<std::unique_ptr<RawWriter>> writers_;  ///< by stream
  /// Goes first of the DDS members, while the listeners still live.
  std::unique_ptr<wire::Bus> bus_;
  std::unique_ptr<wire::RejoinWatch> rejoin_watch_;
};

Status DdsReplay::Impl::open() {
  wire::BusOptions options;
  options.transport = transport_;
  options.header_bytes_per_s = kHeaderBytesPerS;
  options.names = names_;
  auto bus = wire::Bus::open(options, mailbox_);
  NEARMESH_RETURN_IF_ERROR(bus);
  bus_ = std::move(bus).value();
  // The reader first: a peer that hears of a recorded publisher can be heard.
  NEARMESH_RETURN_IF_ERROR(peers_.open(*bus_));
  for (const ReplayStream& stream : streams_) NEARMESH_RETURN_IF_ERROR(add_writer(stream));
  return Status::ok();
}

Status DdsReplay::Impl::add_writer(const ReplayStream& stream) {
  writers_.push_back(wire::visit_topic(
      stream.topic,
      [this]<class Message>(const wire::Topic<Message>&) -> std::unique_ptr<RawWriter> {
        return std::make_unique<TypedRawWriter<Message>>(mailbox_);
      }));
  return writers_.back()->open(*bus_, stream.partition);
}

bool DdsReplay::Impl::publish(std::uint32_t stream, const std::vector<std::uint8_t>& cdr) {
  if (bus_ == nullptr) return false;
  return wire::write_patiently(names_.at(streams_[stream].topic), mailbox_,
                               [&] { return writers_[stream]->write(cdr); });
}

bool DdsReplay::Impl::take_restart() {
  return rejoin_watch_->rejoin_if_due(bus_, [this] {
    writers_.clear();
    peers_.forget();
    return open();
  });
}

Inbox DdsReplay::Impl::take() {
  if (bus_ == nullptr) return {peers_.take_lost(), {}};
  return peers_.take([](const wire::RegionSubscription&) { return true; });
}

Result<std::unique_ptr<DdsReplay>> DdsReplay::create(const wire::TransportOptions& transport,
                                                     const std::vector<ReplayStream>& streams,
                                                     const wire::TopicNames& names) {
  auto impl = std::make_unique<Impl>(transport, streams, names);
  NEARMESH_RETURN_IF_ERROR(impl->start());
  return std::unique_ptr<DdsReplay>(new DdsReplay(std::move(impl)));
}

DdsReplay::DdsReplay(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
DdsReplay::~DdsReplay() = default;

bool DdsReplay::publish(std::uint32_t stream, const std::vector<std::uint8_t>& cdr) {
  return impl_->publish(stream, cdr);
}
void DdsReplay::withdraw(std::uint32_t stream, const std::vector<std::uint8_t>& cdr) {
  impl_->withdraw(stream, cdr);
}
bool DdsReplay::take_restart() { return impl_->take_restart(); }
Inbox DdsReplay::take() { return impl_->take(); }
bool DdsReplay::send(SessionId peer, const wire::SplitBatchMessage& batch) {
  return impl_->peers().send(peer, batch);
}
void DdsReplay::wait(double seconds) { impl_->mailbox().wait(seconds); }
Status DdsReplay::identity() const { return impl_->identity(); }
std::vector<std::string> DdsReplay::take_complaints() { return impl_->mailbox().take_complaints(); }

}  // namespace nearmesh::publisher
