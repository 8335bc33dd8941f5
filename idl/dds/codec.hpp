// SPDX-License-Identifier: Apache-2.0
#pragma once
// Plain structs to generated samples and back. For the rooms named dds alone.
// decode() is where bytes from outside become a message: it trusts nothing and ends with check().
// All are in codec_*.cpp, by what the messages are about; what these files share: codec_fields.hpp.

#include <array>
#include <cstdint>

#include "fastdds_api.hpp"
#include "nearmesh/idl/messages/messages.hpp"
#include "nearmesh/idl/nearmesh_types.hpp"

namespace nearmesh::wire {

/// A content hash as samples carry it: the high word first.
[[nodiscard]] inline std::array<std::uint64_t, 2> words_of(const ContentHash& content) {
  return {content.high, content.low};
}

/// The generated type that carries a message.
template <class Message>
struct Generated;

/// encode(). Out: every field of `sample` is set. The message should have passed check(): nothing
/// is cut or refused here. decode(). Errors: kUnsupported for another wire version;
/// kInvalidArgument naming the field that lies outside its limits.
#define NEARMESH_CODEC(Message, SampleName)                            \
  template <>                                                          \
  struct Generated<Message> {                                          \
    using Own = Generated;                                             \
    using Sample = wire_types::SampleName;                             \
    using Type = wire_types::SampleName##PubSubType;                   \
    [[nodiscard]] static std::size_t max_key_bytes() {                 \
      return NEARMESH_MAX_KEY_BYTES(wire_types, SampleName);           \
    }                                                                  \
  };                                                                   \
  void encode(const Message& message, wire_types::SampleName& sample); \
  [[nodiscard]] Result<Message> decode(const wire_types::SampleName& sample)
NEARMESH_CODEC(Hello, HelloSample);
NEARMESH_CODEC(MeshHeader, MeshHeaderSample);
NEARMESH_CODEC(RegionSubscription, RegionSubscriptionSample);
NEARMESH_CODEC(SplitBatchMessage, SplitBatchSample);
NEARMESH_CODEC(BodyPoses, BodyPosesSample);
NEARMESH_CODEC(BodyDirectory, BodyDirectorySample);
NEARMESH_CODEC(BodyPromises, BodyPromisesSample);
NEARMESH_CODEC(WantedPoses, WantedPosesSample);
NEARMESH_CODEC(ContactReport, ContactReportSample);
NEARMESH_CODEC(WatchedBodies, WatchedBodiesSample);
NEARMESH_CODEC(BoundsReport, BoundsReportSample);
NEARMESH_CODEC(HeldDetail, HeldDetailSample);
NEARMESH_CODEC(ProcessStatus, ProcessStatusSample);
NEARMESH_CODEC(Echo, EchoSample);
#undef NEARMESH_CODEC
template <>
struct Generated<Probe> : Generated<Echo> {};
template <>
struct Generated<NearPoses> : Generated<BodyPoses> {};

}  // namespace nearmesh::wire
