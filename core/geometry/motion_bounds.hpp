// SPDX-License-Identifier: Apache-2.0
#pragma once
// Bounds of what a motion does to a body: how far, how fast, how exactly we know it. They run
// inside queries, many times each; who calls them has set the floating-point environment
// (base/float_guard.hpp).

#include "nearmesh/core/geometry/motion.hpp"

namespace nearmesh {

/// Length, rounded up.
[[nodiscard]] double length_bound(const std::array<double, 3>& v);

/// Greatest distance of a point of the box from the model's origin, about which the body turns;
/// metres, rounded up.
[[nodiscard]] double reach_m(const Grid& grid, const GridBox& box);

/// Upper bound of the speed of any point that lies within reach_m of the model's origin: |v| + |w|
/// reach. m/s
[[nodiscard]] double speed_bound_mps(const Motion& motion, double reach_m);

/// How far pose_at's pose may place a point within reach_m of the origin from where the motion
/// truly takes it, at any instant of [0, duration_s]. Metres.
[[nodiscard]] double placing_error_m(const Motion& motion, double reach_m, double duration_s);

/// The same for a point of a posed triangle: make_posed_frame of pose_at, then pose_point, on the
/// given lattice. Less than 1.8 lattice cells and some 2^-29 of the reach, where turns and speeds
/// are ordinary.
[[nodiscard]] double posing_error_m(const Motion& motion, double reach_m, double duration_s,
                                    const Grid& grid, int lattice_exp);

}  // namespace nearmesh
