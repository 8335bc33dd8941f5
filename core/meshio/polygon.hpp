// SPDX-License-Identifier: Apache-2.0
#pragma once
// Cuts a polygon into triangles.

#include <cstdint>
#include <span>

#include "nearmesh/core/mesh/detail/indexed_mesh.hpp"

namespace nearmesh::meshio {

/// A concave polygon with more corners is refused: cutting it takes cubic time at worst.
inline constexpr std::size_t kMostConcaveCorners = 1024;

/// Appends corners - 2 triangles (none below three corners): a fan from the first corner where the
/// polygon is convex, else ears (G. H. Meisters, "Polygons have ears", 1975) seen along its normal.
/// A polygon that crosses itself or has no area ends in a fan, too: no corner is ever lost. In:
/// indices within mesh.positions_m. Errors: kUnsupported (see above).
[[nodiscard]] Status append_polygon(std::span<const std::uint32_t> corners, IndexedMesh& mesh);

}  // namespace nearmesh::meshio
