// SPDX-License-Identifier: Apache-2.0
#include "door_watch.hpp"

#include <algorithm>
#include <chrono>
#include <ctime>
#include <new>
#include <utility>

#include "core/base/float_guard.hpp"
#include "fastdds_api.hpp"
#include "idl/messages/process_name.hpp"

namespace nearmesh::wire {
namespace {

constexpr double kTick_s = 0.25;
constexpr int kTicksASecond = 4;
/// More between two ticks means that this process, or the whole machine, stood still: others did
/// not fall silent meanwhile.
constexpr double kLongestTick_s = 2 * kTick_s;

/// What a participant says that leaves (DDSI-RTPS 2.3, 8.5.3 and 9.6.3.9): it disposes of itself.
std::vector<std::uint8_t> farewell_of(const ParticipantBook::Gone& gone) {
  std::vector<std::uint8_t> bytes{'R', 'T', 'P', 'S', 2, 3, 1, 15};
  bytes.insert(bytes.end(), gone.key.begin(), gone.key.end());
  bytes.insert(bytes.end(), {0x15, 3, 52, 0, 0, 0, 16, 0,     // data with inline QoS
                             0, 1, 0, 0xc7, 0, 1, 0, 0xc2});  // reader and writer of these
  const auto high = static_cast<std::uint32_t>(gone.sequence >> 32);
  const auto low = static_cast<std::uint32_t>(gone.sequence);
  for (const std::uint32_t word : {high, low})
    for (int shift = 0; shift < 32; shift += 8)
      bytes.push_back(static_cast<std::uint8_t>(word >> shift));
  bytes.insert(bytes.end(), {0x70, 0, 16, 0});  // the key
  bytes.insert(bytes.end(), gone.key.begin(), gone.key.end());
  bytes.insert(bytes.end(), {0, 0, 1, 0xc1, 0x71, 0, 4, 0, 0, 0, 0, 3,  // disposed and unregistered
                             1, 0, 0, 0});
  return bytes;
}

}  // namespace

DoorWatch::DoorWatch(const DoorRules& rules, std::unique_ptr<IdentityBook> identities)
    : rules_(rules),
      identities_(std::move(identities)),
      book_(rules.bodies.has_value()),
      pace_(rules.announcement_s) {
  thread_ = std::thread([this] { run(); });
}

DoorWatch::~DoorWatch() {
  {
    const std::lock_guard lock(mutex_);
    ending_ = true;
  }
  condition_.notify_all();
  thread_.join();
}

RtpsVerdict DoorWatch::check(std::span<const std::uint8_t> message, const MessageSource& from) {
  RtpsVerdict verdict = check_rtps(message, gap_turn_.load(std::memory_order_relaxed));
  if (verdict.is_cut_gap) gap_turn_.fetch_add(1, std::memory_order_relaxed);
  if (!verdict.refusal && verdict.tells_of_others && rules_.is_plain)
    verdict.refusal = DoorRefusal::kSource;
  if (!verdict.refusal && has_ended_) verdict.refusal = DoorRefusal::kIdentity;
  if (!verdict.refusal && identities_ != nullptr && verdict.announcement) judge_release(verdict);
  if (!verdict.refusal && identities_ != nullptr && !verdict.certificate.empty())
    verdict.refusal = judge_handshake(verdict);
  if (!verdict.refusal) {
    const std::lock_guard lock(mutex_);
    const bool was_known = !verdict.announcement || book_.is_known(verdict.source);
    if (!was_known && keeps_out(verdict)) {
      verdict.is_kept_out = true;
      return verdict;
    }
    verdict.refusal = book_.hear(verdict, from);
    if (!verdict.refusal && rules_.is_plain) book_.hold_back(verdict);
    if (!verdict.refusal && paces()) note_for_pace(verdict, was_known);
    if (!verdict.refusal && from.connection && !verdict.tcp_places.empty())
      verdict.reach_by(book_.connection_of(verdict.source).value_or(*from.connection));
  }
  if (verdict.refusal) count(*verdict.refusal);
  return verdict;
}

/// A stranger that moves nothing, or to one that moves nothing, has no clock to tell. May throw
/// std::bad_alloc.
bool DoorWatch::keeps_out(const RtpsVerdict& newcomer) {
  if (!rules_.bodies || newcomer.announcement->leaves) return false;
  const std::optional<ToldBodies> told = told_bodies_in(newcomer.announcement->user);
  if (!told || !are_strangers(*rules_.bodies, *told)) return false;
  return told->moved.empty() || rules_.bodies->moved.empty() || book_.keeps_out(newcomer.source);
}

/// Where there is no memory for it more is told than need be.
void DoorWatch::note_for_pace(const RtpsVerdict& message, bool was_known) {
  const std::lock_guard lock(pace_mutex_);
  try {
    if (message.announcement && message.announcement->leaves) {
      pace_.forget(message.source);
      hearers_.forget(message.source);
    } else if (message.announcement && !was_known) {
      hearers_.expect(message.source, *message.announcement);
      pace_.expect(message.source, *message.announcement);
    }
    for (const auto& confirmation : message.confirmations)
      if (confirmation) pace_.confirm(message.source, *confirmation);
  } catch (const std::bad_alloc&) {
    complain_of_memory();
  }
}

void DoorWatch::tell_moved(std::uint32_t writer, const std::vector<std::string>& bodies) {
  const std::lock_guard lock(pace_mutex_);
  hearers_.move(writer, bodies);
}

void DoorWatch::count(DoorRefusal refusal) {
  refused_[static_cast<std::size_t>(refusal)].fetch_add(1, std::memory_order_relaxed);
}

std::array<std::uint64_t, kDoorRefusals> DoorWatch::refused() const {
  std::array<std::uint64_t, kDoorRefusals> counts{};
  for (std::size_t i = 0; i < counts.size(); ++i)
    counts[i] = refused_[i].load(std::memory_order_relaxed);
  return counts;
}

/// Whose certificate is not of this authority is left to Fast DDS, which refuses it too. A
/// participant keeps the certificate that it came with: with another one, say that of the same
/// name's rightful owner, it could stay when its own is revoked.
std::optional<DoorRefusal> DoorWatch::judge_handshake(const RtpsVerdict& message) {
  const std::optional<IdentityFacts> facts = identities_->facts_of(message.certificate);
  if (!facts) return std::nullopt;
  if (!std::equal(facts->key_start.begin(), facts->key_start.end(), message.source.begin()))
    return DoorRefusal::kIdentity;
  if (const std::string fault = identities_->fault_of(*facts, std::time(nullptr)); !fault.empty()) {
    refuse_identity(*facts, fault);
    return DoorRefusal::kIdentity;
  }
  const std::lock_guard lock(mutex_);
  const auto at = certificates_.find(message.source);
  if (at != certificates_.end())
    return at->second.serial == facts->serial ? std::nullopt
                                              : std::optional(DoorRefusal::kIdentity);
  // Fast DDS shakes hands with nobody whom it does not know.
  if (rules_.is_plain && !book_.is_known(message.source)) return std::nullopt;
  if (!has_room_for_certificate()) return DoorRefusal::kCrowd;
  certificates_.emplace(message.source, *facts);
  return std::nullopt;
}

/// It is heard all the same: Fast DDS lets it wait for ever, in silence. Each name once.
void DoorWatch::judge_release(const RtpsVerdict& message) {
  const RtpsAnnouncement& told = *message.announcement;
  if (!told.is_secured || told.release == kToldRelease) return;
  const auto end = std::find(told.name.begin(), told.name.end(), 0);
  const std::string name = shown_participant(std::string(told.name.begin(), end));
  say_once(of_other_releases_, name,
           name + " is secured by a Fast DDS " +
               (told.release == 0 ? "before 3" : std::to_string(told.release)) +
               ", this program by " + kFastDdsVersion +
               ": the two never find each other; one release for all of a secured bus "
               "(docs/platforms.md)");
}

/// With a discovery server nobody says here who has left.
bool DoorWatch::has_room_for_certificate() {
  if (certificates_.size() < kMaxCertificates) return true;
  std::erase_if(certificates_, [this](const auto& entry) { return !book_.is_known(entry.first); });
  return certificates_.size() < kMaxCertificates;
}

/// Once for each certificate: its program tries again and again.
void DoorWatch::refuse_identity(const IdentityFacts& facts, const std::string& fault) {
  say_once(refused_serials_, facts.serial,
           "identity " + facts.name + ": its certificate " + facts.serial + " " + fault +
               ": no program with it takes part");
}

/// May be called again where there was no memory for it.
void DoorWatch::look_at_identities() {
  if (std::string line = identities_->refresh(); !line.empty()) say(std::move(line));
  const std::time_t now = std::time(nullptr);
  if (const std::string fault = identities_->fault_of(identities_->own(), now);
      !fault.empty() && !has_ended_) {
    std::string line = "this program's identity " + identities_->own().name + " " + fault +
                       ": it has no part in the bus any more; give it a new one (docs/security.md)";
    say(line);
    {
      const std::lock_guard lock(mutex_);
      own_end_ = std::move(line);
    }
    has_ended_ = true;
  }
  const std::lock_guard lock(mutex_);
  std::erase_if(certificates_, [&](const auto& entry) {
    const auto& [key, facts] = entry;
    if (rules_.is_plain && !book_.is_known(key)) return true;
    const std::string fault = identities_->fault_of(facts, now);
    if (fault.empty()) return false;
    refuse_identity(facts, fault);
    book_.bar(key);
    return true;
  });
}

bool DoorWatch::is_barred(const ParticipantKey& participant) const {
  const std::lock_guard lock(mutex_);
  return book_.is_barred(participant);
}

std::string DoorWatch::own_end() const {
  const std::lock_guard lock(mutex_);
  return own_end_;
}

std::optional<bool> DoorWatch::is_silent(const ParticipantKey& participant,
                                         double silence_s) const {
  if (has_ended_) return true;
  const std::lock_guard lock(mutex_);
  return book_.is_silent(participant, silence_s);
}

void DoorWatch::add(LeaseEnd* end) {
  const std::lock_guard lock(ends_mutex_);
  if (std::find(ends_.begin(), ends_.end(), end) == ends_.end()) ends_.push_back(end);
}

void DoorWatch::remove(LeaseEnd* end) {
  const std::lock_guard lock(ends_mutex_);
  std::erase(ends_, end);
}

void DoorWatch::set_mailbox(Mailbox* mailbox) {
  const std::lock_guard lock(complain_mutex_);
  mailbox_ = mailbox;
}

void DoorWatch::complain_of_memory() noexcept {
  const std::lock_guard lock(complain_mutex_);
  if (mailbox_ != nullptr) mailbox_->complain_of_memory();
}

void DoorWatch::say(std::string line) {
  const std::lock_guard lock(complain_mutex_);
  if (mailbox_ != nullptr) mailbox_->complain(std::move(line));
}

/// Remembered when it is said: what was not, for want of memory or since nobody listens yet, is
/// said the next time.
void DoorWatch::say_once(Said& said, const std::string& what, std::string line) {
  const std::lock_guard lock(complain_mutex_);
  if (mailbox_ == nullptr || said.use(what) != nullptr) return;
  mailbox_->complain(std::move(line));
  said.put(what, {});
}

void DoorWatch::say_what_was_refused() {
  const auto counts = refused();
  std::uint64_t all = 0;
  std::string reasons;
  for (std::size_t i = 0; i < counts.size(); ++i) {
    const std::uint64_t more = counts[i] - said_[i];
    if (more == 0) continue;
    all += more;
    reasons += (reasons.empty() ? "" : ", ") + std::string(to_string(static_cast<DoorRefusal>(i))) +
               " " + std::to_string(more);
  }
  if (all == 0) return;
  say("door: refused " + std::to_string(all) + (all == 1 ? " message (" : " messages (") + reasons +
      "), see docs/network.md, The door");
  said_ = counts;
}

void DoorWatch::run() {
  const FloatGuard guard;
  auto last = std::chrono::steady_clock::now();
  const auto is_over = [this] {
    std::unique_lock lock(mutex_);
    return condition_.wait_for(lock, std::chrono::duration<double>(kTick_s),
                               [this] { return ending_; });
  };
  for (int ticks = 1; !is_over(); ++ticks) {
    const auto now = std::chrono::steady_clock::now();
    const std::chrono::duration<double> passed = now - last;
    last = now;
    try {
      tick(passed.count());
      if (ticks % kTicksASecond == 0) say_what_was_refused();
    } catch (const std::bad_alloc&) {
      complain_of_memory();  // what was not done is done at the next tick
    }
  }
}

void DoorWatch::tick(double passed_s) {
  looked_s_ += passed_s;
  {
    const std::lock_guard lock(mutex_);
    book_.tick(std::min(passed_s, kLongestTick_s));
  }
  if (identities_ != nullptr && looked_s_ >= rules_.identity_period_s) {
    look_at_identities();
    looked_s_ = 0;
  }
  if (gone_.empty()) {
    const std::lock_guard lock(mutex_);
    gone_ = book_.take_gone();
  }
  if (!gone_.empty()) {
    const std::lock_guard lock(pace_mutex_);
    for (const ParticipantBook::Gone& one : gone_) pace_.forget(one.key);
  }
  tell_ends();
}

void DoorWatch::tell_ends() {
  if (!rules_.is_plain) gone_.clear();
  const std::lock_guard lock(ends_mutex_);
  for (; !gone_.empty(); gone_.pop_back()) {
    const std::vector<std::uint8_t> farewell = farewell_of(gone_.back());
    // What is told again must be news to who has heard it.
    ++gone_.back().sequence;
    for (LeaseEnd* end : ends_) end->end(farewell);
  }
}

}  // namespace nearmesh::wire
