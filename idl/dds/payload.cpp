// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/idl/dds/payload.hpp"

#include "type_support.hpp"

namespace nearmesh::wire {

Status check_recorded_version(std::uint32_t wire_version) {
  if (wire_version == kWireVersion) return Status::ok();
  return {StatusCode::kUnsupported, "recorded with wire version " + std::to_string(wire_version) +
                                        ", this build reads " + std::to_string(kWireVersion) +
                                        ": use the build that recorded it, or record anew"};
}

namespace detail {

Status decode_payload(TopicPlace place, std::span<const std::uint8_t> cdr, void* message) {
  return visit_topic(place, [&]<class Message>(const Topic<Message>&) -> Status {
    TypeOf<Message> type;
    typename TypeOf<Message>::Data data;
    read_cdr(type, cdr, data);
    if (!data.fault.empty()) return {StatusCode::kInvalidArgument, data.fault};
    auto decoded = decode(data);
    if (decoded.is_ok()) *static_cast<Message*>(message) = {std::move(decoded).value()};
    return decoded.status();
  });
}

std::vector<std::uint8_t> encode_payload(TopicPlace place, const void* message) {
  return visit_topic(place, [&]<class Message>(const Topic<Message>&) {
    using Type = TypeOf<Message>;
    Type type;
    typename Type::Data data;
    encode(*static_cast<const Message*>(message), data);
    std::vector<std::uint8_t> cdr = to_cdr(type, data);
    NEARMESH_ASSERT(!cdr.empty());
    return cdr;
  });
}

}  // namespace detail

std::string record_key(TopicPlace place, std::span<const std::uint8_t> cdr) {
  return visit_topic(place, [&]<class Message>(const Topic<Message>& topic) -> std::string {
    if (topic.key == nullptr) return {};
    const Result<Message> message = decode_payload<Message>(cdr);
    return message.is_ok() ? topic.key(message.value()) : std::string();
  });
}

const char* idl_text() {
  return
#include "nearmesh/idl/nearmesh_idl_text.inc"
      ;
}

}  // namespace nearmesh::wire
