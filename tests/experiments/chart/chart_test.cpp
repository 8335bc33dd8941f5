// SPDX-License-Identifier: Apache-2.0
// A small slice of the chart: shapes of its curves, no false certificate, the same rows in every
// run.
#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <set>
#include <stdexcept>

#include "core/base/csv.hpp"
#include "hoppe.hpp"
#include "play.hpp"
#include "scenes.hpp"
#include "test_models.hpp"

namespace nearmesh::chart {
namespace {

const Scene& scene_named(const std::string& name) {
  static std::map<std::string, Scene> made;
  const auto at = made.find(name);
  if (at != made.end()) return at->second;
  for (const SceneInfo& info : scenes())
    if (info.name == name) return made.emplace(name, *info.make({.quick = true})).first->second;
  throw std::invalid_argument(name);
}

/// Rows of a run, as the file has them.
struct Rows {
  explicit Rows(const Scene& scene, const std::vector<std::string>& only = {}) : file(".csv") {
    std::FILE* rows = std::fopen(file.path().c_str(), "w");
    std::FILE* models = std::tmpfile();
    write_row_names(rows, models);
    totals = play(scene, only, rows);
    std::fclose(models);
    std::fclose(rows);
    Result<CsvTable> read = CsvTable::read(file.path());
    EXPECT_TRUE(read.is_ok()) << read.status().message();
    table = std::move(read).value();
  }
  [[nodiscard]] const std::string& text(std::size_t row, const std::string& column) const {
    return table.text(row, table.column(column));
  }
  [[nodiscard]] double number(std::size_t row, const std::string& column) const {
    return table.number(row, table.column(column)).value();
  }
  /// The last row of each pose.
  [[nodiscard]] std::map<std::string, std::size_t> last(const std::string& method) const {
    std::map<std::string, std::size_t> rows;
    for (std::size_t r = 0; r < table.row_count(); ++r)
      if (text(r, "method") == method) rows[text(r, "index")] = r;
    return rows;
  }
  /// Over these, but for empty cells.
  [[nodiscard]] double mean(const std::string& method, const std::string& column) const {
    double sum = 0, count = 0;
    for (const auto& [index, row] : last(method)) {
      if (text(row, column).empty()) continue;
      sum += number(row, column);
      ++count;
    }
    return sum / count;
  }
  test::TempFile file;
  PlayTotals totals;
  CsvTable table;
};

const Rows& terrain_rows() {
  static const Rows rows(scene_named("terrain-grazing"));
  return rows;
}

TEST(Chart, HasPosesThatTouchAndPosesThatDoNot) {
  const Rows& rows = terrain_rows();
  EXPECT_EQ(rows.mean("certified", "truth"), 0.5);
}

TEST(Chart, NoMethodGivesAFalseCertificate) {
  for (const char* name : {"terrain-grazing", "touching-flight", "near-flight", "needle-in-plain",
                           "conforming", "paper-sphere"}) {
    const Rows rows(scene_named(name));
    EXPECT_EQ(rows.totals.false_certificates, 0U) << name;
    EXPECT_EQ(rows.totals.rows, rows.table.row_count());
  }
}

TEST(Chart, WhoCanProveProvesInTheEnd) {
  const Rows& rows = terrain_rows();
  for (const MethodInfo& info : methods()) {
    if (info.looks_ahead) continue;
    EXPECT_EQ(rows.mean(info.name, "certified"), info.proof == "none" ? 0 : 1) << info.name;
    EXPECT_EQ(rows.mean(info.name, "finished"), 1) << info.name;
  }
  EXPECT_EQ(rows.mean("static-full", "correct"), 1);
  EXPECT_EQ(rows.mean("static-full", "recall"), 1);
}

TEST(Chart, CertifiedNeedsHardlyMoreThanTheLeastAndOneRoundTrip) {
  const Rows& rows = terrain_rows();
  // The least without half-spaces, which spare some of them.
  EXPECT_LT(rows.mean("certified", "splits"), rows.mean("certified-least", "splits"));
  EXPECT_LT(rows.mean("certified", "requests"), 1.2);
  EXPECT_GT(rows.mean("certified-least", "requests"), 3);
  EXPECT_LT(rows.mean("certified", "bytes"), rows.mean("static-full", "bytes"));
  EXPECT_LT(rows.mean("triangles-trusted", "bytes"), rows.mean("clusters-chosen", "bytes"));
  EXPECT_LT(rows.mean("clusters-chosen", "bytes"), 0.9 * rows.mean("clusters-checked", "bytes"));
}

TEST(Chart, WhoLooksAheadAsksLessOften) {
  const Rows rows(scene_named("touching-flight"));
  for (const std::string method : {"certified", "clusters-chosen"}) {
    const auto plain = rows.last(method), ahead = rows.last(method + "-ahead");
    const std::size_t last = plain.rbegin()->second, last_ahead = ahead.rbegin()->second;
    EXPECT_EQ(rows.mean(method + "-ahead", "certified"), 1) << method;
    EXPECT_LT(rows.number(last_ahead, "requests"), rows.number(last, "requests")) << method;
  }
}

TEST(Chart, StaticLevelsGrowAndGlobalRefinementEndsAtTheWholeMesh) {
  const Rows& rows = terrain_rows();
  const char* levels[] = {"static-1/256", "static-1/64", "static-1/16", "static-1/4",
                          "static-full"};
  for (std::size_t i = 1; i < 5; ++i) {
    EXPECT_LT(rows.mean(levels[i - 1], "bytes"), rows.mean(levels[i], "bytes"));
    EXPECT_LT(rows.mean(levels[i - 1], "faces_held"), rows.mean(levels[i], "faces_held"));
  }
  EXPECT_EQ(rows.mean("global", "faces_held"), rows.mean("static-full", "faces_held"));
}

TEST(Chart, HoppeClosureNeedsTheAncestorsAndMore) {
  const Rows& rows = terrain_rows();
  EXPECT_GT(rows.mean("grid8-hoppe", "splits"), rows.mean("grid8", "splits"));
  EXPECT_GT(rows.mean("grid8", "splits"), rows.mean("grid32", "splits"));
}

TEST(Chart, NothingIsReceivedBeyondTheBudgetOrForgotten) {
  const Rows& rows = terrain_rows();
  std::map<std::pair<std::string, std::string>, double> before;
  for (std::size_t r = 0; r < rows.table.row_count(); ++r) {
    if (rows.text(r, "method").find('-') == std::string::npos) continue;
    const double bytes = rows.number(r, "bytes");
    double& last = before[{rows.text(r, "method"), rows.text(r, "index")}];
    EXPECT_GE(bytes, last);
    last = bytes;
    // Base meshes come as a whole.
    if (rows.number(r, "answers") == 1) {
      EXPECT_LE(bytes, rows.number(r, "budget_bytes")) << rows.text(r, "method");
    }
  }
}

TEST(Chart, RowsAreTheSameInEveryRunButForTimes) {
  const Scene& scene = scene_named("terrain-grazing");
  const std::vector<std::string> own = {"certified",        "certified-least", "grid8-hoppe",
                                        "clusters-checked", "clusters-chosen", "triangles-trusted"};
  const Rows first(scene, own), second(scene, own);
  ASSERT_EQ(first.table.row_count(), second.table.row_count());
  ASSERT_GT(first.table.row_count(), 100U);
  const std::set<std::string> timings{"t_r_us", "t_b_us", "t_q_us", "t_l_us"};
  for (const char* column : {"scene",
                             "method",
                             "proof",
                             "kind",
                             "index",
                             "budget_bytes",
                             "bytes",
                             "header_bytes",
                             "requests",
                             "request_bytes",
                             "splits",
                             "status",
                             "truth",
                             "answers",
                             "correct",
                             "certified",
                             "false_certificate",
                             "recall",
                             "false_faces",
                             "position_error_m",
                             "normal_error_rad",
                             "faces_held",
                             "tree_bytes",
                             "needed_faces",
                             "finished"})
    for (std::size_t r = 0; r < first.table.row_count(); ++r)
      ASSERT_EQ(first.text(r, column), second.text(r, column)) << column << " in row " << r;
}

// A method that claims what it has not proved is counted.
TEST(Chart, CountsAFalseCertificate) {
  Scene scene = *[]() -> std::optional<Scene> {
    for (const SceneInfo& info : scenes())
      if (info.name == "terrain-grazing") return info.make({.quick = true});
    return std::nullopt;
  }();
  // The truth is that of the tree; the methods stream another ground.
  scene.a.tree = build_triangle_tree(scene.a.baked.header.grid, {});
  const Rows rows(scene, {"certified"});
  EXPECT_GT(rows.totals.false_certificates, 0U);
}

TEST(HoppeRule, DoesEachSplitOnlyAfterTheFacesAroundIt) {
  const BakedModel model = test::bake_named("sphere");
  const std::vector<VertexId> order = global_order(model.store, 0xffffffffU);
  const HoppeRule rule(model.store, order);
  std::uint64_t with_rule = 0, without = 0;
  for (std::size_t i = 0; i < order.size(); i += 7) {
    ActiveMesh ruled(model.store), plain(model.store);
    RefineDelta done, ancestors;
    rule.split(ruled, order[i], done);
    ASSERT_TRUE(plain.split(order[i], ancestors));
    EXPECT_TRUE(ruled.is_active(order[i]));
    for (const VertexId u : ancestors.split) EXPECT_TRUE(ruled.is_active(u));
    with_rule += ruled.split_count();
    without += plain.split_count();
    // No split comes before one that it rests on.
    std::set<std::uint32_t> seen;
    for (const VertexId u : done.split) EXPECT_TRUE(seen.insert(u.value).second);
  }
  EXPECT_GT(with_rule, without);
}

}  // namespace
}  // namespace nearmesh::chart
