// SPDX-License-Identifier: Apache-2.0
#pragma once
// A sample's bytes (CDR with its encapsulation, as on the wire and in a recording) to a message and back. No Fast DDS here.

#include <cstdint>
#include <span>
#include <vector>

#include "nearmesh/wire/messages.hpp"

namespace nearmesh::wire {

/// In: Hello, MeshHeader, RegionSubscription, SplitBatchMessage, BodyPose or ContactReport.
/// Errors: kUnsupported for another wire version; kInvalidArgument for bytes that contradict the type, or a field outside
/// its limits.
template <class Message>
[[nodiscard]] Result<Message> decode_payload(std::span<const std::uint8_t> cdr);

/// The bytes that decode_payload takes. The message should have passed check().
template <class Message>
[[nodiscard]] std::vector<std::uint8_t> encode_payload(const Message& message);

/// Text of nearmesh.idl, for whoever reads the bytes without this library.
[[nodiscard]] const char* idl_text();

}  // namespace nearmesh::wire
