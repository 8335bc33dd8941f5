// SPDX-License-Identifier: Apache-2.0
// nearmesh-publisher: serves progressive models to any number of peers over DDS. Its verbs, their
// flags and their help.

#include <CLI/CLI.hpp>
#include <memory>

#include "commands.hpp"
#include "core/command/run_program.hpp"
#include "idl/program/command.hpp"
#include "idl/program/logging.hpp"
#include "idl/program/metrics.hpp"
#include "nearmesh/idl/messages/topics.hpp"

namespace nearmesh::publisher::program {
namespace {

/// Of header_bytes_per_s on a thin link: 0.8 Mbit/s.
constexpr double kThinHeaderBytesPerSecond = 100'000;

void add_settings(wire::program::Settings& settings, ServeOptions& options) {
  settings.add("models", options.models,
               "What is served; a model's name is its file's or folder's name",
               ".spm files, and folders of worlds");
  settings.add("replaces", options.replaces,
               "Contents whose place a model takes: peers that hold one go over to it, at once, or "
               "all in the "
               "frame of that time on the exercise's clock; epochs count up from 1",
               "MODEL=CONTENT[@EPOCH:TIME]");
  wire::program::add_transport_settings(settings, options.channel.transport);
  settings.add("max_peers", options.channel.max_peers, 1, 100'000,
               "Peers beyond this many are refused");
  settings.add("header_bytes_per_s", options.channel.header_bytes_per_s, 100'000, 1'000'000'000,
               "Pace of mesh headers, all peers together; below the link's rate");
  wire::program::add_metrics_setting(settings, options.metrics);
}

void add_serve_command(CLI::App& app, Action& chosen) {
  const auto options = std::make_shared<ServeOptions>();
  CLI::App* command = app.add_subcommand(
      "serve", "Serve models and worlds until Ctrl-C; a model's name is its file's or folder's.");
  options->channel.transport.listen_port = wire::kDefaultTcpPort;
  const auto settings = std::make_shared<wire::program::Settings>();
  add_settings(*settings, *options);
  wire::program::add_bus_flags(
      *command, settings, options->channel.transport, {"service"},
      [options, known = settings.get()] {
        const wire::Transport transport = options->channel.transport.transport;
        if (transport == wire::Transport::kThin)
          known->set_preset("header_bytes_per_s", kThinHeaderBytesPerSecond,
                            wire::to_string(transport));
      },
      "models");
  end_help(*command, {"nearmesh-publisher serve terrain.spm aircraft.spm --interface eth0",
                      "nearmesh-publisher serve WORLD --config /etc/nearmesh/publisher.yaml",
                      "nearmesh-publisher serve new/terrain.spm --replaces "
                      "terrain=8f1c42d0a97be35561d09f7c2e04ab83"});
  command->callback([options, &chosen] {
    if (options->models.empty()) throw CLI::RequiredError("models");
    chosen = [options] { return run(*options); };
  });
}

void add_replay_command(CLI::App& app, Action& chosen) {
  CLI::App* command = app.add_subcommand(
      "replay",
      "Play a recording (nearmesh-subscriber record) into a live domain, "
      "as it was. Peers that join are answered "
      "with the detail that recorded peers had been sent by then. Obeys lines "
      "of standard input: pause (and again: go on), step (to the next pose), "
      "12.5 (to that second), +5 or -60 (seconds on or back), start, end, quit.");
  const auto options = std::make_shared<ReplayOptions>();
  options->transport.prefix.clear();  // as recorded
  command
      ->add_option("recording", options->path, "Recording (.db3, the first of its files, or .mcap)")
      ->required();
  command
      ->add_option("--rate", options->playhead.rate, "Recorded seconds that are played in a second")
      ->capture_default_str()
      ->check([](const std::string& text) {
        char* end = nullptr;
        const double rate = std::strtod(text.c_str(), &end);
        const bool good = *end == '\0' && std::isfinite(rate) && rate > 0;
        return good ? std::string() : "expected a number above 0, found " + text;
      });
  command
      ->add_option("--start", options->playhead.start_s, "Begin here, seconds into the recording")
      ->capture_default_str();
  command
      ->add_option("--end", options->playhead.end_s,
                   "End here, seconds into the recording (default: after the last sample)")
      ->check(CLI::NonNegativeNumber);
  command->add_flag("--loop", options->loop, "Begin again at the end, until Ctrl-C");
  command
      ->add_option("--topics", options->topics,
                   "Only these: " + CLI::detail::join(wire::recorded_topics(), ", "))
      ->delimiter(',')
      ->check(CLI::IsMember(wire::recorded_topics()));
  command->add_option(
      "--remap", options->remaps,
      "OLD:=NEW, the recorded prefix or a topic and what it is called here; repeatable");
  command->add_option("--models", options->models,
                      "Folder with .spm files: live peers get all detail of these models, so that "
                      "they may fly where no recorded peer was");
  command->add_flag("--json", options->json,
                    "Print one JSON line about what was played at the end");
  const auto settings = std::make_shared<wire::program::Settings>();
  wire::program::add_transport_settings(*settings, options->transport);
  wire::program::add_bus_flags(*command, settings, options->transport, {});
  end_help(*command,
           {"nearmesh-publisher replay flight.db3 --rate 2 --start 10",
            "nearmesh-publisher replay flight.db3 --models models --remap nearmesh:=again"});
  command->callback([options, &chosen] { chosen = [options] { return run(*options); }; });
}

void add_domain_option(CLI::App& command, std::uint32_t& domain) {
  command.add_option("--domain", domain, "DDS domain of the programs")
      ->capture_default_str()
      ->check(CLI::Range(0, 232));
}

void add_discovery_command(CLI::App& app, Action& chosen) {
  const auto options = std::make_shared<DiscoveryOptions>();
  CLI::App* command = app.add_subcommand(
      "discovery",
      "Run a discovery server until Ctrl-C: programs that name it with --discovery-server find "
      "each other through it, and are told only of those that they share topics with.");
  command
      ->add_option("--listen", options->listen,
                   "ADDRESS or ADDRESS:PORT of this machine where it is found (port " +
                       std::to_string(wire::kDefaultServerPort) + ")")
      ->required();
  add_domain_option(*command, options->transport.domain);
  end_help(*command, {"nearmesh-publisher discovery --listen 192.0.2.7 --domain 7"});
  command->callback([options, &chosen] { chosen = [options] { return run(*options); }; });
}

void add_bus_options(CLI::App& command, std::uint32_t& domain, std::string& prefix) {
  add_domain_option(command, domain);
  command.add_option("--prefix", prefix, "First part of every topic's name")->capture_default_str();
}

void add_security_commands(CLI::App& app, Action& chosen) {
  auto making = std::make_shared<MakeSecurityOptions>();
  CLI::App* make_command = app.add_subcommand(
      "make-security", "Make identities for secured programs: keys, certificates, permissions.");
  make_command
      ->add_option("folder", making->folder,
                   "The set; one that exists is added to, with its authorities")
      ->required();
  add_bus_options(*make_command, making->plan.domain, making->plan.prefix);
  make_command->add_option("--publisher", making->publishers, "Names of identities that serve");
  make_command->add_option("--subscriber", making->subscribers,
                           "Names of identities that ask and move bodies");
  make_command->add_option("--recorder", making->recorders, "Names of identities that only listen");
  make_command->add_option("--topic", making->plan.topics,
                           "Other topics that these identities may write and read, as a host's own "
                           "are: flight_sim/state, or flight_sim/* for all that begin so");
  make_command->add_option("--days", making->plan.valid_days, "How many days all of it is valid")
      ->capture_default_str();
  make_command->add_flag("--force", making->plan.force, "Make identities anew that exist");
  make_command->add_option("--revoke", making->revoked,
                           "Revoke all certificates that were made in these names, and make none");
  end_help(*make_command,
           {"nearmesh-publisher make-security keys --domain 7 --publisher server1 "
            "--subscriber alice bob",
            "nearmesh-publisher make-security keys --domain 7 --subscriber sim1 --topic "
            "flight_sim/state",
            "nearmesh-publisher make-security keys --domain 7 --revoke alice"});
  make_command->callback([&chosen, making] { chosen = [making] { return run(*making); }; });

  auto checking = std::make_shared<CheckSecurityOptions>();
  CLI::App* check_command = app.add_subcommand(
      "check-security", "Say what is wrong with an identity's folder, or with all of a set.");
  check_command->add_option("folder", checking->folder, "An identity's folder, or the set's")
      ->required();
  add_bus_options(*check_command, checking->domain, checking->prefix);
  end_help(*check_command, {"nearmesh-publisher check-security keys/server1 --domain 7"});
  check_command->callback([&chosen, checking] { chosen = [checking] { return run(*checking); }; });
}

}  // namespace
}  // namespace nearmesh::publisher::program

int main(int argc, char** argv) {
  using namespace nearmesh::publisher::program;
  nearmesh::wire::program::
      stop_on_signals();  // first: whoever stops it while it starts shall see it end well
  CLI::App app{"Serves nearmesh models (.spm) to peers over DDS, and replays recordings.",
               "nearmesh-publisher"};
  app.require_subcommand(1);
  nearmesh::Action chosen;
  add_serve_command(app, chosen);
  add_replay_command(app, chosen);
  add_discovery_command(app, chosen);
  add_security_commands(app, chosen);
  nearmesh::wire::program::begin_logging(app.get_name());
  return nearmesh::run_program(
      app, argc, argv, [&chosen] { return chosen(); }, nearmesh::wire::program::dds_versions(),
      " 5: this program's identity was revoked or has expired.");
}
