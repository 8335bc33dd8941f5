// SPDX-License-Identifier: Apache-2.0
#pragma once
// API (docs/api.md).
// A sample's bytes (CDR with its encapsulation, as on the wire and in a recording) to a message and
// back. No Fast DDS here.

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "nearmesh/idl/messages/topics.hpp"

namespace nearmesh::wire {

/// Recordings of this build's wire version are read and played, no others. Errors: kUnsupported
/// naming both versions.
[[nodiscard]] Status check_recorded_version(std::uint32_t wire_version);

namespace detail {
/// `message`: of the type that the topic carries.
[[nodiscard]] Status decode_payload(TopicPlace place, std::span<const std::uint8_t> cdr,
                                    void* message);
[[nodiscard]] std::vector<std::uint8_t> encode_payload(TopicPlace place, const void* message);
}  // namespace detail

/// In: a message of the table of topics.
/// Errors: kUnsupported for another wire version; kInvalidArgument for bytes that contradict the
/// type, or a field outside its limits.
template <class Message>
[[nodiscard]] Result<Message> decode_payload(std::span<const std::uint8_t> cdr) {
  Message message;
  NEARMESH_RETURN_IF_ERROR(detail::decode_payload(place_of<Message>(), cdr, &message));
  return message;
}

/// The bytes that decode_payload takes. The message should have passed check().
template <class Message>
[[nodiscard]] std::vector<std::uint8_t> encode_payload(const Message& message) {
  return detail::encode_payload(place_of<Message>(), &message);
}

/// The key under which a sample is recorded, as the table of topics says (Topic::key); "" also for
/// what does not decode.
[[nodiscard]] std::string record_key(TopicPlace place, std::span<const std::uint8_t> cdr);

/// Text of nearmesh.idl, for whoever reads the bytes without this library.
[[nodiscard]] const char* idl_text();

}  // namespace nearmesh::wire
