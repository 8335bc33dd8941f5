// SPDX-License-Identifier: Apache-2.0
#pragma once
// API (docs/api.md).
// How nearmesh reports trouble with data from outside: files, samples, poses, configuration. A
// caller's own mistakes are asserted instead (assert.hpp); no exception crosses a target boundary.

#include <cstdint>
#include <optional>
#include <string>
#include <utility>

#include "nearmesh/core/base/detail/assert.hpp"

namespace nearmesh {

enum class StatusCode : std::uint8_t {
  kOk,
  kInvalidArgument,  ///< a value from the user or the wire is outside its stated range
  kNotFound,         ///< the named thing does not exist
  kCorrupt,          ///< bytes contradict their checksum or their format
  kUnsupported,      ///< well formed, but of a version or size this build does not handle
  kIo,               ///< the operating system refused
  kConflict,         ///< contradicts what is already held (other content under the same name)
};

/// Short lower-case name of a code, for messages and JSON.
[[nodiscard]] const char* to_string(StatusCode code);

/// Success, or a code with a message that names the thing, the place, what was expected and what
/// was found.
class [[nodiscard]] Status {
 public:
  Status() = default;
  Status(StatusCode code, std::string message) : code_(code), message_(std::move(message)) {}
  [[nodiscard]] static Status ok() { return {}; }
  [[nodiscard]] bool is_ok() const { return code_ == StatusCode::kOk; }
  [[nodiscard]] StatusCode code() const { return code_; }
  [[nodiscard]] const std::string& message() const { return message_; }

 private:
  StatusCode code_ = StatusCode::kOk;
  std::string message_;
};

/// A value, or the Status that says why there is none.
template <class T>
class [[nodiscard]] Result {
 public:
  Result(T value) : value_(std::move(value)) {}         // NOLINT: implicit by design
  Result(Status status) : status_(std::move(status)) {  // NOLINT: implicit by design
    NEARMESH_ASSERT(!status_.is_ok());
  }
  [[nodiscard]] bool is_ok() const { return value_.has_value(); }
  [[nodiscard]] const Status& status() const { return status_; }
  [[nodiscard]] T& value() & {
    NEARMESH_ASSERT(value_.has_value());
    return *value_;
  }
  [[nodiscard]] const T& value() const& {
    NEARMESH_ASSERT(value_.has_value());
    return *value_;
  }
  /// By value, so that `for (x : make().value())` keeps what it walks over.
  [[nodiscard]] T value() && {
    NEARMESH_ASSERT(value_.has_value());
    return std::move(*value_);
  }

 private:
  std::optional<T> value_;
  Status status_;
};

namespace detail {
[[nodiscard]] inline const Status& status_of(const Status& status) { return status; }
template <class T>
[[nodiscard]] const Status& status_of(const Result<T>& result) {
  return result.status();
}
}  // namespace detail

}  // namespace nearmesh

/// Hands an error on: returns from the enclosing function, whose result is a Status or a Result,
/// when `expr`, a Status or a Result, is not ok. The status is copied, since `expr` may name a part
/// of what is gone after it: `make().status()`.
#define NEARMESH_RETURN_IF_ERROR(expr)                                                  \
  do {                                                                                  \
    if (const ::nearmesh::Status nearmesh_tried_ = ::nearmesh::detail::status_of(expr); \
        !nearmesh_tried_.is_ok())                                                       \
      return nearmesh_tried_;                                                           \
  } while (false)
