// SPDX-License-Identifier: Apache-2.0
#pragma once
// Is every stored bound of a progressive model a bound? An independent check over all nodes of the
// merge forest and over levels of detail, from the faces and positions alone.

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "nearmesh/core/query/query.hpp"
#include "nearmesh/core/refine/detail/active_mesh.hpp"

namespace nearmesh::test {

/// Faces by the vertices that they have as corners.
class FacesOfVertex {
 public:
  explicit FacesOfVertex(const SplitStore& store) : faces_of_(store.vertex_count()) {
    const auto take = [this](const SplitFace& face) {
      for (const VertexId corner : face.corners())
        faces_of_[corner.value].push_back(static_cast<std::uint32_t>(faces_.size()));
      faces_.push_back(face);
    };
    for (const SplitFace& face : store.base_faces()) take(face);
    for (std::uint32_t v = 0; v < store.vertex_count(); ++v)
      if (!store.is_root({v}))
        for (const SplitFace& face : store.faces({v})) take(face);
  }
  [[nodiscard]] const std::vector<SplitFace>& faces() const { return faces_; }
  [[nodiscard]] const std::vector<std::uint32_t>& of(VertexId v) const {
    return faces_of_[v.value];
  }

 private:
  std::vector<SplitFace> faces_;
  std::vector<std::vector<std::uint32_t>> faces_of_;
};

/// Distance of two grid points, rounded up.
inline double distance_up(const GridPoint& p, const GridPoint& q) {
  // Of 32-bit differences: below 2^66 only in theory, grids have 31 bits at most.
  std::int64_t square = 0;
  for (int k = 0; k < 3; ++k) {
    const std::int64_t d = std::int64_t{p[k]} - q[k];
    square += d * d;
  }
  if (square == 0) return 0;
  const auto rounded = static_cast<double>(square);
  return std::nextafter(std::sqrt(std::nextafter(rounded, 1e300)), 1e300);
}

/// Checks one node: each original face with a corner below it lies, corner by corner, inside the
/// node's box and within node_bound of the vertex that stands for the node. A triangle lies where
/// its corners lie, since boxes and balls are convex. Appends to `trouble` and stops at the first
/// violation.
inline void check_node(const SplitStore& store, const FacesOfVertex& faces, NodeSpan node,
                       std::string& trouble) {
  if (!trouble.empty()) return;
  const GridBox box = store.box(node);
  const double bound = node_bound(store, node);
  for (std::uint32_t v = node.begin(); v < node.end(); ++v)
    for (const std::uint32_t f : faces.of({v}))
      for (const VertexId corner : faces.faces()[f].corners()) {
        const GridPoint& p = store.position(corner);
        GridBox of_corner;
        of_corner.add(p);
        const std::string which = "node " + std::to_string(node.begin()) + " of " +
                                  std::to_string(node.size) + ", corner " +
                                  std::to_string(corner.value) + ": ";
        if (!box.contains(of_corner)) trouble = which + "outside the node's box";
        if (distance_up(p, store.position(node.first)) > bound)
          trouble = which + "farther than the bound " + std::to_string(bound);
        if (!trouble.empty()) return;
      }
}

/// Checks a level: in the current mesh each face with a corner in an unresolved node has an image
/// that holds the vertex standing for it (so the distance above is one to the image), or has fallen
/// together to an edge or point that does.
inline void check_level(const ActiveMesh& mesh, const FacesOfVertex& faces, std::string& trouble) {
  if (!trouble.empty()) return;
  const SplitStore& store = mesh.store();
  for (const SplitFace& face : faces.faces()) {
    for (const VertexId corner : face.corners()) {
      const VertexId stands = mesh.active_predecessor(corner);
      const NodeSpan node = mesh.current_node(stands);
      if (!node.contains(corner) || node.first != stands)
        trouble = "vertex " + std::to_string(stands.value) + " does not stand for " +
                  std::to_string(corner.value);
      for (const VertexId other : face.corners())
        if (distance_up(store.position(other), store.position(stands)) > node_bound(store, node))
          trouble = "a face of node " + std::to_string(node.begin()) +
                    " is farther from its image than the bound";
      if (!trouble.empty()) return;
    }
  }
}

/// Every node of the forest, and `levels` levels of global refinement between base and full mesh.
/// Empty when all holds, else the first violation. The store is complete. Cost: O(faces x (depth +
/// levels)).
[[nodiscard]] inline std::string check_bounds(const SplitStore& store, std::size_t levels) {
  const FacesOfVertex faces(store);
  std::string trouble;
  for (const BaseRoot& root : store.roots()) check_node(store, faces, root.node, trouble);
  const std::vector<VertexId> order = global_order(store, 0xffffffffU);
  for (const VertexId u : order) {
    const NodeSpan node = store.node_of(u);
    check_node(store, faces, node.left_of(u), trouble);
    check_node(store, faces, node.right_of(u), trouble);
  }
  ActiveMesh mesh(store);
  RefineDelta delta;
  std::size_t done = 0;
  for (std::size_t level = 0; level <= levels; ++level) {
    for (; done < order.size() * level / std::max<std::size_t>(levels, 1); ++done)
      if (!mesh.split(order[done], delta)) return "a split of the complete store cannot be done";
    check_level(mesh, faces, trouble);
  }
  return trouble;
}

}  // namespace nearmesh::test
