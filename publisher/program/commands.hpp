// SPDX-License-Identifier: Apache-2.0
#pragma once
// Subcommands of nearmesh-publisher. Each adds its options to the program and, when it was chosen, leaves what to do in
// `chosen`.

#include <CLI/CLI.hpp>
#include <csignal>
#include <functional>

#include "nearmesh/core/base/status.hpp"

namespace nearmesh::publisher::program {

/// Set by SIGINT and SIGTERM.
extern volatile std::sig_atomic_t stop_requested;

void add_serve_command(CLI::App& app, std::function<Status()>& chosen);
void add_replay_command(CLI::App& app, std::function<Status()>& chosen);
/// make-security and check-security.
void add_security_commands(CLI::App& app, std::function<Status()>& chosen);

}  // namespace nearmesh::publisher::program
