// SPDX-License-Identifier: Apache-2.0
#pragma once
// The walk's kernels (box_kernels.hpp, triangle_kernels.hpp), one call each. The walk has them
// inlined, once for each instruction set, so nothing but tests calls these: they hold each kernel
// against exact geometry, where a walk would show only what came of all of them.

#include "placed_boxes.hpp"

namespace nearmesh {

/// Each as the kernel of its name, `..._inline`, for all lanes and without what kDepth or kGuess
/// add.
void place_boxes(const Placing& placing, const BoxLanes& boxes, PlacedBoxes& out);
void place_faces(const Placing& placing, const TriangleLanes& faces, PlacedFaces& out);

[[nodiscard]] std::uint32_t boxes_apart(const Placing& placing, const PlacedBoxes& own,
                                        const PlacedBoxes& other, std::uint32_t other_lane);
[[nodiscard]] std::uint32_t faces_apart(const Placing& placing, const PlacedFaces& own,
                                        const PlacedBoxes& other, std::uint32_t other_lane);
[[nodiscard]] PairVerdicts test_triangles(const RelativeFrame& other_in_own,
                                          const TriangleLanes& own, const TriangleLanes& other);

}  // namespace nearmesh
