// SPDX-License-Identifier: Apache-2.0
// nearmesh-subscriber: its commands. Each is a thin user of the subscriber library.

#include <CLI/CLI.hpp>
#include <csignal>
#include <exception>
#include <memory>

#include "commands.hpp"
#include "idl/program/command.hpp"
#include "idl/program/logging.hpp"

namespace nearmesh::subscriber::program {

volatile std::sig_atomic_t stop_requested = 0;

namespace {
void request_stop(int) { stop_requested = 1; }
}  // namespace

void add_transport_options(CLI::App& command, wire::TransportOptions& transport) {
  const auto settings = std::make_shared<wire::program::Settings>();
  const auto levels = std::make_shared<std::vector<std::string>>(1, "info");
  wire::program::add_transport_settings(*settings, transport);
  wire::program::add_log_setting(*settings, *levels, {kRooms.begin(), kRooms.end()});
  wire::program::add_flags(command, settings, [&transport, levels, known = settings.get()] {
    wire::program::apply_preset(*known, transport);
    wire::program::set_log_levels(*levels);
  });
}

}  // namespace nearmesh::subscriber::program

int main(int argc, char** argv) {
  using namespace nearmesh::subscriber::program;
  CLI::App app{
      "A nearmesh peer: answers frame by frame whether bodies touch, and records sessions.",
      "nearmesh-subscriber"};
  app.require_subcommand(1);
  std::function<nearmesh::Status()> chosen;
  add_run_command(app, chosen);
  add_record_command(app, chosen);
  add_info_command(app, chosen);
  add_verify_command(app, chosen);
  add_export_command(app, chosen);
  add_report_command(app, chosen);
  add_status_command(app, chosen);
  add_doctor_command(app, chosen);
  try {
    nearmesh::wire::program::begin_logging("nearmesh-subscriber");
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
