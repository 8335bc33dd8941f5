// SPDX-License-Identifier: Apache-2.0
#pragma once
// A body at an instant: where it is and how it moves.

#include "nearmesh/core/geometry/pose.hpp"

namespace nearmesh {

/// World frame, metres, seconds; the angular velocity turns about the origin of the body's model frame.
struct Motion {
  Pose pose;
  std::array<double, 3> linear_velocity_mps{};
  std::array<double, 3> angular_velocity_radps{};
};

/// Checks a motion from outside. Errors: as check_pose; kInvalidArgument, naming `body` and the entry,
/// where a velocity is not finite or beyond 1e9 (m/s, rad/s).
[[nodiscard]] Status check_motion(const Motion& motion, std::string_view body);

}  // namespace nearmesh
