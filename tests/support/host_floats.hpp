// SPDX-License-Identifier: Apache-2.0
#pragma once
// Floating-point environments that a host may have set before it calls us.

#include <gtest/gtest.h>

#include <cfenv>
#include <cstdint>
#include <iterator>
#include <span>

#include "instruction_sets.hpp"
#include "rounds.hpp"

namespace nearmesh::test {

/// The two registers of the processor that say how it computes.
struct HostFloats {
  const char* name;
  std::uint32_t mxcsr;
  std::uint16_t control_word;

  [[nodiscard]] static HostFloats now() {
    HostFloats found{"now", 0, 0};
    asm volatile("stmxcsr %0\n\tfnstcw %1"
                 : "=m"(found.mxcsr), "=m"(found.control_word)
                 :
                 : "memory");
    return found;
  }
  /// And the old unit has an exception raised (the root of pi is not exact), which waits to trap
  /// where that is let.
  void set() const {
    const std::uint16_t plain = 0x037f;
    asm volatile("fnclex\n\tfldcw %2\n\tfldpi\n\tfsqrt\n\tfstp %%st(0)\n\tldmxcsr %0\n\tfldcw %1"
                 :
                 : "m"(mxcsr), "m"(control_word), "m"(plain)
                 : "memory", "st", "st(1)", "st(2)", "st(3)", "st(4)", "st(5)", "st(6)", "st(7)");
  }
};
inline constexpr HostFloats kPlainFloats{"plain", 0x1f80, 0x037f};
inline constexpr HostFloats kHostFloats[] = {
    {"FE_UPWARD", 0x5f80, 0x0b7f},
    {"FE_DOWNWARD", 0x3f80, 0x077f},
    {"FE_TOWARDZERO", 0x7f80, 0x0f7f},
    {"flush to zero", 0x9f80, 0x037f},
    {"denormals are zeros", 0x1fc0, 0x037f},
    {"all exceptions trap", 0x0000, 0x0340},
    {"an exception was raised", 0x1f84, 0x037f},
    {"all of it, in single precision", 0xe040, 0x0c40},
};

/// `work` must give the same in each environment, on each instruction set, and leave the
/// environment as it was. It must not compute by itself, as that would trap.
template <class Work>
void expect_same_under_all_floats(const Work& work) {
  const auto expected = work();
  for_each_instruction_set([&] {
    for (const HostFloats& host : std::span(kHostFloats).last(rounds(std::size(kHostFloats)))) {
      SCOPED_TRACE(host.name);
      host.set();
      const auto found = work();
      const HostFloats left = HostFloats::now();
      kPlainFloats.set();
      EXPECT_EQ(found, expected);
      EXPECT_EQ(left.mxcsr, host.mxcsr);
      EXPECT_EQ(left.control_word, host.control_word);
    }
  });
}

}  // namespace nearmesh::test
