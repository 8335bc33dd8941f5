// SPDX-License-Identifier: Apache-2.0
#pragma once
// Subcommands of nearmesh-publisher that have a file of their own.

#include <CLI/CLI.hpp>
#include <functional>

#include "nearmesh/core/base/status.hpp"

namespace nearmesh::publisher {

/// make-security and check-security. `chosen` is set to what is to be run when the command line names one of them.
void add_security_commands(CLI::App& app, std::function<Status()>& chosen);

}  // namespace nearmesh::publisher
