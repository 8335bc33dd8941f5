// SPDX-License-Identifier: Apache-2.0
#include "run_jobs.hpp"

#include <atomic>
#include <exception>
#include <mutex>
#include <thread>
#include <vector>

namespace nearmesh::c {
namespace {

class Jobs {
 public:
  Jobs(std::size_t count, const std::function<void(std::size_t)>& job)
      : job_(job), states_(count) {}

  void run(std::size_t index) noexcept {
    if (index >= states_.size()) return;
    std::uint8_t expected = kToDo;
    if (!states_[index].compare_exchange_strong(expected, kRuns)) return;
    try {
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
  void rethrow() const {
    if (fault_) std::rethrow_exception(fault_);
  }

 private:
  static constexpr std::uint8_t kToDo = 0, kRuns = 1, kDone = 2;
  const std::function<void(std::size_t)>& job_;
  std::vector<std::atomic<std::uint8_t>> states_;
  std::mutex mutex_;
  std::exception_ptr fault_;
};

extern "C" void run_one_job(void* jobs, size_t index) { static_cast<Jobs*>(jobs)->run(index); }

}  // namespace

subscriber::RunJobs run_jobs_of(nearmesh_run_jobs run, void* user) {
  if (run == nullptr) return nullptr;
  return [run, user](std::size_t count, const std::function<void(std::size_t)>& job) {
    Jobs jobs(count, job);
    try {
      run(user, count, &run_one_job, &jobs);
    } catch (...) {  // of a host that is written in C++ after all
      jobs.finish();
      throw;
    }
    jobs.finish();
    jobs.rethrow();
  };
}

}  // namespace nearmesh::c
