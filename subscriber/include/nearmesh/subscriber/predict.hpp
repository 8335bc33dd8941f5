// SPDX-License-Identifier: Apache-2.0
#pragma once
// Where will the other body be? Regions of interest in a model's grid, for the demand walk. Takes trees and motions, gives
// boxes.
// Source: the paper, section 3.2 (prediction by coherence); departure: swept boxes of the other body instead of grid cells.

#include <vector>

#include "nearmesh/core/abtree/tree.hpp"
#include "nearmesh/core/geometry/motion.hpp"

namespace nearmesh::subscriber {

/// Boxes in the grid of `own` that cover where the faces of `other` may be during [now, now + lookahead_s] at constant
/// velocities, grown by `margin_m`. At most `max_boxes` (>= 1): the other tree is opened largest box first. Empty when
/// they cannot reach own's root box.
[[nodiscard]] std::vector<GridBox> swept_region(const TreeView& own, const Motion& own_motion,
                                                const TreeView& other, const Motion& other_motion,
                                                double lookahead_s, double margin_m,
                                                std::size_t max_boxes);

}  // namespace nearmesh::subscriber
