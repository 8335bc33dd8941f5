// SPDX-License-Identifier: Apache-2.0
#pragma once
// Tables of numbers with a header line, as poses and trajectories come.

#include <string>
#include <string_view>
#include <vector>

#include "nearmesh/core/base/status.hpp"

namespace nearmesh {

/// Comma-separated text whose first line names the columns; cells stay text until they are asked
/// for.
class CsvTable {
 public:
  /// Errors: kIo with the path; kInvalidArgument with path and line where a row's cell count
  /// differs from the header's.
  [[nodiscard]] static Result<CsvTable> read(const std::string& path);

  [[nodiscard]] std::size_t row_count() const { return rows_.size(); }
  /// Place of a column, or npos.
  [[nodiscard]] std::size_t column(std::string_view name) const;
  static constexpr std::size_t npos = static_cast<std::size_t>(-1);

  /// "path:line" of a row, for messages.
  [[nodiscard]] std::string place(std::size_t row) const {
    return path_ + ":" + std::to_string(lines_[row]);
  }
  [[nodiscard]] const std::string& text(std::size_t row, std::size_t column) const {
    return rows_[row][column];
  }
  /// Errors: kInvalidArgument naming path, line, column and what was found instead of a number.
  [[nodiscard]] Result<double> number(std::size_t row, std::size_t column) const;
  /// Errors: kInvalidArgument naming the path and the first column of `names` that is absent.
  [[nodiscard]] Result<std::vector<std::size_t>> columns(
      const std::vector<std::string>& names) const;
  /// That error of a column: the path, its name, and the columns that are there.
  [[nodiscard]] Status missing_column(std::string_view name) const;

 private:
  std::string path_;
  std::vector<std::string> names_;
  std::vector<std::vector<std::string>> rows_;
  std::vector<std::size_t> lines_;
};

}  // namespace nearmesh
