// SPDX-License-Identifier: Apache-2.0
// CGAL with exact predicates and inexact constructions, in two ways.
// Rigid_triangle_mesh_collision_detection moves trees by transforms; it says whether surfaces meet,
// not where. An AABB_tree of a's posed triangles answers for each of b's; posed points are doubles:
// rotation and translation round, which matters only where the true point is no double.
#include <CGAL/AABB_traits.h>
#include <CGAL/AABB_tree.h>
#include <CGAL/AABB_triangle_primitive.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/IO/polygon_soup_io.h>
#include <CGAL/Polygon_mesh_processing/intersection.h>
#include <CGAL/Rigid_triangle_mesh_collision_detection.h>
#include <CGAL/Surface_mesh.h>
#include <CGAL/version.h>

#include <iterator>

#include "peers.hpp"

namespace nearmesh::peers {
namespace {

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Points = std::vector<Kernel::Point_3>;
using Mesh = CGAL::Surface_mesh<Kernel::Point_3>;
using Triangles = std::vector<Kernel::Triangle_3>;
using Primitive = CGAL::AABB_triangle_primitive<Kernel, Triangles::const_iterator>;
using Tree = CGAL::AABB_tree<CGAL::AABB_traits<Kernel, Primitive>>;

Points posed(const IndexedMesh& mesh, const Pose& pose) {
  const auto& r = pose.rotation;
  const auto& t = pose.translation_m;
  Points points;
  for (const auto& p : mesh.positions_m)
    points.emplace_back(r[0] * p[0] + r[1] * p[1] + r[2] * p[2] + t[0],
                        r[3] * p[0] + r[4] * p[1] + r[5] * p[2] + t[1],
                        r[6] * p[0] + r[7] * p[1] + r[8] * p[2] + t[2]);
  return points;
}

Triangles triangles(const IndexedMesh& mesh, const Pose& pose) {
  const Points points = posed(mesh, pose);
  Triangles out;
  for (const auto& f : mesh.faces) out.emplace_back(points[f[0]], points[f[1]], points[f[2]]);
  return out;
}

// A non-manifold face cannot be added to such a mesh; it is left out, and the answer may differ for
// it.
Mesh surface(const IndexedMesh& mesh, const Pose& pose) {
  Mesh out;
  for (const Kernel::Point_3& p : posed(mesh, pose)) out.add_vertex(p);
  for (const auto& f : mesh.faces)
    out.add_face(Mesh::Vertex_index(f[0]), Mesh::Vertex_index(f[1]), Mesh::Vertex_index(f[2]));
  return out;
}

Kernel::Aff_transformation_3 transform(const Pose& pose) {
  const auto& r = pose.rotation;
  const auto& t = pose.translation_m;
  return {r[0], r[1], r[2], t[0], r[3], r[4], r[5], t[1], r[6], r[7], r[8], t[2]};
}

class Rigid : public Peer {
 public:
  Rigid(const IndexedMesh& a, const IndexedMesh& b) : a_(surface(a, {})), b_(surface(b, {})) {
    detection_.add_mesh(a_, CGAL::parameters::apply_per_connected_component(false));
    detection_.add_mesh(b_, CGAL::parameters::apply_per_connected_component(false));
  }
  void place(const Pose& a, const Pose& b) override {
    detection_.set_transformation(0, transform(a));
    detection_.set_transformation(1, transform(b));
  }
  bool touches() override { return !detection_.get_all_intersections(0).empty(); }

 private:
  Mesh a_, b_;
  CGAL::Rigid_triangle_mesh_collision_detection<Mesh> detection_;
};

class PosedTriangles : public Peer {
 public:
  PosedTriangles(const IndexedMesh& a, const IndexedMesh& b) : a_(a), b_(b) {}
  void place(const Pose& a, const Pose& b) override {
    pose_a_ = a;
    pose_b_ = b;
  }
  bool touches() override { return count_pairs() > 0; }
  std::optional<std::uint64_t> count_pairs() override {
    const Triangles of_a = triangles(a_, pose_a_), of_b = triangles(b_, pose_b_);
    Tree tree(of_a.begin(), of_a.end());
    std::uint64_t pairs = 0;
    for (const Kernel::Triangle_3& triangle : of_b) {
      std::vector<Tree::Primitive_id> hit;
      tree.all_intersected_primitives(triangle, std::back_inserter(hit));
      pairs += hit.size();
    }
    return pairs;
  }
  std::optional<std::uint64_t> count_distinct_pairs(std::size_t /*limit*/) override {
    return count_pairs();
  }
  std::optional<bool> solids_meet() override {
    return CGAL::Polygon_mesh_processing::do_intersect(
        surface(a_, pose_a_), surface(b_, pose_b_),
        CGAL::parameters::do_overlap_test_of_bounded_sides(true));
  }

 private:
  const IndexedMesh a_, b_;
  Pose pose_a_, pose_b_;
};

// PLY, STL, OFF, OBJ as a soup of polygons.
bool reads(const std::string& path) {
  Points points;
  std::vector<std::vector<std::size_t>> polygons;
  return CGAL::IO::read_polygon_soup(path, points, polygons) && !polygons.empty();
}

template <class Way>
PeerInfo info(const std::string& name) {
  return {.name = name,
          .library = "CGAL",
          .version = CGAL_VERSION_STR,
          .make = [](const IndexedMesh& a, const IndexedMesh& b) -> std::unique_ptr<Peer> {
            return std::make_unique<Way>(a, b);
          },
          .reads = reads};
}

}  // namespace

PeerInfo cgal_rigid() { return info<Rigid>("cgal-exact"); }
PeerInfo cgal_triangles() { return info<PosedTriangles>("cgal-triangles"); }

}  // namespace nearmesh::peers
