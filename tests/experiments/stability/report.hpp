// SPDX-License-Identifier: Apache-2.0
#pragma once
// Counts of marks by scene and system, and the files made of them: results.csv, failures.csv,
// systems.csv, scale.csv. make_page.py makes docs/stability.md and its picture of these.

#include <array>
#include <string>
#include <vector>

#include "case.hpp"
#include "nearmesh/core/base/status.hpp"

namespace nearmesh::stability {

/// One cell of the table.
struct Tally {
  std::string scene, title, system;
  std::array<std::uint64_t, 6> marks{};  ///< by Mark

  [[nodiscard]] std::uint64_t count(Mark mark) const {
    return marks[static_cast<std::size_t>(mark)];
  }
  [[nodiscard]] std::uint64_t cases() const;
  /// Right, or honestly undecided.
  [[nodiscard]] std::uint64_t right() const {
    return count(Mark::kRight) + count(Mark::kUndecided);
  }
  [[nodiscard]] bool is_applicable() const { return count(Mark::kNotApplicable) < cases(); }
};

struct Failure {
  std::string scene, system, name, expected, found;
};

struct SystemNote {
  std::string name, version, call;
};

/// One row of F14's own table.
struct ScaleRow {
  std::string system;
  std::uint64_t faces = 0;
  double prepare_s = 0;       ///< once, offline (nearmesh: clean, bake, write)
  double first_answer_s = 0;  ///< from the mesh or the model file at hand to the first answer
  std::uint64_t memory_bytes = 0;
};

struct Report {
  std::vector<SystemNote> systems;
  std::vector<Tally> tallies;     ///< scene by scene, systems in order
  std::vector<Failure> failures;  ///< the first few of each cell
  std::vector<ScaleRow> scale;    ///< empty when F14 was not asked for
};

/// Writes the tables into the folder, which is made where it is not there; scale.csv only when
/// there are rows. Errors: kIo.
[[nodiscard]] Status write_report(const Report& report, const std::string& folder);

}  // namespace nearmesh::stability
