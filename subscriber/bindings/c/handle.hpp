// SPDX-License-Identifier: Apache-2.0
#pragma once
// What every function of the C interface does before and after its work: no exception leaves,
// errors become numbers and text, handles are told from each other, structs of other lengths are
// read.

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <exception>
#include <new>
#include <string>
#include <type_traits>

#include "core/base/float_guard.hpp"
#include "nearmesh.h"
#include "nearmesh/core/base/status.hpp"

namespace nearmesh::c {

/// Leads each handle.
enum class Kind : std::uint32_t {
  kNone = 0,  ///< destroyed
  kModel = 0x6d6d6f64,
  kQuery = 0x6d717279,
  kWorld = 0x6d776c64,
  kSession = 0x6d736573,
  kRecording = 0x6d726563,
};
[[nodiscard]] const char* to_string(Kind kind);

/// One thread at a time: who comes second is told so.
class Use {
 public:
  explicit Use(std::atomic<bool>& in_use) : in_use_(in_use), had_(!in_use.exchange(true)) {}
  ~Use() {
    if (had_) in_use_ = false;
  }
  Use(const Use&) = delete;
  Use& operator=(const Use&) = delete;
  [[nodiscard]] bool had() const { return had_; }
  [[nodiscard]] static Status refusal(Kind kind);

 private:
  std::atomic<bool>& in_use_;
  bool had_;
};

/// A handle of some kind, whatever was given.
template <class Handle>
[[nodiscard]] Status check_handle(const Handle* handle) {
  if (handle == nullptr)
    return {StatusCode::kInvalidArgument, std::string(to_string(Handle::kKind)) + " is NULL"};
  if (handle->kind != Handle::kKind)
    return {StatusCode::kInvalidArgument,
            std::string("the handle is no ") + to_string(Handle::kKind)};
  return Status::ok();
}

/// The same for functions that have no status to give.
template <class Handle>
[[nodiscard]] bool is_handle(const Handle* handle) {
  return handle != nullptr && handle->kind == Handle::kKind;
}

[[nodiscard]] Status check_given(const void* pointer, const char* name);
/// `count` things at `pointer`, which may be NULL where there are none.
[[nodiscard]] Status check_array(const void* pointer, std::size_t count, const char* name);
/// In [least, most]; not a NaN.
[[nodiscard]] Status check_number(double number, double least, double most, const char* name);

/// Fills `error`, where there is one. Out: its status.
nearmesh_status tell(nearmesh_error* error, nearmesh_status status, const char* message) noexcept;
nearmesh_status tell(nearmesh_error* error, const Status& status) noexcept;

/// Runs `body`, which gives a Status, in our floating-point environment, and whatever it throws
/// becomes a status.
template <class Body>
nearmesh_status guarded(nearmesh_error* error, Body&& body) noexcept {
  const FloatGuard guard;
  try {
    return tell(error, body());
  } catch (const std::bad_alloc&) {
    return tell(error, NEARMESH_OUT_OF_MEMORY, "out of memory");
  } catch (const std::exception& fault) {
    return tell(error, NEARMESH_INTERNAL, fault.what());
  } catch (...) {
    return tell(error, NEARMESH_INTERNAL, "an exception of unknown type");
  }
}

/// The same of a handle: checked, and used by one thread at a time.
template <class Handle, class Body>
nearmesh_status guarded(Handle* handle, nearmesh_error* error, Body&& body) noexcept {
  return guarded(error, [&]() -> Status {
    NEARMESH_RETURN_IF_ERROR(check_handle(handle));
    const Use use(handle->in_use);
    if (!use.had()) return Use::refusal(Handle::kKind);
    return body();
  });
}

/// No option struct is shorter or longer: what claims to be was never initialised.
inline constexpr std::size_t kLeastOptions = 2 * sizeof(std::size_t), kMostOptions = 1 << 16;

/// A struct of options as this library knows it, of one that may be shorter or longer. `options`
/// has the defaults.
template <class Options>
[[nodiscard]] Status read_options(const Options* given, const char* name, Options& options) {
  static_assert(std::is_trivially_copyable_v<Options>);
  static_assert(sizeof(Options) % 8 == 0, "a hole at the end would be taken for a field");
  if (given == nullptr) return Status::ok();
  const std::size_t size = given->size;
  if (size < kLeastOptions || size > kMostOptions)
    return {StatusCode::kInvalidArgument, std::string(name) + ": size is " + std::to_string(size) +
                                              ", expected what " + name + "_init() sets"};
  const auto* bytes = reinterpret_cast<const unsigned char*>(given);
  for (std::size_t i = sizeof(Options); i < size; ++i)
    if (bytes[i] != 0)
      return {StatusCode::kUnsupported,
              std::string(name) + ": byte " + std::to_string(i) + " is set, this library knows " +
                  std::to_string(sizeof(Options)) + ": the program needs a newer one"};
  std::memcpy(static_cast<void*>(&options), given, std::min(size, sizeof(Options)));
  options.size = sizeof(Options);
  return Status::ok();
}

/// The defaults into a struct of `size` bytes; what this library does not know is 0.
template <class Options>
nearmesh_status init_options(Options* options, std::size_t size, Options defaults) noexcept {
  if (options == nullptr || size < kLeastOptions || size > kMostOptions)
    return NEARMESH_INVALID_ARGUMENT;
  std::memset(static_cast<void*>(options), 0, size);
  defaults.size = size;
  std::memcpy(static_cast<void*>(options), &defaults, std::min(size, sizeof(Options)));
  return NEARMESH_OK;
}

}  // namespace nearmesh::c
