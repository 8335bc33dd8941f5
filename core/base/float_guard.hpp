// SPDX-License-Identifier: Apache-2.0
#pragma once
// The floating-point environment that our arithmetic is proved for, whatever the host's is: a host
// may round otherwise, flush small numbers to zero or let exceptions trap, and the bits of an
// answer would follow.

#include <cfenv>
#include <cstdint>

namespace nearmesh {

/// While it lives: round to nearest, no exception traps, nothing is flushed to zero. Then the
/// environment, the flags of exceptions included, is again as it was found. One stands at the top
/// of each function that a host calls and that computes, and of each thread; nesting costs a few
/// nanoseconds. What we call back runs in our environment. A number that such a function returns
/// goes through keep(): `return guard.keep(sum);`
class FloatGuard {
 public:
  FloatGuard(const FloatGuard&) = delete;
  FloatGuard& operator=(const FloatGuard&) = delete;

  /// The number, computed by now. What is returned in a register is no business of "memory" below:
  /// clang takes the last steps towards it out of the guarded lines.
  [[nodiscard]] double keep(double number) const {
    asm volatile("" : "+m"(number) : : "memory");
    return number;
  }

#if defined(__x86_64__)
  // By hand, as fegetenv() and fesetenv() take ten times as long. "memory": what is computed before
  // and after stays there.
  FloatGuard() {
    asm volatile("stmxcsr %0" : "=m"(vector_) : : "memory");
    if ((vector_ & ~kFlags) != kVectorPlain) load(kVectorPlain);
    // Nothing of ours computes on the old unit, but the C library looks there for how to round what
    // it reads and prints.
    asm volatile("fnstcw %0" : "=m"(old_unit_) : : "memory");
    if (old_unit_ != kOldUnitPlain) {
      // An exception that the host has raised there and then let trap would trap at the first step
      // that waits for it, fldcw.
      const std::uint16_t plain = kOldUnitPlain;
      asm volatile("fnstenv %0\n\tfnclex\n\tfldcw %1"
                   : "=m"(old_environment_)
                   : "m"(plain)
                   : "memory");
    }
  }
  ~FloatGuard() {
    if (old_unit_ != kOldUnitPlain) asm volatile("fldenv %0" : : "m"(old_environment_) : "memory");
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
  std::uint32_t old_environment_[7];  // only where the old unit is not plain
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
