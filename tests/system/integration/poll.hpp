// SPDX-License-Identifier: Apache-2.0
#pragma once
// Waiting for what other threads and programs do.

#include <chrono>
#include <functional>
#include <thread>

namespace nearmesh::test {

/// Looks every `period_s` until `done` holds; false when the time is over. Looks once more then: this program may have been held up since
/// it looked last.
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

}  // namespace nearmesh::test
