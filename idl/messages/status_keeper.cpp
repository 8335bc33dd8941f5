// SPDX-License-Identifier: Apache-2.0
#include "status_keeper.hpp"

#include <unistd.h>

#include <algorithm>

#include "core/base/resources.hpp"
#include "process_name.hpp"

namespace nearmesh::wire {

void StatusKeeper::note(const std::string& line, double now_s) {
  std::string text = status_line(line);
  std::erase_if(lines_, [&](const Line& known) { return known.text == text; });
  lines_.push_back({std::move(text), now_s});
  if (lines_.size() > kMaxStatusLines) lines_.pop_front();
}

void StatusKeeper::complete(ProcessStatus& status, double now_s) {
  if (status.name.empty()) status.name = default_process_name();
  status.host = host_name();
  status.process_id = static_cast<std::uint32_t>(::getpid());
  status.resident_bytes = resident_memory_bytes();
  status.uptime_s = now_s;
  status.bytes_per_s =
      now_s > last_s_ ? static_cast<double>(status.bytes - last_bytes_) / (now_s - last_s_) : 0;
  std::erase_if(lines_, [&](const Line& line) { return now_s - line.heard_s > kKept_s; });
  status.complaints.clear();
  for (const Line& line : lines_) status.complaints.push_back(line.text);
  last_s_ = now_s;
  last_bytes_ = status.bytes;
  next_s_ = now_s + kStatusPeriod_s;
}

}  // namespace nearmesh::wire
