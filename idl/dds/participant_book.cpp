// SPDX-License-Identifier: Apache-2.0
#include "participant_book.hpp"

#include <algorithm>

namespace nearmesh::wire {
namespace {

std::int64_t sequence_after(std::int64_t sequence) {
  return std::min(sequence, kMaxSequence - 1) + 1;
}

}  // namespace

std::optional<DoorRefusal> ParticipantBook::hear(const RtpsVerdict& message,
                                                 const MessageSource& from) {
  if (!barred_.empty() && is_barred(message.source)) return DoorRefusal::kIdentity;
  const auto at = known_.find(message.source);
  if (at == known_.end()) {
    // Fast DDS takes nothing from who is unknown but its announcement.
    if (!message.announcement || message.announcement->leaves) {
      if (has_strangers_ && !message.announcement) {
        if (spoken_.size() >= kMaxSpoken) spoken_.clear();
        spoken_.insert(message.source);
      }
      return std::nullopt;
    }
    if (known_.size() >= kMaxKnown || !may_come_in(message.source)) return DoorRefusal::kCrowd;
    Known known{.first_s = now_s_,
                .last_s = now_s_,
                .lease_s = message.announcement->lease_s,
                .announced_s = now_s_,
                .sequence = message.announcement->sequence,
                .has_spoken = false,
                .ports = {},
                .connection = from.connection,
                .begun = {}};
    if (from.is_udp) known.ports.push_back(from.port);
    known_.emplace(message.source, std::move(known));
    return std::nullopt;
  }
  Known& known = at->second;
  if (!speaks_from(known, from)) return DoorRefusal::kSource;
  known.last_s = now_s_;
  if (!message.announcement) {
    if (!known.has_spoken) known.first_s = now_s_;
    known.has_spoken = true;
    return std::nullopt;
  }
  if (message.announcement->leaves) {
    known_.erase(at);
    return std::nullopt;
  }
  known.lease_s = message.announcement->lease_s;
  // Several at a time are one: it has several sockets.
  if (now_s_ > known.announced_s) {
    known.period_s = now_s_ - known.announced_s;
    known.announced_s = now_s_;
  }
  known.sequence = std::max(known.sequence, message.announcement->sequence);
  return std::nullopt;
}

std::optional<RtpsPlace> ParticipantBook::connection_of(const ParticipantKey& key) const {
  const auto at = known_.find(key);
  return at == known_.end() ? std::nullopt : at->second.connection;
}

/// Where the message tells of an endpoint, what was counted of it before was another's: of an
/// earlier message, and of this one too, for a heartbeat in it may come before the word of who it
/// is of, and is to nobody then.
void ParticipantBook::hold_back(RtpsVerdict& message) {
  const auto at = known_.find(message.source);
  Known* const known = at != known_.end() ? &at->second : nullptr;
  const auto begin_anew = [&] {
    if (known != nullptr && message.tells_of_endpoints) known->begun.clear();
  };
  begin_anew();
  for (const RtpsBeginning& one : message.far_beginnings) {
    std::int64_t handed_on = kFarBeginning;
    if (known != nullptr &&
        (known->begun.contains(one.writer) || known->begun.size() < kMaxBegun)) {
      std::int64_t& begun = known->begun.try_emplace(one.writer, kFarBeginning).first->second;
      const std::int64_t leap =
          std::clamp(one.first - begun, std::int64_t{0}, static_cast<std::int64_t>(leap_tokens_));
      leap_tokens_ -= static_cast<double>(leap);
      begun += leap;
      handed_on = begun;
    }
    if (handed_on < one.first) message.change_sequence(one.first_at, handed_on, one.little_endian);
  }
  begin_anew();
}

bool ParticipantBook::speaks_from(Known& known, const MessageSource& from) const {
  if (!from.is_udp ||
      std::find(known.ports.begin(), known.ports.end(), from.port) != known.ports.end())
    return true;
  if (now_s_ - known.last_s > kMoved_s) known.ports.clear();
  // One that moved, or was first heard through another transport, has yet to be learnt: it may have
  // several.
  if (known.ports.empty())
    known.first_s = now_s_;
  else if (now_s_ - known.first_s > kLearning_s || known.ports.size() >= kMaxPorts)
    return false;
  known.ports.push_back(from.port);
  return true;
}

bool ParticipantBook::may_come_in(const ParticipantKey& key) {
  if (tokens_ >= 1) {
    --tokens_;
    return true;
  }
  const auto waiting = waiting_.find(key);
  if (waiting == waiting_.end()) {
    if (waiting_order_.size() >= kMaxWaiting) {
      waiting_.erase(waiting_order_.front());
      waiting_order_.pop_front();
    }
    // In this order: who waits is in the queue, even where there is no memory for the second.
    waiting_order_.push_back(key);
    waiting_.emplace(key, now_s_);
    return false;
  }
  if (now_s_ - waiting->second < kAgain_s || again_tokens_ < 1) return false;
  --again_tokens_;
  waiting_.erase(waiting);
  waiting_order_.erase(std::find(waiting_order_.begin(), waiting_order_.end(), key));
  return true;
}

bool ParticipantBook::keeps_out(const ParticipantKey& stranger) {
  if (spoken_.erase(stranger) > 0) return false;
  std::erase_if(chosen_, [this](const ParticipantKey& key) { return !known_.contains(key); });
  if (chosen_.size() >= kChosen || now_s_ < next_choice_s_ || dice_() % kLots != 0) return true;
  chosen_.push_back(stranger);
  next_choice_s_ = now_s_ + kChoice_s;
  return false;
}

bool ParticipantBook::has_left(const Known& known) const {
  const double lease_s =
      known.has_spoken ? known.lease_s : std::min(known.lease_s, kOnlyAnnounced_s);
  return now_s_ - known.last_s > lease_s;
}

void ParticipantBook::tick(double seconds) {
  now_s_ += seconds;
  tokens_ = std::min(kBurst, tokens_ + kNewcomersPerSecond * seconds);
  again_tokens_ = std::min(kBurst, again_tokens_ + kNewcomersPerSecond * seconds);
  leap_tokens_ = std::min(kLeapBurst, leap_tokens_ + kLeapsPerSecond * seconds);
  const auto leaves = [this](const auto& entry) { return has_left(entry.second); };
  // All memory first: nobody is forgotten whose end is not told.
  gone_.reserve(gone_.size() +
                static_cast<std::size_t>(std::count_if(known_.begin(), known_.end(), leaves)));
  std::erase_if(known_, [&](const auto& entry) {
    if (!leaves(entry)) return false;
    gone_.push_back({entry.first, sequence_after(entry.second.sequence)});
    return true;
  });
}

void ParticipantBook::bar(const ParticipantKey& key) {
  gone_.reserve(gone_.size() + 1);
  barred_.insert(key);
  const auto at = known_.find(key);
  gone_.push_back({key, at == known_.end() ? 1 : sequence_after(at->second.sequence)});
  if (at != known_.end()) known_.erase(at);
}

std::optional<bool> ParticipantBook::is_silent(const ParticipantKey& key, double silence_s) const {
  if (is_barred(key)) return true;
  const auto at = known_.find(key);
  if (at == known_.end()) return std::nullopt;
  const Known& known = at->second;
  return now_s_ - known.last_s >
         std::max(silence_s, std::min(3 * known.period_s, known.lease_s / 2));
}

}  // namespace nearmesh::wire
