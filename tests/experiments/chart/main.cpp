// SPDX-License-Identifier: Apache-2.0
// nearmesh-chart: speed against accuracy. `run` plays scenes through every method and writes CSV
// (columns: play.hpp), `plot` draws them. Single thread, since times are measured.

#include <unistd.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <filesystem>

#include "core/base/stopwatch.hpp"
#include "play.hpp"
#include "scenes.hpp"
#include "tests/experiments/perf/first_line_of.hpp"

using namespace nearmesh;
using namespace nearmesh::chart;

namespace {

struct RunOptions {
  std::string out;
  std::vector<std::string> scenes, methods;
  SceneOptions scene{.data = NEARMESH_TEST_DATA};
};

bool wanted(const RunOptions& options, const SceneInfo& info) {
  if (options.scenes.empty()) return !options.scene.quick || !info.full_only;
  return std::find(options.scenes.begin(), options.scenes.end(), info.name) != options.scenes.end();
}

int run(const RunOptions& options) {
  std::error_code error;
  std::filesystem::create_directories(options.out, error);
  std::FILE* rows = std::fopen((options.out + "/rows.csv").c_str(), "w");
  std::FILE* models = std::fopen((options.out + "/models.csv").c_str(), "w");
  std::FILE* about = std::fopen((options.out + "/about.csv").c_str(), "w");
  if (rows == nullptr || models == nullptr || about == nullptr) {
    std::fprintf(stderr, "cannot write into %s\n", options.out.c_str());
    return 2;
  }
  write_row_names(rows, models);
  PlayTotals totals;
  const Stopwatch watch;
  for (const SceneInfo& info : scenes()) {
    if (!wanted(options, info)) continue;
    const std::optional<Scene> scene = info.make(options.scene);
    if (!scene) continue;
    std::fprintf(stderr, "%s: %u and %u faces, %zu poses (%.0f s so far)\n", info.name.c_str(),
                 scene->a.baked.header.face_count, scene->b.baked.header.face_count,
                 scene->poses.size(), watch.seconds());
    write_models(*scene, models);
    const PlayTotals more = play(*scene, options.methods, rows);
    totals.rows += more.rows;
    totals.false_certificates += more.false_certificates;
  }
  std::fprintf(
      about, "key,value\nmachine,%s\ncompiler,%s\ncommit,%s\ncommand,nearmesh-chart run -o DIR%s\n",
      perf::first_line_of("grep -m1 'model name' /proc/cpuinfo | cut -d: -f2- | sed 's/^ //'")
          .c_str(),
      NEARMESH_CHART_COMPILER,
      perf::first_line_of("git -C '" NEARMESH_CHART_SOURCE
                          "' describe --always --dirty 2>/dev/null")
          .c_str(),
      options.scene.quick ? " --quick" : "");
  std::fclose(about);
  std::fclose(models);
  const bool written = std::fclose(rows) == 0;
  std::printf("%llu rows, %llu false certificates\n", static_cast<unsigned long long>(totals.rows),
              static_cast<unsigned long long>(totals.false_certificates));
  return written && totals.false_certificates == 0 ? 0 : 1;
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app(
      "Charts speed against accuracy: certified answers, the 2006 paper's grid, levels of detail, "
      "streams of triangles");
  app.require_subcommand(1);
  RunOptions options;
  CLI::App* runs =
      app.add_subcommand("run", "Plays scenes through every method. Fails on a false certificate");
  runs->add_option("-o,--out", options.out, "Folder for rows.csv, models.csv and about.csv")
      ->required();
  std::vector<std::string> scene_names, method_names;
  for (const SceneInfo& info : scenes()) scene_names.push_back(info.name);
  for (const MethodInfo& info : methods()) method_names.push_back(info.name);
  runs->add_option("--scene", options.scenes, "Only these")->check(CLI::IsMember(scene_names));
  runs->add_option("--method", options.methods, "Only these, without the libraries")
      ->check(CLI::IsMember(method_names));
  runs->add_option("--data", options.scene.data, "Folder of shared meshes")->capture_default_str();
  runs->add_flag("--quick", options.scene.quick,
                 "Small meshes, few poses, no shared meshes: some seconds");
  std::string folder, docs;
  CLI::App* plots =
      app.add_subcommand("plot", "Draws the charts of a run as SVG and PNG beside its CSV files");
  plots->add_option("DIR", folder, "Folder of a run")->required()->check(CLI::ExistingDirectory);
  plots
      ->add_option("--docs", docs,
                   "Also brings results.md and its pictures in this folder up to date")
      ->check(CLI::ExistingDirectory);
  CLI11_PARSE(app, argc, argv);
  if (runs->parsed()) return run(options);
  std::vector<const char*> words{NEARMESH_CHART_PYTHON,
                                 NEARMESH_CHART_SOURCE "/tests/experiments/chart/plot_chart.py",
                                 folder.c_str()};
  if (!docs.empty()) words.push_back(docs.c_str());
  words.push_back(nullptr);
  ::execvp(words[0], const_cast<char* const*>(words.data()));
  std::fprintf(stderr, "cannot run %s\n", NEARMESH_CHART_PYTHON);
  return 2;
}
