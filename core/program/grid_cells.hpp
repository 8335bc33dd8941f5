// SPDX-License-Identifier: Apache-2.0
#pragma once
// How Liu, Georganas and Roth 2006 predict where detail is needed. For the methods that certified
// answers are compared with.

#include <algorithm>
#include <array>
#include <set>
#include <vector>

#include "nearmesh/core/refine/detail/active_mesh.hpp"

namespace nearmesh::program {

/// Their section 3.2: the model's box is cut into cells, 8 along each axis as printed; the cells
/// where the current meshes touch, and their neighbours, are refined fully; then the query runs
/// again, until no new cell is touched.
class GridCells {
 public:
  explicit GridCells(const SplitStore& store, int cells_per_axis = 8)
      : box_(store.whole_box()),
        cells_(cells_per_axis),
        by_cell_(static_cast<std::size_t>(cells_) * static_cast<std::size_t>(cells_) *
                 static_cast<std::size_t>(cells_)) {
    for (std::uint32_t v = 0; v < store.vertex_count(); ++v)
      by_cell_[static_cast<std::size_t>(cell_of(store.position({v})))].push_back({v});
  }
  [[nodiscard]] const std::vector<VertexId>& vertices(int cell) const {
    return by_cell_[static_cast<std::size_t>(cell)];
  }

  /// The cells that a box reaches into, and their neighbours.
  void touched(const GridBox& box, std::set<int>& cells) const {
    std::array<int, 3> lo{}, hi{};
    for (std::size_t k = 0; k < 3; ++k) {
      lo[k] = std::max(0, along(box.lo.v[k], static_cast<int>(k)) - 1);
      hi[k] = std::min(cells_ - 1, along(box.hi.v[k], static_cast<int>(k)) + 1);
    }
    for (int x = lo[0]; x <= hi[0]; ++x)
      for (int y = lo[1]; y <= hi[1]; ++y)
        for (int z = lo[2]; z <= hi[2]; ++z) cells.insert((x * cells_ + y) * cells_ + z);
  }

 private:
  [[nodiscard]] int along(std::int32_t x, int k) const {
    const std::int64_t extent = std::int64_t{box_.hi[k]} - box_.lo[k] + 1;
    return static_cast<int>(
        std::clamp<std::int64_t>((std::int64_t{x} - box_.lo[k]) * cells_ / extent, 0, cells_ - 1));
  }
  [[nodiscard]] int cell_of(const GridPoint& p) const {
    return (along(p[0], 0) * cells_ + along(p[1], 1)) * cells_ + along(p[2], 2);
  }
  GridBox box_;
  int cells_;
  std::vector<std::vector<VertexId>> by_cell_;
};

/// The box of a face as it is in the current mesh.
inline GridBox current_box(const ActiveMesh& mesh, FaceKey key) {
  GridBox box;
  for (const VertexId corner : mesh.store().face(key).corners())
    box.add(mesh.store().position(mesh.active_predecessor(corner)));
  return box;
}

}  // namespace nearmesh::program
