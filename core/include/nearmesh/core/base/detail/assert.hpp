// SPDX-License-Identifier: Apache-2.0
#pragma once
// Checks of the caller's own duties. On in Debug and RelWithDebInfo, off where NDEBUG is defined.

#include <cstdio>
#include <cstdlib>

#ifdef NDEBUG
#define NEARMESH_ASSERT(condition) static_cast<void>(0)
#else
#define NEARMESH_ASSERT(condition)                                                         \
  ((condition) ? static_cast<void>(0)                                                      \
               : (std::fprintf(stderr, "%s:%d: nearmesh assertion failed: %s\n", __FILE__, \
                               __LINE__, #condition),                                      \
                  std::abort()))
#endif
