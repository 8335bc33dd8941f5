// SPDX-License-Identifier: Apache-2.0
#pragma once
// Makes the generated type supports of Fast DDS 2.9 fit for bytes from strangers. For the rooms named dds
// alone.
// * getKey of the generated code shares one buffer between threads (3,338 wrong keys in 4 M calls);
// ours has its own.
// * The generated deserialize lets std::bad_alloc and others out, into a thread of Fast DDS; ours
// catches everything.
// * A sample that cannot be read is *delivered*, as an Envelope with a fault, because Fast DDS
// drops failures in
//   silence, and because it computes the key after a failed deserialize from whatever was in the
//   object before.

#include <fastcdr/Cdr.h>
#include <fastcdr/FastBuffer.h>
#include <fastdds/dds/topic/TypeSupport.hpp>

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstring>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "codec.hpp"

namespace nearmesh::wire {

/// A sample with what is wrong with it; an empty fault means that its bytes were well formed.
/// The data object of every reader and writer here.
template <class Sample>
struct Envelope : Sample {
  std::string fault;
  /// What was read, as it was (RawType alone); what is written, where not empty: then the fields are for the key only.
  std::vector<std::uint8_t> cdr;
};

/// Reads the wire version of a serialized sample. Out: nothing wrong, or one clause that says what.
[[nodiscard]] inline std::string judge_payload(const std::uint8_t* bytes, std::size_t size) {
  constexpr std::size_t kEncapsulation = 4;
  if (size < kEncapsulation + sizeof(std::uint16_t))
    return std::to_string(size) + " bytes, too short";
  if (bytes[0] != 0 || bytes[1] > 1)
    return "encapsulation " + std::to_string(bytes[0] * 256 + bytes[1]) + ", expected plain CDR";
  const bool little = bytes[1] == 1;
  const unsigned version = little ? bytes[4] + 256U * bytes[5] : bytes[5] + 256U * bytes[4];
  if (version == kWireVersion) return {};
  return "wire version " + std::to_string(version) + ", this build speaks " +
         std::to_string(kWireVersion);
}

/// In: the generated type support. Its maximum size stays: a reader of Fast DDS 2.9 drops what is
/// larger, in silence.
template <class Support>
class SafeType : public Support {
 public:
  using Sample = typename Support::type;
  using Data = Envelope<Sample>;

  SafeType() {
    this->auto_fill_type_object(false);
    this->auto_fill_type_information(false);
  }

  void* createData() override { return static_cast<Sample*>(new Data); }
  void deleteData(void* data) override { delete &envelope(data); }

  std::function<std::uint32_t()> getSerializedSizeProvider(void* data) override {
    if (envelope(data).cdr.empty()) return Support::getSerializedSizeProvider(data);
    return [data] { return static_cast<std::uint32_t>(envelope(data).cdr.size()); };
  }

  bool serialize(void* data, eprosima::fastrtps::rtps::SerializedPayload_t* payload) override {
    if (const std::vector<std::uint8_t>& cdr = envelope(data).cdr; !cdr.empty()) {
      if (cdr.size() > payload->max_size || cdr.size() < 2) return false;
      std::copy(cdr.begin(), cdr.end(), payload->data);
      payload->length = static_cast<std::uint32_t>(cdr.size());
      payload->encapsulation = cdr[1];
      return true;
    }
    try {
      return Support::serialize(data, payload);
    } catch (...) {
      return false;
    }
  }

  bool deserialize(eprosima::fastrtps::rtps::SerializedPayload_t* payload, void* data) override {
    Data& target = envelope(data);
    static_cast<Sample&>(target) = Sample{};
    target.fault = judge_payload(payload->data, payload->length);
    if (!target.fault.empty()) return true;
    bool read = false;
    try {
      read = Support::deserialize(payload, data);
      // Also catches names that were cut to their bound, and bytes that belong to no field. Up to
      // three bytes of padding follow a sample on the wire.
      const std::size_t expected = 4 + Sample::getCdrSerializedSize(target);
      read = read && expected <= payload->length && payload->length < expected + 4;
    } catch (...) {
      read = false;
    }
    if (!read) {
      static_cast<Sample&>(target) = Sample{};
      target.fault = std::to_string(payload->length) + " bytes that contradict the type";
    }
    return true;
  }

  bool getKey(void* data, eprosima::fastrtps::rtps::InstanceHandle_t* handle,
              bool force_md5) override {
    if (!Sample::isKeyDefined()) return false;
    std::array<unsigned char, kMaxKeyBytes> bytes{};
    eprosima::fastcdr::FastBuffer buffer(reinterpret_cast<char*>(bytes.data()), bytes.size());
    eprosima::fastcdr::Cdr key(buffer, eprosima::fastcdr::Cdr::BIG_ENDIANNESS);
    try {
      static_cast<const Sample*>(data)->serializeKey(key);
    } catch (...) {
      return false;
    }
    constexpr std::size_t kHandleBytes = 16;
    unsigned char* out = &handle->value[0];
    if (force_md5 || Sample::getKeyMaxCdrSerializedSize() > kHandleBytes) {
      MD5 digest;
      digest.init();
      digest.update(bytes.data(), static_cast<unsigned int>(key.getSerializedDataLength()));
      digest.finalize();
      std::memcpy(out, digest.digest, kHandleBytes);
    } else {
      std::memcpy(out, bytes.data(), kHandleBytes);
    }
    return true;
  }

 private:
  static constexpr std::size_t kMaxKeyBytes = 256;  // contact reports: 8 + 2 * 69 and padding

  static Data& envelope(void* data) { return static_cast<Data&>(*static_cast<Sample*>(data)); }
};

/// As SafeType, and keeps the bytes of what it reads, also of what is faulty: for recorders.
template <class Support>
class RawType : public SafeType<Support> {
 public:
  using Base = SafeType<Support>;
  using Sample = typename Base::Sample;
  using Data = typename Base::Data;

  bool deserialize(eprosima::fastrtps::rtps::SerializedPayload_t* payload, void* data) override {
    static_cast<Data&>(*static_cast<Sample*>(data))
        .cdr.assign(payload->data, payload->data + payload->length);
    return Base::deserialize(payload, data);
  }
};

/// The type supports of a message, as it is written and read, and as a recorder reads it.
template <class Message>
using TypeOf = SafeType<typename Generated<Message>::Type>;
template <class Message>
using RawTypeOf = RawType<typename Generated<Message>::Type>;

/// A sample's bytes into a data object, as when they come from the bus.
template <class Type>
void read_cdr(Type& type, std::span<const std::uint8_t> cdr, typename Type::Data& data) {
  eprosima::fastrtps::rtps::SerializedPayload_t payload;
  payload.data = const_cast<std::uint8_t*>(cdr.data());  // only read
  payload.length = payload.max_size = static_cast<std::uint32_t>(cdr.size());
  type.deserialize(&payload, static_cast<typename Type::Sample*>(&data));
  payload.data = nullptr;  // its destructor would free it
}

}  // namespace nearmesh::wire
