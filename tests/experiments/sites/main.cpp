// SPDX-License-Identifier: Apache-2.0
// nearmesh-plan-sites: what thousands of peers at several sites cost, from measured costs, the
// product's message sizes and a simulation with its broad phase. Prints the tables of
// docs/sites.md, or writes them into it; or an allow list for a router.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <fstream>
#include <iostream>
#include <sstream>

#include "core/command/run_program.hpp"
#include "tables.hpp"

namespace {

using namespace nearmesh;

Result<std::string> read(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  std::ostringstream text;
  text << in.rdbuf();
  if (!in) return Status(StatusCode::kIo, path + ": cannot be read");
  return text.str();
}

Status write(const std::string& path, const std::string& text) {
  std::ofstream out(path, std::ios::binary);
  out << text;
  out.close();
  return out ? Status::ok() : Status(StatusCode::kIo, path + ": cannot be written");
}

struct Options {
  sites::Scenario scenario;
  std::string docs = NEARMESH_SITES_DOCS, page, allow_list;
};

Status plan(const Options& options) {
  if (!options.allow_list.empty()) {
    std::cout << sites::allow_list(options.allow_list);
    return Status::ok();
  }
  const auto inputs = sites::Inputs::read(options.docs);
  NEARMESH_RETURN_IF_ERROR(inputs);
  const auto tables = sites::make_tables(inputs.value(), options.scenario);
  NEARMESH_RETURN_IF_ERROR(tables);
  if (options.page.empty()) {
    for (const sites::Table& table : tables.value())
      std::cout << table.name << "\n\n" << table.text << "\n";
    return Status::ok();
  }
  const auto page = read(options.page);
  NEARMESH_RETURN_IF_ERROR(page);
  const auto written = sites::with_tables(page.value(), tables.value());
  NEARMESH_RETURN_IF_ERROR(written);
  return write(options.page, written.value());
}

}  // namespace

int main(int argc, char** argv) {
  Options options;
  CLI::App app(
      "Plans an exercise of several sites: tables of what discovery, poses, promises and requests "
      "cost.");
  app.add_option("--peers", options.scenario.peers, "a body each");
  app.add_option("--sites-a-side", options.scenario.sites_a_side,
                 "sites share the world as squares");
  app.add_option("--cells-a-side", options.scenario.cells_a_side, "layouts of domains")
      ->delimiter(',');
  app.add_option("--side-m", options.scenario.side_m, "of the world");
  app.add_option("--gathered", options.scenario.gathered, "share of flights that go to a hub");
  app.add_option("--rate", options.scenario.frame_rate_hz, "frames a second");
  app.add_option("--seconds", options.scenario.duration_s, "that are simulated");
  app.add_option("--seed", options.scenario.seed, "of the flights");
  app.add_option("--docs", options.docs,
                 "folder of sites/ and network/, where what was measured lies");
  app.add_option("--page", options.page, "write the tables into this page instead");
  app.add_option("--allow-list", options.allow_list,
                 "print a router's allow list for topics of this prefix, and nothing else");
  return run_program(app, argc, argv, [&]() -> Outcome { return plan(options); });
}
