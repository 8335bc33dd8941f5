// SPDX-License-Identifier: Apache-2.0
#include "watch.hpp"

#include <sched.h>
#include <sys/mount.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <numeric>
#include <stdexcept>

namespace nearmesh::test {
namespace {

namespace fs = std::filesystem;

constexpr char kSharedMemory[] = "/dev/shm";

/// The number behind "Name:" in a file of such lines.
double field(const std::string& path, const std::string& name) {
  std::ifstream in(path);
  for (std::string line; std::getline(in, line);)
    if (line.starts_with(name + ":")) return std::stod(line.substr(name.size() + 1));
  return 0;
}

}  // namespace

Holding holding_of(pid_t process) {
  const std::string folder = "/proc/" + std::to_string(process);
  Holding holding;
  holding.rss_kb = field(folder + "/status", "VmRSS");
  holding.heap_kb = field(folder + "/status", "RssAnon");
  holding.threads = static_cast<int>(field(folder + "/status", "Threads"));
  holding.pss_kb = field(folder + "/smaps_rollup", "Pss");
  std::error_code gone;
  for (fs::directory_iterator at(folder + "/fd", gone), end; !gone && at != end; at.increment(gone))
    ++holding.descriptors;
  return holding;
}

Slope slope_of(const std::vector<double>& seconds, const std::vector<double>& values) {
  const auto n = static_cast<double>(seconds.size());
  if (seconds.size() < 3) return {};
  const double middle_s = std::accumulate(seconds.begin(), seconds.end(), 0.0) / n;
  const double middle = std::accumulate(values.begin(), values.end(), 0.0) / n;
  double square = 0, product = 0, rest = 0;
  for (std::size_t i = 0; i < seconds.size(); ++i) {
    square += (seconds[i] - middle_s) * (seconds[i] - middle_s);
    product += (seconds[i] - middle_s) * (values[i] - middle);
  }
  const double slope = product / square;
  for (std::size_t i = 0; i < seconds.size(); ++i) {
    const double off = values[i] - middle - slope * (seconds[i] - middle_s);
    rest += off * off;
  }
  return {60 * slope, 60 * std::sqrt(rest / (n - 2) / square)};
}

void take_own_shared_memory() {
  if (::unshare(CLONE_NEWNS) != 0 ||
      ::mount("none", "/", nullptr, MS_REC | MS_PRIVATE, nullptr) != 0 ||
      ::mount("none", kSharedMemory, "tmpfs", 0, nullptr) != 0)
    throw std::runtime_error("a /dev/shm of its own is not permitted");
}

SharedFiles shared_files() {
  SharedFiles found;
  for (const fs::directory_entry& entry : fs::directory_iterator(kSharedMemory)) {
    const std::string name = entry.path().filename();
    std::error_code gone;
    const std::uintmax_t bytes = entry.file_size(gone);
    if (!gone) found.bytes += bytes;
    // Segments, ports and their locks; named semaphores of the ports.
    if (name.find("fastrtps_") != std::string::npos || name.starts_with("fast_datasharing_"))
      ++found.of_fast_dds;
    else
      found.others.push_back(name);
  }
  return found;
}

}  // namespace nearmesh::test
