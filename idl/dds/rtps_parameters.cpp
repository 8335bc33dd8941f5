// SPDX-License-Identifier: Apache-2.0
#include "rtps_parameters.hpp"

namespace nearmesh::wire {
namespace {

void read_token(Cursor& in) {
  read_token(in, [](auto, auto) {});
}

void read_texts(Cursor& in) {
  for (std::uint32_t left = in.count(4); left > 0 && in.is_whole(); --left) in.text();
}

}  // namespace

bool describes_type(std::uint16_t parameter) {
  return parameter == 0x0069 || parameter == 0x0072 || parameter == 0x0075;
}

void read_properties(Cursor& in) {
  for (std::uint32_t left = in.count(8); left > 0 && in.is_whole(); --left) {
    in.text();
    in.text();
  }
}

bool is_parameter(std::uint16_t id, Cursor::Bytes bytes, bool little_endian) {
  Cursor in(bytes, little_endian);
  switch (id) {
    case 0x0002:  // lease
      in.skip(8);
      break;
    case 0x0015:  // protocol version
    case 0x0016:  // vendor
    case 0x0058:  // builtin endpoints
      in.skip(4);
      break;
    case 0x1004:  // security of an endpoint
    case 0x1005:  // of a participant
      in.skip(8);
      break;
    case 0x0050:  // GUIDs: participant
    case 0x005a:  // endpoint
    case 0x0070:  // key
    case 0x8002:  // persistence
      in.skip(16);
      break;
    case 0x002f:  // locators
    case 0x0030:
    case 0x0031:
    case 0x0032:
    case 0x0033:
    case 0x0048:
      in.skip(24);
      break;
    case 0x0005:  // names: topic
    case 0x0007:  // type
    case 0x0062:  // entity
      in.terminated_text();
      break;
    case 0x002c:  // bytes: user
    case 0x002e:  // topic
    case 0x002d:  // group
      in.skip(in.u32());
      break;
    case 0x0029:  // partitions
      read_texts(in);
      break;
    case 0x0059:
      read_properties(in);
      break;
    case 0x1001:  // tokens: identity
    case 0x1002:  // permissions
    case 0x1006:  // status
      read_token(in);
      break;
    case 0x0035:  // a content filter: its names and expression, then parameters
      for (int i = 0; i < 4; ++i) in.text();
      read_texts(in);
      break;
    case 0x0073:  // data representations
      in.skip(2 * in.count(2));
      break;
    case 0x8006:  // data sharing domains
      in.skip(8 * std::size_t{in.count(8)});
      break;
    default:
      break;
  }
  return in.is_whole();
}

}  // namespace nearmesh::wire
