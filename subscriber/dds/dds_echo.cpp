// SPDX-License-Identifier: Apache-2.0
#include "dds_echo.hpp"

#include <deque>
#include <sstream>
#include <utility>

#include "idl/dds/dds_support.hpp"

namespace nearmesh::subscriber {
namespace {

using wire::Handle;
using wire::Microseconds;

constexpr std::size_t kMaxEchoesTaken = 256;
constexpr std::size_t kMaxReplies =
    1024;  ///< waiting to be sent; others' requests beyond are dropped
constexpr double kRetry_s = 0.002;

}  // namespace

class DdsEcho::Impl {
 public:
  explicit Impl(const wire::TransportOptions& transport)
      : transport_(transport),
        own_id_(wire::make_session_id()),
        echo_{transport_.prefix, mailbox_, false},
        probe_{transport_.prefix, mailbox_, true} {}

  Status start() {
    auto bus =
        wire::Bus::open({.transport = transport_, .participant_name = "nearmesh doctor"}, mailbox_);
    if (!bus.is_ok()) return bus.status();
    bus_ = std::move(bus).value();
    NEARMESH_RETURN_IF_ERROR(open(echo_));
    return open(probe_);
  }

  wire::SessionId own_id() const { return own_id_; }

  std::vector<std::string> locators() const {
    eprosima::fastrtps::rtps::LocatorList_t list;
    echo_.reader->get_listening_locators(list);
    std::vector<std::string> texts;
    for (const auto& locator : list) {
      std::ostringstream text;
      text << locator;
      texts.push_back(text.str());
    }
    return texts;
  }

  bool send(const wire::Echo& echo, bool best_effort) {
    const Lane& lane = best_effort ? probe_ : echo_;
    if (!check(echo).is_ok()) return false;
    return wire::write_message<wire::EchoType>(*lane.writer, echo, mailbox_) !=
           wire::WriteResult::kFull;
  }

  std::vector<wire::Echo> poll(double seconds) {
    const bool sent_all = flush();
    mailbox_.wait(sent_all ? seconds : std::min(seconds, kRetry_s));
    std::vector<wire::Echo> taken;
    bool more = false;
    for (Lane* lane : {&echo_, &probe_}) {
      more |= wire::drain<wire::EchoType>(*lane->reader, mailbox_, kMaxEchoesTaken,
                                          [&](wire::Echo&& echo, const Handle&, Microseconds) {
                                            take(std::move(echo), *lane, taken);
                                          });
      for (const auto& match : lane->reader_listener.take_matches())
        if (match.writer != lane->writer->get_instance_handle())
          lane->matched_writers += match.gone ? -1 : 1;
    }
    if (more) mailbox_.wake();
    static_cast<void>(flush());
    return taken;
  }

  bool is_matched() const {
    for (const Lane* lane : {&echo_, &probe_})
      if (lane->matched_writers == 0 || !lane->writer_listener.is_matched_beside_participant_of(
                                            lane->reader->get_instance_handle()))
        return false;
    return true;
  }
  std::vector<std::string> take_complaints() { return mailbox_.take_complaints(); }

 private:
  /// A topic with this process's writer and reader.
  struct Lane {
    Lane(const std::string& prefix, wire::Mailbox& mailbox, bool best_effort)
        : is_best_effort(best_effort),
          topic(best_effort ? wire::TopicNames(prefix).probe : wire::TopicNames(prefix).echo),
          writer_listener(mailbox, topic),
          reader_listener(mailbox, topic) {}
    const bool is_best_effort;
    const std::string topic;
    wire::WriterListener writer_listener;
    wire::ReaderListener reader_listener;
    wire::fdds::DataWriter* writer = nullptr;
    wire::fdds::DataReader* reader = nullptr;
    int matched_writers = 0;
    std::deque<wire::Echo> replies;
  };

  Status open(Lane& lane) {
    auto topic = bus_->add_topic<wire::EchoType>(lane.topic);
    if (!topic.is_ok()) return topic.status();
    wire::fdds::DataReaderQos reader_qos = wire::reader_qos(wire::kEchoDelivery);
    wire::fdds::DataWriterQos writer_qos =
        wire::writer_qos(wire::kEchoDelivery, transport_.heartbeat_s);
    if (lane.is_best_effort) {
      reader_qos.reliability().kind = wire::fdds::BEST_EFFORT_RELIABILITY_QOS;
      writer_qos.reliability().kind = wire::fdds::BEST_EFFORT_RELIABILITY_QOS;
    }
    auto reader = bus_->add_reader(topic.value(), reader_qos, lane.reader_listener);
    if (!reader.is_ok()) return reader.status();
    lane.reader = reader.value();
    auto writer = bus_->add_writer(topic.value(), writer_qos, lane.writer_listener);
    if (!writer.is_ok()) return writer.status();
    lane.writer = writer.value();
    return Status::ok();
  }

  void take(wire::Echo&& echo, Lane& lane, std::vector<wire::Echo>& taken) {
    if (echo.from == own_id_ || (echo.to != 0 && echo.to != own_id_)) return;
    if (!echo.is_reply && lane.replies.size() < kMaxReplies) {
      wire::Echo& reply = lane.replies.emplace_back(echo);
      reply.from = own_id_;
      reply.to = echo.from;
      reply.is_reply = true;
    }
    taken.push_back(std::move(echo));
  }

  /// Out: false when a reply could not be taken.
  bool flush() {
    for (Lane* lane : {&echo_, &probe_})
      for (; !lane->replies.empty(); lane->replies.pop_front())
        if (!send(lane->replies.front(), lane->is_best_effort)) return false;
    return true;
  }

  const wire::TransportOptions transport_;
  const wire::SessionId own_id_;
  wire::Mailbox mailbox_;
  Lane echo_, probe_;
  std::unique_ptr<wire::Bus> bus_;  ///< last: goes first, while the listeners still live
};

Result<std::unique_ptr<DdsEcho>> DdsEcho::create(const wire::TransportOptions& transport) {
  auto impl = std::make_unique<Impl>(transport);
  NEARMESH_RETURN_IF_ERROR(impl->start());
  return std::unique_ptr<DdsEcho>(new DdsEcho(std::move(impl)));
}

DdsEcho::DdsEcho(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
DdsEcho::~DdsEcho() = default;
wire::SessionId DdsEcho::own_id() const { return impl_->own_id(); }
std::vector<std::string> DdsEcho::locators() const { return impl_->locators(); }
bool DdsEcho::send(const wire::Echo& echo, bool best_effort) {
  return impl_->send(echo, best_effort);
}
std::vector<wire::Echo> DdsEcho::poll(double seconds) { return impl_->poll(seconds); }
bool DdsEcho::is_matched() const { return impl_->is_matched(); }
std::vector<std::string> DdsEcho::take_complaints() { return impl_->take_complaints(); }

}  // namespace nearmesh::subscriber
