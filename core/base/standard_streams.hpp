// SPDX-License-Identifier: Apache-2.0
#pragma once
// Standard output as a stream that may fail, and what a program does where it was started without
// one.

#include "nearmesh/core/base/status.hpp"

namespace nearmesh {

/// Opens what the caller closed of standard input, output and error, so that no file of the program
/// takes their number and gets what is printed: on such a stream every write fails. First of all in
/// a program.
void keep_standard_streams();

/// Writes what was printed until now. Errors: kIo when that or anything printed before could not be
/// written.
[[nodiscard]] Status flush_standard_output();

}  // namespace nearmesh
