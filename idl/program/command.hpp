// SPDX-License-Identifier: Apache-2.0
#pragma once
// Settings as flags of a command line, and those that both programs have.

#include <CLI/CLI.hpp>
#include <memory>
#include <string>
#include <vector>

#include "nearmesh/idl/dds/transport_options.hpp"
#include "settings.hpp"

namespace nearmesh::wire::program {

/// How to join the bus. Presets come with the transport: call apply_preset() when all layers have
/// spoken.
void add_transport_settings(Settings& settings, wire::TransportOptions& transport);
void apply_preset(Settings& settings, const wire::TransportOptions& transport);

/// Makes a flag of each setting (those of `positional` stand without one), and --config,
/// --print-config and, where the command has none, --json. When the command line was parsed the
/// layers are applied in their order; what is wrong in any of them is wrong usage
/// (CLI::ValidationError). Then `ready` is called, for what follows from the settings. With
/// --print-config the settings are printed, and the program ends (CLI::Success). Call last, when
/// the command has its other options.
void add_flags(CLI::App& command, const std::shared_ptr<Settings>& settings,
               std::function<void()> ready, const std::string& positional = {});

/// The flags of a verb that joins the bus: `settings`, which hold those of the transport, and what
/// is logged, of `rooms` and of Fast DDS. When all layers have spoken the transport's preset is
/// applied, then `preset` is called. The transport must live as long as the command. Else as
/// add_flags.
void add_bus_flags(CLI::App& command, const std::shared_ptr<Settings>& settings,
                   const wire::TransportOptions& transport, std::vector<std::string> rooms,
                   std::function<void()> preset = {}, const std::string& positional = {});

}  // namespace nearmesh::wire::program
