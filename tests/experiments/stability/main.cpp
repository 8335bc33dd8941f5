// SPDX-License-Identifier: Apache-2.0
// nearmesh-stability: runs the scenes through every system of this build and writes the tables.
#include <CLI/CLI.hpp>
#include <cstdio>

#include "report.hpp"
#include "scale.hpp"
#include "scenes.hpp"
#include "system.hpp"

namespace nearmesh::stability {
namespace {

constexpr std::size_t kFailuresShown = 5;  // of each cell
constexpr std::size_t kLargeMesh_faces = 20'000;

struct Options {
  std::string out = ".", data_folder = NEARMESH_TEST_DATA;
  std::vector<std::string> systems, scenes;
  bool quick = false;
};

bool is_chosen(const std::vector<std::string>& chosen, const std::string& name) {
  return chosen.empty() || std::find(chosen.begin(), chosen.end(), name) != chosen.end();
}

/// One cell of the table, as it fills.
class Cell {
 public:
  Cell(const std::string& scene, const std::string& title, const std::string& system)
      : tally_{.scene = scene, .title = title, .system = system, .marks = {}} {}

  void count(const Case& c, const Verdict& verdict, std::vector<Failure>& failures) {
    const Mark mark = judge(c, verdict);
    ++tally_.marks[static_cast<std::size_t>(mark)];
    if (mark == Mark::kRight || mark == Mark::kUndecided || mark == Mark::kNotApplicable) return;
    if (shown_++ < kFailuresShown)
      failures.push_back(
          {tally_.scene, tally_.system, c.name, describe_truth(c), describe(verdict)});
  }
  [[nodiscard]] const Tally& tally() const { return tally_; }

 private:
  Tally tally_;
  std::size_t shown_ = 0;
};

/// Adds a row for contact or not, and where the scene asks for it one for the number of pairs.
void run_scene(const Scene& scene, const std::vector<std::unique_ptr<System>>& systems,
               Report& report) {
  std::vector<Tally> by_pairs;
  std::vector<Failure> failures_by_pairs;
  for (const auto& system : systems) {
    Cell touch(scene.id, scene.title, system->name());
    Cell pairs(scene.id + " pairs", scene.pairs_title, system->name());
    for (const Case& c : scene.cases) {
      const bool is_large =
          c.a.mesh && c.a.mesh->faces.size() + c.b.mesh->faces.size() > kLargeMesh_faces;
      const Verdict verdict = ask_in_child(*system, c, is_large ? 60 : 10);
      touch.count(c, verdict, report.failures);
      if (!scene.pairs_title.empty() && c.pairs)
        pairs.count(as_pairs(c), verdict, failures_by_pairs);
    }
    report.tallies.push_back(touch.tally());
    by_pairs.push_back(pairs.tally());
    std::fprintf(stderr, "%-4s %-9s %6llu of %zu right\n", scene.id.c_str(), system->name().c_str(),
                 static_cast<unsigned long long>(touch.tally().right()), scene.cases.size());
  }
  if (scene.pairs_title.empty()) return;
  report.tallies.insert(report.tallies.end(), by_pairs.begin(), by_pairs.end());
  report.failures.insert(report.failures.end(), failures_by_pairs.begin(), failures_by_pairs.end());
}

int run(const Options& options) {
  Report report;
  std::vector<std::unique_ptr<System>> systems = available_systems();
  std::erase_if(systems, [&](const auto& s) { return !is_chosen(options.systems, s->name()); });
  for (const auto& s : systems) report.systems.push_back({s->name(), s->version(), s->call()});
  for (const std::string& id : scene_ids()) {
    if (!is_chosen(options.scenes, id)) continue;
    const Scene scene = make_scene(id, options.data_folder, options.quick);
    if (scene.cases.empty()) {
      std::fprintf(stderr, "%s: no cases, left out (its data is not at %s)\n", id.c_str(),
                   options.data_folder.c_str());
      continue;
    }
    run_scene(scene, systems, report);
  }
  if (is_chosen(options.scenes, "F14")) report.scale = measure_scale(systems, options.quick);
  const Status written = write_report(report, options.out);
  if (written.is_ok()) return 0;
  std::fprintf(stderr, "nearmesh-stability: %s\n", written.message().c_str());
  return 1;
}

}  // namespace
}  // namespace nearmesh::stability

int main(int argc, char** argv) {
  nearmesh::stability::Options options;
  CLI::App app{
      "Runs the scenes in which methods fail through nearmesh and, where installed, FCL, Bullet "
      "and CGAL.",
      "nearmesh-stability"};
  app.add_option("--out", options.out,
                 "Folder for the tables (*.csv), of which make_page.py makes the page")
      ->capture_default_str();
  app.add_option("--systems", options.systems, "Only these (nearmesh, FCL, Bullet, CGAL)")
      ->delimiter(',');
  app.add_option("--scenes", options.scenes, "Only these rows, e.g. F3,F14")->delimiter(',');
  app.add_option("--data", options.data_folder, "Folder of the shared test data (F16)")
      ->capture_default_str();
  app.add_flag("--quick", options.quick, "A sample of the variants");
  CLI11_PARSE(app, argc, argv);
  return nearmesh::stability::run(options);
}
