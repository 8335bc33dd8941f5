// SPDX-License-Identifier: Apache-2.0
#pragma once
// API (docs/api.md).
// From a mesh as it came (IndexedMesh) to integer geometry fit for simplification (GridMesh):
// rounded to a power-of-two grid, welded, with what was dropped counted by kind.

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "nearmesh/core/base/detail/ids.hpp"
#include "nearmesh/core/geometry/detail/grid.hpp"
#include "nearmesh/core/mesh/indexed_mesh.hpp"

namespace nearmesh {

/// Greatest coordinate taken: squares of distances must stay far inside a double.
inline constexpr double kMaxCoordinate_m = 1e150;
/// The cell is never below 2^kMinCellExponent metres; a smaller model (denormals) becomes a point.
inline constexpr int kMinCellExponent = -kMaxGridExponent;
/// Cell of a model that is a single point at the origin.
inline constexpr int kPointCellExponent = -20;

/// Faces of distinct vertices on a grid. Vertex numbers here are places in `positions` (they become
/// VertexIds only when the merge forest is numbered). Every position is a corner of some face. Two
/// vertices share a position only where a face that is a segment or a point was kept.
struct GridMesh {
  Grid grid;
  std::vector<GridPoint> positions;
  std::vector<std::array<std::uint32_t, 3>> faces;  ///< three distinct indices, input orientation
                                                    ///< and rotation kept
  std::vector<FaceId> face_ids;                     ///< input number of each face, ascending
};

/// What clean_mesh did, for the report of `nearmesh-model build`.
/// faces_in = kept faces + faces_duplicate + faces_degenerate_dropped.
struct CleanReport {
  std::uint64_t vertices_in = 0, faces_in = 0;
  std::uint64_t vertices_unreferenced = 0;  ///< dropped
  std::uint64_t vertices_welded = 0;        ///< merged into another at the same grid point
  std::uint64_t faces_duplicate = 0;        ///< dropped: same three grid points as an earlier face,
                                            ///< in either orientation
  std::uint64_t faces_degenerate_dropped = 0;  ///< a repeated grid point, covered by a kept face's
                                               ///< edge or corner
  std::uint64_t faces_degenerate_kept = 0;  ///< a repeated grid point, kept as a segment or point
  std::uint64_t edges_non_manifold = 0;     ///< with more than two faces (segments not counted)
  std::uint64_t edges_boundary = 0;         ///< with one face (segments not counted)
  std::uint64_t edges_disagreeing = 0;      ///< with more faces, not passed equally often both ways
  std::uint64_t components = 0;             ///< connected through shared vertices
  double rounding_error_m = 0;  ///< greatest distance of a vertex from its grid point, as doubles
                                ///< have it: short of it by 2^-51 at most
};

struct CleanOptions {
  /// Per axis, in [kMinGridBits, kMaxGridBits]; 21: a cell of half a millionth of the size.
  int grid_bits = 21;
  /// None: the smallest cell for which the model fits. Models with one lattice need equal
  /// grid_bits, too.
  std::optional<CommonLattice> lattice;
};

struct CleanResult {
  GridMesh mesh;
  CleanReport report;
};

/// Rounds to a grid of so many bits per axis (to the nearest point, halves up), welds equal grid
/// points, drops unreferenced vertices and duplicate faces. The cell is the smallest power of two
/// for which the bounding box of the referenced vertices fits; the origin is a multiple of the
/// cell, so that regular data keeps its common factors of two. A mesh that is a single point has
/// kMinGridBits, if its lattice is its own. A face whose corners fall together is a segment or a
/// point: dropped where a kept face covers it, else kept with duplicated vertices (nothing that
/// could be touched may vanish). Three distinct points on a line are an ordinary face. In: at least
/// one face; indices in range; coordinates of referenced vertices finite and within
/// kMaxCoordinate_m; options in range; below 2^31 vertices and 2^30 faces.
/// Out: vertices in input order of the first at each grid point, duplicated ones last; faces in
/// input order. Depends on the input alone. Errors: kInvalidArgument naming the first offender
/// (vertex or face number, what was found), or a lattice on which the mesh does not fit; the input
/// is untouched. Cost: O(n log n), about 0.3 s for a million faces.
[[nodiscard]] Result<CleanResult> clean_mesh(const IndexedMesh& mesh,
                                             const CleanOptions& options = {});

}  // namespace nearmesh
