// SPDX-License-Identifier: Apache-2.0
#pragma once
// API (docs/api.md).
// A sample's bytes (CDR with its encapsulation, as on the wire and in a recording) to a message and back. No Fast DDS here.

#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "nearmesh/idl/messages/messages.hpp"

namespace nearmesh::wire {

/// Recordings of this build's wire version are read and played, no others. Errors: kUnsupported naming both versions.
[[nodiscard]] Status check_recorded_version(std::uint32_t wire_version);

/// In: Hello, MeshHeader, RegionSubscription, SplitBatchMessage, BodyPose or ContactReport.
/// Errors: kUnsupported for another wire version; kInvalidArgument for bytes that contradict the type, or a field outside
/// its limits.
template <class Message>
[[nodiscard]] Result<Message> decode_payload(std::span<const std::uint8_t> cdr);

/// The bytes that decode_payload takes. The message should have passed check().
template <class Message>
[[nodiscard]] std::vector<std::uint8_t> encode_payload(const Message& message);

/// The key under which a sample is recorded (RecordingWriter::append), so that what holds at a moment is found without
/// reading all: of a hello the publisher, of a header and a batch the content, of a request the peer, of a pose the body.
/// None (empty) for reports, for subscriptions that only return credit, and for what does not decode.
[[nodiscard]] std::string record_key(std::string_view type, std::span<const std::uint8_t> cdr);

/// Text of nearmesh.idl, for whoever reads the bytes without this library.
[[nodiscard]] const char* idl_text();

}  // namespace nearmesh::wire
