// SPDX-License-Identifier: Apache-2.0
// nearmesh-subscriber: its commands. Each is a thin user of the subscriber library.

#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/spdlog.h>

#include <CLI/CLI.hpp>
#include <csignal>
#include <exception>

#include "commands.hpp"

namespace nearmesh::subscriber {

volatile std::sig_atomic_t stop_requested = 0;

namespace {
void request_stop(int) { stop_requested = 1; }
}  // namespace

void add_transport_options(CLI::App& command, wire::TransportOptions& transport) {
  command.add_option("--domain", transport.domain, "DDS domain")
      ->capture_default_str()
      ->check(CLI::Range(0, 232));
  command.add_option("--prefix", transport.prefix, "First part of every topic's name")
      ->capture_default_str();
  command.add_option(
      "--interface", transport.interface,
      "Use one network interface only, by address or name; 127.0.0.1 needs no network");
  command.add_option(
      "--peer", transport.initial_peers,
      "Address to look for publishers at, where multicast does not get through; repeatable");
}
}  // namespace nearmesh::subscriber

int main(int argc, char** argv) {
  using namespace nearmesh::subscriber;
  CLI::App app{
      "A nearmesh peer: answers frame by frame whether bodies touch, and records sessions.",
      "nearmesh-subscriber"};
  app.require_subcommand(1);
  std::function<nearmesh::Status()> chosen;
  add_run_command(app, chosen);
  add_record_command(app, chosen);
  add_info_command(app, chosen);
  add_verify_command(app, chosen);
  try {
    spdlog::set_default_logger(spdlog::stderr_color_mt("nearmesh-subscriber"));
    spdlog::set_pattern("%H:%M:%S %n %^%l%$: %v");
    app.parse(argc, argv);
    std::signal(SIGINT, request_stop);
    std::signal(SIGTERM, request_stop);
    const nearmesh::Status status = chosen();
    if (status.is_ok()) return 0;
    spdlog::error("{}", status.message());
    return 1;
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "nearmesh-subscriber: %s\n", error.what());
    return 1;
  }
}
