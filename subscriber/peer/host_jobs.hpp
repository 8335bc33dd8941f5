// SPDX-License-Identifier: Apache-2.0
#pragma once
// Jobs on threads of the host's. What it does not keep of its word is made good: a job that it
// leaves out is run afterwards, one that it runs twice is run once. And nothing that one side
// throws passes through the frames of the other, where it would end a thread of the host's, and so
// the process, or leave the session half-way.

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <exception>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

#include "core/base/float_guard.hpp"
#include "nearmesh/subscriber/peer/session.hpp"

namespace nearmesh::subscriber {

class HostJobs {
 public:
  HostJobs(std::size_t count, const std::function<void(std::size_t)>& job)
      : job_(job), states_(count) {}

  /// All of them, each once. Out: what the host threw; null: nothing. Throws what the first job
  /// that threw did.
  [[nodiscard]] std::exception_ptr run_on(const RunJobs& host) {
    std::exception_ptr fault_of_host;
    try {
      host(states_.size(), [this](std::size_t i) { run(i); });
    } catch (...) {
      fault_of_host = std::current_exception();
    }
    finish();
    if (fault_) std::rethrow_exception(fault_);
    return fault_of_host;
  }

 private:
  void run(std::size_t index) noexcept {
    if (index >= states_.size()) return;
    std::uint8_t expected = kToDo;
    if (!states_[index].compare_exchange_strong(expected, kRuns)) return;
    try {
      const FloatGuard guard;  // of this thread
      job_(index);
    } catch (...) {
      const std::lock_guard lock(mutex_);
      if (!fault_) fault_ = std::current_exception();
    }
    states_[index].store(kDone, std::memory_order_release);
  }
  /// What was left out; and waits for what others have begun.
  void finish() noexcept {
    for (std::size_t i = 0; i < states_.size(); ++i) run(i);
    for (const auto& state : states_)
      while (state.load(std::memory_order_acquire) != kDone) std::this_thread::yield();
  }

  static constexpr std::uint8_t kToDo = 0, kRuns = 1, kDone = 2;
  const std::function<void(std::size_t)>& job_;
  std::vector<std::atomic<std::uint8_t>> states_;
  std::mutex mutex_;
  std::exception_ptr fault_;  // of a job
};

}  // namespace nearmesh::subscriber
