// SPDX-License-Identifier: Apache-2.0
#include "dds_monitor.hpp"

#include <algorithm>
#include <map>
#include <set>
#include <tuple>
#include <utility>

#include "core/base/hash.hpp"
#include "core/base/stopwatch.hpp"
#include "idl/dds/bus.hpp"
#include "idl/dds/dds_time.hpp"
#include "idl/dds/endpoint_names.hpp"
#include "idl/dds/endpoints.hpp"
#include "idl/dds/room.hpp"
#include "idl/dds/writer_books.hpp"
#include "idl/messages/contents.hpp"
#include "idl/messages/process_name.hpp"
#include "idl/messages/status_keeper.hpp"
#include "nearmesh/core/query/query.hpp"

namespace nearmesh::subscriber {
namespace {

using wire::Handle;
using wire::Microseconds;

constexpr std::size_t kMaxHeard = 4096;
constexpr std::size_t kMaxRefusals = 256;
constexpr std::size_t kMaxRegions = 16384;
/// Of which nothing was heard for so long make room: bodies come and go while their peers stay.
constexpr double kOldRegion_s = 60;
constexpr double kStatusSilence_s = 2;

/// Whose replica is of another content than is served under its name.
void find_strays(const std::string& name, const std::vector<ContentHash>& served,
                 const std::vector<wire::ProcessStatus>& processes,
                 std::vector<std::string>& lines) {
  for (const wire::ProcessStatus& process : processes)
    for (const wire::ProcessStatus::Model& model : process.models)
      if (!process.is_publisher && model.name == name && model.content_hash.is_set() &&
          std::find(served.begin(), served.end(), model.content_hash) == served.end())
        lines.push_back("model " + name + ": peer " + wire::called(process.session, process.name) +
                        " stands by content " + to_hex(model.content_hash) +
                        ", but what is served under this name is " + to_hex(served.front()));
}

/// Names that stand for more than one content.
std::vector<std::string> conflicts(const std::vector<wire::Hello>& publishers,
                                   const std::vector<wire::ProcessStatus>& processes) {
  std::set<std::string> names;
  for (const wire::Hello& hello : publishers)
    for (const wire::Hello::Model& model : hello.models) names.insert(model.name);
  std::vector<std::string> lines;
  for (const std::string& name : names) {
    std::vector<wire::Offer> offers;
    for (const wire::Hello& hello : publishers) wire::add_offer(hello, name, offers);
    // Which epochs have begun only those know who are in the exercise.
    std::set<std::uint32_t> epochs;
    for (const wire::Offer& offer : offers) epochs.insert(offer.epoch.number);
    std::vector<ContentHash> standing, all;
    for (const std::uint32_t epoch : epochs) {
      const std::vector<ContentHash> its = wire::standing(wire::of_epoch(offers, epoch));
      all.insert(all.end(), its.begin(), its.end());
      if (its.size() > 1) standing = its;
    }
    find_strays(name, all, processes, lines);
    if (standing.size() < 2) continue;
    std::string line = "model " + name + ": ";
    for (const ContentHash& content : standing) {
      const wire::Offer& offer = *wire::offer_of(offers, content);
      line += "publisher " + wire::called(offer.publisher, offer.name) + " serves content " +
              to_hex(content) + ", ";
    }
    lines.push_back(line + wire::kConflictAdvice);
  }
  return lines;
}

/// Whether there is room for an entry.
template <class Key, class Value>
bool has_room_for(std::map<Key, Value>& known, const Key& key, double now_s) {
  if (known.size() < kMaxRegions || known.contains(key)) return true;
  return std::erase_if(known, [now_s](const auto& entry) {
           return now_s - entry.second.heard_s > kOldRegion_s;
         }) > 0;
}

}  // namespace

class DdsMonitor::Impl {
 public:
  explicit Impl(const wire::TransportOptions& transport)
      : transport_(transport), silence_(kStatusSilence_s) {}

  Status start() {
    NEARMESH_RETURN_IF_ERROR(wire::check_room(transport_));
    auto bus = wire::Bus::open({.transport = transport_}, mailbox_);
    NEARMESH_RETURN_IF_ERROR(bus);
    bus_ = std::move(bus).value();
    NEARMESH_RETURN_IF_ERROR(hello_reader_.open(*bus_));
    return status_reader_.open(*bus_);
  }

  Status hear_regions() {
    NEARMESH_RETURN_IF_ERROR(report_reader_.open(*bus_, "", wire::Hearing::kLatest));
    return request_reader_.open(*bus_, "", wire::Hearing::kLatest);
  }

  void listen(double seconds) {
    mailbox_.wait(seconds);
    // What is faulty is heard too: it is complained of by itself.
    const auto heard = [this](const Handle& writer) { silence_.heard(writer); };
    const bool more = hello_reader_.drain(
        kMaxHeard,
        [&](wire::Hello&& hello, const Handle& writer, Microseconds) {
          hellos_[writer] = std::move(hello);
        },
        heard);
    const bool more_statuses = status_reader_.drain(
        kMaxHeard, [&](wire::ProcessStatus&& status, const Handle& writer, Microseconds) {
          const auto [known, is_new] = processes_.try_emplace(writer);
          if (is_new) known->second.turn = ++turns_;
          known->second.status = std::move(status);
          known->second.heard_s = clock_.seconds();
        });
    const bool more_regions = report_reader_.is_open() && take_regions();
    if (more || more_statuses || more_regions) mailbox_.wake();
    take_matches();
    for (const Handle& writer : silence_.take_silent(clock_.seconds()))
      refuse("publisher " + wire::name_of(writer, mailbox_) + wire::kSilentHint);
    for (std::string& line : mailbox_.take_complaints()) refuse(std::move(line));
  }

  Status identity() const { return wire::identity_of(bus_->door().get()); }

  BusView view() const {
    BusView view;
    std::map<wire::SessionId, wire::Hello> publishers;
    for (const auto& [writer, hello] : hellos_) publishers[hello.publisher] = hello;
    for (const auto& [id, hello] : publishers) view.publishers.push_back(hello);
    std::vector<std::string> claimed;
    for (const auto& [writer, process] : those_who_speak(claimed))
      view.processes.push_back(process->status);
    view.errors = conflicts(view.publishers, view.processes);
    view.errors.insert(view.errors.end(), claimed.begin(), claimed.end());
    view.refusals = refusals_;
    const double now_s = clock_.seconds();
    for (const auto& [key, region] : regions_)
      view.regions.push_back({region.report, now_s - region.heard_s,
                              is_certified(static_cast<AnswerStatus>(region.report.status))
                                  ? 0
                                  : now_s - region.certified_s});
    for (const auto& [key, request] : requests_) {
      view.requests.push_back(request.view);
      view.requests.back().age_s = now_s - request.heard_s;
    }
    return view;
  }

 private:
  struct Process {
    wire::ProcessStatus status;
    std::uint64_t turn = 0;  ///< in which its writer was heard first
    double heard_s = 0;
  };
  /// One of each session, by session: who was heard first of those that still give signs of life.
  /// Who joined anew is one of two until its old self is missed, so that alone is no error; where
  /// two go on, one is a stranger.
  std::vector<std::pair<Handle, const Process*>> those_who_speak(
      std::vector<std::string>& claimed) const {
    const double since_s = clock_.seconds() - 3 * wire::kStatusPeriod_s;
    std::map<wire::SessionId, std::vector<std::pair<Handle, const Process*>>> by_session;
    for (const auto& [writer, process] : processes_)
      by_session[process.status.session].emplace_back(writer, &process);
    std::vector<std::pair<Handle, const Process*>> first;
    for (auto& [session, all] : by_session) {
      std::sort(all.begin(), all.end(), [since_s](const auto& one, const auto& other) {
        return std::pair(one.second->heard_s < since_s, one.second->turn) <
               std::pair(other.second->heard_s < since_s, other.second->turn);
      });
      first.push_back(all.front());
      if (all.size() < 2 || all[1].second->heard_s < since_s) continue;
      claimed.push_back("process " + wire::called(session, all[0].second->status.name) + ": " +
                        wire::name_of(all[0].first, mailbox_) + " and " +
                        wire::name_of(all[1].first, mailbox_) +
                        " both say that they are it, what the second says is not shown: stop "
                        "whichever is not");
    }
    return first;
  }

  /// Out: true when there may be more.
  bool take_regions() {
    const double now_s = clock_.seconds();
    const bool more = report_reader_.drain(
        kMaxHeard, [&](wire::ContactReport&& report, const Handle& writer, Microseconds) {
          const auto key = std::tuple(report.peer, report.body_a, report.body_b);
          if (!has_room_for(regions_, key, now_s)) return;
          Region& region = regions_.try_emplace(key, Region{.certified_s = now_s}).first->second;
          region.writer = writer;
          region.heard_s = now_s;
          if (is_certified(static_cast<AnswerStatus>(report.status))) region.certified_s = now_s;
          region.report = std::move(report);
        });
    const bool more_requests = request_reader_.drain(
        kMaxHeard, [&](wire::RegionSubscription&& asked, const Handle& writer, Microseconds) {
          if (asked.request == 0) return;
          const auto note = [&](const ContentHash& content, std::size_t nodes, std::size_t pairs) {
            const std::pair key(asked.peer, content);
            if (has_room_for(requests_, key, now_s))
              requests_[key] = {
                  {asked.peer, content, asked.priority, static_cast<std::uint32_t>(nodes),
                   static_cast<std::uint32_t>(pairs)},
                  writer,
                  now_s};
          };
          if (!asked.certificate) return note(asked.content_hash, asked.region.attach.size(), 0);
          const CertificateRequest& told = *asked.certificate;
          for (std::size_t i = 0; i < told.models.size(); ++i)
            note(told.models[i].content, 0,
                 static_cast<std::size_t>(
                     std::count_if(told.pairs.begin(), told.pairs.end(),
                                   [&](const auto& pair) { return pair.a == i || pair.b == i; })));
        });
    for (const auto& event : report_reader_.take_matches())
      if (event.is_gone())
        std::erase_if(regions_,
                      [&](const auto& known) { return known.second.writer == event.writer; });
    for (const auto& event : request_reader_.take_matches())
      if (event.is_gone())
        std::erase_if(requests_,
                      [&](const auto& known) { return known.second.writer == event.writer; });
    return more || more_requests;
  }

  void take_matches() {
    for (const auto& event : hello_reader_.take_matches()) {
      if (event.is_gone()) {
        silence_.gone(event.writer);
        hellos_.erase(event.writer);
      } else {
        silence_.matched(event.writer, clock_.seconds());
      }
    }
    // A host that uses a channel alone may have nothing to say of itself.
    for (const auto& event : status_reader_.take_matches())
      if (event.is_gone()) processes_.erase(event.writer);
  }

  void refuse(std::string line) {
    if (!known_.insert(line).second) return;
    // The newest stay: who looks on for weeks is not to miss what is refused now.
    if (refusals_.size() == kMaxRefusals) {
      known_.erase(refusals_.front());
      refusals_.erase(refusals_.begin());
    }
    refusals_.push_back(std::move(line));
  }

  const wire::TransportOptions transport_;
  const Stopwatch clock_;
  wire::Mailbox mailbox_;
  wire::Reader<wire::Hello> hello_reader_{mailbox_};
  wire::Reader<wire::ProcessStatus> status_reader_{mailbox_};
  wire::Reader<wire::ContactReport> report_reader_{mailbox_};
  wire::Reader<wire::RegionSubscription> request_reader_{mailbox_};
  wire::SilenceWatch silence_;
  std::map<Handle, wire::Hello> hellos_;
  std::map<Handle, Process> processes_;  ///< by writer
  std::uint64_t turns_ = 0;
  struct Region {
    wire::ContactReport report;
    Handle writer;
    double heard_s = 0, certified_s = 0;
  };
  std::map<std::tuple<wire::SessionId, std::string, std::string>, Region> regions_;
  struct Request {
    RequestView view;  ///< but its age
    Handle writer;
    double heard_s = 0;
  };
  std::map<std::pair<wire::SessionId, ContentHash>, Request> requests_;
  std::vector<std::string> refusals_;
  std::set<std::string> known_;
  std::unique_ptr<wire::Bus> bus_;  ///< last: goes first, while the listeners still live
};

Result<std::unique_ptr<DdsMonitor>> DdsMonitor::create(const wire::TransportOptions& transport,
                                                       bool regions) {
  auto impl = std::make_unique<Impl>(transport);
  NEARMESH_RETURN_IF_ERROR(impl->start());
  if (regions) NEARMESH_RETURN_IF_ERROR(impl->hear_regions());
  return std::unique_ptr<DdsMonitor>(new DdsMonitor(std::move(impl)));
}

DdsMonitor::DdsMonitor(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
DdsMonitor::~DdsMonitor() = default;
void DdsMonitor::listen(double seconds) { impl_->listen(seconds); }
BusView DdsMonitor::view() const { return impl_->view(); }
Status DdsMonitor::identity() const { return impl_->identity(); }

}  // namespace nearmesh::subscriber
