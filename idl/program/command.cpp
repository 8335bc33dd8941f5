// SPDX-License-Identifier: Apache-2.0
#include "command.hpp"

#include <unistd.h>

#include <cstdio>
#include <cstdlib>

#include "idl/messages/process_name.hpp"
#include "logging.hpp"
#include "nearmesh/idl/messages/topics.hpp"

namespace nearmesh::wire::program {
namespace {

struct Given {
  std::string config;
  bool print = false, json = false;
  std::vector<std::pair<std::string, std::vector<std::string>>> flags;
};

void require(const Status& status) {
  if (!status.is_ok()) throw CLI::ValidationError(status.message());
}

void apply(Settings& settings, const Given& given) {
  const char* variable = std::getenv("NEARMESH_CONFIG");
  const std::string file = !given.config.empty() ? given.config : variable ? variable : "";
  if (!file.empty()) require(settings.read_file(file));
  require(settings.read_environment(::environ));
  for (const auto& [key, values] : given.flags) require(settings.set_flag(key, values));
}

std::string transport_names() {
  std::string names;
  for (const wire::Transport transport : wire::kTransports)
    names += std::string(names.empty() ? "" : ", ") + wire::to_string(transport);
  return names;
}

}  // namespace

void add_transport_settings(Settings& settings, wire::TransportOptions& transport) {
  settings.add("domain", transport.domain, 0, 232, "DDS domain");
  settings.add("name", transport.name,
               "What this process is called in logs, status, reports and recordings",
               "1 to 63 of printable ASCII; unset: HOST/PROCESS", wire::check_process_name);
  settings.add("prefix", transport.prefix, "First part of every topic's name",
               "1 to 100 letters, digits, '_', '-' or inner '/'", wire::check_prefix);
  settings.add_text(
      "transport",
      [&transport](const std::string& name) { transport.transport = *wire::transport_of(name); },
      [&transport] { return std::string(wire::to_string(transport.transport)); },
      "How bytes travel, and which settings go with that: docs/operate.md, Transports",
      transport_names(),
      [](const std::string& name) {
        if (wire::transport_of(name)) return Status::ok();
        return Status{StatusCode::kInvalidArgument,
                      "expected one of " + transport_names() + ", found " + name};
      });
  settings.add("interface", transport.interface,
               "Use one network interface only; 127.0.0.1 needs no network",
               "address or name; empty: all");
  settings.add("security", transport.security,
               "Join with this program's identity, and hear nobody without one",
               "folder, made by nearmesh-publisher make-security; empty: none");
  settings.add("peer", transport.initial_peers,
               "Addresses to look for others at, where multicast does not get through",
               "IPv4 addresses; with tcp also ADDRESS:PORT");
  settings.add("discovery_server", transport.discovery_server,
               "Find others through this Fast DDS discovery server alone",
               "ADDRESS or ADDRESS:PORT; empty: none");
  settings.add("listen_port", transport.listen_port, 0, 65535,
               "With tcp: the port to listen at; 0: do not listen");
  settings.add("participants_per_peer", transport.participants_per_peer, 1, 120,
               "Processes that are looked for at each address of peer");
  settings.add("lease_s", transport.lease_s, 0.2, 3600,
               "A process silent for so long is forgotten, and joins anew");
  settings.add("silence_s", transport.silence_s, 0.2, 3600,
               "A process silent for so long is taken for lost until it is heard again; above "
               "announcement_s");
  settings.add("announcement_s", transport.announcement_s, 0.05, 1800,
               "Period of life signs, at most half of lease_s");
  settings.add("identity_period_s", transport.identity_period_s, 0.25, 60,
               "How often all certificates are looked at: expired, or revoked?");
  settings.add("heartbeat_s", transport.heartbeat_s, 0.005, 60,
               "How soon a lost datagram is noticed");
}

void apply_preset(Settings& settings, const wire::TransportOptions& transport) {
  const wire::TransportOptions preset = wire::preset_of(transport.transport);
  const std::string name = wire::to_string(transport.transport);
  settings.set_preset("silence_s", preset.silence_s, name);
  settings.set_preset("announcement_s", preset.announcement_s, name);
  settings.set_preset("heartbeat_s", preset.heartbeat_s, name);
}

void add_flags(CLI::App& command, const std::shared_ptr<Settings>& settings,
               std::function<void()> ready, const std::string& positional) {
  const auto given = std::make_shared<Given>();
  for (const Settings::Shown& setting : settings->show()) {
    const std::string name = setting.key == positional ? setting.key : flag_of(setting.key);
    const std::string built_in = setting.built_in.empty() || setting.built_in == ""
                                     ? ""
                                     : "; default " + setting.built_in.dump();
    const std::string help = setting.help + " (" + setting.values + built_in + ")";
    if (!setting.is_list) {
      command
          .add_option_function<std::string>(
              name,
              [given, key = setting.key](const std::string& value) {
                given->flags.push_back({key, {value}});
              },
              help)
          ->type_name("VALUE");
      continue;
    }
    command
        .add_option_function<std::vector<std::string>>(
            name,
            [given, key = setting.key](const std::vector<std::string>& values) {
              given->flags.emplace_back(key, values);
            },
            help)
        ->type_name(name == setting.key ? "FILE" : "VALUE")
        ->allow_extra_args(name == setting.key);
  }
  command.add_option("--config", given->config,
                     "YAML file of settings (default: the one that NEARMESH_CONFIG names)");
  command.add_flag("--print-config", given->print,
                   "Print each setting and where it came from, and end");
  CLI::Option* json = command.get_option_no_throw("--json");
  if (json == nullptr)
    json = command.add_flag("--json", given->json, "With --print-config: print JSON");
  command.parse_complete_callback([settings, given, json, ready = std::move(ready)] {
    apply(*settings, *given);
    ready();
    if (!given->print) return;
    const std::string text =
        json->count() > 0 ? settings->as_json().dump(2) + "\n" : settings->as_yaml();
    std::fputs(text.c_str(), stdout);
    throw CLI::Success();
  });
}

void add_bus_flags(CLI::App& command, const std::shared_ptr<Settings>& settings,
                   const wire::TransportOptions& transport, std::vector<std::string> rooms,
                   std::function<void()> preset, const std::string& positional) {
  const auto levels = std::make_shared<std::vector<std::string>>(1, "info");
  rooms.emplace_back(kFastDdsRoom);
  add_log_setting(*settings, *levels, rooms);
  add_flags(
      command, settings,
      [&transport, levels, preset = std::move(preset), known = settings.get()] {
        apply_preset(*known, transport);
        if (preset) preset();
        set_log_levels(*levels);
      },
      positional);
}

}  // namespace nearmesh::wire::program
