// SPDX-License-Identifier: Apache-2.0
// A sample of any bytes, through the very code that Fast DDS calls, then decode() with its checks.
// The first byte names the type; its top bit asks for a good head (encapsulation and version), so
// that more than those is reached. Holds: what is accepted survives the way to bytes and back.

#include "fuzz_input.hpp"
#include "idl/dds/codec.hpp"
#include "idl/dds/type_support.hpp"

using namespace nearmesh;
using namespace nearmesh::wire;

namespace {

using Bytes = std::vector<std::uint8_t>;

template <class Type, class Message>
Bytes to_bytes(const Message& message) {
  Type type;
  typename Type::Data data;
  encode(message, data);
  Bytes written = to_cdr(type, data);
  FUZZ_CHECK(!written.empty());
  return written;
}

template <class Type>
auto from_bytes(std::span<const std::uint8_t> bytes)
    -> decltype(decode(std::declval<typename Type::Sample>())) {
  Type type;
  void* data = type.make_data();
  // A buffer of just this size, so that a read beyond it is seen.
  Payload payload(static_cast<std::uint32_t>(bytes.size()));
  if (!bytes.empty()) std::memcpy(payload.data, bytes.data(), bytes.size());
  payload.length = static_cast<std::uint32_t>(bytes.size());
  FUZZ_CHECK(type.read(payload, data));
  auto& sample = static_cast<typename Type::Data&>(*static_cast<typename Type::Sample*>(data));
  Handle key;
  static_cast<void>(type.key_of(data, key, false));
  const std::string fault = sample.fault;
  auto decoded = decode(sample);
  type.delete_made(data);
  if (!fault.empty()) return Status{StatusCode::kCorrupt, fault};
  return decoded;
}

template <class Type>
void run(std::span<const std::uint8_t> bytes) {
  const auto message = from_bytes<Type>(bytes);
  if (!message.is_ok()) {
    FUZZ_CHECK(!message.status().message().empty());
    return;
  }
  FUZZ_CHECK(check(message.value()).is_ok());
  const Bytes again = to_bytes<Type>(message.value());
  const auto back = from_bytes<Type>(again);
  FUZZ_CHECK(back.is_ok());
  FUZZ_CHECK(to_bytes<Type>(back.value()) == again);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  fuzz::FuzzInput in(data, size);
  const std::uint8_t choice = in.byte();
  Bytes bytes(in.rest().begin(), in.rest().end());
  if (choice >= 128) bytes.insert(bytes.begin(), {0, 1, 0, 0, kWireVersion, 0});
  switch (choice % 14) {
    case 0:
      run<TypeOf<Hello>>(bytes);
      break;
    case 1:
      run<TypeOf<MeshHeader>>(bytes);
      break;
    case 2:
      run<TypeOf<RegionSubscription>>(bytes);
      break;
    case 3:
      run<TypeOf<SplitBatchMessage>>(bytes);
      break;
    case 4:
      run<TypeOf<BodyPoses>>(bytes);
      break;
    case 5:
      run<TypeOf<ContactReport>>(bytes);
      break;
    case 6:
      run<TypeOf<ProcessStatus>>(bytes);
      break;
    case 7:
      run<TypeOf<Echo>>(bytes);
      break;
    case 8:
      run<TypeOf<HeldDetail>>(bytes);
      break;
    case 9:
      run<TypeOf<BodyDirectory>>(bytes);
      break;
    case 10:
      run<TypeOf<WatchedBodies>>(bytes);
      break;
    case 11:
      run<TypeOf<BoundsReport>>(bytes);
      break;
    case 12:
      run<TypeOf<BodyPromises>>(bytes);
      break;
    default:
      run<TypeOf<WantedPoses>>(bytes);
  }
  return 0;
}
