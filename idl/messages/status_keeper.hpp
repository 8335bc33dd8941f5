// SPDX-License-Identifier: Apache-2.0
#pragma once
// What a ProcessStatus needs over time, alike for publishers and peers: when the next is due, the
// rate since the last, and the newest complaints.

#include <deque>
#include <string>

#include "nearmesh/idl/messages/messages.hpp"

namespace nearmesh::wire {

/// How often each process tells its status: also its sign of life.
inline constexpr double kStatusPeriod_s = 1;

/// Times are of any one steady clock, from 0 at the process's start. Threads: one at a time.
class StatusKeeper {
 public:
  /// A line of trouble: stays in the status for kKept_s after it was last heard.
  void note(const std::string& line, double now_s);
  /// True once a second.
  [[nodiscard]] bool is_due(double now_s) const { return now_s >= next_s_; }
  /// Fills in the name where there is none, host, process, memory, uptime_s, bytes_per_s (from
  /// `bytes`) and complaints.
  void complete(ProcessStatus& status, double now_s);

 private:
  static constexpr double kKept_s = 60;
  struct Line {
    std::string text;
    double heard_s;
  };
  std::deque<Line> lines_;  ///< distinct, the newest last
  double next_s_ = 0, last_s_ = 0;
  std::uint64_t last_bytes_ = 0;
};

}  // namespace nearmesh::wire
