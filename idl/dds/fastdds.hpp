// SPDX-License-Identifier: Apache-2.0
#pragma once
// What a program wants of the loaded Fast DDS itself: its version, whether it asserts, and its log.
// No Fast DDS here.

#include <cstdint>
#include <functional>
#include <string>

namespace nearmesh::wire {

/// "2.9.1": what this was built with.
[[nodiscard]] const char* fastdds_version();

/// Whether the library that is loaded was built with live assertions: then a fault in it ends the
/// process. Told by whether it asks the C library for what a failed assertion calls.
[[nodiscard]] bool fastdds_asserts();

enum class FastDdsLevel : std::uint8_t { kError, kWarning, kInfo };
/// From now on Fast DDS's log goes to `take` alone, and not to standard output: `take` is called by
/// one thread of Fast DDS at a time, until the process ends.
void take_fastdds_log(std::function<void(FastDdsLevel, const std::string&)> take);
/// What Fast DDS logs: this and what is graver.
void set_fastdds_level(FastDdsLevel level);

/// Participants of one process speak to each other as those of two do. For tests; before the first
/// participant.
void speak_through_transports();

}  // namespace nearmesh::wire
