// SPDX-License-Identifier: Apache-2.0
#pragma once
// Times by the clock that stamps received samples. For the rooms named dds alone.

#include <cstdint>

#include "fastdds_api.hpp"

namespace nearmesh::wire {

using Timestamp = rtps::Time_t;
using Microseconds = std::int64_t;

[[nodiscard]] inline Microseconds to_us(const Timestamp& time) { return time.to_ns() / 1000; }
/// Since the epoch.
[[nodiscard]] inline Microseconds now_us() {
  Timestamp time;
  Timestamp::now(time);
  return to_us(time);
}

}  // namespace nearmesh::wire
