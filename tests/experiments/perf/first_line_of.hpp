// SPDX-License-Identifier: Apache-2.0
#pragma once
// What a command says about the machine and the commit, for the heads of measurements.

#include <cstdio>
#include <string>

namespace nearmesh::perf {

/// The first line that a shell command prints; empty where it cannot be run.
inline std::string first_line_of(const std::string& command) {
  std::string text;
  if (std::FILE* pipe = ::popen(command.c_str(), "r")) {
    for (int c = std::fgetc(pipe); c != EOF && c != '\n'; c = std::fgetc(pipe))
      text += static_cast<char>(c);
    ::pclose(pipe);
  }
  return text;
}

}  // namespace nearmesh::perf
