// SPDX-License-Identifier: Apache-2.0
#pragma once
// How often tests try what they draw at random, or what takes the same steps each time.

namespace nearmesh::test {

#ifdef __SANITIZE_ADDRESS__
inline constexpr bool kSanitized = true;
#else
inline constexpr bool kSanitized = false;
#endif

/// As many as that; under the address sanitizer a tenth, which takes the same steps: there they
/// must only read and overflow nothing. That all answers are right, the other builds show.
constexpr int rounds(int count) { return !kSanitized ? count : count < 10 ? 1 : count / 10; }

}  // namespace nearmesh::test
