// SPDX-License-Identifier: Apache-2.0
#include "csv.hpp"

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cstring>
#include <fstream>

namespace nearmesh {
namespace {

std::vector<std::string> cut(const std::string& line) {
  std::vector<std::string> cells;
  std::size_t begin = 0;
  while (true) {
    const std::size_t comma = line.find(',', begin);
    std::size_t end = comma == std::string::npos ? line.size() : comma;
    std::size_t from = begin;
    while (from < end && (line[from] == ' ' || line[from] == '\t')) ++from;
    while (end > from && (line[end - 1] == ' ' || line[end - 1] == '\t' || line[end - 1] == '\r'))
      --end;
    cells.push_back(line.substr(from, end - from));
    if (comma == std::string::npos) return cells;
    begin = comma + 1;
  }
}

}  // namespace

Result<CsvTable> CsvTable::read(const std::string& path) {
  std::ifstream in(path);
  if (!in) return Status{StatusCode::kIo, path + ": cannot open: " + std::strerror(errno)};
  CsvTable table;
  table.path_ = path;
  std::string line;
  for (std::size_t number = 1; std::getline(in, line); ++number) {
    if (line.find_first_not_of(" \t\r") == std::string::npos) continue;
    std::vector<std::string> cells = cut(line);
    if (table.names_.empty()) {
      table.names_ = std::move(cells);
      continue;
    }
    if (cells.size() != table.names_.size())
      return Status{StatusCode::kInvalidArgument,
                    path + ":" + std::to_string(number) + ": expected " +
                        std::to_string(table.names_.size()) + " cells, found " +
                        std::to_string(cells.size())};
    table.rows_.push_back(std::move(cells));
    table.lines_.push_back(number);
  }
  if (table.names_.empty())
    return Status{StatusCode::kInvalidArgument, path + ": expected a header line, found nothing"};
  return table;
}

std::size_t CsvTable::column(std::string_view name) const {
  const auto at = std::find(names_.begin(), names_.end(), name);
  return at == names_.end() ? npos : static_cast<std::size_t>(at - names_.begin());
}

Result<double> CsvTable::number(std::size_t row, std::size_t column) const {
  const std::string& cell = rows_[row][column];
  double value = 0;
  const auto [end, error] = std::from_chars(cell.data(), cell.data() + cell.size(), value);
  if (error != std::errc{} || end != cell.data() + cell.size())
    return Status{StatusCode::kInvalidArgument, place(row) + ": column " + names_[column] +
                                                    ": expected a number, found '" + cell + "'"};
  return value;
}

Status CsvTable::missing_column(std::string_view name) const {
  std::string found;
  for (const std::string& one : names_) found += (found.empty() ? "" : ", ") + one;
  return {StatusCode::kInvalidArgument,
          path_ + ": expected a column named " + std::string(name) + ", found " + found};
}

Result<std::vector<std::size_t>> CsvTable::columns(const std::vector<std::string>& names) const {
  std::vector<std::size_t> places;
  for (const std::string& name : names) {
    places.push_back(column(name));
    if (places.back() == npos) return missing_column(name);
  }
  return places;
}

}  // namespace nearmesh
