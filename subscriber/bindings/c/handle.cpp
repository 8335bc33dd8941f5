// SPDX-License-Identifier: Apache-2.0
#include "handle.hpp"

#include <cstdio>

namespace nearmesh::c {
namespace {

nearmesh_status status_of(StatusCode code) noexcept {
  switch (code) {
    case StatusCode::kOk:
      return NEARMESH_OK;
    case StatusCode::kInvalidArgument:
      return NEARMESH_INVALID_ARGUMENT;
    case StatusCode::kNotFound:
      return NEARMESH_NOT_FOUND;
    case StatusCode::kCorrupt:
      return NEARMESH_CORRUPT;
    case StatusCode::kUnsupported:
      return NEARMESH_UNSUPPORTED;
    case StatusCode::kIo:
      return NEARMESH_IO;
    case StatusCode::kConflict:
      return NEARMESH_CONFLICT;
  }
  return NEARMESH_INTERNAL;
}

}  // namespace

const char* to_string(Kind kind) {
  switch (kind) {
    case Kind::kNone:
      break;
    case Kind::kModel:
      return "model";
    case Kind::kQuery:
      return "query";
    case Kind::kWorld:
      return "world";
    case Kind::kSession:
      return "session";
    case Kind::kRecording:
      return "recording";
  }
  return "handle";
}

Status Use::refusal(Kind kind) {
  return {StatusCode::kConflict,
          std::string("the ") + to_string(kind) +
              " is in use: by another thread, or by the call that this one comes from"};
}

Status check_given(const void* pointer, const char* name) {
  if (pointer == nullptr) return {StatusCode::kInvalidArgument, std::string(name) + " is NULL"};
  return Status::ok();
}

Status check_array(const void* pointer, std::size_t count, const char* name) {
  return count == 0 ? Status::ok() : check_given(pointer, name);
}

Status check_number(double number, double least, double most, const char* name) {
  if (number >= least && number <= most) return Status::ok();
  char text[160];
  std::snprintf(text, sizeof text, "%s is %.9g, expected a number from %.9g to %.9g", name, number,
                least, most);
  return {StatusCode::kInvalidArgument, text};
}

nearmesh_status tell(nearmesh_error* error, nearmesh_status status, const char* message) noexcept {
  if (error != nullptr) {
    error->status = status;
    std::size_t length = std::min(std::strlen(message), std::size_t{NEARMESH_MESSAGE_BYTES - 1});
    // Not within a character of UTF-8.
    if (message[length] != 0)
      while (length > 0 && (static_cast<unsigned char>(message[length]) & 0xc0U) == 0x80U) --length;
    std::memcpy(error->message, message, length);
    error->message[length] = 0;
  }
  return status;
}

nearmesh_status tell(nearmesh_error* error, const Status& status) noexcept {
  return tell(error, status_of(status.code()), status.message().c_str());
}

}  // namespace nearmesh::c

using nearmesh::c::tell;

const char* nearmesh_status_name(nearmesh_status status) noexcept {
  switch (status) {
    case NEARMESH_OK:
      return "ok";
    case NEARMESH_INVALID_ARGUMENT:
      return "invalid_argument";
    case NEARMESH_NOT_FOUND:
      return "not_found";
    case NEARMESH_CORRUPT:
      return "corrupt";
    case NEARMESH_UNSUPPORTED:
      return "unsupported";
    case NEARMESH_IO:
      return "io";
    case NEARMESH_CONFLICT:
      return "conflict";
    case NEARMESH_OUT_OF_MEMORY:
      return "out_of_memory";
    case NEARMESH_INTERNAL:
      return "internal";
    default:
      return "unknown";
  }
}

const char* nearmesh_version() noexcept { return NEARMESH_BUILT_VERSION; }

int32_t nearmesh_has_dds() noexcept {
#ifdef NEARMESH_C_WITH_DDS
  return 1;
#else
  return 0;
#endif
}
