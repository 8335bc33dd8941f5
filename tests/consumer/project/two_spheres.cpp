// SPDX-License-Identifier: Apache-2.0
// Bakes a sphere and asks, with a proof, whether two of them touch: at half a metre of overlap and
// at half a metre apart.

#include <cstdio>
#include <string>

#include "nearmesh/core/bake/bake.hpp"
#include "nearmesh/core/mesh/generate.hpp"
#include "nearmesh/core/query/certify.hpp"

namespace {

// The answer for two unit spheres whose centres are `distance_m` apart on x.
nearmesh::Result<nearmesh::Answer> ask(const nearmesh::BakedModel& sphere, double distance_m) {
  const nearmesh::Pose here;
  nearmesh::Pose there;
  there.translation_m = {distance_m, 0, 0};
  const nearmesh::Grid& grid = sphere.header.grid;
  const auto placed = nearmesh::pose_pair(grid, here, "left", grid, there, "right");
  if (!placed.is_ok()) return placed.status();
  nearmesh::LocalModel left(sphere.store, grid);
  nearmesh::LocalModel right(sphere.store, grid);
  const auto complete = [](nearmesh::NodeSpan) { return nearmesh::Status::ok(); };
  return nearmesh::certify(left, placed.value().a, complete, right, placed.value().b, complete, {});
}

int fail(const std::string& message) {
  std::fprintf(stderr, "%s\n", message.c_str());
  return 1;
}

}  // namespace

int main() {
  const auto clean = nearmesh::clean_mesh(nearmesh::generate_sphere(32, 1));
  if (!clean.is_ok()) return fail(clean.status().message());
  const auto sphere =
      nearmesh::bake(clean.value().mesh, clean.value().report.rounding_error_m, {.base_faces = 64});
  if (!sphere.is_ok()) return fail(sphere.status().message());

  const auto touching = ask(sphere.value(), 1.5);
  const auto apart = ask(sphere.value(), 2.5);
  if (!touching.is_ok()) return fail(touching.status().message());
  if (!apart.is_ok()) return fail(apart.status().message());
  std::printf("1.5 m: %s, %zu pairs of faces\n", to_string(touching.value().status),
              touching.value().pairs.size());
  std::printf("2.5 m: %s, at least %.3f m\n", to_string(apart.value().status),
              apart.value().clearance_m);
  const bool right = touching.value().status == nearmesh::AnswerStatus::kContact &&
                     !touching.value().pairs.empty() &&
                     apart.value().status == nearmesh::AnswerStatus::kFree &&
                     apart.value().clearance_m > 0 && apart.value().clearance_m <= 0.51;
  return right ? 0 : fail("expected a contact, then a free answer");
}
