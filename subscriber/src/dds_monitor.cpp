// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/subscriber/dds_monitor.hpp"

#include <map>
#include <set>
#include <utility>

#include "nearmesh/core/base/hash.hpp"
#include "nearmesh/core/base/stopwatch.hpp"
#include "nearmesh/wire/dds_support.hpp"

namespace nearmesh::subscriber {
namespace {

using wire::Handle;
using wire::Microseconds;

constexpr std::size_t kMaxTaken = 4096;
constexpr std::size_t kMaxRefusals = 256;
constexpr double kSilence_s = 2;

}  // namespace

class DdsMonitor::Impl {
 public:
  explicit Impl(const wire::TransportOptions& transport)
      : transport_(transport),
        names_(transport.prefix),
        hello_listener_(mailbox_, names_.hello),
        status_listener_(mailbox_, names_.process_status),
        silence_(kSilence_s) {}

  Status start() {
    auto bus = wire::Bus::open({.transport = transport_, .participant_name = "nearmesh monitor"},
                               mailbox_);
    if (!bus.is_ok()) return bus.status();
    bus_ = std::move(bus).value();
    auto hello = bus_->add_topic<wire::HelloType>(names_.hello);
    if (!hello.is_ok()) return hello.status();
    auto hellos =
        bus_->add_reader(hello.value(), wire::reader_qos(wire::kHelloDelivery), hello_listener_);
    if (!hellos.is_ok()) return hellos.status();
    hello_reader_ = hellos.value();
    auto status = bus_->add_topic<wire::ProcessStatusType>(names_.process_status);
    if (!status.is_ok()) return status.status();
    auto statuses = bus_->add_reader(status.value(), wire::reader_qos(wire::kProcessStatusDelivery),
                                     status_listener_);
    if (!statuses.is_ok()) return statuses.status();
    status_reader_ = statuses.value();
    return Status::ok();
  }

  void listen(double seconds) {
    mailbox_.wait(seconds);
    // What is faulty is heard too: it is complained of by itself.
    const auto heard = [this](const Handle& writer) { silence_.heard(writer); };
    const bool more = wire::drain<wire::HelloType>(
        *hello_reader_, mailbox_, kMaxTaken,
        [&](wire::Hello&& hello, const Handle& writer, Microseconds) {
          hellos_[writer] = std::move(hello);
        },
        heard);
    const bool more_statuses = wire::drain<wire::ProcessStatusType>(
        *status_reader_, mailbox_, kMaxTaken,
        [&](wire::ProcessStatus&& status, const Handle& writer, Microseconds) {
          processes_[writer] = std::move(status);
        });
    if (more || more_statuses) mailbox_.wake();
    take_matches();
    for (const Handle& writer : silence_.take_silent(clock_.seconds()))
      refuse("publisher " + wire::name_of(writer) + wire::kSilentHint);
    for (std::string& line : mailbox_.take_complaints()) refuse(std::move(line));
    find_conflicts();
  }

  BusView view() const {
    BusView view;
    std::map<wire::SessionId, wire::Hello> publishers;
    for (const auto& [writer, hello] : hellos_) publishers[hello.publisher] = hello;
    for (const auto& [id, hello] : publishers) view.publishers.push_back(hello);
    std::map<wire::SessionId, wire::ProcessStatus> processes;
    for (const auto& [writer, status] : processes_) processes[status.session] = status;
    for (const auto& [id, status] : processes) view.processes.push_back(status);
    view.refusals = refusals_;
    return view;
  }

 private:
  void take_matches() {
    for (const auto& event : hello_listener_.take_matches()) {
      if (event.gone) {
        silence_.gone(event.writer);
        hellos_.erase(event.writer);
      } else {
        silence_.matched(event.writer, clock_.seconds());
      }
    }
    // A host that uses a channel alone may have nothing to say of itself.
    for (const auto& event : status_listener_.take_matches())
      if (event.gone) processes_.erase(event.writer);
  }

  void find_conflicts() {
    std::map<std::string, std::pair<std::uint64_t, wire::SessionId>> by_name;
    for (const auto& [writer, hello] : hellos_)
      for (const wire::Hello::Model& model : hello.models) {
        const auto [first, is_new] =
            by_name.try_emplace(model.name, model.content_hash, hello.publisher);
        if (first->second.first == model.content_hash) continue;
        // Smaller id first, whoever was heard first.
        std::pair one{first->second.second, first->second.first},
            other{hello.publisher, model.content_hash};
        if (other < one) std::swap(one, other);
        refuse("model " + model.name + ": publisher " + to_hex(one.first) + " serves content " +
               to_hex(one.second) + ", publisher " + to_hex(other.first) + " content " +
               to_hex(other.second) + "; peers take either: rename or replace one file");
      }
  }

  void refuse(std::string line) {
    if (refusals_.size() < kMaxRefusals && known_.insert(line).second)
      refusals_.push_back(std::move(line));
  }

  const wire::TransportOptions transport_;
  const wire::TopicNames names_;
  const Stopwatch clock_;
  wire::Mailbox mailbox_;
  wire::ReaderListener hello_listener_, status_listener_;
  wire::SilenceWatch silence_;
  std::map<Handle, wire::Hello> hellos_;
  std::map<Handle, wire::ProcessStatus> processes_;
  std::vector<std::string> refusals_;
  std::set<std::string> known_;
  wire::fdds::DataReader* hello_reader_ = nullptr;
  wire::fdds::DataReader* status_reader_ = nullptr;
  std::unique_ptr<wire::Bus> bus_;  ///< last: goes first, while the listeners still live
};

Result<std::unique_ptr<DdsMonitor>> DdsMonitor::create(const wire::TransportOptions& transport) {
  auto impl = std::make_unique<Impl>(transport);
  NEARMESH_RETURN_IF_ERROR(impl->start());
  return std::unique_ptr<DdsMonitor>(new DdsMonitor(std::move(impl)));
}

DdsMonitor::DdsMonitor(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
DdsMonitor::~DdsMonitor() = default;
void DdsMonitor::listen(double seconds) { impl_->listen(seconds); }
BusView DdsMonitor::view() const { return impl_->view(); }

}  // namespace nearmesh::subscriber
