// SPDX-License-Identifier: Apache-2.0
#include "dds_replay.hpp"

#include <chrono>
#include <utility>

#include "dds_peers.hpp"
#include "idl/dds/rejoin_watch.hpp"

namespace nearmesh::publisher {

using wire::SessionId;

namespace {

constexpr std::size_t kMaxPeers = 1000;
constexpr std::chrono::seconds kPublishDeadline{2};
constexpr std::int32_t kHeaderBytesPerS = 4'000'000;  ///< as DdsChannelOptions

/// One DDS writer of recorded bytes, whatever its type.
class RawWriter {
 public:
  virtual ~RawWriter() = default;
  virtual wire::WriteResult write(const std::vector<std::uint8_t>& cdr, wire::Mailbox& mailbox) = 0;
  virtual void withdraw(const std::vector<std::uint8_t>& cdr) = 0;
};

template <class Type>
class TypedRawWriter final : public RawWriter {
 public:
  explicit TypedRawWriter(wire::fdds::DataWriter& writer) : writer_(writer) {}

  wire::WriteResult write(const std::vector<std::uint8_t>& cdr, wire::Mailbox& mailbox) override {
    read(cdr);
    data_.cdr = cdr;
    return wire::write_sample<Type>(writer_, data_, mailbox);
  }
  void withdraw(const std::vector<std::uint8_t>& cdr) override {
    read(cdr);
    data_.cdr.clear();
    writer_.dispose(static_cast<typename Type::Sample*>(&data_),
                    eprosima::fastrtps::rtps::c_InstanceHandle_Unknown);
  }

 private:
  /// The fields, for the key. Bytes that do not decode have the key of an empty sample.
  void read(const std::vector<std::uint8_t>& cdr) {
    eprosima::fastrtps::rtps::SerializedPayload_t payload;
    payload.data = const_cast<std::uint8_t*>(cdr.data());  // only read
    payload.length = payload.max_size = static_cast<std::uint32_t>(cdr.size());
    type_.deserialize(&payload, static_cast<typename Type::Sample*>(&data_));
    payload.data = nullptr;  // its destructor would free it
  }

  wire::fdds::DataWriter& writer_;
  Type type_;
  typename Type::Data data_;
};

}  // namespace

class DdsReplay::Impl {
 public:
  Impl(const wire::TransportOptions& transport, const std::vector<ReplayStream>& streams,
       const ReplayNames& names)
      : transport_(transport),
        streams_(streams),
        names_(names),
        peers_(mailbox_, names.of(ReplayTopic::kRegionSubscription),
               names.of(ReplayTopic::kSplitBatch), kMaxPeers, transport.heartbeat_s) {}

  Status start() {
    rejoin_watch_ = std::make_unique<wire::RejoinWatch>(mailbox_, transport_);
    return open();
  }
  bool publish(std::uint32_t stream, const std::vector<std::uint8_t>& cdr);
  void withdraw(std::uint32_t stream, const std::vector<std::uint8_t>& cdr) {
    if (bus_ != nullptr) writers_[stream]->withdraw(cdr);
  }
  bool take_restart();
  Inbox take();
  DdsPeers& peers() { return peers_; }
  wire::Mailbox& mailbox() { return mailbox_; }

 private:
  Status open();
  Status add_writer(const ReplayStream& stream);
  template <class Type>
  Status add_writer(const ReplayStream& stream, const wire::fdds::DataWriterQos& qos);

  const wire::TransportOptions transport_;
  const std::vector<ReplayStream> streams_;
  const ReplayNames names_;
  wire::Mailbox mailbox_;
  std::vector<std::unique_ptr<wire::WriterListener>> listeners_;  ///< by stream
  DdsPeers peers_;
  std::vector<std::unique_ptr<RawWriter>> writers_;  ///< by stream
  std::unique_ptr<wire::Bus>
      bus_;  ///< goes first of the DDS members, while the listeners still live
  std::unique_ptr<wire::RejoinWatch> rejoin_watch_;
};

Status DdsReplay::Impl::open() {
  wire::BusOptions options;
  options.transport = transport_;
  options.participant_name = "nearmesh replay";
  options.header_bytes_per_s = kHeaderBytesPerS;
  auto bus = wire::Bus::open(options, mailbox_);
  if (!bus.is_ok()) return bus.status();
  bus_ = std::move(bus).value();
  // The reader first: a peer that hears of a recorded publisher can be heard.
  NEARMESH_RETURN_IF_ERROR(peers_.open(*bus_));
  for (const ReplayStream& stream : streams_) NEARMESH_RETURN_IF_ERROR(add_writer(stream));
  return Status::ok();
}

Status DdsReplay::Impl::add_writer(const ReplayStream& stream) {
  const double heartbeat_s = transport_.heartbeat_s;
  switch (stream.topic) {
    case ReplayTopic::kHello:
      return add_writer<wire::HelloType>(stream,
                                         wire::writer_qos(wire::kHelloDelivery, heartbeat_s));
    case ReplayTopic::kMeshHeader:
      return add_writer<wire::MeshHeaderType>(stream, wire::mesh_header_writer_qos(heartbeat_s));
    case ReplayTopic::kRegionSubscription:
      return add_writer<wire::RegionSubscriptionType>(
          stream, wire::writer_qos(wire::kRegionSubscriptionDelivery, heartbeat_s));
    case ReplayTopic::kSplitBatch:
      return add_writer<wire::SplitBatchType>(
          stream, wire::writer_qos(wire::kSplitBatchDelivery, heartbeat_s));
    case ReplayTopic::kBodyPose:
      return add_writer<wire::BodyPoseType>(stream,
                                            wire::writer_qos(wire::kBodyPoseDelivery, heartbeat_s));
    case ReplayTopic::kContactReport:
      break;
  }
  return add_writer<wire::ContactReportType>(
      stream, wire::writer_qos(wire::kContactReportDelivery, heartbeat_s));
}

template <class Type>
Status DdsReplay::Impl::add_writer(const ReplayStream& stream,
                                   const wire::fdds::DataWriterQos& qos) {
  auto topic = bus_->add_topic<Type>(names_.of(stream.topic));
  if (!topic.is_ok()) return topic.status();
  listeners_.push_back(std::make_unique<wire::WriterListener>(mailbox_, names_.of(stream.topic)));
  auto writer = bus_->add_writer(topic.value(), qos, *listeners_.back(), stream.partition);
  if (!writer.is_ok()) return writer.status();
  writers_.push_back(std::make_unique<TypedRawWriter<Type>>(*writer.value()));
  return Status::ok();
}

bool DdsReplay::Impl::publish(std::uint32_t stream, const std::vector<std::uint8_t>& cdr) {
  if (bus_ == nullptr) return false;
  const auto deadline = std::chrono::steady_clock::now() + kPublishDeadline;
  for (;;) {
    const wire::WriteResult result = writers_[stream]->write(cdr, mailbox_);
    if (result != wire::WriteResult::kFull) return result == wire::WriteResult::kTaken;
    if (std::chrono::steady_clock::now() >= deadline) break;
    mailbox_.wait(0.002);
  }
  mailbox_.wake();  // waiting for room may have taken a wake-up that was meant for wait()
  mailbox_.complain(names_.of(streams_[stream].topic) + ": not sent: no room for 2 s");
  return false;
}

bool DdsReplay::Impl::take_restart() {
  if (!rejoin_watch_->take_due()) return false;
  bus_.reset();
  writers_.clear();
  listeners_.clear();
  peers_.forget();
  if (const Status status = open(); !status.is_ok()) {
    mailbox_.complain("could not join again: " + status.message());
    bus_.reset();
    rejoin_watch_->try_again();
    return false;
  }
  return true;
}

Inbox DdsReplay::Impl::take() {
  if (bus_ == nullptr) return {peers_.take_lost(), {}};
  return peers_.take([](const wire::RegionSubscription&) { return true; });
}

Result<std::unique_ptr<DdsReplay>> DdsReplay::create(const wire::TransportOptions& transport,
                                                     const std::vector<ReplayStream>& streams,
                                                     const ReplayNames& names) {
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
std::vector<std::string> DdsReplay::take_complaints() { return impl_->mailbox().take_complaints(); }

}  // namespace nearmesh::publisher
