// SPDX-License-Identifier: Apache-2.0
// nearmesh-model: makes, inspects and queries progressive model files, without a network.

#include <cstdio>
#include <exception>

#include "commands.hpp"

int main(int argc, char** argv) {
  CLI::App app{"Makes, inspects and queries nearmesh model files (.spm).", "nearmesh-model"};
  app.require_subcommand(1);
  app.fallthrough(false);
  nearmesh::program::Action action;
  nearmesh::program::add_generate(app, action);
  nearmesh::program::add_build(app, action);
  nearmesh::program::add_info(app, action);
  nearmesh::program::add_export(app, action);
  nearmesh::program::add_query(app, action);
  nearmesh::program::add_check(app, action);
  try {
    app.parse(argc, argv);
    const nearmesh::Status status = action();
    if (status.is_ok()) return 0;
    std::fprintf(stderr, "nearmesh-model: %s\n", status.message().c_str());
    return 1;
  } catch (const CLI::ParseError& error) {
    const int code = app.exit(error);
    return code == 0 ? 0 : 2;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "nearmesh-model: %s\n", error.what());
    return 1;
  }
}
