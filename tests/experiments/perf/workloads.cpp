// SPDX-License-Identifier: Apache-2.0
#include "workloads.hpp"

#include <cmath>
#include <cstdio>
#include <cstdlib>

#include "nearmesh/core/query/query.hpp"
#include "test_models.hpp"

namespace nearmesh::perf {
namespace {

bool touches(const Model& a, const Model& b, const PosePair& poses) {
  const PosedPair posed = pose_pair(a.tree.grid, poses.a, "a", b.tree.grid, poses.b, "b").value();
  return query(a.tree.view(), posed.a, b.tree.view(), posed.b,
               {.any = true, .clearance = Clearance::kNone})
             .status == AnswerStatus::kContact;
}

std::array<double, 3> middle_m(const IndexedMesh& mesh) {
  std::array<double, 3> lo = mesh.positions_m.front(), hi = lo;
  for (const auto& p : mesh.positions_m)
    for (std::size_t k = 0; k < 3; ++k) {
      lo[k] = std::min(lo[k], p[k]);
      hi[k] = std::max(hi[k], p[k]);
    }
  return {(lo[0] + hi[0]) / 2, (lo[1] + hi[1]) / 2, (lo[2] + hi[2]) / 2};
}

double radius_m(const IndexedMesh& mesh) {
  const auto c = middle_m(mesh);
  double square = 0;
  for (const auto& p : mesh.positions_m) {
    double s = 0;
    for (std::size_t k = 0; k < 3; ++k) s += (p[k] - c[k]) * (p[k] - c[k]);
    square = std::max(square, s);
  }
  return std::sqrt(square);
}

}  // namespace

Model make_model(const IndexedMesh& mesh, std::uint32_t base_faces) {
  Result<CleanResult> clean = clean_mesh(mesh);
  if (!clean.is_ok()) {
    std::fprintf(stderr, "%s\n", clean.status().message().c_str());
    std::exit(2);
  }
  GridMesh grid_mesh = clean.value().mesh;
  Result<BakedModel> baked =
      bake(grid_mesh, clean.value().report.rounding_error_m, {.base_faces = base_faces});
  if (!baked.is_ok()) {
    std::fprintf(stderr, "%s\n", baked.status().message().c_str());
    std::exit(2);
  }
  Model model{std::move(baked).value(), {}, {}};
  for (const GridPoint& p : grid_mesh.positions) {
    std::array<double, 3> at = grid_mesh.grid.origin_m;
    for (int k = 0; k < 3; ++k)
      at[static_cast<std::size_t>(k)] += std::ldexp(p[k], grid_mesh.grid.exponent);
    model.mesh.positions_m.push_back(at);
  }
  model.mesh.faces = grid_mesh.faces;
  model.tree = build_full_tree(model.baked.header, model.baked.store).value();
  return model;
}

WholeModel::WholeModel(const Model& model)
    : LocalModel(model.baked.store, model.baked.header.grid) {
  RefineDelta delta;
  for (const VertexId split : global_order(model.baked.store, model.baked.header.vertex_count))
    static_cast<void>(mesh.split(split, delta));
  tree.update(delta);
}

std::vector<PoseSet> distances(const Model& a, const Model& b, int draws) {
  const std::pair<const char*, double> factors[] = {
      {"apart_2", 2},      {"apart_1.1", 1.1},      {"apart_1.01", 1.01}, {"near_miss", 1.00001},
      {"grazing", 0.9999}, {"touching_0.98", 0.98}, {"deep_0.8", 0.8},    {"deep_0.5", 0.5}};
  std::vector<PoseSet> sets;
  for (const auto& [name, factor] : factors) sets.push_back({name, {}});
  Random random(17);
  const auto middle_a = middle_m(a.mesh), middle_b = middle_m(b.mesh);
  const double reach = 1.01 * (radius_m(a.mesh) + radius_m(b.mesh));
  for (int draw = 0; draw < draws; ++draw) {
    PosePair poses;
    poses.b.rotation = test::random_rotation(random);
    const auto turn = test::random_rotation(random);
    const std::array<double, 3> direction{turn[0], turn[3], turn[6]};
    const auto turned = test::place({poses.b.rotation, {}}, middle_b);
    const auto at_distance = [&](double distance) {
      PosePair at = poses;
      for (std::size_t k = 0; k < 3; ++k)
        at.b.translation_m[k] = middle_a[k] - turned[k] + distance * direction[k];
      return at;
    };
    // From far outside inwards, so that the first contact is found also where the bodies are not
    // convex.
    double free = reach, inside = reach;
    while (inside > 0 && !touches(a, b, at_distance(inside))) {
      free = inside;
      inside -= reach / 64;
    }
    for (int i = 0; i < 40; ++i) {
      const double between = (free + inside) / 2;
      (touches(a, b, at_distance(between)) ? inside : free) = between;
    }
    for (std::size_t i = 0; i < sets.size(); ++i)
      sets[i].poses.push_back(at_distance(free * factors[i].second));
  }
  return sets;
}

PoseSet flight(const Model& terrain, const Model& aircraft, int frames) {
  PoseSet set{"flight", {}};
  const double half = radius_m(terrain.mesh) / 3, low = 0.4 * radius_m(aircraft.mesh);
  for (int i = 0; i < frames; ++i) {
    // 60 m/s at 20 frames a second, along a slow turn.
    const double s = 3.0 * i;
    const double heading = 0.002 * i, c = std::cos(heading), sn = std::sin(heading);
    PosePair at;
    at.b.rotation = {c, -sn, 0, sn, c, 0, 0, 0, 1};
    at.b.translation_m = {-half / 2 + s * c, half / 3 + s * sn, 0};
    // The ground below, by the nearest vertex of the terrain.
    double best = 1e300, height = 0;
    for (const auto& p : terrain.mesh.positions_m) {
      const double dx = p[0] - at.b.translation_m[0], dy = p[1] - at.b.translation_m[1];
      if (dx * dx + dy * dy < best) {
        best = dx * dx + dy * dy;
        height = p[2];
      }
    }
    at.b.translation_m[2] = height + low * (0.6 + 0.6 * std::sin(0.1 * i));
    set.poses.push_back(at);
  }
  return set;
}

}  // namespace nearmesh::perf
