// SPDX-License-Identifier: Apache-2.0
// The nearmesh-model program against the reference answers of PQP, FCL and CGAL, on scans and a
// screw.
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <map>
#include <sstream>

#include "core/base/csv.hpp"
#include "test_models.hpp"

namespace nearmesh {
namespace {

namespace fs = std::filesystem;

struct Line {
  std::string status, faces;
  long pairs = 0;
};

/// What stands behind `"key":` up to the end of the value; lists whole.
std::string field(const std::string& line, const std::string& key) {
  std::string quoted(1, '"');
  quoted.append(key).append("\":");
  const std::size_t at = line.find(quoted);
  if (at == std::string::npos) return {};
  const std::size_t begin = at + quoted.size();
  std::size_t end = begin;
  for (int depth = 0; end < line.size(); ++end) {
    depth += line[end] == '[' ? 1 : line[end] == ']' ? -1 : 0;
    if (depth < 0 || (depth == 0 && (line[end] == ',' || line[end] == '}'))) break;
  }
  return line.substr(begin, end - begin);
}

struct Case {
  const char *csv, *a, *b;
};

class ModelQueryProgram : public ::testing::TestWithParam<Case> {
 protected:
  static constexpr std::size_t kStep = 10;  // every tenth pose

  void SetUp() override {
    const fs::path data = NEARMESH_TEST_DATA;
    csv_ = data / "reference" / GetParam().csv;
    for (const fs::path& needed : {csv_, data / GetParam().a, data / GetParam().b})
      if (!fs::exists(needed)) GTEST_SKIP() << "no test data: " << needed << " is absent";
    if (!fs::exists(program())) GTEST_SKIP() << program() << " is not built";
    build(data / GetParam().a, a_.path());
    build(data / GetParam().b, b_.path());
    std::ifstream in(csv_);
    std::ofstream out(poses_.path());
    std::string line;
    for (std::size_t row = 0; std::getline(in, line); ++row)
      if (row == 0 || (row - 1) % kStep == 0) out << line << '\n';
  }
  static std::string quote(const std::string& word) {
    std::string quoted(1, '\'');
    return quoted.append(word).append(1, '\'');
  }
  static std::string program() { return std::string(NEARMESH_BIN_DIR) + "/nearmesh-model"; }
  static void build(const fs::path& mesh, const std::string& out) {
    const std::string command = quote(program()) + " build " + quote(mesh.string()) + " -o " +
                                quote(out) + " --json > /dev/null 2>&1";
    ASSERT_EQ(std::system(command.c_str()), 0) << command;
  }
  std::map<std::string, Line> run(const std::string& method, const std::string& more = "") const {
    const test::TempFile out(".json");
    const std::string command = quote(program()) + " query " + quote(a_.path()) + " " +
                                quote(b_.path()) + " --poses " + quote(poses_.path()) +
                                " --method " + method + " " + more + " --json > " +
                                quote(out.path());
    EXPECT_EQ(std::system(command.c_str()), 0) << command;
    std::map<std::string, Line> lines;
    std::ifstream in(out.path());
    for (std::string line; std::getline(in, line);)
      lines[field(line, "id")] = {field(line, "status"), field(line, "faces"),
                                  std::atol(field(line, "pairs").c_str())};
    return lines;
  }
  /// Each reference row must be there, with the same boolean; pair counts where the reference is
  /// free.
  void expect_reference(const std::map<std::string, Line>& lines) const {
    const CsvTable table = CsvTable::read(poses_.path()).value();
    const std::size_t id = table.column("id"), pairs = table.column("pqp_pairs");
    EXPECT_EQ(lines.size(), table.row_count());
    std::size_t contacts = 0;
    for (std::size_t row = 0; row < table.row_count(); ++row) {
      SCOPED_TRACE("pose " + table.text(row, id));
      const auto line = lines.find(table.text(row, id));
      ASSERT_NE(line, lines.end());
      const auto expected = static_cast<long>(table.number(row, pairs).value());
      EXPECT_EQ(line->second.status, expected > 0 ? "\"contact\"" : "\"free\"");
      if (expected == 0 || std::string(GetParam().csv).starts_with("armadillo")) {
        EXPECT_EQ(line->second.pairs, expected);
      }
      contacts += expected > 0 ? 1 : 0;
    }
    std::printf("%zu poses, %zu in contact\n", table.row_count(), contacts);
  }

  fs::path csv_;
  test::TempFile a_, b_, poses_{".csv"};
};
INSTANTIATE_TEST_SUITE_P(
    References, ModelQueryProgram,
    ::testing::Values(Case{"armadillo_camelhead.csv", "scans/armadillo_86k.obj",
                           "scans/camelhead.off"},
                      Case{"m16_loose_helix.csv", "assembly/factory_bolt_m16_loose.obj",
                           "assembly/factory_nut_m16_loose_subdiv_3x.obj"},
                      Case{"m16_loose_spin.csv", "assembly/factory_bolt_m16_loose.obj",
                           "assembly/factory_nut_m16_loose_subdiv_3x.obj"}),
    [](const auto& tested) {
      const std::string csv = tested.param.csv;
      return csv.substr(0, csv.find('.'));
    });

TEST_P(ModelQueryProgram, FullAnswersAreTheReferences) { expect_reference(run("full")); }

TEST_P(ModelQueryProgram, CertifiedAnswersAreTheReferences) { expect_reference(run("certified")); }

TEST_P(ModelQueryProgram, CertifiedFacePairsAreTheFullMeshes) {
  const auto full = run("full", "--list-pairs"), certified = run("certified", "--list-pairs");
  ASSERT_EQ(full.size(), certified.size());
  for (const auto& [id, line] : full) {
    SCOPED_TRACE("pose " + id);
    ASSERT_TRUE(certified.contains(id));
    EXPECT_EQ(certified.at(id).status, line.status);
    EXPECT_EQ(certified.at(id).faces, line.faces);
    EXPECT_FALSE(line.faces.empty());
  }
}

}  // namespace
}  // namespace nearmesh
