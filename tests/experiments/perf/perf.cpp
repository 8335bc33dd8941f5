// SPDX-License-Identifier: Apache-2.0
// nearmesh-perf: the same meshes, the same poses, one run: nearmesh's certified answer against the
// neighbouring libraries' full-mesh queries, and their distances; and whole frames of a session.
// Prints CSV rows workload,contender,metric,value,unit,repeat; the first lines name machine and
// build. Answers are compared before they are timed. Single thread.

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <span>

#include "core/base/stopwatch.hpp"
#include "distance_rows.hpp"
#include "first_line_of.hpp"
#include "frame_rows.hpp"
#include "nearmesh/core/meshio/import.hpp"
#include "nearmesh/core/query/certify.hpp"
#include "test_models.hpp"
#include "tests/peers/peers.hpp"
#include "workloads.hpp"

using namespace nearmesh;
using namespace nearmesh::perf;

void Report::print_summary() const {
  std::printf("%-44s %12s  ratio of nearmesh to each\n", "workload, metric", "nearmesh us");
  for (const auto& [what, contenders] : rows_) {
    const auto ours = contenders.find(kUnderTest);
    if (ours == contenders.end()) continue;
    const double value = quantile(ours->second, 0.5);
    std::printf("%-44s %12.2f ", what.c_str(), value);
    for (const auto& [name, values] : contenders)
      if (name != kUnderTest) std::printf("  %s %.3f", name.c_str(), value / quantile(values, 0.5));
    std::printf("\n");
  }
}

namespace {

// A replica of each model that holds what the pose needs: certified before it is timed.
class Nearmesh : public peers::Peer {
 public:
  Nearmesh(const Model& a, const Model& b)
      : a_(a.baked.store, a.baked.header.grid), b_(b.baked.store, b.baked.header.grid) {}
  void place(const Pose& a, const Pose& b) override {
    posed_ = pose_pair(a_.grid, a, "a", b_.grid, b, "b").value();
    static_cast<void>(certify(a_, posed_.a, test::no_require, b_, posed_.b, test::no_require,
                              {.clearance = Clearance::kNone}));
  }
  bool touches() override {
    return query(a_.view(), posed_.a, b_.view(), posed_.b,
                 {.any = true, .clearance = Clearance::kNone})
               .status == AnswerStatus::kContact;
  }
  std::optional<std::uint64_t> count_pairs() override {
    return query(a_.view(), posed_.a, b_.view(), posed_.b, {.clearance = Clearance::kNone})
        .pair_total;
  }

 private:
  LocalModel a_, b_;
  PosedPair posed_;
};

// False, with a message, where a contender's answers differ from ours.
bool compare(const std::string& workload, std::size_t pose, std::vector<Contender>& entries) {
  bool same = true;
  const bool touches = entries.front().peer->touches();
  const std::uint64_t pairs = entries.front().peer->count_pairs().value();
  for (std::size_t i = 1; i < entries.size(); ++i) {
    const bool theirs = entries[i].peer->touches();
    const std::optional<std::uint64_t> count = entries[i].peer->count_pairs();
    if (theirs == touches && (!count || !entries[i].info.counts_exactly || *count == pairs))
      continue;
    std::fprintf(stderr, "%s, pose %zu: nearmesh says %s, %llu pairs; %s says %s, %llu\n",
                 workload.c_str(), pose, touches ? "contact" : "free",
                 static_cast<unsigned long long>(pairs), entries[i].info.name.c_str(),
                 theirs ? "contact" : "free", static_cast<unsigned long long>(count.value_or(0)));
    same = false;
  }
  return same;
}

void time_poses(const std::string& workload, const PoseSet& set, std::vector<Contender>& entries,
                int repeats, Report& report, int& differences) {
  std::fprintf(stderr, "%s/%s\n", workload.c_str(), set.name.c_str());
  const std::string name = workload + "/" + set.name;
  for (std::size_t i = 0; i < set.poses.size(); ++i) {
    for (Contender& entry : entries) entry.peer->place(set.poses[i].a, set.poses[i].b);
    if (!compare(name, i, entries)) ++differences;
  }
  for (int repeat = 0; repeat < repeats; ++repeat) {
    std::vector<std::vector<double>> first(entries.size()), all(entries.size());
    for (const PosePair& poses : set.poses)
      for (std::size_t i = 0; i < entries.size(); ++i) {
        peers::Peer& contender = *entries[i].peer;
        contender.place(poses.a, poses.b);
        first[i].push_back(least_of_three_us([&] { contender.touches(); }));
        bool counts = true;
        const double all_us =
            least_of_three_us([&] { counts = contender.count_pairs().has_value(); });
        if (counts) all[i].push_back(all_us);
      }
    for (std::size_t i = 0; i < entries.size(); ++i)
      for (const auto& [metric, values] :
           {std::pair("first_contact", &first[i]), std::pair("all_pairs", &all[i])})
        if (!values->empty())
          for (const auto& [suffix, q] : {std::pair("median", 0.5), std::pair("p95", 0.95)})
            report.add(name, entries[i].info.name, std::string(metric) + "_" + suffix,
                       quantile(*values, q), "us", repeat);
  }
}

// The frame in which detail arrives: one delivery of the splits that the frame's pose needs, the
// tree's update and one query. Which splits those are, a twin finds out beforehand, as the
// publisher's walk would.
void time_refining(const std::string& workload, const PoseSet& set, const Model& a, const Model& b,
                   int repeats, Report& report) {
  for (int repeat = 0; repeat < repeats; ++repeat) {
    LocalModel twin_a(a.baked.store, a.baked.header.grid),
        twin_b(b.baked.store, b.baked.header.grid);
    LocalModel own_a(a.baked.store, a.baked.header.grid), own_b(b.baked.store, b.baked.header.grid);
    std::vector<double> refine, tree, query_time, total, splits;
    for (const PosePair& poses : set.poses) {
      const PosedPair posed = pose_pair(own_a.grid, poses.a, "a", own_b.grid, poses.b, "b").value();
      static_cast<void>(certify(twin_a, posed.a, test::no_require, twin_b, posed.b,
                                test::no_require, {.clearance = Clearance::kNone}));
      std::vector<VertexId> new_a, new_b;
      for (auto [twin, own, found] :
           {std::tuple(&twin_a, &own_a, &new_a), std::tuple(&twin_b, &own_b, &new_b)})
        for (const TreeletSplit& split : active_treelet(twin->mesh))
          if (!own->mesh.is_active(split.split)) found->push_back(split.split);
      RefineDelta delta_a, delta_b;
      Stopwatch watch;
      for (const VertexId u : new_a) static_cast<void>(own_a.mesh.split(u, delta_a));
      for (const VertexId u : new_b) static_cast<void>(own_b.mesh.split(u, delta_b));
      const double refine_s = watch.lap();
      own_a.tree.update(delta_a);
      own_b.tree.update(delta_b);
      const double tree_s = watch.lap();
      const Answer answer =
          query(own_a.view(), posed.a, own_b.view(), posed.b, {.clearance = Clearance::kNone});
      const double query_s = watch.lap();
      if (!is_certified(answer.status))
        std::fprintf(stderr, "%s: a frame is not certified\n", workload.c_str());
      if (new_a.empty() && new_b.empty()) continue;
      refine.push_back(refine_s * 1e6);
      tree.push_back(tree_s * 1e6);
      query_time.push_back(query_s * 1e6);
      total.push_back((refine_s + tree_s + query_s) * 1e6);
      splits.push_back(static_cast<double>(new_a.size() + new_b.size()));
    }
    if (total.empty()) continue;
    report.add(workload, kUnderTest, "T_R_median", quantile(refine, 0.5), "us", repeat);
    report.add(workload, kUnderTest, "T_B_median", quantile(tree, 0.5), "us", repeat);
    report.add(workload, kUnderTest, "T_Q_median", quantile(query_time, 0.5), "us", repeat);
    report.add(workload, kUnderTest, "T_R+T_B+T_Q_median", quantile(total, 0.5), "us", repeat);
    report.add(workload, kUnderTest, "splits_a_frame_median", quantile(splits, 0.5), "splits",
               repeat);
  }
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("Times nearmesh against neighbouring libraries on the same meshes and poses");
  std::string out = "perf.csv", data = NEARMESH_TEST_DATA;
  std::vector<std::string> only, contenders;
  int repeats = 3, draws = 25, frames = 200;
  bool summary = false;
  app.add_option("-o,--out", out, "CSV file")->capture_default_str();
  app.add_option("--data", data, "Folder of shared test data (for the bunny)")
      ->capture_default_str();
  app.add_option(
      "--workload", only,
      "Only these: sphere bunny terrain1m terrain8m frames (default: all but terrain8m)");
  app.add_option("--contender", contenders, "Only these beside nearmesh");
  app.add_option("--repeats", repeats, "Runs of each workload")
      ->capture_default_str()
      ->check(CLI::Range(1, 100));
  app.add_option("--draws", draws, "Random directions a distance")
      ->capture_default_str()
      ->check(CLI::Range(1, 1000));
  app.add_option("--frames", frames, "Frames of a flight")
      ->capture_default_str()
      ->check(CLI::Range(1, 2000));
  app.add_flag("--summary", summary, "Also print the ratios to each");
  CLI11_PARSE(app, argc, argv);

  Report report(out);
  if (!report.is_open()) {
    std::fprintf(stderr, "cannot write %s\n", out.c_str());
    return 2;
  }
  report.comment("machine: " + first_line_of("grep -m1 'model name' /proc/cpuinfo | cut -d: -f2-"));
  report.comment("compiler: " NEARMESH_PERF_COMPILER);
  report.comment("flags: " NEARMESH_PERF_FLAGS);
  report.comment("commit: " + first_line_of("git -C '" NEARMESH_PERF_SOURCE
                                            "' describe --always --dirty 2>/dev/null"));
  report.header();

  const auto wanted = [&only](const std::string& name, bool by_default) {
    return only.empty() ? by_default : std::find(only.begin(), only.end(), name) != only.end();
  };
  int differences = 0;
  const auto enter = [&](const Model& a, const Model& b) {
    std::vector<Contender> entries(1);
    entries[0].info = {.name = kUnderTest, .counts_exactly = true};
    entries[0].peer = std::make_unique<Nearmesh>(a, b);
    for (peers::PeerInfo info : peers::timed_peers())
      if (contenders.empty() ||
          std::find(contenders.begin(), contenders.end(), info.name) != contenders.end()) {
        std::fprintf(stderr, "building %s\n", info.name.c_str());
        entries.push_back({info, info.make(a.mesh, b.mesh)});
      }
    return entries;
  };
  const auto time_all = [&](const std::string& name, const PoseSet& set, const Model& a,
                            const Model& b, std::vector<Contender>& entries) {
    time_poses(name, set, entries, repeats, report, differences);
    differences += time_distances(name, set, a, b, std::span(entries).subspan(1), repeats, report);
  };
  const auto against_itself = [&](const std::string& name, const Model& model) {
    std::vector<Contender> entries = enter(model, model);
    for (const PoseSet& set : distances(model, model, draws))
      time_all(name, set, model, model, entries);
  };

  if (wanted("sphere", true)) against_itself("sphere", make_model(generate_sphere(66, 0)));
  if (wanted("bunny", true) || wanted("frames", true)) {
    const Result<IndexedMesh> bunny = import_mesh(data + "/scans/stanford_bunny.obj");
    if (bunny.is_ok()) {
      const Model model = make_model(bunny.value());
      if (wanted("bunny", true)) against_itself("bunny", model);
      if (wanted("frames", true)) time_near_miss("bunny_near_miss", model, report);
    } else {
      std::fprintf(stderr, "bunny left out: %s\n", bunny.status().message().c_str());
    }
  }
  if (wanted("frames", true))
    time_flights(make_model(generate_terrain(708, 42)), make_model(generate_aircraft(8000, 1)),
                 report);
  for (const auto& [name, size, by_default] :
       {std::tuple("terrain1m", 708U, true), std::tuple("terrain8m", 2000U, false)})
    if (wanted(name, by_default)) {
      std::fprintf(stderr, "baking %s\n", name);
      const Model terrain = make_model(generate_terrain(size, 42)),
                  aircraft = make_model(generate_aircraft(8000, 1));
      const PoseSet poses = flight(terrain, aircraft, frames);
      time_refining(std::string(name) + "/refining", poses, terrain, aircraft, repeats, report);
      std::vector<Contender> entries = enter(terrain, aircraft);
      time_all(name, poses, terrain, aircraft, entries);
    }
  if (summary) report.print_summary();
  if (differences > 0) std::fprintf(stderr, "%d poses with different answers\n", differences);
  return 0;
}
