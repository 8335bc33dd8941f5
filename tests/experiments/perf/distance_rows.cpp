// SPDX-License-Identifier: Apache-2.0
#include "distance_rows.hpp"

#include <cmath>
#include <cstdio>

#include "test_models.hpp"

namespace nearmesh::perf {
namespace {

Answer ask(const LocalModel& a, const LocalModel& b, const PosedPair& posed, Clearance clearance) {
  return query(a.view(), posed.a, b.view(), posed.b, {.clearance = clearance});
}

/// Of one contender, over the poses.
struct Times {
  std::string name;
  std::vector<double> us;
};

/// How good bounds are, over the poses.
struct Bounds {
  Times times;
  std::vector<double> shares;  // of the exact distance
  int cut = 0;                 // ended by their steps
};

void time_bound(const LocalModel& a, const LocalModel& b, const PosedPair& posed, double exact_m,
                Bounds& bounds) {
  Answer answer;
  bounds.times.us.push_back(
      least_of_three_us([&] { answer = ask(a, b, posed, Clearance::kBound); }));
  bounds.shares.push_back(answer.clearance_m / exact_m);
  bounds.cut += answer.clearance_share < kClearanceShare ? 1 : 0;
}

}  // namespace

int time_distances(const std::string& workload, const PoseSet& set, const Model& a, const Model& b,
                   std::span<Contender> others, int repeats, Report& report) {
  const std::string name = workload + "/" + set.name;
  const WholeModel whole_a(a), whole_b(b);
  // Posed vertices are rounded to the lattice: both sides are given a cell.
  const double cell_m = std::ldexp(4.0, lattice_exponent(a.baked.header.grid, b.baked.header.grid));
  int outside = 0;
  for (int repeat = 0; repeat < repeats; ++repeat) {
    Times exact{kUnderTest, {}};
    Bounds whole{{"nearmesh-bound", {}}, {}, 0}, least{{"nearmesh-bound-least", {}}, {}, 0};
    std::vector<Times> theirs(others.size());
    std::vector<int> theirs_outside(others.size());
    std::vector<double> widths;
    for (const PosePair& at : set.poses) {
      const PosedPair posed = pose_pair(whole_a.grid, at.a, "a", whole_b.grid, at.b, "b").value();
      const Answer truth = ask(whole_a, whole_b, posed, Clearance::kExact);
      if (truth.status != AnswerStatus::kFree) continue;
      exact.us.push_back(least_of_three_us(
          [&] { static_cast<void>(ask(whole_a, whole_b, posed, Clearance::kExact)); }));
      widths.push_back(truth.distance_at_most_m / truth.clearance_m - 1);
      time_bound(whole_a, whole_b, posed, truth.distance_at_most_m, whole);
      LocalModel least_a(a.baked.store, whole_a.grid), least_b(b.baked.store, whole_b.grid);
      static_cast<void>(certify(least_a, posed.a, test::no_require, least_b, posed.b,
                                test::no_require, {.clearance = Clearance::kNone}));
      time_bound(least_a, least_b, posed, truth.distance_at_most_m, least);
      for (std::size_t i = 0; i < others.size(); ++i) {
        others[i].peer->place(at.a, at.b);
        std::optional<double> said = others[i].peer->distance_m();
        if (!said) continue;
        theirs[i].us.push_back(least_of_three_us([&] { said = others[i].peer->distance_m(); }));
        if (*said >= truth.clearance_m - cell_m && *said <= truth.distance_at_most_m + cell_m)
          continue;
        ++theirs_outside[i];
        if (repeat == 0)
          std::fprintf(stderr, "%s: nearmesh says %.9g to %.9g m; %s says %.9g\n", name.c_str(),
                       truth.clearance_m, truth.distance_at_most_m, others[i].info.name.c_str(),
                       *said);
      }
    }
    if (exact.us.empty()) return 0;
    const auto add = [&](const std::string& who, const char* metric, double value,
                         const char* unit) {
      report.add(name, who, std::string("distance_") + metric, value, unit, repeat);
    };
    add(kUnderTest, "poses", static_cast<double>(exact.us.size()), "poses");
    add(kUnderTest, "median", quantile(exact.us, 0.5), "us");
    add(kUnderTest, "width", quantile(widths, 0.5), "share");
    for (const Bounds* bounds : {&whole, &least}) {
      add(bounds->times.name, "median", quantile(bounds->times.us, 0.5), "us");
      add(bounds->times.name, "share", quantile(bounds->shares, 0.5), "share");
      add(bounds->times.name, "cut", bounds->cut, "poses");
    }
    outside = 0;
    for (std::size_t i = 0; i < others.size(); ++i) {
      if (theirs[i].us.empty()) continue;
      add(others[i].info.name, "median", quantile(theirs[i].us, 0.5), "us");
      add(others[i].info.name, "outside", theirs_outside[i], "poses");
      outside += theirs_outside[i];
    }
  }
  return outside;
}

}  // namespace nearmesh::perf
