// SPDX-License-Identifier: Apache-2.0
#pragma once
// A trajectory that nearmesh-demo-flights wrote, for peers that are no nearmesh-subscriber.

#include <stdexcept>
#include <string>
#include <vector>

#include "core/base/csv.hpp"
#include "nearmesh/core/geometry/motion.hpp"

namespace nearmesh::test {

/// One motion a row; velocities are those to the next row at `rate_hz` rows a second. Throws
/// std::runtime_error.
inline std::vector<Motion> read_trajectory(const std::string& path, double rate_hz) {
  const Result<CsvTable> read = CsvTable::read(path);
  if (!read.is_ok()) throw std::runtime_error(read.status().message());
  const CsvTable& table = read.value();
  std::vector<Motion> motions;
  for (std::size_t row = 0; row < table.row_count(); ++row) {
    Motion motion;
    for (std::size_t i = 0; i < 12; ++i) {
      const std::string name =
          i < 9 ? "R" + std::to_string(i / 3) + std::to_string(i % 3) : "T" + std::to_string(i - 9);
      (i < 9 ? motion.pose.rotation[i] : motion.pose.translation_m[i - 9]) =
          table.number(row, table.column(name)).value();
    }
    motions.push_back(motion);
  }
  for (std::size_t row = 0; row + 1 < motions.size(); ++row)
    for (std::size_t k = 0; k < 3; ++k)
      motions[row].linear_velocity_mps[k] =
          rate_hz * (motions[row + 1].pose.translation_m[k] - motions[row].pose.translation_m[k]);
  return motions;
}

}  // namespace nearmesh::test
