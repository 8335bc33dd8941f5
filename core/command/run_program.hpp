// SPDX-License-Identifier: Apache-2.0
#pragma once
// What the mains of all programs do: from the command line to the exit code.

#include <CLI/CLI.hpp>
#include <functional>
#include <string>

#include "outcome.hpp"

namespace nearmesh {

/// What a program does once its command line was read: set by the chosen verb's callback.
using Action = std::function<Outcome()>;

/// Parses, runs what was chosen, and says in one line on standard error what went wrong. Out: the exit code: 0; the action's where
/// that failed; 1 where what it printed could not be written; 2 for wrong usage. `--help` and `--version`, of the program and of
/// each verb, end with 0, or 1 likewise. `libraries`: what `--version` adds behind the project's version, on lines of its own.
[[nodiscard]] int run_program(CLI::App& app, int argc, char** argv, const Action& chosen,
                              const std::string& libraries = {});

}  // namespace nearmesh
