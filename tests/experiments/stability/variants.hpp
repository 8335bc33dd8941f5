// SPDX-License-Identifier: Apache-2.0
#pragma once
// The same scene seen otherwise: turned, moved, scaled, swapped, renumbered. Every change is exact
// in doubles (asserted), so the truth stays what it was.

#include <cstdint>
#include <optional>
#include <vector>

#include "case.hpp"

namespace nearmesh::stability {

/// Both bodies turned about the world's origin by one of the 24 rotations that permute the axes; 0
/// is none.
[[nodiscard]] Case turned(const Case& base, std::uint32_t turn);
/// The rotation matrix of `turned`.
[[nodiscard]] std::array<double, 9> quarter_turn(std::uint32_t turn);
[[nodiscard]] Case swapped(const Case& base);
/// Vertices, faces and corners within faces (cyclically) of both in another order.
[[nodiscard]] Case renumbered(const Case& base, std::uint64_t seed);
/// Both poses moved by 2^k metres along each axis, to alternate sides. None where that is not
/// exact.
[[nodiscard]] std::optional<Case> moved(const Case& base, int k);
/// Both meshes' vertices moved likewise under unchanged rotations: coordinates far from the model's
/// own origin.
[[nodiscard]] std::optional<Case> moved_vertices(const Case& base, int k);
/// All lengths times 2^k. None where a translation would pass 5e8 m (poses are taken up to 1e9 m),
/// and of two single points: a point at its model's origin has a cell of 2^-20 m whatever its
/// surroundings, so they do not scale.
[[nodiscard]] std::optional<Case> scaled(const Case& base, int k);

/// Both bodies under one random integer matrix (seeded) that fills the 21 bits of the grid: affine
/// maps keep what touches, and products of such coordinates no longer fit a double. None where a
/// body is turned, or where nothing is left to fill.
[[nodiscard]] std::optional<Case> sheared(const Case& base, std::uint64_t seed);

/// The base case and what keeps it near the origin at its size: the 24 turns, swapped, renumbered
/// twice, sheared.
[[nodiscard]] std::vector<Case> near_variants(const Case& base);
/// The base case far away and at other sizes (F6).
[[nodiscard]] std::vector<Case> far_variants(const Case& base);

}  // namespace nearmesh::stability
