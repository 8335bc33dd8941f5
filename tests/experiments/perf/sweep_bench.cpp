// SPDX-License-Identifier: Apache-2.0
// Time of a sweep against that of a query, without clearance and with both kinds, as CSV: an
// aircraft of 20,000 faces at 50 m/s near a terrain of 100,000.
//   nearmesh-bench-sweep
// Single thread, thread CPU time; medians and 95th percentiles of 100 places.

#include <algorithm>
#include <cstdio>
#include <ctime>

#include "core/base/random.hpp"
#include "full_tree.hpp"
#include "nearmesh/core/mesh/generate.hpp"
#include "nearmesh/core/query/sweep.hpp"

using namespace nearmesh;

namespace {

double cpu_us() {
  timespec t{};
  ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) * 1e6 + static_cast<double>(t.tv_nsec) * 1e-3;
}

Answer still(const TreeView& a, const TreeView& b, const Pose& pose, Clearance clearance) {
  const PosedPair posed = pose_pair(*a.grid, {}, "terrain", *b.grid, pose, "aircraft").value();
  return query(a, posed.a, b, posed.b, {.clearance = clearance});
}

/// Comes down until it is about so far from the ground.
void descend(const TreeView& ground, const TreeView& aircraft, double distance_m, Pose& pose) {
  for (int i = 0; i < 60; ++i) {
    const double left_m = still(ground, aircraft, pose, Clearance::kExact).clearance_m - distance_m;
    if (left_m < 0.05 * distance_m) return;
    pose.translation_m[2] -= 0.98 * left_m;
  }
}

struct Sample {
  std::vector<double> us;
  void add(double x) { us.push_back(x); }
  double quantile(double q) {
    std::sort(us.begin(), us.end());
    return us[static_cast<std::size_t>(q * static_cast<double>(us.size() - 1) + 0.5)];
  }
};

void measure(const TreeView& ground, const TreeView& aircraft, const char* name, double distance_m,
             std::array<double, 3> velocity_mps, double duration_s) {
  Random random(1);
  Sample query_us, bound_us, exact_us, share, sweep_us;
  int stopped = 0;
  std::array<int, 4> seen{};
  for (int i = 0; i < 100; ++i) {
    Motion motion;
    motion.pose.translation_m = {random.between(-2500, 2500), random.between(-2500, 2500), 3000};
    motion.linear_velocity_mps = velocity_mps;
    motion.angular_velocity_radps = {0, 0.3, 0.4};
    descend(ground, aircraft, distance_m, motion.pose);
    const double start = cpu_us();
    static_cast<void>(still(ground, aircraft, motion.pose, Clearance::kNone));
    const double queried = cpu_us();
    const Answer bound = still(ground, aircraft, motion.pose, Clearance::kBound);
    const double bounded = cpu_us();
    const Answer exact = still(ground, aircraft, motion.pose, Clearance::kExact);
    const double cleared = cpu_us();
    const SweptAnswer answer =
        sweep(ground, {}, "terrain", aircraft, motion, "aircraft", {.duration_s = duration_s})
            .value();
    sweep_us.add(cpu_us() - cleared);
    bound_us.add(bounded - queried);
    exact_us.add(cleared - bounded);
    share.add(bound.clearance_m / exact.clearance_m);
    stopped += bound.clearance_share < kClearanceShare ? 1 : 0;
    query_us.add(queried - start);
    ++seen[static_cast<std::size_t>(answer.status)];
  }
  std::printf("%s,%g,%g,%.0f,%.0f,%.0f,%.2f,%d,%.0f,%.0f,%d,%d,%d\n", name, distance_m, duration_s,
              query_us.quantile(0.5), bound_us.quantile(0.5), exact_us.quantile(0.5),
              share.quantile(0.5), stopped, sweep_us.quantile(0.5), sweep_us.quantile(0.95),
              seen[0], seen[1], seen[3]);
}

}  // namespace

int main() {
  const TriangleTree ground = full_tree(generate_terrain(224, 7));
  const TriangleTree aircraft = full_tree(generate_aircraft(20000, 7));
  std::printf(
      "motion,distance_m,duration_s,query_us,query_with_bound_us,query_with_exact_us,"
      "bound_to_exact,ended_by_steps,sweep_us,sweep_p95_us,"
      "free,contact,uncertain\n");
  for (const double duration_s : {0.05, 0.5}) {
    for (const double distance_m : {100.0, 10.0, 1.0})
      measure(ground.view(), aircraft.view(), "level", distance_m, {50, 0, 0}, duration_s);
    measure(ground.view(), aircraft.view(), "dive", 2, {0, 0, -50}, duration_s);
  }
  return 0;
}
