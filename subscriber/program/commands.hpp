// SPDX-License-Identifier: Apache-2.0
#pragma once
// Subcommands of nearmesh-subscriber. Each adds its options to the program and, when it was chosen, leaves what to do in
// `chosen`.

#include <CLI/CLI.hpp>
#include <array>
#include <csignal>
#include <functional>

#include "nearmesh/core/base/status.hpp"
#include "nearmesh/idl/dds/transport_options.hpp"

namespace nearmesh::subscriber::program {

/// Set by SIGINT and SIGTERM.
extern volatile std::sig_atomic_t stop_requested;

/// Rooms of the log (--log ROOM=LEVEL).
inline constexpr std::array<const char*, 2> kRooms{"session", "record"};

/// How to join the bus, and what to log, as settings (--config, --print-config). Call last, when the command has its
/// other options; the transport must live as long as the command.
void add_transport_options(CLI::App& command, wire::TransportOptions& transport);

void add_run_command(CLI::App& app, std::function<Status()>& chosen);
void add_record_command(CLI::App& app, std::function<Status()>& chosen);
void add_info_command(CLI::App& app, std::function<Status()>& chosen);
void add_verify_command(CLI::App& app, std::function<Status()>& chosen);
void add_export_command(CLI::App& app, std::function<Status()>& chosen);
void add_report_command(CLI::App& app, std::function<Status()>& chosen);
void add_status_command(CLI::App& app, std::function<Status()>& chosen);
void add_doctor_command(CLI::App& app, std::function<Status()>& chosen);

}  // namespace nearmesh::subscriber::program
