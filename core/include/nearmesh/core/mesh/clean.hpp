// SPDX-License-Identifier: Apache-2.0
#pragma once
// From a mesh as it came (IndexedMesh) to integer geometry fit for simplification (GridMesh):
// rounded to a power-of-two grid, welded, with what was dropped counted by kind.

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "nearmesh/core/base/ids.hpp"
#include "nearmesh/core/geometry/grid.hpp"
#include "nearmesh/core/mesh/indexed_mesh.hpp"

namespace nearmesh {

/// Faces of distinct vertices on a grid. Vertex numbers here are places in `positions` (they become
/// VertexIds only when the merge forest is numbered).
struct GridMesh {
  Grid grid;
  std::vector<GridPoint> positions;
  std::vector<std::array<std::uint32_t, 3>> faces;  ///< three distinct indices, input orientation
                                                    ///< and rotation kept
  std::vector<FaceId> face_ids;                     ///< input number of each face, ascending
};

/// What clean_mesh did, for the report of `nearmesh-model build`.
struct CleanReport {
  std::uint64_t vertices_in = 0, faces_in = 0;
  std::uint64_t vertices_unreferenced = 0;    ///< dropped
  std::uint64_t vertices_welded = 0;          ///< merged into another at the same grid point
  std::uint64_t faces_duplicate = 0;          ///< dropped: same three grid points as an earlier face
  std::uint64_t faces_degenerate_dropped = 0; ///< a repeated grid point, covered by a kept face's edge or corner
  std::uint64_t faces_degenerate_kept = 0;    ///< a repeated grid point, kept as a segment or point
  std::uint64_t edges_non_manifold = 0;       ///< with more than two faces
  std::uint64_t edges_boundary = 0;           ///< with one face
  std::uint64_t components = 0;               ///< connected through shared vertices
  double rounding_error_m = 0;                ///< greatest distance of a vertex from its grid point
};

struct CleanResult {
  GridMesh mesh;
  CleanReport report;
};

/// Rounds to a grid of `grid_bits` bits per axis, welds equal grid points, drops unreferenced
/// vertices and duplicate faces. The cell is the smallest power of two for which the bounding box fits;
/// the origin is a multiple of the cell, so that regular data keeps its common factors of two.
/// A face whose corners fall together is a segment or a point: dropped where a kept face covers it, else kept
/// with duplicated vertices (F4: nothing touchable may vanish).
/// In: at least one face; indices in range; coordinates of referenced vertices finite; grid_bits in
/// [kMinGridBits, kMaxGridBits]. Errors: kInvalidArgument naming the first offender (vertex or face number,
/// what was found); the input is untouched. Cost: O(n log n).
[[nodiscard]] Result<CleanResult> clean_mesh(const IndexedMesh& mesh, int grid_bits);

}  // namespace nearmesh
