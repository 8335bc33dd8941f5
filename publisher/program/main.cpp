// SPDX-License-Identifier: Apache-2.0
// nearmesh-publisher: serves progressive models to any number of peers over DDS.

#include <CLI/CLI.hpp>
#include <csignal>
#include <exception>

#include "commands.hpp"
#include "idl/program/logging.hpp"

namespace nearmesh::publisher::program {

volatile std::sig_atomic_t stop_requested = 0;

namespace {
void request_stop(int) { stop_requested = 1; }
}  // namespace

}  // namespace nearmesh::publisher::program

int main(int argc, char** argv) {
  using namespace nearmesh::publisher::program;
  CLI::App app{"Serves nearmesh models (.spm) to peers over DDS, and replays recorded sessions.",
               "nearmesh-publisher"};
  app.require_subcommand(1);
  std::function<nearmesh::Status()> chosen;
  add_serve_command(app, chosen);
  add_replay_command(app, chosen);
  add_security_commands(app, chosen);
  try {
    nearmesh::wire::program::begin_logging("nearmesh-publisher");
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
    std::fprintf(stderr, "nearmesh-publisher: %s\n", error.what());
    return 1;
  }
}
