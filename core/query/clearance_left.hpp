// SPDX-License-Identifier: Apache-2.0
#pragma once
// What a certified answer about earlier poses still says at other ones.

#include "nearmesh/core/geometry/motion.hpp"
#include "nearmesh/core/query/query.hpp"

namespace nearmesh {

/// What there is to know of a body for this, whatever it is held against: worked out once for many
/// pairs.
struct BodyReach {
  double reach_m = 0;    ///< of the model from its origin
  double speed_mps = 0;  ///< of any of its points, at most
  double error_m = 0;    ///< of posing it, on a lattice without cells
};
[[nodiscard]] BodyReach reach_of(const TreeView& view, const Motion& motion);

/// Of two bodies that reach so far.
[[nodiscard]] constexpr bool is_first_larger(double reach_a_m, double reach_b_m) {
  return reach_a_m >= reach_b_m;
}

/// A body when the answer was given, and now.
struct MovedBody {
  const BodyReach& reach;  ///< of the motion that it has now
  const Pose &then, &now;
  double age_s = 0;  ///< so long ago it was where it is `now`; negative: it will be
};

struct ClearanceLeft {
  /// The surfaces are at least so far apart at the poses of now, metres; 0: nothing follows.
  double clearance_m = 0;
  /// For so long from now on nothing can touch, if neither is faster than its motion of now says.
  /// Infinite where neither moves.
  double safe_s = 0;
  /// Posed points are off by this much together, then and now, metres. 0, and so is what follows,
  /// of poses that are the same to the bit.
  double error_m = 0;
  /// Gaps that tests of the two trees find between parts, along the axes of either and normals of
  /// their slabs, have changed by less, metres: what a turn moves far from its centre, and rounding
  /// to floats, included.
  double boxes_moved_m = 0;
  /// The same of gaps along axes and normals of the larger body alone, and but for what floats lose
  /// of a box's size: the smaller one may turn far from the point about which the larger one is
  /// turned.
  double moved_by_larger_m = 0;
};

/// Where a certified answer without a pair gave `clearance_m`, about the same two contents: no
/// point of a body has gone farther than its pose's change takes it, whichever way it went
/// meanwhile, and what is held does not matter. Of poses that are the same to the bit, what was
/// said then. What both have been shifted by alike does not count.
/// In: the pair's lattice.
[[nodiscard]] ClearanceLeft clearance_left(const MovedBody& a, const MovedBody& b, int lattice_exp,
                                           double clearance_m);

}  // namespace nearmesh
