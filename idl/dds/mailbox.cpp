// SPDX-License-Identifier: Apache-2.0
#include "mailbox.hpp"

#include <algorithm>
#include <utility>

namespace nearmesh::wire {

void Mailbox::wake() {
  {
    const std::lock_guard lock(mutex_);
    awake_ = true;
  }
  condition_.notify_all();
}

void Mailbox::wait(double seconds) {
  std::unique_lock lock(mutex_);
  condition_.wait_for(lock, std::chrono::duration<double>(seconds), [this] { return awake_; });
  awake_ = false;
}

void Mailbox::complain(std::string line) {
  // Names that others chose are in it, and it goes to terminals and logs.
  line.resize(std::min(line.size(), kMaxLine));
  std::replace_if(
      line.begin(), line.end(), [](char c) { return c < 0x20 || c > 0x7e; }, '?');
  {
    const std::lock_guard lock(mutex_);
    const Clock::time_point now = Clock::now();
    const auto is_over = [&](Clock::time_point said) { return now - said >= quiet_; };
    if (const auto known = said_.find(line); known != said_.end() && !is_over(known->second))
      return;
    if (said_.size() >= kMaxComplaints)
      std::erase_if(said_, [&](const auto& said) { return is_over(said.second); });
    if (said_.size() >= kMaxComplaints) {
      ++dropped_complaints_;
      return;
    }
    // Kept first: where there is no memory to remember it, it is said twice.
    complaints_.push_back(line);
    said_[std::move(line)] = now;
    awake_ = true;
  }
  condition_.notify_all();
}

std::vector<std::string> Mailbox::take_complaints() {
  if (lacked_memory_) {
    complain("no memory: some of what came or was to be sent is lost, and is asked for again");
    lacked_memory_ = false;
  }
  const std::lock_guard lock(mutex_);
  std::vector<std::string> taken = std::exchange(complaints_, {});
  if (dropped_complaints_ > 0 && Clock::now() - told_dropped_ >= quiet_) {
    taken.push_back(std::to_string(std::exchange(dropped_complaints_, 0)) +
                    " more complaints were not kept");
    told_dropped_ = Clock::now();
  }
  return taken;
}

bool Mailbox::has_complaints() {
  const std::lock_guard lock(mutex_);
  return !complaints_.empty() || lacked_memory_;
}

void Mailbox::meet(const ParticipantKey& participant, const std::string& name) {
  const std::lock_guard lock(mutex_);
  if (name.empty()) {
    names_.erase(participant);
  } else if (names_.size() < kMaxNames || names_.contains(participant)) {
    names_[participant] = name;
  }
}

std::string Mailbox::name_of(const ParticipantKey& participant) const {
  const std::lock_guard lock(mutex_);
  const auto known = names_.find(participant);
  return known == names_.end() ? std::string() : known->second;
}

}  // namespace nearmesh::wire
