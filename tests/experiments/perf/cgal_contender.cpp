// SPDX-License-Identifier: Apache-2.0
// CGAL: Rigid_triangle_mesh_collision_detection with exact predicates. It says whether surfaces meet, not where.
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Rigid_triangle_mesh_collision_detection.h>
#include <CGAL/Surface_mesh.h>

#include "contender.hpp"

namespace nearmesh::perf {
namespace {

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Mesh = CGAL::Surface_mesh<Kernel::Point_3>;

// A non-manifold face cannot be added to such a mesh; it is left out, and the answer may differ for it.
Mesh build(const IndexedMesh& mesh) {
  Mesh out;
  for (const auto& p : mesh.positions_m) out.add_vertex({p[0], p[1], p[2]});
  for (const auto& f : mesh.faces)
    out.add_face(Mesh::Vertex_index(f[0]), Mesh::Vertex_index(f[1]), Mesh::Vertex_index(f[2]));
  return out;
}

Kernel::Aff_transformation_3 transform(const Pose& pose) {
  const auto& r = pose.rotation;
  const auto& t = pose.translation_m;
  return {r[0], r[1], r[2], t[0], r[3], r[4], r[5], t[1], r[6], r[7], r[8], t[2]};
}

class Cgal : public Contender {
 public:
  Cgal(const IndexedMesh& a, const IndexedMesh& b) : a_(build(a)), b_(build(b)) {
    detection_.add_mesh(a_, CGAL::parameters::apply_per_connected_component(false));
    detection_.add_mesh(b_, CGAL::parameters::apply_per_connected_component(false));
  }
  void place(const Pose& a, const Pose& b) override {
    detection_.set_transformation(0, transform(a));
    detection_.set_transformation(1, transform(b));
  }
  bool touches() override { return !detection_.get_all_intersections(0).empty(); }
  std::optional<std::uint64_t> count_pairs() override { return std::nullopt; }
  bool refit_b(const std::vector<std::array<double, 3>>& /*positions_m*/) override { return false; }

 private:
  Mesh a_, b_;
  CGAL::Rigid_triangle_mesh_collision_detection<Mesh> detection_;
};

}  // namespace

std::unique_ptr<Contender> make_cgal(const IndexedMesh& a, const IndexedMesh& b) {
  return std::make_unique<Cgal>(a, b);
}

}  // namespace nearmesh::perf
