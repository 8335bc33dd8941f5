// SPDX-License-Identifier: Apache-2.0
#pragma once
// The commands of nearmesh-model. Each adds its options to the program and, if chosen, runs; a Status that is not ok
// becomes one line on standard error and exit code 1 (wrong usage: 2).

#include <CLI/CLI.hpp>
#include <functional>

#include "nearmesh/core/base/status.hpp"

namespace nearmesh::program {

/// What main runs after parsing: set by the chosen command.
using Action = std::function<Status()>;

void add_generate(CLI::App& app, Action& chosen);
void add_build(CLI::App& app, Action& chosen);
void add_info(CLI::App& app, Action& chosen);
void add_export(CLI::App& app, Action& chosen);
void add_query(CLI::App& app, Action& chosen);
void add_check(CLI::App& app, Action& chosen);

}  // namespace nearmesh::program
