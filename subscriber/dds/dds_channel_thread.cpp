// SPDX-License-Identifier: Apache-2.0
// The channel's thread: what it opens, what it sends.
#include <algorithm>
#include <new>
#include <type_traits>
#include <utility>

#include "core/base/float_guard.hpp"
#include "dds_channel_impl.hpp"
#include "idl/dds/rejoin_watch.hpp"
#include "or_no_memory.hpp"

namespace nearmesh::subscriber {
namespace {

constexpr double kIdleWait_s = 0.5;  ///< everything wakes the thread; this is a safety net
constexpr double kNoMemoryWait_s = 0.1;
constexpr double kRetryWait_s = 0.002;  ///< when Fast DDS could not take a sample
/// Batches are acknowledged together for so long, or until they are that share of the window: on
/// thin links each as it comes.
constexpr double kAcknowledgeWait_s = 0.01;
constexpr std::size_t kAcknowledgeShare = 8;

}  // namespace

void DdsChannel::Impl::run(std::promise<Status> started) {
  const FloatGuard guard;
  // A participant of the host's is the host's to repair.
  std::unique_ptr<wire::RejoinWatch> rejoin_watch;
  const Status opened = or_no_memory([&] {
    if (options_.participant == nullptr)
      rejoin_watch = std::make_unique<wire::RejoinWatch>(mailbox_, options_.transport);
    return open();
  });
  const bool works = opened.is_ok();
  started.set_value(opened);
  while (works && !stopping_) {
    if (rejoin_watch != nullptr)
      static_cast<void>(rejoin_watch->rejoin_if_due(bus_, [this] { return rejoin(); }));
    if (bus_ == nullptr) {
      mailbox_.wait(kIdleWait_s);
      continue;
    }
    try {
      open_what_is_of_use();
      const bool sent_all = flush();
      const bool more = receive();
      const double wait_s = acknowledge();
      arrived_.notify_all();
      if (!more) mailbox_.wait(sent_all ? wait_s : kRetryWait_s);
    } catch (const std::bad_alloc&) {
      mailbox_.complain_of_memory();
      mailbox_.wait(kNoMemoryWait_s);
    }
  }
  bus_.reset();
}

Status DdsChannel::Impl::open() {
  wire::BusOptions bus_options;
  bus_options.transport = options_.transport;
  bus_options.host_participant = options_.participant;
  if (options_.bodies) bus_options.bodies = {*options_.bodies, options_.moves};
  bus_options.on_writer = [this](const wire::BusOptions::Found& found) {
    if (found.gone || found.topic != names_.of<wire::BodyPromises>()) return;
    promises_found_ = true;
    mailbox_.wake();
  };
  bus_options.on_reader = [this](const wire::BusOptions::Found& found) {
    if (found.gone || found.topic != names_.of<wire::HeldDetail>()) return;
    recorder_found_ = true;
    mailbox_.wake();
  };
  auto bus = wire::Bus::open(bus_options, mailbox_);
  NEARMESH_RETURN_IF_ERROR(bus);
  bus_ = std::move(bus).value();
  {
    const std::lock_guard lock(mutex_);
    door_ = bus_->door();
  }
  // Readers first: who hears our subscriptions can answer them.
  NEARMESH_RETURN_IF_ERROR(batch_reader_.open(*bus_, wire::partition_of(own_id_)));
  NEARMESH_RETURN_IF_ERROR(hello_reader_.open(*bus_));
  NEARMESH_RETURN_IF_ERROR(header_reader_.open(*bus_));
  NEARMESH_RETURN_IF_ERROR(directory_reader_.open(*bus_));
  NEARMESH_RETURN_IF_ERROR(pose_reader_.open(*bus_, "", wire::Hearing::kLatest));
  NEARMESH_RETURN_IF_ERROR(subscription_writer_.open(*bus_));
  NEARMESH_RETURN_IF_ERROR(directory_writer_.open(*bus_));
  NEARMESH_RETURN_IF_ERROR(pose_writer_.open(*bus_));
  NEARMESH_RETURN_IF_ERROR(report_writer_.open(*bus_));
  NEARMESH_RETURN_IF_ERROR(status_writer_.open(*bus_));
  if (options_.participant == nullptr) return Status::ok();
  // Its listener is the host's, so who comes is not told here.
  NEARMESH_RETURN_IF_ERROR(open_promising());
  NEARMESH_RETURN_IF_ERROR(open_promised());
  NEARMESH_RETURN_IF_ERROR(open_bounding());
  return open_holding();
}

/// Each endpoint is told to every participant, and costs both. So those that few scenes need are
/// opened once somebody is there who uses them.
void DdsChannel::Impl::open_what_is_of_use() {
  const auto open_if = [&](bool is_due, Status (Impl::*opening)()) {
    if (!is_due) return;
    if (const Status status = (this->*opening)(); !status.is_ok())
      mailbox_.complain(std::string(status.message()));
  };
  {
    const std::lock_guard lock(mutex_);
    promises_made_ |= !promises_.empty();
    bounds_told_ |= !watched_.unsent.empty() || !bounds_.empty();
  }
  open_if(promises_made_ && !near_writer_.is_open(), &Impl::open_promising);
  open_if(promises_found_.exchange(false), &Impl::open_promised);
  open_if(bounds_told_ && !bounds_writer_.is_open(), &Impl::open_bounding);
  open_if(recorder_found_.exchange(false), &Impl::open_holding);
}

template <class Endpoint, class... How>
Status DdsChannel::Impl::open(Endpoint& endpoint, const How&... how) {
  return endpoint.is_open() ? Status::ok() : endpoint.open(*bus_, how...);
}

/// For promises of own bodies.
Status DdsChannel::Impl::open_promising() {
  NEARMESH_RETURN_IF_ERROR(open(wanted_reader_, "", wire::Hearing::kLatest));
  NEARMESH_RETURN_IF_ERROR(open(promise_writer_));
  return open(near_writer_);
}

/// For those of others'.
Status DdsChannel::Impl::open_promised() {
  NEARMESH_RETURN_IF_ERROR(open(wanted_writer_));
  NEARMESH_RETURN_IF_ERROR(open(promise_reader_));
  return open(near_reader_, "", wire::Hearing::kLatest);
}

/// For pairs that bounds prove free. As answers are, they are written whether anybody listens or
/// not: a recorder that comes late shall count what it missed.
Status DdsChannel::Impl::open_bounding() {
  NEARMESH_RETURN_IF_ERROR(open(watched_writer_));
  return open(bounds_writer_);
}

/// For who records.
Status DdsChannel::Impl::open_holding() { return open(held_writer_); }

/// Out: how long the thread may rest.
double DdsChannel::Impl::acknowledge() {
  const auto now = std::chrono::steady_clock::now();
  double wait_s = kIdleWait_s;
  std::vector<wire::RegionSubscription> due;
  {
    const std::lock_guard lock(mutex_);
    for (auto& [publisher, account] : accounts_) {
      if (account.bytes == 0) continue;
      const std::chrono::duration<double> since = now - account.acknowledged;
      if (since.count() < kAcknowledgeWait_s &&
          account.bytes < account.window_bytes / kAcknowledgeShare) {
        wait_s = std::min(wait_s, kAcknowledgeWait_s - since.count());
        continue;
      }
      wire::RegionSubscription credit;
      credit.peer = own_id_;
      credit.publisher = publisher;
      credit.acknowledged_sequence = account.sequence;
      credit.window_bytes = account.window_bytes;
      due.push_back(std::move(credit));
      account.bytes = 0;
      account.acknowledged = now;
    }
  }
  for (const wire::RegionSubscription& credit : due)
    if (subscription_writer_.write(credit) == wire::WriteResult::kFull) {
      const std::lock_guard lock(mutex_);
      if (const auto at = accounts_.find(credit.publisher); at != accounts_.end()) {
        at->second.bytes += at->second.window_bytes;  // overdue
        wait_s = kRetryWait_s;
      }
    }
  return wait_s;
}

/// As a new participant, with the same session. Every publisher is
/// lost and, if it still lives, found again.
Status DdsChannel::Impl::rejoin() {
  for (const SessionId publisher : hellos_.clear()) tell_lost(publisher);
  movers_.clear();
  wishers_.clear();
  routes_.clear();
  headers_.clear();
  drop_ended();
  {
    const std::lock_guard lock(mutex_);
    movers_.tell_movers(inbox_);
  }
  const auto forget = [](auto&... endpoints) { (endpoints.forget(), ...); };
  forget(hello_reader_, header_reader_, batch_reader_, directory_reader_, pose_reader_,
         near_reader_, promise_reader_, wanted_reader_);
  forget(subscription_writer_, directory_writer_, pose_writer_, promise_writer_, near_writer_,
         wanted_writer_, report_writer_, watched_writer_, bounds_writer_, held_writer_,
         status_writer_);
  {
    const std::lock_guard lock(mutex_);
    directory_.say_again();
    watched_.say_again();
    has_other_bodies_ = true;
  }
  return open();
}

/// Out: false when Fast DDS could not take a sample, so that it should be tried again soon.
bool DdsChannel::Impl::flush() {
  bool all = true;
  // Not by any reader: a recorder hears subscriptions too, and does not answer them.
  if (std::any_of(
          hellos_.writers().begin(), hellos_.writers().end(), [this](const Handle& publisher) {
            return subscription_writer_.listener().is_matched_with_participant_of(publisher);
          }))
    all &= flush(subscriptions_, subscription_writer_);
  all &= flush(directory_.unsent, directory_writer_);
  all &= flush(promises_, promise_writer_);
  all &= flush(poses_, pose_writer_);
  all &= end_silent_parts(promises_, retold_promises_, promise_writer_);
  all &= end_silent_parts(poses_, retold_poses_, pose_writer_);
  all &= flush(watched_.unsent, watched_writer_);
  all &= flush(bounds_, bounds_writer_);
  all &= flush(wanted_, wanted_writer_);
  all &= flush(near_, near_writer_);
  all &= flush(held_, held_writer_);
  all &= flush(reports_, report_writer_);
  all &= flush(statuses_, status_writer_);
  return all;
}

/// To the door, before poses of such a body go out.
void DdsChannel::Impl::tell_moved() {
  std::vector<std::string> names;
  {
    const std::lock_guard lock(mutex_);
    if (!std::exchange(has_other_bodies_, false)) return;
    for (const auto& [part, directory] : directory_.parts)
      for (const wire::BodyDirectory::Body& body : directory.bodies) names.push_back(body.name);
  }
  bus_->tell_moved(pose_writer_.endpoint(), names);
  if (!options_.bodies) return;
  for (const std::string& name : names)
    if (std::find(options_.moves.begin(), options_.moves.end(), name) == options_.moves.end() &&
        not_told_.insert(name).second)
      mailbox_.complain("body " + name +
                        " is moved here, but DdsChannelOptions::moves does not name it: peers that "
                        "name it may never hear of it");
}

/// The last poses or promises of a part are kept for who joins later. Where all its bodies are
/// gone, or are not such any more, they would be for good: between them and those of other parts
/// Fast DDS tells such a reader of one gap that grows with each sample, of which doors let in
/// kMaxGap a time (rtps_check.hpp), and whoever joins keeps what no directory names. Unregistered,
/// not disposed of: then the writer keeps nothing of the part, as soon as all readers have heard of
/// it. To readers that is no news. The directory's word that a part has no bodies stays, as does
/// the watched bodies': a reader that stood still beyond its lease still believes the one before,
/// and hears of it by what is kept alone. Out: as flush().
template <class Message>
bool DdsChannel::Impl::end_silent_parts(const std::deque<Message>& queue,
                                        std::set<std::uint32_t>& retold,
                                        wire::Writer<Message>& writer) {
  constexpr bool kPromised = std::is_same_v<Message, wire::BodyPromises>;
  constexpr std::uint32_t kCount = kPromised ? wire::kBodiesPerPromise : wire::kBodiesPerPart;
  std::set<std::uint32_t> silent;
  {
    const std::lock_guard lock(mutex_);
    if (!queue.empty()) return true;  // some may be of these parts: they go first
    for (const std::uint32_t part : std::exchange(retold, {}))
      if (!names_bodies(part * kCount, kCount, kPromised)) silent.insert(part);
  }
  if (!writer.is_open()) return true;  // it has said nothing
  for (const std::uint32_t part : silent) {
    typename wire::Writer<Message>::Data key;
    encode(Message{.peer = own_id_, .part = part}, key);
    // Where nothing was said of it, Fast DDS finds nothing to do.
    const wire::ReturnCode code = writer.endpoint().unregister_instance(
        static_cast<typename wire::TypeOf<Message>::Sample*>(&key),
        wire::rtps::c_InstanceHandle_Unknown);
    if (!wire::is_timeout(code)) continue;
    const std::lock_guard lock(mutex_);
    retold.insert(silent.find(part), silent.end());
    return false;
  }
  return true;
}

template <class Message>
bool DdsChannel::Impl::flush(std::deque<Message>& queue, wire::Writer<Message>& writer) {
  if (!writer.is_open()) return true;  // open_what_is_of_use() comes first
  std::deque<Message> outgoing;
  {
    const std::lock_guard lock(mutex_);
    outgoing.swap(queue);
  }
  if constexpr (std::is_same_v<Message, wire::BodyPoses>) tell_moved();  // of these bodies, too
  while (!outgoing.empty() && writer.write(outgoing.front()) != wire::WriteResult::kFull)
    outgoing.pop_front();
  if (outgoing.empty()) return true;
  const std::lock_guard lock(mutex_);
  queue.insert(queue.begin(), std::make_move_iterator(outgoing.begin()),
               std::make_move_iterator(outgoing.end()));
  return false;
}

}  // namespace nearmesh::subscriber
