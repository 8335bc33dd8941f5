// SPDX-License-Identifier: Apache-2.0
#pragma once
// A program's log on standard error: one logger for each room, each with a level of its own.
// Nothing is logged each frame unless a level of debug is asked for.

#include <spdlog/spdlog.h>

#include <string>
#include <vector>

#include "nearmesh/idl/dds/transport_options.hpp"
#include "settings.hpp"

namespace nearmesh::wire::program {

/// The room of what Fast DDS itself logs, at level error where nothing is said of it.
inline constexpr const char* kFastDdsRoom = "fastdds";

/// Until set_log_levels: level info. Fast DDS's own log comes here too, after a burst one line a
/// second.
void begin_logging(const std::string& program);
/// Adds the setting "log": levels as "LEVEL" for all, or "LOGGER=LEVEL" of those named here; the
/// later wins.
void add_log_setting(Settings& settings, std::vector<std::string>& levels,
                     const std::vector<std::string>& rooms);
/// In: what passed the setting's check.
void set_log_levels(const std::vector<std::string>& levels);
/// The logger of a room. Threads: all.
[[nodiscard]] spdlog::logger& log(const std::string& room);
/// The first line of a program that stays on the bus: which Fast DDS it is, and whether a fault in
/// that ends the process.
void log_fastdds();
/// The next: why others may not be found, where the machine's network gives a reason.
void log_network(const TransportOptions& transport);
/// "wire version 8\nFast DDS 2.9.1, with live assertions": what --version of a program that speaks
/// DDS adds.
[[nodiscard]] std::string dds_versions();

}  // namespace nearmesh::wire::program
