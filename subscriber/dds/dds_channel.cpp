// SPDX-License-Identifier: Apache-2.0
// What the host calls.
#include "nearmesh/subscriber/dds/dds_channel.hpp"

#include <system_error>
#include <utility>

#include "dds_channel_impl.hpp"
#include "idl/dds/room.hpp"

namespace nearmesh::subscriber {

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
    has_other_bodies_ = true;
    for (std::uint32_t part = first / wire::kBodiesPerPromise;
         part <= last / wire::kBodiesPerPromise; ++part)
      retold_promises_.insert(part);
  }
  mailbox_.wake();
}

/// Whether there are own bodies of these numbers of which promises are made, or such of which none
/// are. The mutex is held.
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
    waiting_batches_.clear();
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
