// SPDX-License-Identifier: Apache-2.0
#pragma once
// The tables of docs/sites.md: what was measured, what the simulation computes from that, and what
// is guessed.

#include <string>
#include <vector>

#include "facts.hpp"
#include "simulation.hpp"

namespace nearmesh::sites {

/// As pages write numbers: thousands apart, else three digits.
[[nodiscard]] std::string number(double x);

struct Table {
  /// "measured-...", "computed-...", "guessed"; or of topics: "allow-list", "topics".
  std::string name;
  std::string text;  ///< lines of Markdown
};

/// What was measured.
struct Inputs {
  Measured measured;                  ///< everybody finds everybody
  std::vector<Measured::Row> server;  ///< through a discovery server
  Asking asking;

  /// From docs/sites and docs/network below `docs`. Errors: those of Measured::read and
  /// Asking::read.
  [[nodiscard]] static Result<Inputs> read(const std::string& docs);
};

/// Runs the scenario, and some with fewer peers. Errors: those of check().
[[nodiscard]] Result<std::vector<Table>> make_tables(const Inputs& inputs,
                                                     const Scenario& scenario);

/// The page with these tables, each between "<!-- table NAME -->" and "<!-- end -->".
/// Errors: kInvalidArgument naming a table that has no such place, or a place without its table.
[[nodiscard]] Result<std::string> with_tables(const std::string& page,
                                              const std::vector<Table>& tables);

}  // namespace nearmesh::sites
