// SPDX-License-Identifier: Apache-2.0
#pragma once
// Where the threads of Fast DDS leave word for the one thread that makes the DDS calls. For the
// rooms named dds alone.

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <map>
#include <mutex>
#include <string>
#include <vector>

#include "rtps_check.hpp"

namespace nearmesh::wire {

/// Threads: all.
class Mailbox {
 public:
  /// A line is not said again for so long.
  explicit Mailbox(double quiet_s = 10) : quiet_(quiet_s) {}

  void wake();
  /// Blocks until wake() was called since the last return, or the time is over.
  void wait(double seconds);
  /// Keeps a line until it is taken; what was said a moment ago is not said again, so that whoever
  /// sends faults without end gives one line, not a log full. More than kMaxComplaints different
  /// ones are counted. What is not printable ASCII becomes '?', and a line ends after kMaxLine
  /// bytes. Also wakes, when there is something to take.
  void complain(std::string line);
  /// Of a thread of ours that caught std::bad_alloc: keeps a line without asking for memory.
  void complain_of_memory() noexcept { lacked_memory_ = true; }
  [[nodiscard]] std::vector<std::string> take_complaints();
  [[nodiscard]] bool has_complaints();

  /// What a participant calls itself, as discovery tells it; "" forgets it.
  void meet(const ParticipantKey& participant, const std::string& name);
  /// "" where it is not known.
  [[nodiscard]] std::string name_of(const ParticipantKey& participant) const;

 private:
  static constexpr std::size_t kMaxComplaints = 256;
  static constexpr std::size_t kMaxLine = 512;
  static constexpr std::size_t kMaxNames = 4096;
  using Clock = std::chrono::steady_clock;
  const std::chrono::duration<double> quiet_;
  mutable std::mutex mutex_;
  std::condition_variable condition_;
  bool awake_ = false;
  std::vector<std::string> complaints_;
  std::map<std::string, Clock::time_point> said_;  ///< of late, at most kMaxComplaints
  std::uint64_t dropped_complaints_ = 0;
  Clock::time_point told_dropped_{};
  std::map<ParticipantKey, std::string> names_;
  std::atomic<bool> lacked_memory_ = false;
};

}  // namespace nearmesh::wire
