// SPDX-License-Identifier: Apache-2.0
#include "report.hpp"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <numeric>
#include <sstream>

namespace nearmesh::stability {
namespace {

const char* const kHeadings = "right,undecided,wrong,crash,hang,not_applicable,cases";

Status write_file(const std::string& path, const std::string& text) {
  std::ofstream file(path, std::ios::binary);
  file << text;
  file.close();
  if (!file) return {StatusCode::kIo, path + ": cannot be written"};
  return Status::ok();
}

std::string results_csv(const Report& report) {
  std::ostringstream csv;
  csv << "scene,title,system," << kHeadings << '\n';
  for (const Tally& t : report.tallies)
    csv << t.scene << ",\"" << t.title << "\"," << t.system << ',' << t.count(Mark::kRight) << ','
        << t.count(Mark::kUndecided) << ',' << t.count(Mark::kWrong) << ',' << t.count(Mark::kCrash)
        << ',' << t.count(Mark::kHang) << ',' << t.count(Mark::kNotApplicable) << ',' << t.cases()
        << '\n';
  return csv.str();
}

std::string failures_csv(const Report& report) {
  std::ostringstream csv;
  csv << "scene,system,case,expected,found\n";
  for (const Failure& f : report.failures)
    csv << f.scene << ',' << f.system << ",\"" << f.name << "\",\"" << f.expected << "\",\""
        << f.found << "\"\n";
  return csv.str();
}

std::string scale_csv(const Report& report) {
  std::ostringstream csv;
  csv << "system,faces,prepare_s,first_answer_s,memory_bytes\n";
  for (const ScaleRow& row : report.scale)
    csv << row.system << ',' << row.faces << ',' << row.prepare_s << ',' << row.first_answer_s
        << ',' << row.memory_bytes << '\n';
  return csv.str();
}

std::string systems_csv(const Report& report) {
  std::ostringstream csv;
  csv << "system,version,call\n";
  for (const SystemNote& s : report.systems)
    csv << s.name << ',' << s.version << ",\"" << s.call << "\"\n";
#ifdef __VERSION__
  csv << "compiler," << __VERSION__ << ",\"\"\n";
#else
  csv << "compiler,unknown,\"\"\n";
#endif
  return csv.str();
}

}  // namespace

std::uint64_t Tally::cases() const {
  return std::accumulate(marks.begin(), marks.end(), std::uint64_t{0});
}

Status write_report(const Report& report, const std::string& folder) {
  std::error_code error;
  std::filesystem::create_directories(folder, error);  // a failure shows when files are written
  NEARMESH_RETURN_IF_ERROR(write_file(folder + "/results.csv", results_csv(report)));
  NEARMESH_RETURN_IF_ERROR(write_file(folder + "/failures.csv", failures_csv(report)));
  NEARMESH_RETURN_IF_ERROR(write_file(folder + "/systems.csv", systems_csv(report)));
  return report.scale.empty() ? Status::ok() : write_file(folder + "/scale.csv", scale_csv(report));
}

}  // namespace nearmesh::stability
