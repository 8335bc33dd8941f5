// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/core/base/status.hpp"

namespace nearmesh {

const char* to_string(StatusCode code) {
  switch (code) {
    case StatusCode::kOk:
      return "ok";
    case StatusCode::kInvalidArgument:
      return "invalid argument";
    case StatusCode::kNotFound:
      return "not found";
    case StatusCode::kCorrupt:
      return "corrupt";
    case StatusCode::kUnsupported:
      return "unsupported";
    case StatusCode::kIo:
      return "io";
    case StatusCode::kConflict:
      return "conflict";
  }
  return "unknown";
}

}  // namespace nearmesh
