// SPDX-License-Identifier: Apache-2.0
#pragma once
// API (docs/api.md).
// A body at an instant: where it is and how it moves; and where that motion takes it.
// Deterministic: + - * / and sqrt only, so every machine gets the same pose for the same instant.

#include <string_view>

#include "nearmesh/core/geometry/pose.hpp"

namespace nearmesh {

/// World frame, metres, seconds; the angular velocity turns about the origin of the body's model
/// frame.
struct Motion {
  Pose pose;
  std::array<double, 3> linear_velocity_mps{};
  std::array<double, 3> angular_velocity_radps{};
};

[[nodiscard]] constexpr bool is_at_rest(const Motion& motion) {
  constexpr std::array<double, 3> kNone{};
  return motion.linear_velocity_mps == kNone && motion.angular_velocity_radps == kNone;
}

/// Checks a motion from outside. Errors: as check_pose; kInvalidArgument, naming `body`, where a
/// velocity's component is not finite or beyond 1e9.
[[nodiscard]] Status check_motion(const Motion& motion, std::string_view body);

/// The farthest turn that pose_at follows, radians (166,886 turns).
inline constexpr double kMaxTurnRad = 0x1p20;

/// The pose after dt_s, may be negative: x(t) = exp([w] dt) R0 x + T0 + v dt, with v and w the
/// motion's velocities. Exactly the given pose at dt_s = 0, and exactly its rotation where the body
/// does not turn.
/// Error: the rotation, as an operator and hence in each entry, is within pose_rotation_error(|w
/// dt|) of the true one; the translation within 2^-50 (|T0| + |v dt|) metres.
/// Precondition: check_motion accepted the motion, |w dt| <= kMaxTurnRad (asserted).
[[nodiscard]] Pose pose_at(const Motion& motion, double dt_s);

/// The velocities that take a body from one pose to another in `dt_s` by the smaller turn, at the
/// first of them: pose_at then gives the second, but for rounding. A body that turns by more than
/// half a turn in that time seems to turn the other way.
/// Precondition: check_pose accepted both, dt_s > 0.
[[nodiscard]] Motion motion_between(const Pose& from, const Pose& to, double dt_s);

/// Bound of the error of a rotation by pose_at after a turn of so many radians: (64 + 320 turn)
/// 2^-53.
[[nodiscard]] constexpr double pose_rotation_error(double turn_rad) {
  return (64 + 320 * turn_rad) * 0x1p-53;
}

}  // namespace nearmesh
