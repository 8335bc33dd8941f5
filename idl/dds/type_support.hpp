// SPDX-License-Identifier: Apache-2.0
#pragma once
// Makes the generated type supports of Fast DDS fit for bytes from strangers. For the rooms named
// dds alone.
// * The keys of the generated code share one buffer between threads (3,338 wrong keys in 4 M
//   calls);
// ours has its own.
// * The generated deserialize lets std::bad_alloc and others out, into a thread of Fast DDS; ours
// catches everything.
// * A sample that cannot be read is *delivered*, as an Envelope with a fault, because Fast DDS
// drops failures in
//   silence, and because it computes the key after a failed deserialize from whatever was in the
//   object before.

#include <fastdds/dds/topic/TypeSupport.hpp>

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstring>
#include <span>
#include <string>
#include <vector>

#include "codec.hpp"
#include "fastdds_api.hpp"

namespace nearmesh::wire {

/// A sample with what is wrong with it; an empty fault means that its bytes were well formed.
/// The data object of every reader and writer here.
template <class Sample>
struct Envelope : Sample {
  std::string fault;
  /// What was read, as it was (RawType alone); what is written, where not empty: then the fields
  /// are for the key only.
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

/// In: what was generated for a message. Its maximum size stays: a reader of Fast DDS drops what is
/// larger, in silence.
template <class OfMessage>
class SafeType : public OfEitherVersion<typename OfMessage::Type> {
 public:
  using Support = typename OfMessage::Type;
  using Sample = typename OfMessage::Sample;
  using Data = Envelope<Sample>;

  void* make_data() override { return static_cast<Sample*>(new Data); }
  void delete_made(void* data) override { delete &envelope(data); }

  std::uint32_t size_of(const void* data) override {
    const Data& from = envelope(data);
    return static_cast<std::uint32_t>(
        from.cdr.empty() ? generated_size(static_cast<const Sample&>(from)) : from.cdr.size());
  }

  bool write(const void* data, Payload& payload) override {
    const Data& from = envelope(data);
    if (from.cdr.size() > payload.max_size || from.cdr.size() == 1) return false;
    std::copy(from.cdr.begin(), from.cdr.end(), payload.data);
    payload.length = static_cast<std::uint32_t>(
        from.cdr.empty() ? written_size(from, {payload.data, payload.max_size}) : from.cdr.size());
    if (payload.length > 0) payload.encapsulation = payload.data[1];
    return payload.length > 0;
  }

  bool read(Payload& payload, void* data) override {
    Data& target = envelope(data);
    static_cast<Sample&>(target) = Sample{};
    target.fault = judge_payload(payload.data, payload.length);
    if (!target.fault.empty()) return true;
    bool is_good = false;
    try {
      // Written again, it has the same size: that also catches names that were cut to their bound,
      // and bytes that belong to no field. Up to three bytes of padding follow a sample on the
      // wire.
      if (generated_read<Support>(*this, payload, data)) {
        std::vector<std::uint8_t> again(generated_size(static_cast<const Sample&>(target)));
        const std::size_t expected = written_size(target, again);
        is_good = expected <= payload.length && payload.length < expected + 4;
      }
    } catch (...) {
    }
    if (!is_good) {
      static_cast<Sample&>(target) = Sample{};
      target.fault = std::to_string(payload.length) + " bytes that contradict the type";
    }
    return true;
  }

  bool key_of(const void* data, Handle& handle, bool force_md5) override {
    if (!this->has_key()) return false;
    std::array<std::uint8_t, kMaxKeyBytes> bytes{};
    std::size_t size = 0;
    try {
      size = generated_key(*static_cast<const Sample*>(data), bytes);
    } catch (...) {
      return false;
    }
    constexpr std::size_t kHandleBytes = 16;
    unsigned char* out = &handle.value[0];
    if (force_md5 || OfMessage::max_key_bytes() > kHandleBytes) {
      Md5 digest;
      digest.init();
      digest.update(bytes.data(), static_cast<unsigned int>(size));
      digest.finalize();
      std::memcpy(out, digest.digest, kHandleBytes);
    } else {
      std::memcpy(out, bytes.data(), kHandleBytes);
    }
    return true;
  }

 private:
  static constexpr std::size_t kMaxKeyBytes = 256;  // contact reports: 8 + 2 * 69 and padding

  /// 0 where it does not fit.
  static std::size_t written_size(const Data& data, std::span<std::uint8_t> out) {
    try {
      return generated_write(static_cast<const Sample&>(data), out);
    } catch (...) {
      return 0;
    }
  }

  static Data& envelope(void* data) { return static_cast<Data&>(*static_cast<Sample*>(data)); }
  static const Data& envelope(const void* data) {
    return static_cast<const Data&>(*static_cast<const Sample*>(data));
  }
};

/// As SafeType, and keeps the bytes of what it reads, also of what is faulty: for recorders.
template <class OfMessage>
class RawType : public SafeType<OfMessage> {
 public:
  using Base = SafeType<OfMessage>;
  using Sample = typename Base::Sample;
  using Data = typename Base::Data;

  bool read(Payload& payload, void* data) override {
    static_cast<Data&>(*static_cast<Sample*>(data))
        .cdr.assign(payload.data, payload.data + payload.length);
    return Base::read(payload, data);
  }
};

/// The type supports of a message, as it is written and read, and as a recorder reads it. Messages
/// of one generated type have one.
template <class Message>
using TypeOf = SafeType<typename Generated<Message>::Own>;
template <class Message>
using RawTypeOf = RawType<typename Generated<Message>::Own>;

/// A sample's bytes into a data object, as when they come from the bus.
template <class Type>
void read_cdr(Type& type, std::span<const std::uint8_t> cdr, typename Type::Data& data) {
  Payload payload;
  payload.data = const_cast<std::uint8_t*>(cdr.data());  // only read
  payload.length = payload.max_size = static_cast<std::uint32_t>(cdr.size());
  static_cast<void>(type.read(payload, static_cast<typename Type::Sample*>(&data)));
  payload.data = nullptr;  // its destructor would free it
}

/// The bytes of a sample, as they go to the bus. Empty: it cannot be written.
template <class Type>
[[nodiscard]] std::vector<std::uint8_t> to_cdr(Type& type, const typename Type::Data& data) {
  const auto* sample = static_cast<const typename Type::Sample*>(&data);
  Payload payload(type.size_of(sample));
  if (!type.write(sample, payload)) return {};
  return {payload.data, payload.data + payload.length};
}

}  // namespace nearmesh::wire
