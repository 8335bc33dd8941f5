// SPDX-License-Identifier: Apache-2.0
#pragma once
// What nearmesh-perf writes: rows workload,contender,metric,value,unit,repeat.

#include <algorithm>
#include <fstream>
#include <map>
#include <string>
#include <vector>

#include "core/base/stopwatch.hpp"

namespace nearmesh::perf {

inline constexpr const char* kUnderTest = "nearmesh";

class Report {
 public:
  explicit Report(const std::string& path) : out_(path) {}
  [[nodiscard]] bool is_open() const { return out_.is_open(); }
  void comment(const std::string& text) { out_ << "# " << text << '\n'; }
  void header() { out_ << "workload,contender,metric,value,unit,repeat\n"; }
  void add(const std::string& workload, const std::string& contender, const std::string& metric,
           double value, const std::string& unit, int repeat) {
    out_ << workload << ',' << contender << ',' << metric << ',' << value << ',' << unit << ','
         << repeat << '\n';
    out_.flush();
    rows_[workload + "," + metric][contender].push_back(value);
  }
  /// To standard output: what is under test, and its ratio to each other.
  void print_summary() const;

 private:
  std::ofstream out_;
  std::map<std::string, std::map<std::string, std::vector<double>>> rows_;
};

/// Precondition: there are values.
inline double quantile(std::vector<double> values, double q) {
  std::sort(values.begin(), values.end());
  return values[std::min(values.size() - 1,
                         static_cast<std::size_t>(q * static_cast<double>(values.size())))];
}

/// The least of three calls: what the machine can do, not what disturbed it. A call of more than 10
/// ms is not made again.
template <class Call>
double least_of_three_us(const Call& call) {
  double least = 1e300;
  for (int i = 0; i < 3 && (i == 0 || least <= 1e4); ++i) {
    const Stopwatch watch;
    call();
    least = std::min(least, watch.seconds() * 1e6);
  }
  return least;
}

}  // namespace nearmesh::perf
