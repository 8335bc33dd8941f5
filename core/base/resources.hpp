// SPDX-License-Identifier: Apache-2.0
#pragma once
// What the process uses, for reports.

#include <cstdint>

namespace nearmesh {

/// Greatest resident size so far.
[[nodiscard]] std::uint64_t peak_memory_bytes();
/// Resident size now.
[[nodiscard]] std::uint64_t resident_memory_bytes();

}  // namespace nearmesh
