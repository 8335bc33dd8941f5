// SPDX-License-Identifier: Apache-2.0
#pragma once
// Waiting for what other threads and programs do.

#include <chrono>
#include <functional>
#include <thread>

namespace nearmesh::test {

/// Looks every `period_s` until `done` holds; false when the time is over.
inline bool poll(const std::function<bool()>& done, double seconds, double period_s) {
  using Seconds = std::chrono::duration<double>;
  const auto end = std::chrono::steady_clock::now() + Seconds(seconds);
  while (!done()) {
    if (std::chrono::steady_clock::now() > end) return false;
    std::this_thread::sleep_for(Seconds(period_s));
  }
  return true;
}

}  // namespace nearmesh::test
