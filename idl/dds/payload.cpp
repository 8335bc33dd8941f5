// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/idl/dds/payload.hpp"

#include "codec.hpp"
#include "core/base/hash.hpp"
#include "nearmesh/idl/messages/topics.hpp"
#include "type_support.hpp"

namespace nearmesh::wire {
namespace {

using eprosima::fastrtps::rtps::SerializedPayload_t;

template <class Message>
struct TypeOf;
template <>
struct TypeOf<Hello> : HelloType {};
template <>
struct TypeOf<MeshHeader> : MeshHeaderType {};
template <>
struct TypeOf<RegionSubscription> : RegionSubscriptionType {};
template <>
struct TypeOf<SplitBatchMessage> : SplitBatchType {};
template <>
struct TypeOf<BodyPose> : BodyPoseType {};
template <>
struct TypeOf<ContactReport> : ContactReportType {};

}  // namespace

Status check_recorded_version(std::uint32_t wire_version) {
  if (wire_version == kWireVersion) return Status::ok();
  return {StatusCode::kUnsupported, "recorded with wire version " + std::to_string(wire_version) +
                                        ", this build reads " + std::to_string(kWireVersion) +
                                        ": use the build that recorded it, or record anew"};
}

template <class Message>
Result<Message> decode_payload(std::span<const std::uint8_t> cdr) {
  using Type = TypeOf<Message>;
  Type type;
  typename Type::Data data;
  SerializedPayload_t payload;
  payload.data = const_cast<std::uint8_t*>(cdr.data());  // only read
  payload.length = payload.max_size = static_cast<std::uint32_t>(cdr.size());
  type.deserialize(&payload, static_cast<typename Type::Sample*>(&data));
  payload.data = nullptr;  // its destructor would free it
  if (!data.fault.empty()) return Status{StatusCode::kInvalidArgument, data.fault};
  return decode(data);
}

template <class Message>
std::vector<std::uint8_t> encode_payload(const Message& message) {
  using Type = TypeOf<Message>;
  Type type;
  typename Type::Data data;
  encode(message, data);
  auto* sample = static_cast<typename Type::Sample*>(&data);
  SerializedPayload_t payload(type.getSerializedSizeProvider(sample)());
  const bool fits = type.serialize(sample, &payload);
  NEARMESH_ASSERT(fits);
  return {payload.data, payload.data + payload.length};
}

#define NEARMESH_PAYLOAD_OF(Message)                                                   \
  template Result<Message> decode_payload<Message>(std::span<const std::uint8_t> cdr); \
  template std::vector<std::uint8_t> encode_payload<Message>(const Message& message)
NEARMESH_PAYLOAD_OF(Hello);
NEARMESH_PAYLOAD_OF(MeshHeader);
NEARMESH_PAYLOAD_OF(RegionSubscription);
NEARMESH_PAYLOAD_OF(SplitBatchMessage);
NEARMESH_PAYLOAD_OF(BodyPose);
NEARMESH_PAYLOAD_OF(ContactReport);
#undef NEARMESH_PAYLOAD_OF

std::string record_key(std::string_view type, std::span<const std::uint8_t> cdr) {
  const auto key = [](const auto& message, auto of) {
    return message.is_ok() ? of(message.value()) : std::string();
  };
  if (type == kHelloType)
    return key(decode_payload<Hello>(cdr), [](const Hello& m) { return to_hex(m.publisher); });
  if (type == kMeshHeaderType)
    return key(decode_payload<MeshHeader>(cdr),
               [](const MeshHeader& m) { return to_hex(m.content_hash); });
  if (type == kRegionSubscriptionType)
    return key(decode_payload<RegionSubscription>(cdr), [](const RegionSubscription& m) {
      return m.request == 0 ? std::string() : to_hex(m.peer);
    });
  if (type == kSplitBatchType)
    return key(decode_payload<SplitBatchMessage>(cdr),
               [](const SplitBatchMessage& m) { return to_hex(m.content_hash); });
  if (type == kBodyPoseType)
    return key(decode_payload<BodyPose>(cdr), [](const BodyPose& m) { return m.body; });
  return {};
}

const char* idl_text() {
  return
#include "nearmesh/idl/nearmesh_idl_text.inc"
      ;
}

}  // namespace nearmesh::wire
