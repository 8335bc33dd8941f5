// SPDX-License-Identifier: Apache-2.0
// A point x of the model is at R x + T. Between two poses it goes |(R' - R) x + (T' - T)|, at most
// |R' - R| |x| + |T' - T|, with the Frobenius norm for the first; no rotation is assumed to be one.
// The full mesh lies in the root's box, so |x| is at most its reach. What both bodies are shifted
// by alike changes no distance: of the shifts their difference counts. The answer was about posed
// points, each within posing_error_m of R x + T, and so is what is asked now, or later: two errors
// of each body, of the pose that is farther out. posing_error_m's share of a lattice is 1.7322
// cells.
//
// Gaps. A test of boxes sees a point x of one body at y = S^-1 (R x + d) in the other's frame, S
// being that one's rotation and d the way between the origins. y goes |S' - S| |R' x + d'| + |R' -
// R| |x| + |d' - d| at most, so a gap along an axis or a normal of that frame changes by no more,
// and three axes together by sqrt(3) of it. A box is within its body's reach, whichever of the two
// it is of: where both frames may have shown the gap each turn counts with the reach of both and
// the way between them; where it was the larger body's, a turn of the smaller one counts with the
// smaller one's reach alone. Factors 3 are for sqrt(3), and for rotations that are so but for 1e-5.
#include "clearance_left.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "core/base/float_guard.hpp"
#include "core/geometry/motion_bounds.hpp"
#include "swept_frames.hpp"

namespace nearmesh {
namespace {

constexpr int kNoLattice = -1000;

template <std::size_t kCount>
double distance(const std::array<double, kCount>& p, const std::array<double, kCount>& q) {
  double square = 0;
  for (std::size_t k = 0; k < kCount; ++k) square += (p[k] - q[k]) * (p[k] - q[k]);
  return std::sqrt(square) * kRoundUp;
}

}  // namespace

BodyReach reach_of(const TreeView& view, const Motion& motion) {
  const FloatGuard guard;
  BodyReach body;
  body.reach_m = reach_m(*view.grid, view.root().box);
  body.speed_mps = speed_bound_mps(motion, body.reach_m);
  body.error_m = posing_error_m({.pose = motion.pose}, body.reach_m, 0, *view.grid, kNoLattice);
  return body;
}

ClearanceLeft clearance_left(const MovedBody& a, const MovedBody& b, int lattice_exp,
                             double clearance_m) {
  const FloatGuard guard;
  const double cells_m = 1.74 * std::ldexp(1.0, lattice_exp);
  std::array<double, 3> shift_a, shift_b;
  for (std::size_t k = 0; k < 3; ++k) {
    shift_a[k] = a.now.translation_m[k] - a.then.translation_m[k];
    shift_b[k] = b.now.translation_m[k] - b.then.translation_m[k];
  }
  const double shift_m = distance(shift_a, shift_b);
  const double turn_a = distance(a.then.rotation, a.now.rotation),
               turn_b = distance(b.then.rotation, b.now.rotation);
  double moved_m = shift_m, error_m = 0, speed_mps = 0, gone_m = 0, reach_m = 0;
  bool has_moved = false;
  for (const auto& [body, turn] : {std::pair(&a, turn_a), std::pair(&b, turn_b)}) {
    const double way_m = distance(body->then.translation_m, body->now.translation_m);
    has_moved |= way_m > 0 || turn > 0;
    moved_m += turn * body->reach.reach_m;
    reach_m += body->reach.reach_m;
    error_m += 2 * (body->reach.error_m + 0x1p-48 * way_m + cells_m);
    speed_mps += body->reach.speed_mps;
    if (body->reach.speed_mps > 0) gone_m += body->reach.speed_mps * std::abs(body->age_s);
  }
  const double left_m = clearance_m - (moved_m + error_m) * kRoundUp;
  ClearanceLeft left{.clearance_m = has_moved ? std::max(0.0, left_m) : clearance_m};
  if (speed_mps > 0) {
    left.safe_s = std::max(0.0, left_m - gone_m * kRoundUp) / (speed_mps * kRoundUp);
  } else if (!has_moved || left_m > 0) {
    left.safe_s = std::numeric_limits<double>::infinity();
  }
  if (has_moved) {
    const double apart_m = distance(a.now.translation_m, b.now.translation_m);
    left.error_m = error_m * kRoundUp;
    left.boxes_moved_m = (moved_m + 3 * (turn_a + turn_b) * (reach_m + apart_m) + error_m +
                          0x1p-16 * (reach_m + apart_m)) *
                         kRoundUp;
    const bool is_a_larger = is_first_larger(a.reach.reach_m, b.reach.reach_m);
    const double larger_turn = is_a_larger ? turn_a : turn_b,
                 smaller_turn = is_a_larger ? turn_b : turn_a;
    left.moved_by_larger_m = (shift_m + 3 * larger_turn * (reach_m + apart_m) +
                              3 * smaller_turn * std::min(a.reach.reach_m, b.reach.reach_m) +
                              error_m + 0x1p-20 * (reach_m + apart_m)) *
                             kRoundUp;
  }
  left.clearance_m = guard.keep(left.clearance_m);
  left.safe_s = guard.keep(left.safe_s);
  return left;
}

}  // namespace nearmesh
