// SPDX-License-Identifier: Apache-2.0
#pragma once
// Where a body may be, by what is known of it in a frame: a pose, or a promise alone. For the
// session that says what is free by bounds, and for whoever proves it again: both count with this.

#include <array>
#include <cstdint>
#include <optional>
#include <string_view>

#include "body_bounds.hpp"
#include "broad_phase.hpp"
#include "nearmesh/core/base/content_hash.hpp"

namespace nearmesh {

/// Closed; world frame, metres.
struct Ball {
  std::array<double, 3> center_m{};
  double radius_m = 0;

  /// The distance is rounded down.
  [[nodiscard]] bool meets(const WorldBox& box) const;
};

/// The ball in a cube of ModelBounds::around_ball(), about the same center.
[[nodiscard]] Ball ball_in(const WorldBox& cube, const std::array<double, 3>& center_m);

struct BodyPlace {
  WorldBox box;              ///< with look-ahead and margin
  std::optional<Ball> ball;  ///< of one that is known by a promise alone: it is in both
  double way_m = 0;          ///< no point of it goes farther in the look-ahead
  std::uint64_t digest = 0;  ///< of all that this follows from
};

/// What is asked of all bodies alike.
struct LookAhead {
  double horizon_s = 0, margin_m = 0;
};

/// Whose place it is; two bodies in the same place have two digests, for they have two names.
struct PlacedBody {
  std::string_view name;
  ContentHash content;
  Company company;
};

/// Known by a pose. Precondition: check_motion accepted the motion.
[[nodiscard]] BodyPlace place_by_pose(const PlacedBody& body, const ModelBounds& model,
                                      const Motion& motion, const LookAhead& ahead);
/// Known by a promise: its origin is in the ball, and no point of it is faster.
[[nodiscard]] BodyPlace place_by_promise(const PlacedBody& body, const ModelBounds& model,
                                         const Ball& origin, double max_speed_mps,
                                         const LookAhead& ahead);

/// Those of which this is false are free for certain (core/THEOREM.md, "Free by bounds", "Free by
/// promise").
[[nodiscard]] bool may_be_near(const BodyPlace& a, const BodyPlace& b);

}  // namespace nearmesh
