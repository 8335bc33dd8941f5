// SPDX-License-Identifier: Apache-2.0
#include "dds_peers.hpp"

#include <utility>

#include "idl/messages/process_name.hpp"

namespace nearmesh::publisher {

using wire::Handle;
using wire::Microseconds;
using wire::SessionId;

namespace {

/// A recorder hears batches best-effort, so it must have found a new peer's writer before the first
/// of them: without the first, none of what that peer answers can be proved. Peers that are not
/// recorded do not wait.
constexpr std::chrono::milliseconds kRecorderGrace{100};

}  // namespace

void FoundReaders::add(const wire::BusOptions::Found& reader) {
  const std::lock_guard lock(mutex_);
  has_lost_ |= found_.size() >= kMost;
  if (!has_lost_) found_.push_back(reader);
}

std::optional<std::vector<wire::BusOptions::Found>> FoundReaders::take() {
  const std::lock_guard lock(mutex_);
  std::vector<wire::BusOptions::Found> found = std::exchange(found_, {});
  if (std::exchange(has_lost_, false)) return std::nullopt;
  return found;
}

Status DdsPeers::open(wire::Bus& bus) {
  bus_ = &bus;
  return reader_.open(bus);
}

void DdsPeers::forget() {
  for (const SessionId peer : book_.clear()) lost_.push_back(peer);
  peers_.clear();
  prepared_.clear();
  (void)found_.take();
  (void)reader_.take_matches();
}

std::string DdsPeers::name_of(SessionId peer) const {
  const auto writer = book_.writer_of(peer);
  return writer ? wire::participant_name(*writer, mailbox_) : std::string();
}

bool DdsPeers::is_own(const Handle& writer) const {
  return wire::have_one_participant(writer, reader_.endpoint().get_instance_handle());
}

void DdsPeers::found(const wire::BusOptions::Found& reader) {
  if (wire::peer_of(reader.partition) == 0) return;
  found_.add(reader);
  mailbox_.wake();
}

void DdsPeers::prepare() {
  const auto found = found_.take();
  if (!found) {
    // Whose reader has gone would take the place of another for good. Who is there gets its writer
    // when it asks.
    for (auto& [peer, prepared] : std::exchange(prepared_, {}))
      bus_->remove_writer(&prepared.peer.writer->endpoint());
    return;
  }
  for (const wire::BusOptions::Found& one : *found) {
    if (one.topic != bus_->names().of<wire::SplitBatchMessage>()) continue;
    const SessionId peer = wire::peer_of(one.partition);
    const auto known = prepared_.find(peer);
    if (known == prepared_.end()) {
      if (one.gone || peers_.contains(peer) || peers_.size() + prepared_.size() >= max_peers_)
        continue;
      if (Result<Peer> made = make_peer(peer); made.is_ok())
        prepared_.emplace(peer, Prepared{one.endpoint, std::move(made).value()});
    } else if (!one.gone) {
      known->second.reader = one.endpoint;  // joined anew
    } else if (known->second.reader == one.endpoint) {
      bus_->remove_writer(&known->second.peer.writer->endpoint());
      prepared_.erase(known);
    }
  }
}

/// A peer that was lost and found again by the time it is taken from has said again what it wants:
/// it must be lost before that is heard, or the answer is forgotten with it.
Inbox DdsPeers::admit(std::vector<Heard> heard) {
  Inbox inbox;
  inbox.lost_peers = take_lost();
  prepare();
  for (Heard& one : heard)
    if (admit(one.message.peer, one.writer, one.received))
      inbox.subscriptions.push_back(std::move(one.message));
  return inbox;
}

bool DdsPeers::admit(SessionId peer, const Handle& writer, Microseconds received) {
  switch (book_.claim(peer, writer, received)) {
    case wire::SessionBook::Claim::kKnown:
      return true;
    case wire::SessionBook::Claim::kStale:
      return false;
    case wire::SessionBook::Claim::kTaken:
      mailbox_.complain(bus_->names().of<wire::RegionSubscription>() + ": sample of " +
                        wire::name_of(writer, mailbox_) + " dropped: peer " +
                        wire::partition_of(peer) + " speaks through another writer");
      return false;
    case wire::SessionBook::Claim::kNew:
      break;
  }
  if (add_peer(peer, writer)) return true;
  book_.release(peer);
  return false;
}

bool DdsPeers::add_peer(SessionId peer, const Handle& subscriptions) {
  if (peers_.size() >= max_peers_) {
    if (!std::exchange(complained_of_limit_, true))
      mailbox_.complain("peer " + wire::called(peer, name_of(peer)) + " refused: there are " +
                        std::to_string(peers_.size()) + " already, the limit (max_peers)");
    return false;
  }
  auto prepared = prepared_.extract(peer);
  Result<Peer> made =
      prepared.empty() ? make_peer(peer) : Result<Peer>(std::move(prepared.mapped().peer));
  if (!made.is_ok()) {
    mailbox_.complain("peer " + wire::called(peer, name_of(peer)) +
                      " refused: " + made.status().message());
    return false;
  }
  made.value().subscriptions = subscriptions;
  peers_.emplace(peer, std::move(made).value());
  return true;
}

Result<DdsPeers::Peer> DdsPeers::make_peer(SessionId peer) {
  Peer made{std::make_unique<wire::Writer<wire::SplitBatchMessage>>(mailbox_), {}};
  NEARMESH_RETURN_IF_ERROR(made.writer->open(*bus_, wire::partition_of(peer)));
  return made;
}

std::vector<SessionId> DdsPeers::take_lost() {
  std::vector<SessionId> lost = std::exchange(lost_, {});
  for (const auto& event : reader_.take_matches()) {
    if (!event.is_gone()) {
      book_.welcome(event.writer);
      continue;
    }
    const std::optional<SessionId> peer = book_.forget(event.writer, event.when);
    if (!peer) continue;
    const auto found = peers_.find(*peer);
    bus_->remove_writer(&found->second.writer->endpoint());
    peers_.erase(found);
    complained_of_limit_ = false;
    lost.push_back(*peer);
  }
  return lost;
}

bool DdsPeers::send(SessionId peer, const wire::SplitBatchMessage& batch) {
  const auto found = peers_.find(peer);
  if (found == peers_.end()) return false;
  const Peer& entry = found->second;
  // By the peer itself: recorders listen to all partitions, and may be matched before it.
  const wire::WriterListener& readers = entry.writer->listener();
  if (!readers.is_matched_with_participant_of(entry.subscriptions)) return false;
  if (std::chrono::steady_clock::now() - entry.added < kRecorderGrace &&
      readers.is_matched_beside_participant_of(entry.subscriptions))
    return false;
  if (Status status = check(batch); !status.is_ok()) {
    mailbox_.complain(bus_->names().of<wire::SplitBatchMessage>() +
                      ": not sent: " + status.message());
    return true;
  }
  return entry.writer->write(batch) == wire::WriteResult::kTaken;
}

}  // namespace nearmesh::publisher
