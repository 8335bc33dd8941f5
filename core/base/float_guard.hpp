// SPDX-License-Identifier: Apache-2.0
#pragma once
// The floating-point environment that our arithmetic is proved for, whatever the host's is: a host may round otherwise,
// flush small numbers to zero or let exceptions trap, and the bits of an answer would follow.

#include <cfenv>
#include <cstdint>

namespace nearmesh {

/// While it lives: round to nearest, no exception traps, nothing is flushed to zero. Then the environment, the flags of
/// exceptions included, is again as it was found. One stands at the top of each function that a host calls and that
/// computes, and of each thread; nesting costs a few nanoseconds. What we call back runs in our environment.
class FloatGuard {
 public:
  FloatGuard(const FloatGuard&) = delete;
  FloatGuard& operator=(const FloatGuard&) = delete;

#if defined(__x86_64__)
  // By hand, as fegetenv() and fesetenv() take ten times as long. "memory": what is computed before and after stays there.
  FloatGuard() {
    asm volatile("stmxcsr %0" : "=m"(vector_) : : "memory");
    if ((vector_ & ~kFlags) != kVectorPlain) load(kVectorPlain);
    // Nothing of ours computes on the old unit, but the C library looks there for how to round what it reads and prints.
    asm volatile("fnstcw %0" : "=m"(old_unit_) : : "memory");
    if (old_unit_ != kOldUnitPlain) {
      std::fegetenv(&environment_);
      const std::uint16_t plain = kOldUnitPlain;
      asm volatile("fldcw %0" : : "m"(plain) : "memory");
    }
  }
  ~FloatGuard() {
    if (old_unit_ != kOldUnitPlain) std::fesetenv(&environment_);
    std::uint32_t now = 0;
    asm volatile("stmxcsr %0" : "=m"(now) : : "memory");
    if (now != vector_) load(vector_);
  }

 private:
  static void load(std::uint32_t vector) { asm volatile("ldmxcsr %0" : : "m"(vector) : "memory"); }

  static constexpr std::uint32_t kFlags = 0x3f, kVectorPlain = 0x1f80;
  static constexpr std::uint16_t kOldUnitPlain = 0x037f;
  std::uint32_t vector_ = 0;
  std::uint16_t old_unit_ = 0;
  std::fenv_t environment_{};  // only where the old unit's is another
#else
  FloatGuard() {
    std::fegetenv(&environment_);
    std::fesetenv(FE_DFL_ENV);
  }
  ~FloatGuard() { std::fesetenv(&environment_); }

 private:
  std::fenv_t environment_{};
#endif
};

}  // namespace nearmesh
