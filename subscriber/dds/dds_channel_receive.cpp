// SPDX-License-Identifier: Apache-2.0
// What comes, until the host takes it.
#include <utility>

#include "dds_channel_impl.hpp"

namespace nearmesh::subscriber {
namespace {

constexpr std::size_t kMaxTaken = 1024;  ///< of one topic, before the others have their turn

}  // namespace

/// Out: true when some reader may hold more.
bool DdsChannel::Impl::receive() {
  // Whoever comes and goes is remembered until it is taken.
  (void)batch_reader_.take_matches();
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
        for (wire::SplitBatchMessage& one : take_apart(std::move(batch)))
          deliver_batch(std::move(one));
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
  at->second.sequence = last_sequence(batch);
  at->second.bytes += sample_bytes(batch) + 1;
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
    if (event.is_gone()) wishers_.forget(event.writer);
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
    if (event.is_gone()) routes_.lose(wire::Routes::participant_of(event.writer));
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
  const std::lock_guard lock(mutex_);
  movers_.tell_movers(inbox_);
  return more;
}

/// The session knows peers by their names alone: what a stranger wants, or does not, must not stand
/// for what the peer does. A peer that joined anew before its old self is missed says it again.
bool DdsChannel::Impl::is_of_its_peer(const wire::WantedPoses& wanted, const Handle& writer) {
  const wire::Wishers::Claim claim =
      wishers_.claim(wanted.peer, writer, std::chrono::steady_clock::now());
  // Who contests a name may be who bears it, and gets by its own wish what goes out anyway. One
  // that makes up names finds no room.
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

/// The host takes poses and promises apart. So it could take what waits of a body that is gone for
/// later than what came of the next of its name, and prove that one free by a promise that was made
/// of another.
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

/// Of each publisher that was asked for something so many, of all others together as many: none
/// takes another's place.
void DdsChannel::Impl::deliver_batch(wire::SplitBatchMessage&& batch) {
  {
    const std::lock_guard lock(mutex_);
    const SessionId share = accounts_.contains(batch.publisher) ? batch.publisher : 0;
    if (waiting_batches_[share] < kMaxWaitingBatches) {
      ++waiting_batches_[share];
      inbox_.batches.push_back(std::move(batch));
      return;
    }
  }
  complain_of_overflow(names_.of<wire::SplitBatchMessage>());
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

}  // namespace nearmesh::subscriber
