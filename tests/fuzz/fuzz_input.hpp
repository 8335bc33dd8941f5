// SPDX-License-Identifier: Apache-2.0
#pragma once
// What every fuzz target shares: numbers taken off the fuzzer's bytes, and a check that stops it.

#include <array>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <span>
#include <type_traits>

/// Stops the target, in every build, so that the fuzzer keeps the input.
#define FUZZ_CHECK(condition)                                                                 \
  ((condition)                                                                                \
       ? static_cast<void>(0)                                                                 \
       : (std::fprintf(stderr, "%s:%d: does not hold: %s\n", __FILE__, __LINE__, #condition), \
          std::abort()))

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size);

namespace nearmesh::fuzz {

/// Takes numbers off the front of the bytes; zeros once they are used up.
class FuzzInput {
 public:
  FuzzInput(const std::uint8_t* data, std::size_t size) : rest_(data, size) {}

  [[nodiscard]] bool is_empty() const { return rest_.empty(); }
  [[nodiscard]] std::span<const std::uint8_t> rest() const { return rest_; }

  /// The next bytes, fewer at the end.
  std::span<const std::uint8_t> bytes(std::size_t count) {
    const auto taken = rest_.first(count < rest_.size() ? count : rest_.size());
    rest_ = rest_.subspan(taken.size());
    return taken;
  }
  /// Any number or double, as its bytes stand.
  template <class T>
  T number() {
    static_assert(std::is_trivially_copyable_v<T>);
    std::array<std::uint8_t, sizeof(T)> raw{};
    const auto taken = bytes(sizeof(T));
    if (!taken.empty()) std::memcpy(raw.data(), taken.data(), taken.size());
    T value;
    std::memcpy(&value, raw.data(), sizeof(T));
    return value;
  }
  std::uint8_t byte() { return number<std::uint8_t>(); }
  /// In [0, bound), bound in [1, 2^16].
  std::uint32_t below(std::uint32_t bound) {
    return bound <= 256 ? byte() % bound : number<std::uint16_t>() % bound;
  }

 private:
  std::span<const std::uint8_t> rest_;
};

}  // namespace nearmesh::fuzz
