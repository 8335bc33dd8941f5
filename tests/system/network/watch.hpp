// SPDX-License-Identifier: Apache-2.0
#pragma once
// What a process holds, sampled while it runs, and how fast that grows.

#include <sys/types.h>

#include <cstdint>
#include <string>
#include <vector>

namespace nearmesh::test {

/// kB as the kernel counts them: 1,024 bytes.
struct Holding {
  double rss_kb = 0;   ///< resident
  double pss_kb = 0;   ///< the same, pages that others map too shared out among them
  double heap_kb = 0;  ///< resident and of no file: heap and stacks
  int threads = 0, descriptors = 0;
};
/// Zeros where the process has ended.
[[nodiscard]] Holding holding_of(pid_t process);

struct Slope {
  double per_minute = 0;
  double error = 0;  ///< standard error, the samples taken for independent
};
/// Least squares through (seconds, value); all zero below three samples.
[[nodiscard]] Slope slope_of(const std::vector<double>& seconds, const std::vector<double>& values);

/// Gives this process and what it starts from now on a /dev/shm of their own, empty. For a process
/// of one thread; needs root.
/// Throws std::runtime_error.
void take_own_shared_memory();
struct SharedFiles {
  std::size_t of_fast_dds = 0;
  std::uint64_t bytes = 0;
  std::vector<std::string> others;  ///< names that Fast DDS does not use
};
/// What lies in /dev/shm.
[[nodiscard]] SharedFiles shared_files();

}  // namespace nearmesh::test
