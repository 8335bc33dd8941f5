// SPDX-License-Identifier: Apache-2.0
#pragma once
// Whether this process can join the bus at all. Where threads, descriptors, memory or shared memory
// run out while it does, Fast DDS 2.9 ends it by a signal or leaves it deaf without a word; so what
// joining takes is tried first. For the rooms named dds.

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "interfaces.hpp"
#include "nearmesh/core/base/status.hpp"
#include "nearmesh/idl/dds/transport_options.hpp"

namespace nearmesh::wire {

/// What one participant takes, and some more: it had 9 threads and 13 descriptors.
inline constexpr std::size_t kRoomThreads = 16;
inline constexpr std::size_t kRoomDescriptors = 32;
inline constexpr std::size_t kRoomBytes = 32U << 20;  ///< beside the stacks of the threads
/// Of a domain on one machine: each participant listens at two UDP ports of its own, and RTPS has
/// no more (DDSI-RTPS 2.3, 9.6.1.1).
inline constexpr std::uint32_t kPlacesPerDomain = 120;
/// Of same-host: a segment, which holds the largest header beside batches; and what it and those it
/// speaks to listen at.
inline constexpr std::uint64_t kSharedSegmentBytes = 4U << 20;
inline constexpr std::uint64_t kRoomSharedBytes = kSharedSegmentBytes + (2U << 20);

/// Errors: kIo saying what there is too little of, how much was tried, and which limit to look at.
/// Cost: milliseconds.
[[nodiscard]] Status check_room(const TransportOptions& options);
/// Bytes that can still be written in /dev/shm; nothing where it cannot be written at all.
[[nodiscard]] std::optional<std::uint64_t> free_shared_memory();
/// Why others may not be found although nothing failed, for transports that find them by multicast:
/// one line, or "". The mark is the interface's own: some carry multicast without it.
[[nodiscard]] std::string why_alone(const TransportOptions& options,
                                    const std::vector<Interface>& interfaces);

}  // namespace nearmesh::wire
