// SPDX-License-Identifier: Apache-2.0
// CGAL with exact predicates: an AABB_tree over a's posed triangles, all_intersected_primitives for each of b's.
// Posed points are doubles: rotation and translation round, which matters only where the true point is no double.
#include <CGAL/AABB_traits.h>
#include <CGAL/AABB_tree.h>
#include <CGAL/AABB_triangle_primitive.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/IO/polygon_soup_io.h>
#include <CGAL/Polygon_mesh_processing/intersection.h>
#include <CGAL/Surface_mesh.h>
#include <CGAL/version.h>

#include <iterator>

#include "held.hpp"
#include "system.hpp"

namespace nearmesh::stability {
namespace {

using Kind = Verdict::Kind;
using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Triangles = std::vector<Kernel::Triangle_3>;
using Primitive = CGAL::AABB_triangle_primitive<Kernel, Triangles::const_iterator>;
using Tree = CGAL::AABB_tree<CGAL::AABB_traits<Kernel, Primitive>>;

Triangles posed(const IndexedMesh& mesh, const Pose& pose) {
  std::vector<Kernel::Point_3> points;
  const auto& r = pose.rotation;
  const auto& t = pose.translation_m;
  for (const auto& p : mesh.positions_m)
    points.emplace_back(r[0] * p[0] + r[1] * p[1] + r[2] * p[2] + t[0],
                        r[3] * p[0] + r[4] * p[1] + r[5] * p[2] + t[1],
                        r[6] * p[0] + r[7] * p[1] + r[8] * p[2] + t[2]);
  Triangles triangles;
  for (const auto& f : mesh.faces) triangles.emplace_back(points[f[0]], points[f[1]], points[f[2]]);
  return triangles;
}

/// Reads PLY, STL, OFF, OBJ as a soup of polygons.
Verdict read_file(const std::string& path) {
  std::vector<Kernel::Point_3> points;
  std::vector<std::vector<std::size_t>> polygons;
  const bool read = CGAL::IO::read_polygon_soup(path, points, polygons) && !polygons.empty();
  return {.kind = read ? Kind::kFree : Kind::kRefused};
}

using SurfaceMesh = CGAL::Surface_mesh<Kernel::Point_3>;

SurfaceMesh closed_surface(const Body& body) {
  SurfaceMesh mesh;
  std::vector<SurfaceMesh::Vertex_index> vertices;
  const auto& r = body.pose.rotation;
  const auto& t = body.pose.translation_m;
  for (const auto& p : body.mesh->positions_m)
    vertices.push_back(mesh.add_vertex({r[0] * p[0] + r[1] * p[1] + r[2] * p[2] + t[0],
                                        r[3] * p[0] + r[4] * p[1] + r[5] * p[2] + t[1],
                                        r[6] * p[0] + r[7] * p[1] + r[8] * p[2] + t[2]}));
  for (const auto& f : body.mesh->faces)
    mesh.add_face(vertices[f[0]], vertices[f[1]], vertices[f[2]]);
  return mesh;
}

Verdict solids(const Case& asked) {
  namespace pmp = CGAL::Polygon_mesh_processing;
  const bool meet = pmp::do_intersect(closed_surface(asked.a), closed_surface(asked.b),
                                      CGAL::parameters::do_overlap_test_of_bounded_sides(true));
  return {.kind = meet ? Kind::kTouches : Kind::kFree};
}

class Cgal : public System {
 public:
  [[nodiscard]] std::string name() const override { return "CGAL"; }
  [[nodiscard]] std::string version() const override { return CGAL_VERSION_STR; }
  [[nodiscard]] std::string call() const override {
    return "exact predicates, inexact constructions; AABB_tree of a's posed triangles, "
           "all_intersected_primitives for "
           "each of b's; files by IO::read_polygon_soup. F2: "
           "Polygon_mesh_processing::do_intersect with do_overlap_test_of_bounded_sides";
  }

  [[nodiscard]] Verdict answer(const Case& asked) const override {
    if (asked.question == Question::kBounds || asked.question == Question::kIncremental) return {};
    if (asked.question == Question::kLimit || asked.question == Question::kSweep ||
        asked.question == Question::kContacts)
      return {};
    if (asked.question == Question::kSolids) return solids(asked);
    if (asked.question == Question::kFile) return read_file(asked.path);
    const Triangles of_a = posed(held_of(asked), asked.a.pose),
                    of_b = posed(*asked.b.mesh, asked.b.pose);
    Tree tree(of_a.begin(), of_a.end());
    std::uint64_t pairs = 0;
    for (const Kernel::Triangle_3& triangle : of_b) {
      std::vector<Tree::Primitive_id> hit;
      tree.all_intersected_primitives(triangle, std::back_inserter(hit));
      pairs += hit.size();
    }
    return {.kind = pairs > 0 ? Kind::kTouches : Kind::kFree, .has_pairs = true, .pairs = pairs};
  }
};

}  // namespace

std::unique_ptr<System> make_cgal() { return std::make_unique<Cgal>(); }

}  // namespace nearmesh::stability
