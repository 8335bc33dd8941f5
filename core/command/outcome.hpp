// SPDX-License-Identifier: Apache-2.0
#pragma once
// What a verb of a program comes to. Without CLI11, for the commands themselves.

#include <utility>

#include "nearmesh/core/base/status.hpp"

namespace nearmesh {

/// A status, and the exit code that says so where it is not ok.
struct Outcome {
  Outcome(Status came_to, int code = 1)  // NOLINT: implicit by design
      : status(std::move(came_to)), exit_code(code) {}
  Status status;
  int exit_code;
};

}  // namespace nearmesh
