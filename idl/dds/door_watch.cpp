// SPDX-License-Identifier: Apache-2.0
#include "door_watch.hpp"

#include <algorithm>
#include <chrono>

#include "core/base/float_guard.hpp"

namespace nearmesh::wire {
namespace {

constexpr double kTick_s = 0.25;
constexpr int kTicksASecond = 4;
/// More between two ticks means that this process, or the whole machine, stood still: others did not fall silent meanwhile.
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

DoorWatch::DoorWatch(bool is_plain, double announcement_s, double lease_s)
    : is_plain_(is_plain), pace_(announcement_s, lease_s) {
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

RtpsVerdict DoorWatch::check(std::span<const std::uint8_t> message, const MessageSource& from,
                             Standing& standing) {
  RtpsVerdict verdict = check_rtps(message);
  if (!verdict.refusal && verdict.tells_of_others && is_plain_)
    verdict.refusal = DoorRefusal::kSource;
  if (!verdict.refusal) {
    const std::lock_guard lock(mutex_);
    verdict.refusal = book_.hear(verdict, from, &standing);
  }
  if (is_plain_ && !verdict.refusal && (standing.is_newcomer || verdict.confirmation)) {
    const std::lock_guard lock(pace_mutex_);
    if (standing.is_newcomer) pace_.expect(verdict.source, *verdict.announcement);
    if (verdict.confirmation) pace_.confirm(verdict.source, *verdict.confirmation);
  }
  if (verdict.refusal) count(*verdict.refusal);
  return verdict;
}

bool DoorWatch::may_go(const RtpsPlace& place, const DiscoveryWord& word) {
  const std::chrono::duration<double> now = std::chrono::steady_clock::now().time_since_epoch();
  const std::lock_guard lock(pace_mutex_);
  return pace_.may_go(place, word, now.count());
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

std::optional<bool> DoorWatch::is_silent(const ParticipantKey& participant,
                                         double silence_s) const {
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

void DoorWatch::set_complaint(std::function<void(std::string)> complain) {
  const std::lock_guard lock(complain_mutex_);
  complain_ = std::move(complain);
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
  const std::lock_guard lock(complain_mutex_);
  said_ = counts;
  if (complain_)
    complain_("door: refused " + std::to_string(all) + (all == 1 ? " message (" : " messages (") +
              reasons + "), see docs/network.md, The door");
}

void DoorWatch::run() {
  const FloatGuard guard;
  auto last = std::chrono::steady_clock::now();
  std::unique_lock lock(mutex_);
  for (int ticks = 1; !ending_; ++ticks) {
    condition_.wait_for(lock, std::chrono::duration<double>(kTick_s), [this] { return ending_; });
    const auto now = std::chrono::steady_clock::now();
    const std::chrono::duration<double> passed = now - last;
    last = now;
    const auto gone = book_.tick(std::min(passed.count(), kLongestTick_s));
    lock.unlock();
    if (is_plain_ && !gone.empty()) {
      const std::lock_guard ends_lock(ends_mutex_);
      for (const ParticipantBook::Gone& one : gone) {
        const std::vector<std::uint8_t> farewell = farewell_of(one);
        for (LeaseEnd* end : ends_) end->end(farewell);
      }
    }
    if (ticks % kTicksASecond == 0) say_what_was_refused();
    lock.lock();
  }
}

}  // namespace nearmesh::wire
