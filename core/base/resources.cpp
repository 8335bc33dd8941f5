// SPDX-License-Identifier: Apache-2.0
#include "resources.hpp"

#include <malloc.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <unistd.h>

#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <limits>
#include <memory>

namespace nearmesh {

std::uint64_t peak_memory_bytes() {
  rusage usage{};
  ::getrusage(RUSAGE_SELF, &usage);
  return static_cast<std::uint64_t>(usage.ru_maxrss) * 1024;
}

std::uint64_t resident_memory_bytes() {
  unsigned long pages = 0;
  if (std::FILE* file = std::fopen("/proc/self/statm", "r"); file != nullptr) {
    if (std::fscanf(file, "%*u %lu", &pages) != 1) pages = 0;
    std::fclose(file);
  }
  return static_cast<std::uint64_t>(pages) * static_cast<std::uint64_t>(::sysconf(_SC_PAGESIZE));
}

void keep_large_heap() {
#ifdef __GLIBC__
  constexpr int kReserved = 1 << 30, kStep = 1 << 26;
  ::mallopt(M_MMAP_MAX, 0);
  ::mallopt(M_TRIM_THRESHOLD, std::numeric_limits<int>::max());
  // Addresses alone: pages come when they are used.
  ::mallopt(M_TOP_PAD, kReserved);
  void* begin = ::sbrk(0);
  void* volatile first = std::malloc(kStep);  // or the compiler leaves both out
  std::free(first);
  auto bytes = static_cast<std::size_t>(static_cast<char*>(::sbrk(0)) - static_cast<char*>(begin));
  const auto page = static_cast<std::size_t>(::sysconf(_SC_PAGESIZE));
  if (std::align(page, page, begin, bytes) != nullptr)
    static_cast<void>(::madvise(begin, bytes, MADV_HUGEPAGE));
  ::mallopt(M_TOP_PAD, kStep);
#endif
}

}  // namespace nearmesh
