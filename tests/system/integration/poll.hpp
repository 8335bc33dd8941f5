// SPDX-License-Identifier: Apache-2.0
#pragma once
// Waiting for what other threads and programs do.

#include <chrono>
#include <functional>
#include <thread>

namespace nearmesh::test {

/// Looks every `period_s` until `done` holds; false when the time is over. Looks once more then:
/// this program may have been held up since it looked last.
inline bool poll(const std::function<bool()>& done, double seconds, double period_s) {
  using Seconds = std::chrono::duration<double>;
  const auto end = std::chrono::steady_clock::now() + Seconds(seconds);
  for (;;) {
    const bool is_last = std::chrono::steady_clock::now() > end;
    if (done()) return true;
    if (is_last) return false;
    std::this_thread::sleep_for(Seconds(period_s));
  }
}

/// What is said again and again while something is waited for: each 50 ms.
class SaysAgain {
 public:
  [[nodiscard]] bool is_due() {
    const auto now = std::chrono::steady_clock::now();
    if (now - last_ < std::chrono::milliseconds(50)) return false;
    last_ = now;
    return true;
  }

 private:
  std::chrono::steady_clock::time_point last_{};
};

}  // namespace nearmesh::test
