// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/idl/dds/payload.hpp"

#include <type_traits>

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

// After the encapsulation, whose second byte is 1 for little-endian.
std::size_t low_byte_of_version(std::span<const std::uint8_t> cdr) { return cdr[1] == 1 ? 4 : 5; }

bool is_of_oldest(std::span<const std::uint8_t> cdr) {
  if (cdr.size() < 6) return false;
  const std::size_t low = low_byte_of_version(cdr);
  return cdr[low] == kOldestRecordedWireVersion && cdr[low ^ 1] == 0;
}

}  // namespace

Status check_recorded_version(std::uint32_t wire_version) {
  if (wire_version >= kOldestRecordedWireVersion && wire_version <= kWireVersion)
    return Status::ok();
  return {StatusCode::kUnsupported,
          "recorded with wire version " + std::to_string(wire_version) + ", this build reads " +
              std::to_string(kOldestRecordedWireVersion) + " to " + std::to_string(kWireVersion)};
}

std::vector<std::uint8_t> as_of_now(std::span<const std::uint8_t> cdr) {
  static_assert(kWireVersion < 256);
  std::vector<std::uint8_t> bytes(cdr.begin(), cdr.end());
  if (is_of_oldest(cdr)) bytes[low_byte_of_version(cdr)] = kWireVersion;
  return bytes;
}

template <class Message>
Result<Message> decode_payload(std::span<const std::uint8_t> cdr) {
  using Type = TypeOf<Message>;
  std::vector<std::uint8_t> older;
  if (!std::is_same_v<Message, RegionSubscription> && is_of_oldest(cdr))
    cdr = older = as_of_now(cdr);
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
