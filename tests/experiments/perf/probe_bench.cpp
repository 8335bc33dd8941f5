// SPDX-License-Identifier: Apache-2.0
// Time of 10,000 probes of a terrain that is held as a whole, and Embree's of the same rays, as
// CSV.
//   nearmesh-bench-probe > docs/perf/probes.csv
// Single thread, thread CPU time; the least and the median of 21 batches. A tree of a replica, so
// of its slots, not one built at once.

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <functional>

#include "core/base/random.hpp"
#include "nearmesh/core/bake/bake.hpp"
#include "nearmesh/core/mesh/clean.hpp"
#include "nearmesh/core/mesh/generate.hpp"
#include "nearmesh/core/query/probe.hpp"
#ifdef NEARMESH_PEER_EMBREE_RAYS
#include "embree_rays.hpp"
#endif

using namespace nearmesh;

namespace {

constexpr std::size_t kProbes = 10'000;

double cpu_ms() {
  timespec t{};
  ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) * 1e3 + static_cast<double>(t.tv_nsec) * 1e-6;
}

void measure(std::uint32_t faces, const char* probes, const char* who,
             const std::function<std::size_t()>& run) {
  std::vector<double> ms;
  std::size_t hits = 0;
  for (int i = 0; i < 21; ++i) {
    const double start = cpu_ms();
    hits = run();
    ms.push_back(cpu_ms() - start);
  }
  std::sort(ms.begin(), ms.end());
  std::printf("%u,\"%s\",\"%s\",%.3f,%.3f,%zu\n", faces, probes, who, ms.front(), ms[ms.size() / 2],
              hits);
}

struct Rays {
  const char* name;
  std::vector<RayProbe> rays;
};

/// Over the whole terrain at random, around one place, and slanted views.
std::vector<Rays> make_rays(double half_m, double height_m) {
  Random random(1);
  std::vector<Rays> all{{"heights, anywhere", {}},
                        {"heights, within 200 m", {}},
                        {"heights, a grid of 100 x 100", {}},
                        {"rays, from above", {}},
                        {"rays, level", {}}};
  for (std::size_t i = 0; i < kProbes; ++i) {
    const double x = random.between(-1, 1) * half_m, y = random.between(-1, 1) * half_m;
    all[0].rays.push_back({.origin_m = {x, y, height_m}});
    all[1].rays.push_back(
        {.origin_m = {100 + random.between(-200, 200), 200 + random.between(-200, 200), height_m}});
    all[2].rays.push_back({.origin_m = {4.0 * static_cast<double>(i % 100),
                                        4.0 * static_cast<double>(i / 100), height_m}});
    std::array<double, 3> way{random.between(-1, 1), random.between(-1, 1),
                              random.between(-0.5, -0.05)};
    const double length = std::sqrt(way[0] * way[0] + way[1] * way[1] + way[2] * way[2]);
    for (double& part : way) part /= length;
    all[3].rays.push_back({.origin_m = {x, y, height_m}, .direction = way});
    const double flat = std::sqrt(way[0] * way[0] + way[1] * way[1]);
    all[4].rays.push_back({.origin_m = {x, y, height_m / 2},
                           .direction = {way[0] / flat, way[1] / flat, 0},
                           .range_m = 5000});
  }
  return all;
}

void run(std::uint32_t size) {
  const IndexedMesh mesh = generate_terrain(size, 1);
  const CleanResult clean = clean_mesh(mesh).value();
  const BakedModel model = bake(clean.mesh, clean.report.rounding_error_m, {}).value();
  LocalModel held(model.store, model.header.grid);
  RefineDelta delta;
  for (const VertexId split : global_order(model.store, model.header.vertex_count))
    static_cast<void>(held.mesh.split(split, delta));
  held.tree.update(delta);
  const TreeView view = held.view();
  double half_m = 0, height_m = 0;
  for (const auto& p : mesh.positions_m) {
    half_m = std::max(half_m, std::abs(p[0]));
    height_m = std::max(height_m, p[2]);
  }
  const std::uint32_t faces = model.header.face_count;
  Pose turned;
  turned.rotation = {0.36, 0.48, -0.8, -0.8, 0.6, 0, 0.48, 0.64, 0.6};
#ifdef NEARMESH_PEER_EMBREE_RAYS
  const peers::EmbreeRays embree(mesh);
#endif
  std::vector<RayAnswer> answers(kProbes);
  const auto count = [&](const Pose& pose, const std::vector<RayProbe>& rays) {
    const Result<ProbeNeeds> needs = probe(view, pose, rays, answers);
    if (!needs.is_ok() || !needs.value().is_nothing()) return std::size_t{0};
    return static_cast<std::size_t>(
        std::count_if(answers.begin(), answers.end(),
                      [](const RayAnswer& answer) { return answer.status == ProbeStatus::kHit; }));
  };
  for (const Rays& some : make_rays(half_m * 0.99, height_m + 100)) {
    const char* const name = some.name;
    const std::vector<RayProbe>& rays = some.rays;
    measure(faces, name, "nearmesh", [&] { return count({}, rays); });
    std::vector<RayProbe> also = rays;  // with the body
    for (RayProbe& ray : also)
      for (std::array<double, 3>* v : {&ray.origin_m, &ray.direction}) {
        const std::array<double, 3> old = *v;
        for (std::size_t k = 0; k < 3; ++k)
          (*v)[k] = turned.rotation[3 * k] * old[0] + turned.rotation[3 * k + 1] * old[1] +
                    turned.rotation[3 * k + 2] * old[2];
      }
    measure(faces, name, "nearmesh, turned body", [&] { return count(turned, also); });
#ifdef NEARMESH_PEER_EMBREE_RAYS
    std::vector<float> distances(kProbes);
    for (const bool packets : {false, true})
      measure(faces, name, packets ? "embree, packets of 8" : "embree, one by one", [&] {
        embree.trace(rays, distances, packets);
        return static_cast<std::size_t>(std::count_if(distances.begin(), distances.end(),
                                                      [](float d) { return std::isfinite(d); }));
      });
    count({}, rays);
    std::size_t differ = 0;
    for (std::size_t i = 0; i < kProbes; ++i) {
      const bool hits = answers[i].status == ProbeStatus::kHit;
      if (hits != std::isfinite(distances[i]) ||
          (hits && std::abs(answers[i].distance_m() - static_cast<double>(distances[i])) > 0.05))
        ++differ;
    }
    std::printf("%u,\"%s\",differ by more than 5 cm,,,%zu\n", faces, name, differ);
#endif
  }
}

}  // namespace

int main() {
  std::puts("faces,probes,who,least_ms,median_ms,hits");
  for (const std::uint32_t size : {224U, 708U}) run(size);
}
