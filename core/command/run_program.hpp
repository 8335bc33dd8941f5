// SPDX-License-Identifier: Apache-2.0
#pragma once
// What the mains of all programs do: from the command line to the exit code.

#include <CLI/CLI.hpp>
#include <functional>
#include <initializer_list>
#include <string>

#include "outcome.hpp"

namespace nearmesh {

/// What a program does once its command line was read: set by the chosen verb's callback.
using Action = std::function<Outcome()>;

/// The end of a verb's help: `said`, where there is more to say than its options do, and then
/// commands that are right as they stand, each beginning with the program's name.
/// tests/system/pages/check_commands.py holds them against the options, and asks each verb for one.
void end_help(CLI::App& verb, std::initializer_list<const char*> examples,
              const std::string& said = {});

/// Parses, runs what was chosen, and says in one line on standard error what went wrong. Out: the
/// exit code: 0; the action's where that failed; 1 where what it printed could not be written; 2
/// for wrong usage. `--help` and `--version`, of the program and of each verb, end with 0, or 1
/// likewise. `libraries`: what `--version` adds behind the project's version, on lines of its own.
/// `exit_codes`: what `--help` adds to these three.
[[nodiscard]] int run_program(CLI::App& app, int argc, char** argv, const Action& chosen,
                              const std::string& libraries = {},
                              const std::string& exit_codes = {});

}  // namespace nearmesh
