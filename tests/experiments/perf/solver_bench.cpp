// SPDX-License-Identifier: Apache-2.0
// The way out of two whole meshes that touch, by nearmesh and by others in one run, as CSV.
//   nearmesh-bench-solver [BUNNY.obj] > docs/perf/solver.csv
// Single thread, wall clock, medians of the poses. Whether bodies are free is decided by the exact
// query over all faces.

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <string>

#include "core/base/stopwatch.hpp"
#include "nearmesh/core/mesh/generate.hpp"
#include "nearmesh/core/meshio/import.hpp"
#include "nearmesh/core/query/depth.hpp"
#include "peers.hpp"
#include "workloads.hpp"

using namespace nearmesh;
using peers::Peer;
using perf::Model;
using perf::PosePair;
using perf::WholeModel;
using Vec3 = std::array<double, 3>;

namespace {

constexpr int kMostPushes = 20;

double median(std::vector<double> values) {
  if (values.empty()) return 0;
  std::sort(values.begin(), values.end());
  return values[values.size() / 2];
}
double length(const Vec3& v) { return std::sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]); }

void row(const std::string& scene, const char* who, const char* what, double value) {
  std::printf("%s,%s,%s,%.9g\n", scene.c_str(), who, what, value);
}

/// The library's own word, and whether it is there.
struct Other {
  std::string name;
  std::unique_ptr<Peer> peer;
};

// ---- the way out --------------------------------------------------------------------------------

bool is_free(const WholeModel& a, const WholeModel& b, const PosePair& at) {
  const PosedPair posed = pose_pair(a.grid, at.a, "a", b.grid, at.b, "b").value();
  return query(a.view(), posed.a, b.view(), posed.b, {.clearance = Clearance::kNone}).pair_total ==
         0;
}
PosePair moved(PosePair at, const Vec3& way_m) {
  for (std::size_t k = 0; k < 3; ++k) at.b.translation_m[k] += way_m[k];
  return at;
}

struct WayOut {
  int free_at_once = 0, free_in_the_end = 0, count = 0;
  std::vector<double> us, pushes, lengths_m;

  void tell(const std::string& scene, const char* who, const std::vector<double>& ours_m) const {
    row(scene, who, "poses", count);
    row(scene, who, "free_at_once", free_at_once);
    row(scene, who, "free_in_the_end", free_in_the_end);
    row(scene, who, "pushes", median(pushes));
    std::vector<double> ratios;
    for (std::size_t i = 0; i < lengths_m.size(); ++i) ratios.push_back(lengths_m[i] / ours_m[i]);
    row(scene, who, "length_ratio", median(ratios));
    row(scene, who, "way_out_us", median(us));
  }
};

/// Where its deepest contact points; nothing where it finds none.
std::optional<Vec3> push_of(Peer& peer) {
  const auto contacts = peer.contacts();
  if (!contacts || contacts->empty()) return std::nullopt;
  const auto deepest =
      std::max_element(contacts->begin(), contacts->end(),
                       [](const auto& x, const auto& y) { return x.depth_m < y.depth_m; });
  const double size = length(deepest->normal);
  if (!(size > 0) || !std::isfinite(deepest->depth_m)) return std::nullopt;
  // A hair more, so that it is not the last digit that decides.
  const double way_m = std::max(deepest->depth_m, 0.0) * (1 + 1e-6) + 1e-9;
  Vec3 push;
  for (std::size_t k = 0; k < 3; ++k) push[k] = deepest->normal[k] / size * way_m;
  return push;
}

void measure_way_out(const std::string& scene, const WholeModel& a, const WholeModel& b,
                     const std::vector<PosePair>& poses, std::vector<Other>& others) {
  WayOut ours;
  std::vector<double> widths, query_us;
  std::vector<PosePair> touching;
  for (const PosePair& at : poses) {
    const PosedPair posed = pose_pair(a.grid, at.a, "a", b.grid, at.b, "b").value();
    Stopwatch watch;
    const Answer answer =
        query(a.view(), posed.a, b.view(), posed.b, {.clearance = Clearance::kNone});
    if (answer.pairs.empty()) continue;
    query_us.push_back(watch.lap() * 1e6);
    const Contacts contacts = find_contacts(a.view(), posed.a, b.view(), posed.b, answer);
    const Depth depth =
        find_depth(a.view(), at.a, "a", b.view(), at.b, "b", answer, contacts).value();
    ours.us.push_back(watch.seconds() * 1e6);
    touching.push_back(at);
    ++ours.count;
    const bool is_out = is_free(a, b, moved(at, depth.separation_m));
    ours.free_at_once += is_out ? 1 : 0;
    ours.free_in_the_end += is_out ? 1 : 0;
    ours.pushes.push_back(1);
    ours.lengths_m.push_back(length(depth.separation_m));
    widths.push_back(1 - depth.at_least_m / depth.at_most_m);
  }
  if (touching.empty()) return;
  ours.tell(scene, "nearmesh", ours.lengths_m);
  row(scene, "nearmesh", "bracket_width", median(widths));
  row(scene, "nearmesh", "query_us", median(query_us));
  for (Other& other : others) {
    WayOut its;
    for (const PosePair& at : touching) {
      PosePair now = at;
      int pushes = 0;
      bool was_free_at_once = false;
      for (; pushes < kMostPushes; ++pushes) {
        other.peer->place(now.a, now.b);
        const Stopwatch watch;
        const std::optional<Vec3> push = push_of(*other.peer);
        if (pushes == 0) its.us.push_back(watch.seconds() * 1e6);
        if (!push) break;
        now = moved(now, *push);
        if (pushes == 0) was_free_at_once = is_free(a, b, now);
      }
      ++its.count;
      its.free_at_once += was_free_at_once ? 1 : 0;
      its.free_in_the_end += is_free(a, b, now) ? 1 : 0;
      its.pushes.push_back(pushes);
      Vec3 way;
      for (std::size_t k = 0; k < 3; ++k) way[k] = now.b.translation_m[k] - at.b.translation_m[k];
      its.lengths_m.push_back(length(way));
    }
    its.tell(scene, other.name.c_str(), ours.lengths_m);
  }
}

void measure(const std::string& name, const Model& a, const Model& b, int draws) {
  row(name, "mesh", "faces", static_cast<double>(a.mesh.faces.size()));
  std::vector<Other> others;
  const auto add = [&](const peers::PeerInfo& info) {
    others.push_back({info.library + " " + info.version, info.make(a.mesh, b.mesh)});
  };
#ifdef NEARMESH_PEER_FCL
  add(peers::fcl_obbrss());
#endif
#ifdef NEARMESH_PEER_COAL
  add(peers::coal_obbrss());
#endif
#ifdef NEARMESH_PEER_BULLET
  add(peers::bullet());
#endif
  const WholeModel whole_a(a), whole_b(b);
  for (const perf::PoseSet& set : perf::distances(a, b, draws)) {
    const std::string scene = name + "/" + set.name;
    std::fprintf(stderr, "%s\n", scene.c_str());
    measure_way_out(scene, whole_a, whole_b, set.poses, others);
  }
}

}  // namespace

int main(int argc, char** argv) {
  std::printf("scene,who,what,value\n");
  const Model ball = perf::make_model(generate_sphere(40, 0));
  measure("sphere", ball, ball, 40);
  if (argc < 2) return 0;
  const Result<IndexedMesh> bunny = import_mesh(argv[1]);
  if (!bunny.is_ok()) {
    std::fprintf(stderr, "%s\n", bunny.status().message().c_str());
    return 1;
  }
  const Model rabbit = perf::make_model(bunny.value());
  measure("bunny", rabbit, rabbit, 20);
  return 0;
}
