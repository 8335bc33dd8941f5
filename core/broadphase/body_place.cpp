// SPDX-License-Identifier: Apache-2.0
#include "body_place.hpp"

#include <algorithm>

#include "free_pairs.hpp"

namespace nearmesh {

bool Ball::meets(const WorldBox& box) const {
  double square = 0;
  for (std::size_t k = 0; k < 3; ++k) {
    const double nearest = std::clamp(center_m[k], box.lo_m[k], box.hi_m[k]);
    square += (center_m[k] - nearest) * (center_m[k] - nearest);
  }
  return square * (1 - 0x1p-40) <= radius_m * radius_m;
}

Ball ball_in(const WorldBox& cube, const std::array<double, 3>& center_m) {
  double radius_m = 0;  // the cube is rounded outward
  for (std::size_t k = 0; k < 3; ++k)
    radius_m = std::max({radius_m, cube.hi_m[k] - center_m[k], center_m[k] - cube.lo_m[k]});
  return {center_m, radius_m};
}

BodyPlace place_by_pose(const PlacedBody& body, const ModelBounds& model, const Motion& motion,
                        const LookAhead& ahead) {
  return {.box = model.around(motion, ahead.horizon_s, ahead.margin_m),
          .ball = {},
          .way_m = model.way_m(motion, ahead.horizon_s),
          .digest = place_digest(body.name, body.content, body.company, motion)};
}

BodyPlace place_by_promise(const PlacedBody& body, const ModelBounds& model, const Ball& origin,
                           double max_speed_mps, const LookAhead& ahead) {
  BodyPlace place{.box = {}, .ball = {}, .way_m = max_speed_mps * ahead.horizon_s, .digest = 0};
  place.box = model.around_ball(origin.center_m, origin.radius_m + place.way_m, ahead.margin_m);
  place.ball = ball_in(place.box, origin.center_m);
  Motion promised;
  promised.pose.translation_m = origin.center_m;
  promised.linear_velocity_mps = {max_speed_mps, origin.radius_m, 0};
  place.digest = place_digest(body.name, body.content, body.company, promised);
  return place;
}

bool may_be_near(const BodyPlace& a, const BodyPlace& b) {
  return a.box.meets(b.box) && (!a.ball || a.ball->meets(b.box)) &&
         (!b.ball || b.ball->meets(a.box));
}

}  // namespace nearmesh
