// SPDX-License-Identifier: Apache-2.0
#include "dds_echo.hpp"

#include <deque>
#include <sstream>
#include <utility>

#include "idl/dds/bus.hpp"
#include "idl/dds/dds_time.hpp"
#include "idl/dds/endpoints.hpp"
#include "idl/dds/room.hpp"

namespace nearmesh::subscriber {
namespace {

using wire::Handle;
using wire::Microseconds;

constexpr std::size_t kMaxEchoesTaken = 256;
/// Waiting to be sent; others' requests beyond are dropped.
constexpr std::size_t kMaxReplies = 1024;
constexpr double kRetry_s = 0.002;

}  // namespace

class DdsEcho::Impl {
 public:
  explicit Impl(const wire::TransportOptions& transport)
      : transport_(transport), own_id_(wire::make_session_id()) {}

  Status start() {
    NEARMESH_RETURN_IF_ERROR(wire::check_room(transport_));
    auto bus = wire::Bus::open({.transport = transport_}, mailbox_);
    NEARMESH_RETURN_IF_ERROR(bus);
    bus_ = std::move(bus).value();
    NEARMESH_RETURN_IF_ERROR(echo_.open(*bus_));
    return probe_.open(*bus_);
  }

  wire::SessionId own_id() const { return own_id_; }

  std::vector<std::string> locators() const {
    wire::rtps::LocatorList_t list;
    echo_.reader.endpoint().get_listening_locators(list);
    std::vector<std::string> texts;
    for (const auto& locator : list) {
      std::ostringstream text;
      text << locator;
      texts.push_back(text.str());
    }
    return texts;
  }

  bool send(const wire::Echo& echo, bool best_effort) {
    if (!check(echo).is_ok()) return false;
    return (best_effort ? probe_.writer.write({echo}) : echo_.writer.write(echo)) !=
           wire::WriteResult::kFull;
  }

  std::vector<wire::Echo> poll(double seconds) {
    const bool sent_all = flush();
    mailbox_.wait(sent_all ? seconds : std::min(seconds, kRetry_s));
    std::vector<wire::Echo> taken;
    const bool more_echoes = take(echo_, taken), more_probes = take(probe_, taken);
    if (more_echoes || more_probes) mailbox_.wake();
    static_cast<void>(flush());
    return taken;
  }

  bool is_matched() const { return echo_.is_matched() && probe_.is_matched(); }
  std::vector<std::string> take_complaints() { return mailbox_.take_complaints(); }

 private:
  /// A topic with this process's writer and reader.
  template <class Message>
  struct Lane {
    explicit Lane(wire::Mailbox& mailbox) : reader(mailbox), writer(mailbox) {}
    Status open(wire::Bus& bus) {
      NEARMESH_RETURN_IF_ERROR(reader.open(bus));
      return writer.open(bus);
    }
    bool is_matched() const {
      return matched_writers != 0 && writer.listener().is_matched_beside_participant_of(
                                         reader.endpoint().get_instance_handle());
    }
    wire::Reader<Message> reader;
    wire::Writer<Message> writer;
    int matched_writers = 0;
    std::deque<Message> replies;
  };

  /// Out: true when there may be more.
  template <class Message>
  bool take(Lane<Message>& lane, std::vector<wire::Echo>& taken) {
    const bool more =
        lane.reader.drain(kMaxEchoesTaken, [&](wire::Echo&& echo, const Handle&, Microseconds) {
          if (echo.from == own_id_ || (echo.to != 0 && echo.to != own_id_)) return;
          if (!echo.is_reply && lane.replies.size() < kMaxReplies) {
            wire::Echo& reply = lane.replies.emplace_back(Message{echo});
            reply.from = own_id_;
            reply.to = echo.from;
            reply.is_reply = true;
          }
          taken.push_back(std::move(echo));
        });
    for (const auto& match : lane.reader.take_matches())
      if (match.writer != lane.writer.endpoint().get_instance_handle())
        lane.matched_writers += match.is_gone() ? -1 : 1;
    return more;
  }

  /// Out: false when a reply could not be taken.
  template <class Message>
  bool flush(Lane<Message>& lane) {
    for (; !lane.replies.empty(); lane.replies.pop_front())
      if (lane.writer.write(lane.replies.front()) == wire::WriteResult::kFull) return false;
    return true;
  }
  bool flush() { return flush(echo_) && flush(probe_); }

  const wire::TransportOptions transport_;
  const wire::SessionId own_id_;
  wire::Mailbox mailbox_;
  Lane<wire::Echo> echo_{mailbox_};
  Lane<wire::Probe> probe_{mailbox_};
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
