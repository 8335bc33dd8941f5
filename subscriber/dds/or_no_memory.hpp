// SPDX-License-Identifier: Apache-2.0
#pragma once
// For threads of ours.

#include <new>

#include "nearmesh/core/base/status.hpp"

namespace nearmesh::subscriber {

/// Of a thread of ours, which nothing may leave: what `step` says; kIo where there is no memory for
/// it.
template <class Step>
[[nodiscard]] Status or_no_memory(Step step) {
  try {
    return step();
  } catch (const std::bad_alloc&) {
    return {StatusCode::kIo, "no memory"};
  }
}

}  // namespace nearmesh::subscriber
