// SPDX-License-Identifier: Apache-2.0
#include "run_program.hpp"

#include <cstdio>
#include <exception>
#include <new>

#include "core/base/standard_streams.hpp"

namespace nearmesh {
namespace {

Status parse_and_run(CLI::App& app, int argc, char** argv, const Action& chosen) {
  try {
    app.parse(argc, argv);
    return chosen();
  } catch (const CLI::ParseError&) {
    throw;
  } catch (const std::bad_alloc&) {
    return {StatusCode::kIo, "no memory"};
  } catch (const std::exception& error) {
    return {StatusCode::kIo, error.what()};
  }
}

}  // namespace

int run_program(CLI::App& app, int argc, char** argv, const Action& chosen,
                const std::string& libraries) {
  keep_standard_streams();
  const std::string version =
      app.get_name() + " " + NEARMESH_VERSION + (libraries.empty() ? "" : "\n" + libraries);
  app.set_version_flag("--version", version, "Print versions, and end");
  for (CLI::App* verb : app.get_subcommands({}))
    verb->set_version_flag("--version", version, "Print versions, and end");
  Status status;
  try {
    status = parse_and_run(app, argc, argv, chosen);
  } catch (const CLI::ParseError& error) {
    if (app.exit(error) != 0) return 2;
  }
  // Before what went wrong is said: both may go to one terminal.
  const Status printed = flush_standard_output();
  if (status.is_ok()) status = printed;
  if (status.is_ok()) return 0;
  std::fprintf(stderr, "%s: %s\n", app.get_name().c_str(), status.message().c_str());
  return 1;
}

}  // namespace nearmesh
