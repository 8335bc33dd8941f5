// SPDX-License-Identifier: Apache-2.0
#pragma once
// Small models, baked once, with poses in which two of them touch, nearly touch or stay apart.

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "core/base/hash.hpp"
#include "fault_of.hpp"
#include "fuzz_input.hpp"
#include "nearmesh/core/abtree/detail/ab_tree.hpp"
#include "nearmesh/core/bake/bake.hpp"
#include "nearmesh/core/mesh/generate.hpp"
#include "nearmesh/core/query/query.hpp"
#include "random_rotation.hpp"
#include "soup.hpp"

namespace nearmesh::fuzz {

/// A complete model, and its full mesh as a fixed tree.
struct FullModel {
  BakedModel baked;
  TriangleTree tree;

  [[nodiscard]] const SpmHeader& header() const { return baked.header; }
  [[nodiscard]] const SplitStore& store() const { return baked.store; }
  [[nodiscard]] std::uint32_t vertex_count() const { return baked.header.vertex_count; }
};

inline FullModel make_model(const IndexedMesh& mesh, int grid_bits) {
  const Result<CleanResult> clean = clean_mesh(mesh, {.grid_bits = grid_bits});
  FUZZ_CHECK(clean.is_ok());
  Result<BakedModel> baked =
      bake(clean.value().mesh, clean.value().report.rounding_error_m, {.base_faces = 8});
  FUZZ_CHECK(baked.is_ok());
  std::optional<TriangleTree> tree = build_full_tree(baked.value().header, baked.value().store);
  FUZZ_CHECK(tree.has_value());
  return {std::move(baked).value(), *std::move(tree)};
}

/// A sphere and a rough patch of ground, both of some 80 vertices (more than a slot holds), and a
/// soup.
inline const std::vector<FullModel>& models() {
  static const std::vector<FullModel> all = [] {
    std::vector<FullModel> made;
    made.push_back(make_model(generate_sphere(14, 0), 12));
    IndexedMesh ground = generate_terrain(8, 7);
    const double height = ground.positions_m.front()[2];
    for (auto& p : ground.positions_m)  // to the others' size and place
      p = {p[0] / 96, p[1] / 96, (p[2] - height) / 96};
    made.push_back(make_model(ground, 16));
    made.push_back(make_model(test::make_soup(24, 60, 3), 21));
    return made;
  }();
  return all;
}

/// Model `a` at rest, model `b` turned and moved by the number-th of some fixed ways.
inline PosedPair make_pair(const FullModel& a, const FullModel& b, std::uint32_t number) {
  Random random(number);
  Pose pose_a, pose_b;
  double q[4], length = 0;
  for (double& x : q) {
    x = random.between(-1, 1);
    length += x * x;
  }
  if (number % 4 != 0) pose_b.rotation = test::rotation_of(q, std::sqrt(length));
  const double reach = number % 3 == 0 ? 0.7 : 1.9;
  for (double& t : pose_b.translation_m) t = random.between(-reach, reach);
  const Result<PosedPair> posed =
      pose_pair(a.header().grid, pose_a, "a", b.header().grid, pose_b, "b");
  FUZZ_CHECK(posed.is_ok());
  return posed.value();
}

/// An answer must never contradict the full meshes'.
inline void check_never_wrong(const Answer& answer, const Answer& full) {
  FUZZ_CHECK(full.status == AnswerStatus::kFree || full.status == AnswerStatus::kContact);
  FUZZ_CHECK(test::fault_of(answer, full).empty());
}

/// What a set of active vertices must be, whatever was done to reach it.
inline void check_mesh(const ActiveMesh& mesh) {
  const SplitStore& store = mesh.store();
  std::uint32_t splits = 0;
  std::uint64_t hash = 0;
  for (std::uint32_t v = 0; v < store.vertex_count(); ++v) {
    const auto half_spaces = mesh.half_spaces().of({v});
    FUZZ_CHECK(half_spaces.size() <= kMaxHalfSpaces);
    FUZZ_CHECK(half_spaces.empty() || (mesh.is_active({v}) && !mesh.is_resolved({v})));
    for (const HalfSpace& half_space : half_spaces)
      hash += mix(mix(v) ^ (std::uint64_t{half_space.direction} << kReachBits | half_space.reach));
    if (!mesh.is_active({v})) continue;
    FUZZ_CHECK(store.is_known({v}));
    if (store.is_root({v})) continue;
    ++splits;
    hash += mix(v);
    // Closed towards the roots: the node that the split divides came about.
    const NodeSpan node = store.node_of({v});
    FUZZ_CHECK(store.is_node(node) && store.split_of(node) == VertexId{v});
    FUZZ_CHECK(mesh.is_active(node.first));
    FUZZ_CHECK(node == store.initial_node(node.first) || mesh.is_active({node.end()}));
  }
  FUZZ_CHECK(splits == mesh.split_count());
  FUZZ_CHECK(hash == mesh.state_hash());
}

}  // namespace nearmesh::fuzz
