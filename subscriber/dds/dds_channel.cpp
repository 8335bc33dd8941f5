// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/subscriber/dds/dds_channel.hpp"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <deque>
#include <future>
#include <map>
#include <mutex>
#include <new>
#include <set>
#include <system_error>
#include <thread>
#include <type_traits>
#include <utility>

#include "core/base/float_guard.hpp"
#include "core/base/lru_map.hpp"
#include "dds_headers.hpp"
#include "dds_hellos.hpp"
#include "dds_poses.hpp"
#include "idl/dds/dds_support.hpp"
#include "idl/dds/rejoin_watch.hpp"
#include "idl/dds/room.hpp"
#include "idl/dds/routes.hpp"

namespace nearmesh::subscriber {

using wire::Handle;
using wire::Microseconds;
using wire::SessionId;

namespace {

constexpr std::size_t kMaxTaken = 1024;  ///< of one topic, before the others have their turn
constexpr double kIdleWait_s = 0.5;      ///< everything wakes the thread; this is a safety net
constexpr double kNoMemoryWait_s = 0.1;
constexpr double kRetryWait_s = 0.002;  ///< when Fast DDS could not take a sample
/// Batches are acknowledged together for so long, or until they are that share of the window: on thin links each as it comes.
constexpr double kAcknowledgeWait_s = 0.01;
constexpr std::size_t kAcknowledgeShare = 8;

}  // namespace

class DdsChannel::Impl {
 public:
  explicit Impl(const DdsChannelOptions& options)
      : options_(options),
        own_id_(options.session != 0 ? options.session : wire::make_session_id()),
        names_(options.transport.prefix),
        hellos_(mailbox_, names_.of<wire::Hello>()),
        headers_(mailbox_, names_.of<wire::MeshHeader>()),
        movers_(mailbox_, names_.of<wire::BodyPoses>(), !options.transport.security.empty(),
                options.transport.silence_s) {}
  ~Impl();

  Status start();
  SessionId own_id() const { return own_id_; }
  Status identity() const {
    const std::lock_guard lock(mutex_);
    return wire::identity_of(door_.get());
  }
  std::map<SessionId, PoseCounts> pose_counts() const {
    const std::lock_guard lock(mutex_);
    std::map<SessionId, PoseCounts> counts;
    tally_.for_each([&](SessionId peer, const PoseCounts& heard) { counts.emplace(peer, heard); });
    for (const auto& [peer, samples] : routes_.sent()) counts[peer].sent_near = samples;
    return counts;
  }
  bool has_recorder() const { return held_writer_.listener().has_readers(); }
  void send(const wire::RegionSubscription& subscription);
  template <class Message>
  void put(std::deque<Message> Impl::*queue, const Message& message);
  /// What holds of the own bodies, by part: kept, for as a new participant it is said again. All that was said is sent, not the latest
  /// alone: reports name the edition that they are about.
  template <class Message>
  struct Kept {
    std::map<std::uint32_t, Message> parts;
    std::deque<Message> unsent;

    void say_again() {
      unsent.clear();
      for (const auto& [part, message] : parts) unsent.push_back(message);
    }
  };
  template <class Message>
  void keep(Kept<Message> Impl::*kept, const Message& message);
  void tell_who(const wire::BodyDirectory& directory);
  void tell(wire::ProcessStatus& status);
  Inbox take();
  void wait(double seconds);

  // Written by the host, emptied by the I/O thread.
  std::deque<wire::RegionSubscription> subscriptions_;
  std::deque<wire::BodyPoses> poses_;
  std::deque<wire::NearPoses> near_;
  std::deque<wire::WantedPoses> wanted_;
  std::deque<wire::BodyPromises> promises_;
  std::deque<wire::ContactReport> reports_;
  std::deque<wire::HeldDetail> held_;
  std::deque<wire::ProcessStatus> statuses_;
  std::deque<wire::BoundsReport> bounds_;
  Kept<wire::BodyDirectory> directory_;
  Kept<wire::WatchedBodies> watched_;

 private:
  /// What came of a publisher that was asked, and has not been acknowledged.
  struct Account {
    std::uint32_t window_bytes = 0;
    std::uint32_t sequence = 0;
    std::size_t bytes = 0;
    std::chrono::steady_clock::time_point acknowledged{};
  };

  void run(std::promise<Status> started);
  Status open();
  template <class Endpoint, class... How>
  Status open(Endpoint& endpoint, const How&... how);
  void open_what_is_of_use();
  Status open_promising();
  Status open_promised();
  Status open_bounding();
  Status open_holding();
  bool receive();
  bool receive_hellos();
  bool receive_poses();
  void drop_ended();
  template <class Use>
  void note(SessionId peer, const Handle& writer, const Use& use) {
    if (!movers_.may_speak_for(peer, writer)) return;
    const std::lock_guard lock(mutex_);
    PoseCounts* const known = tally_.use(peer);
    use(known != nullptr ? *known : *tally_.put(peer, {}));
  }
  void tell_lost(SessionId publisher);
  Status rejoin();
  bool flush();
  [[nodiscard]] bool names_bodies(std::uint32_t first, std::uint32_t count, bool promised) const;
  template <class Message>
  bool end_silent_parts(const std::deque<Message>& queue, std::set<std::uint32_t>& retold,
                        wire::Writer<Message>& writer);
  double acknowledge();
  template <class Message>
  bool flush(std::deque<Message>& queue, wire::Writer<Message>& writer);
  template <class Message>
  void deliver(std::vector<Message> Inbox::*list, Message&& message, std::size_t limit,
               const std::string& topic);
  void deliver_header(DdsHeaders::Counted&& header);
  void receive_headers();
  [[nodiscard]] bool is_of_its_publisher(const wire::SplitBatchMessage& batch,
                                         const Handle& writer);
  [[nodiscard]] bool is_of_its_peer(const wire::WantedPoses& wanted, const Handle& writer);
  void note_batch(const wire::SplitBatchMessage& batch);
  void complain_of_overflow(const std::string& topic);

  const DdsChannelOptions options_;
  const SessionId own_id_;
  const wire::TopicNames names_;
  wire::Mailbox mailbox_;
  wire::Reader<wire::Hello> hello_reader_{mailbox_};
  wire::Reader<wire::MeshHeader> header_reader_{mailbox_};
  wire::Reader<wire::SplitBatchMessage> batch_reader_{mailbox_};
  wire::Reader<wire::BodyPoses> pose_reader_{mailbox_};
  wire::Reader<wire::NearPoses> near_reader_{mailbox_};
  wire::Reader<wire::WantedPoses> wanted_reader_{mailbox_};
  wire::Reader<wire::BodyPromises> promise_reader_{mailbox_};
  wire::Reader<wire::BodyDirectory> directory_reader_{mailbox_};
  wire::Reader<wire::ProcessStatus> status_reader_{mailbox_};
  wire::Writer<wire::RegionSubscription> subscription_writer_{mailbox_};
  wire::Writer<wire::BodyPoses> pose_writer_{mailbox_};
  wire::Writer<wire::NearPoses> near_writer_{mailbox_};
  wire::Writer<wire::WantedPoses> wanted_writer_{mailbox_};
  wire::Writer<wire::BodyPromises> promise_writer_{mailbox_};
  wire::Writer<wire::BodyDirectory> directory_writer_{mailbox_};
  wire::Writer<wire::ContactReport> report_writer_{mailbox_};
  wire::Writer<wire::WatchedBodies> watched_writer_{mailbox_};
  wire::Writer<wire::BoundsReport> bounds_writer_{mailbox_};
  wire::Writer<wire::HeldDetail> held_writer_{mailbox_};  ///< heard by recorders alone
  wire::Writer<wire::ProcessStatus> status_writer_{mailbox_};

  mutable std::mutex mutex_;  ///< outgoing queues and inbox; never held during a DDS call
  std::condition_variable arrived_;
  Inbox inbox_;
  std::shared_ptr<wire::DoorWatch> door_;  ///< of the bus
  std::map<SessionId, Account> accounts_;  ///< by publisher: those that requests were sent to
  std::vector<DdsHeaders::Counted> counted_headers_;  ///< of the inbox
  std::size_t waiting_header_bytes_ = 0;
  LruMap<SessionId, PoseCounts> tally_{kMaxWaitingOthers};  ///< what was heard of those heard last
  /// Parts of own bodies, of poses and of promises, of whose bodies something else was said.
  std::set<std::uint32_t> retold_poses_, retold_promises_;
  std::set<std::string> overflowed_;  ///< topics that already complained since the last take()

  // The I/O thread's own.
  DdsHellos hellos_;
  DdsHeaders headers_;
  DdsPoses movers_;
  wire::Wishers wishers_;
  wire::Routes routes_{own_id_};
  std::unique_ptr<wire::Bus> bus_;
  bool promises_made_ = false;  ///< of own bodies
  bool bounds_told_ = false;

  // What others open, as discovery told it.
  std::atomic<bool> promises_found_ = false, recorder_found_ = false;
  std::atomic<bool> stopping_ = false;
  std::thread thread_;
};

// --- Called by the host

Status DdsChannel::Impl::start() {
  if (options_.participant == nullptr)
    NEARMESH_RETURN_IF_ERROR(wire::check_room(options_.transport));
  std::promise<Status> started;
  std::future<Status> outcome = started.get_future();
  try {
    thread_ =
        std::thread([this, promise = std::move(started)]() mutable { run(std::move(promise)); });
  } catch (const std::system_error& fault) {
    return {StatusCode::kIo, std::string("no thread can be started: ") + fault.what()};
  }
  return outcome.get();
}

DdsChannel::Impl::~Impl() {
  stopping_ = true;
  mailbox_.wake();
  if (thread_.joinable()) thread_.join();
}

void DdsChannel::Impl::send(const wire::RegionSubscription& subscription) {
  {
    const std::lock_guard lock(mutex_);
    accounts_[subscription.publisher].window_bytes = subscription.window_bytes;
  }
  put(&Impl::subscriptions_, subscription);
}

template <class Message>
void DdsChannel::Impl::keep(Kept<Message> Impl::*kept, const Message& message) {
  if (Status status = check(message); !status.is_ok()) {
    mailbox_.complain(names_.of<Message>() + ": not sent: " + status.message());
    return;
  }
  {
    const std::lock_guard lock(mutex_);
    auto& [parts, unsent] = this->*kept;
    parts[message.part] = message;
    unsent.push_back(message);
    if (unsent.size() > kMaxOutgoing + parts.size()) (this->*kept).say_again();
  }
  mailbox_.wake();
}

/// Of its parts poses or promises may come no more.
void DdsChannel::Impl::tell_who(const wire::BodyDirectory& directory) {
  keep(&Impl::directory_, directory);
  if (!check(directory).is_ok()) return;
  const std::uint32_t first = directory.part * wire::kBodiesPerPart,
                      last = first + wire::kBodiesPerPart - 1;
  {
    const std::lock_guard lock(mutex_);
    retold_poses_.insert(directory.part);
    for (std::uint32_t part = first / wire::kBodiesPerPromise;
         part <= last / wire::kBodiesPerPromise; ++part)
      retold_promises_.insert(part);
  }
  mailbox_.wake();
}

/// Whether there are own bodies of these numbers of which promises are made, or such of which none are. The mutex is held.
bool DdsChannel::Impl::names_bodies(std::uint32_t first, std::uint32_t count, bool promised) const {
  for (auto part = directory_.parts.lower_bound(first / wire::kBodiesPerPart);
       part != directory_.parts.end() && part->first <= (first + count - 1) / wire::kBodiesPerPart;
       ++part)
    for (const wire::BodyDirectory::Body& body : part->second.bodies)
      if (body.number >= first && body.number - first < count &&
          (body.max_speed_mps > 0) == promised)
        return true;
  return false;
}

void DdsChannel::Impl::tell(wire::ProcessStatus& status) {
  {
    const std::lock_guard lock(mutex_);
    wire::tell_of_process(options_.transport, door_.get(), status);
  }
  put(&Impl::statuses_, status);
}

template <class Message>
void DdsChannel::Impl::put(std::deque<Message> Impl::*queue, const Message& message) {
  const std::string& topic = names_.of<Message>();
  if (Status status = check(message); !status.is_ok()) {
    mailbox_.complain(topic + ": not sent: " + status.message());
    return;
  }
  bool dropped = false;
  {
    const std::lock_guard lock(mutex_);
    auto& waiting = this->*queue;
    if (waiting.size() >= kMaxOutgoing) {
      waiting.pop_front();
      dropped = overflowed_.insert("to " + topic).second;
    }
    waiting.push_back(message);
  }
  if (dropped)
    mailbox_.complain(topic + ": more than " + std::to_string(kMaxOutgoing) +
                      " samples wait to be sent, the oldest are dropped");
  mailbox_.wake();
}

Channel::Inbox DdsChannel::Impl::take() {
  Inbox taken;
  {
    const std::lock_guard lock(mutex_);
    taken = std::exchange(inbox_, {});
    for (DdsHeaders::Counted& header : std::exchange(counted_headers_, {}))
      taken.headers.push_back(std::move(header.header));
    waiting_header_bytes_ = 0;
    overflowed_.clear();
  }
  taken.complaints = mailbox_.take_complaints();
  return taken;
}

void DdsChannel::Impl::wait(double seconds) {
  std::unique_lock lock(mutex_);
  arrived_.wait_for(lock, std::chrono::duration<double>(seconds), [this] {
    return !inbox_.hellos.empty() || !inbox_.lost_publishers.empty() || !counted_headers_.empty() ||
           !inbox_.batches.empty() || !inbox_.poses.empty() || !inbox_.promises.empty() ||
           !inbox_.wanted.empty() || !inbox_.movers.empty() || inbox_.recorder_came ||
           mailbox_.has_complaints();
  });
}

// --- The I/O thread

void DdsChannel::Impl::run(std::promise<Status> started) {
  const FloatGuard guard;
  // A participant of the host's is the host's to repair.
  std::unique_ptr<wire::RejoinWatch> rejoin_watch;
  const Status opened = wire::or_no_memory([&] {
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
  NEARMESH_RETURN_IF_ERROR(pose_reader_.open(*bus_));
  NEARMESH_RETURN_IF_ERROR(status_reader_.open(*bus_, "", wire::Hearing::kLatest));
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

/// Each endpoint is told to every participant, and costs both. So those that few scenes need are opened once somebody is there who uses
/// them.
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

/// For pairs that bounds prove free. As answers are, they are written whether anybody listens or not: a recorder that comes late shall
/// count what it missed.
Status DdsChannel::Impl::open_bounding() {
  NEARMESH_RETURN_IF_ERROR(open(watched_writer_));
  return open(bounds_writer_);
}

/// For who records.
Status DdsChannel::Impl::open_holding() { return open(held_writer_); }

/// Out: true when some reader may hold more.
bool DdsChannel::Impl::receive() {
  // Whoever comes and goes is remembered until it is taken.
  (void)batch_reader_.take_matches();
  (void)status_reader_.take_matches();
  bool more = receive_hellos();
  headers_.take(header_reader_.take_matches());
  more |= header_reader_.drain(kMaxTaken,
                               [&](wire::MeshHeader&& header, const Handle& writer, Microseconds) {
                                 headers_.heard(std::move(header), writer);
                               });
  for (wire::Hello& hello : hellos_.release([this](const Handle& writer) {
         return subscription_writer_.listener().is_matched_with_participant_of(writer);
       })) {
    if (const auto writer = hellos_.writer_of(hello.publisher)) headers_.announced(hello, *writer);
    deliver(&Inbox::hellos, std::move(hello), kMaxWaitingOthers, names_.of<wire::Hello>());
  }
  receive_headers();
  more |= batch_reader_.drain(
      kMaxTaken, [&](wire::SplitBatchMessage&& batch, const Handle& writer, Microseconds) {
        if (!is_of_its_publisher(batch, writer)) return;
        note_batch(batch);
        deliver(&Inbox::batches, std::move(batch), kMaxWaitingBatches,
                names_.of<wire::SplitBatchMessage>());
      });
  more |= receive_poses();
  hellos_.complain_of_silence();
  if (held_writer_.listener().take_came()) {
    const std::lock_guard lock(mutex_);
    inbox_.recorder_came = true;
  }
  return more;
}

/// After the hellos that they need.
void DdsChannel::Impl::receive_headers() {
  for (DdsHeaders::Counted& header : headers_.release()) deliver_header(std::move(header));
  if (const std::uint64_t strays = headers_.complain_of_strays(); strays > 0) {
    const std::lock_guard lock(mutex_);
    inbox_.refused_headers += strays;
  }
}

/// Out: true when there may be more.
bool DdsChannel::Impl::receive_hellos() {
  std::vector<DdsHellos::Heard> heard;
  const bool more = hello_reader_.drain(
      kMaxTaken,
      [&](wire::Hello&& hello, const Handle& writer, Microseconds received) {
        heard.push_back({std::move(hello), writer, received});
      },
      [&](const Handle& writer) { hellos_.heard_of(writer); });
  for (const SessionId lost : hellos_.take(hello_reader_.take_matches(), std::move(heard)))
    tell_lost(lost);
  return more;
}

/// Anybody can write into our partition; only who is the publisher can say what a model is.
bool DdsChannel::Impl::is_of_its_publisher(const wire::SplitBatchMessage& batch,
                                           const Handle& writer) {
  const std::optional<Handle> hello = hellos_.writer_of(batch.publisher);
  if (hello && wire::have_one_participant(*hello, writer)) return true;
  // Of one that was just lost something may still be on its way.
  if (hello)
    mailbox_.complain(names_.of<wire::SplitBatchMessage>() + ": samples of " +
                      wire::name_of(writer, mailbox_) + " dropped: publisher " +
                      wire::partition_of(batch.publisher) + " is another participant");
  return false;
}

void DdsChannel::Impl::note_batch(const wire::SplitBatchMessage& batch) {
  const std::lock_guard lock(mutex_);
  const auto at = accounts_.find(batch.publisher);
  if (at == accounts_.end()) return;
  // Not the highest: a publisher that lost us for a while counts from 1 again.
  at->second.sequence = batch.sequence;
  at->second.bytes += batch.bytes.size() + 1;
}

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

/// Out: true when there may be more.
bool DdsChannel::Impl::receive_poses() {
  // The matches first: of who is gone by then, what it said is all there.
  const std::vector<wire::ReaderListener::Match> tellers = directory_reader_.take_matches();
  std::vector<DdsPoses::HeardDirectory> directories;
  const bool more_told = directory_reader_.drain(
      kMaxTaken, [&](wire::BodyDirectory&& directory, const Handle& writer, Microseconds) {
        if (directory.peer != own_id_) directories.push_back({std::move(directory), writer});
      });
  movers_.take_directories(tellers, std::move(directories), more_told);
  (void)pose_reader_.take_matches();
  (void)near_reader_.take_matches();
  (void)promise_reader_.take_matches();
  for (const wire::ReaderListener::Match& event : wanted_reader_.take_matches())
    if (event.gone) wishers_.forget(event.writer);
  std::vector<DdsPoses::HeardPromises> promises;
  bool more_promised = promise_reader_.drain(
      kMaxTaken, [&](wire::BodyPromises&& promised, const Handle& writer, Microseconds) {
        if (promised.peer == own_id_) return;
        note(promised.peer, writer, [&](PoseCounts& counts) {
          ++counts.heard_promises;
          counts.lost_promises += promise_reader_.missed();
        });
        promises.push_back({std::move(promised), writer});
      });
  movers_.hear_promises(std::move(promises));
  std::vector<DdsPoses::Heard> heard;
  bool more = pose_reader_.drain(kMaxTaken,
                                 [&](wire::BodyPoses&& poses, const Handle& writer, Microseconds) {
                                   if (poses.peer == own_id_) return;
                                   note(poses.peer, writer, [&](PoseCounts& counts) {
                                     ++counts.heard_poses;
                                     counts.lost_poses += pose_reader_.missed();
                                   });
                                   heard.push_back({std::move(poses), writer});
                                 });
  more |= near_reader_.drain(
      kMaxTaken, [&](wire::BodyPoses&& poses, const Handle& writer, Microseconds) {
        if (poses.peer == own_id_) return;
        note(poses.peer, writer, [](PoseCounts& counts) { ++counts.heard_near; });
        heard.push_back({std::move(poses), writer, true});
      });
  more |= more_promised;
  std::vector<wire::BodyPose> accepted = movers_.take(std::move(heard), more);
  if (const std::uint64_t refused = movers_.take_refused(); refused > 0) {
    const std::lock_guard lock(mutex_);
    inbox_.refused_poses += refused;
  }
  drop_ended();
  for (const auto& [mover, writer] : movers_.take_movers())
    routes_.find(mover, wire::Routes::participant_of(writer));
  for (const wire::ReaderListener::Match& event : tellers)
    if (event.gone) routes_.lose(wire::Routes::participant_of(event.writer));
  more |= wanted_reader_.drain(kMaxTaken, [&](wire::WantedPoses&& wanted, const Handle& writer,
                                              Microseconds) {
    if (wanted.mover != own_id_ || wanted.peer == own_id_) return;
    if (!is_of_its_peer(wanted, writer)) return;
    deliver(&Inbox::wanted, std::move(wanted), kMaxWaitingOthers, names_.of<wire::WantedPoses>());
  });
  {
    const std::lock_guard lock(mutex_);
    movers_.tell_bodies(inbox_);
  }
  for (wire::BodyPromise& promise : movers_.take_promises())
    deliver(&Inbox::promises, std::move(promise), kMaxWaitingPoses,
            names_.of<wire::BodyPromises>());
  for (wire::BodyPose& pose : accepted)
    deliver(&Inbox::poses, std::move(pose), kMaxWaitingPoses, names_.of<wire::BodyPoses>());
  more |= more_told;
  more |= status_reader_.drain(
      kMaxTaken, [&](wire::ProcessStatus&& status, const Handle& writer, Microseconds) {
        movers_.hear_sign(status.session, writer);
      });
  const std::lock_guard lock(mutex_);
  movers_.tell_movers(inbox_);
  return more;
}

/// The session knows peers by their names alone: what a stranger wants, or does not, must not stand for what the peer does. A peer that
/// joined anew before its old self is missed says it again.
bool DdsChannel::Impl::is_of_its_peer(const wire::WantedPoses& wanted, const Handle& writer) {
  const wire::Wishers::Claim claim =
      wishers_.claim(wanted.peer, writer, std::chrono::steady_clock::now());
  // Who contests a name may be who bears it, and gets by its own wish what goes out anyway. One that makes up names finds no room.
  if (claim != wire::Wishers::Claim::kFull)
    routes_.want(wanted, wire::Routes::participant_of(writer));
  if (claim == wire::Wishers::Claim::kOwn) return true;
  mailbox_.complain(
      names_.of<wire::WantedPoses>() + ": sample of " + wire::name_of(writer, mailbox_) +
      " dropped: " +
      (claim == wire::Wishers::Claim::kFull
           ? "it speaks for more peers than are kept"
           : "peer " + wire::partition_of(wanted.peer) + " speaks through another writer"));
  return false;
}

/// The host takes poses and promises apart. So it could take what waits of a body that is gone for later than what came of the next of its
/// name, and prove that one free by a promise that was made of another.
void DdsChannel::Impl::drop_ended() {
  const std::set<std::string> ended = movers_.take_ended();
  if (ended.empty()) return;
  const auto is_ended = [&](const auto& said) { return ended.contains(said.body); };
  const std::lock_guard lock(mutex_);
  std::erase_if(inbox_.poses, is_ended);
  std::erase_if(inbox_.promises, is_ended);
}

/// The host takes losses before hellos, so a hello of before the loss must not wait for it.
void DdsChannel::Impl::tell_lost(SessionId publisher) {
  std::vector<DdsHeaders::Counted> not_taken;
  {
    const std::lock_guard lock(mutex_);
    std::erase_if(inbox_.hellos,
                  [&](const wire::Hello& hello) { return hello.publisher == publisher; });
    accounts_.erase(publisher);
    std::erase_if(counted_headers_, [&](DdsHeaders::Counted& header) {
      if (header.header.publisher != publisher) return false;
      waiting_header_bytes_ -= header.header.message.bytes.size();
      not_taken.push_back(std::move(header));
      return true;
    });
  }
  headers_.lost(publisher, std::move(not_taken));
  deliver(&Inbox::lost_publishers, std::move(publisher), kMaxWaitingOthers,
          names_.of<wire::Hello>());
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
         near_reader_, promise_reader_, wanted_reader_, status_reader_);
  forget(subscription_writer_, directory_writer_, pose_writer_, promise_writer_, near_writer_,
         wanted_writer_, report_writer_, watched_writer_, bounds_writer_, held_writer_,
         status_writer_);
  {
    const std::lock_guard lock(mutex_);
    directory_.say_again();
    watched_.say_again();
  }
  return open();
}

template <class Message>
void DdsChannel::Impl::deliver(std::vector<Message> Inbox::*list, Message&& message,
                               std::size_t limit, const std::string& topic) {
  {
    const std::lock_guard lock(mutex_);
    auto& waiting = inbox_.*list;
    if (waiting.size() < limit) {
      waiting.push_back(std::move(message));
      return;
    }
  }
  complain_of_overflow(topic);
}

void DdsChannel::Impl::deliver_header(DdsHeaders::Counted&& header) {
  const std::size_t bytes = header.header.message.bytes.size();
  {
    const std::lock_guard lock(mutex_);
    if (waiting_header_bytes_ + bytes <= kMaxWaitingHeaderBytes) {
      waiting_header_bytes_ += bytes;
      counted_headers_.push_back(std::move(header));
      return;
    }
  }
  complain_of_overflow(names_.of<wire::MeshHeader>());
}

/// Once until the host takes: it may have stopped for long.
void DdsChannel::Impl::complain_of_overflow(const std::string& topic) {
  {
    const std::lock_guard lock(mutex_);
    if (!overflowed_.insert(topic).second) return;
  }
  mailbox_.complain(topic +
                    ": the inbox is full because take() was not called, samples are dropped");
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

/// The last poses or promises of a part are kept for who joins later. Where all its bodies are gone, or are not such any more, they would be
/// for good: between them and those of other parts Fast DDS tells such a reader of one gap that grows with each sample, of which doors let in
/// kMaxGap a time (rtps_check.hpp), and whoever joins keeps what no directory names. Unregistered, not disposed of: then the writer keeps
/// nothing of the part, as soon as all readers have heard of it. To readers that is no news. The directory's word that a part has no bodies
/// stays, as does the watched bodies': a reader that stood still beyond its lease still believes the one before, and hears of it by what is
/// kept alone. Out: as flush().
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
  while (!outgoing.empty() && writer.write(outgoing.front()) != wire::WriteResult::kFull)
    outgoing.pop_front();
  if (outgoing.empty()) return true;
  const std::lock_guard lock(mutex_);
  queue.insert(queue.begin(), std::make_move_iterator(outgoing.begin()),
               std::make_move_iterator(outgoing.end()));
  return false;
}

// --- The channel

Result<std::unique_ptr<DdsChannel>> DdsChannel::create(const DdsChannelOptions& options) {
  auto impl = std::make_unique<Impl>(options);
  NEARMESH_RETURN_IF_ERROR(impl->start());
  return std::unique_ptr<DdsChannel>(new DdsChannel(std::move(impl)));
}

DdsChannel::DdsChannel(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
DdsChannel::~DdsChannel() = default;

SessionId DdsChannel::own_id() const { return impl_->own_id(); }
void DdsChannel::send(const wire::RegionSubscription& subscription) { impl_->send(subscription); }
void DdsChannel::send(const wire::BodyPoses& poses) { impl_->put(&Impl::poses_, poses); }
void DdsChannel::send(const wire::BodyDirectory& directory) { impl_->tell_who(directory); }
void DdsChannel::promise(const wire::BodyPromises& promises) {
  impl_->put(&Impl::promises_, promises);
}
void DdsChannel::send_near(const wire::NearPoses& poses) { impl_->put(&Impl::near_, poses); }
void DdsChannel::want(const wire::WantedPoses& wanted) { impl_->put(&Impl::wanted_, wanted); }
void DdsChannel::send(const wire::ContactReport& report) { impl_->put(&Impl::reports_, report); }
void DdsChannel::tell(wire::ProcessStatus& status) { impl_->tell(status); }
void DdsChannel::tell_held(const wire::HeldDetail& held) { impl_->put(&Impl::held_, held); }
void DdsChannel::tell_watched(const wire::WatchedBodies& watched) {
  impl_->keep(&Impl::watched_, watched);
}
void DdsChannel::tell_bounds(const wire::BoundsReport& bounds) {
  impl_->put(&Impl::bounds_, bounds);
}
bool DdsChannel::has_recorder() const { return impl_->has_recorder(); }
std::map<SessionId, PoseCounts> DdsChannel::pose_counts() const { return impl_->pose_counts(); }
Status DdsChannel::identity() const { return impl_->identity(); }
Channel::Inbox DdsChannel::take() { return impl_->take(); }
void DdsChannel::wait(double seconds) { impl_->wait(seconds); }

}  // namespace nearmesh::subscriber
