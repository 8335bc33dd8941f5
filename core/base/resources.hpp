// SPDX-License-Identifier: Apache-2.0
#pragma once
// What the process uses: for reports, and to use it well.

#include <cstdint>

namespace nearmesh {

/// Greatest resident size so far.
[[nodiscard]] std::uint64_t peak_memory_bytes();
/// Resident size now.
[[nodiscard]] std::uint64_t resident_memory_bytes();

/// For programs whose arrays are large, and come and go, as those of a bake do: from now on the
/// heap keeps what is freed, and its first gigabyte is of huge pages where the kernel has them.
/// Then a bake takes a third less time, which went into new pages, and as much memory. Of the whole
/// process: not for libraries. Threads: before others are started.
void keep_large_heap();

}  // namespace nearmesh
