// SPDX-License-Identifier: Apache-2.0
#pragma once
// One binary holds code for several instruction sets and takes the best that the processor has:
// here each of them.

#include <gtest/gtest.h>
#include <hwy/targets.h>

#include <cstdint>

namespace nearmesh::test {

/// Runs the body once for each instruction set that this processor has.
template <class Body>
void for_each_instruction_set(const Body& body) {
  int sets = 0;
  for (std::int64_t left = hwy::SupportedTargets(); left != 0; left &= left - 1) {
    const std::int64_t target = left & -left;
    SCOPED_TRACE(hwy::TargetName(target));
    hwy::SetSupportedTargetsForTest(target);
    body();
    hwy::SetSupportedTargetsForTest(0);
    ++sets;
  }
  EXPECT_GE(sets, 1);
}

}  // namespace nearmesh::test
