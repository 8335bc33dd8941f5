// SPDX-License-Identifier: Apache-2.0
#pragma once
// One way of asking whether two fixed meshes touch under given poses: ours, or a neighbouring library's. All are given
// the same triangles (of the grid meshes, in metres) and the same poses, and do what a careful user of each would do.

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "nearmesh/core/geometry/pose.hpp"
#include "nearmesh/core/mesh/detail/indexed_mesh.hpp"

namespace nearmesh::perf {

class Contender {
 public:
  virtual ~Contender() = default;
  /// Places the bodies. Not timed: transforms are copied here, and a progressive replica fetches what it lacks.
  virtual void place(const Pose& a, const Pose& b) = 0;
  /// First contact: whether they touch. Timed.
  virtual bool touches() = 0;
  /// All touching pairs of triangles; nothing where the library cannot say. Timed.
  virtual std::optional<std::uint64_t> count_pairs() = 0;
  /// Refits whatever it has to `positions_m` of body b after every vertex moved; false where the library cannot. Timed.
  virtual bool refit_b(const std::vector<std::array<double, 3>>& positions_m) = 0;
};

/// What the answers of a contender may be compared for.
struct ContenderInfo {
  std::string name;
  bool counts_exactly = false;  ///< its number of pairs is to equal ours; booleans always are
  std::unique_ptr<Contender> (*make)(const IndexedMesh& a, const IndexedMesh& b);
};

/// The libraries that were found when this was built.
[[nodiscard]] std::vector<ContenderInfo> peers();

std::unique_ptr<Contender> make_fcl_obb(const IndexedMesh& a, const IndexedMesh& b);
std::unique_ptr<Contender> make_fcl_obbrss(const IndexedMesh& a, const IndexedMesh& b);
std::unique_ptr<Contender> make_bullet(const IndexedMesh& a, const IndexedMesh& b);
std::unique_ptr<Contender> make_embree(const IndexedMesh& a, const IndexedMesh& b);
std::unique_ptr<Contender> make_cgal(const IndexedMesh& a, const IndexedMesh& b);

}  // namespace nearmesh::perf
