// SPDX-License-Identifier: Apache-2.0
#include "answer.hpp"

#include <cmath>
#include <limits>
#include <string>

#include "core/geometry/motion_bounds.hpp"
#include "sweep_from.hpp"

namespace nearmesh {
namespace {

/// Where the motion has taken the body by the frame's time.
Result<Motion> at_frame(const AskedBody& body) {
  if (is_at_rest(body.motion)) return body.motion;
  const double turn_rad = length_bound(body.motion.angular_velocity_radps) * std::abs(body.age_s);
  if (!(turn_rad <= kMaxTurnRad))
    return Status{StatusCode::kInvalidArgument,
                  "motion of " + std::string(body.name) +
                      ": turns by more than 2^20 radians from its pose to the frame's time"};
  Motion motion = body.motion;
  motion.pose = pose_at(body.motion, body.age_s);
  return motion;
}

/// Whether the bodies cannot meet in all of the time ahead, whichever way they go at their speeds: the horizon is longer by more
/// than what their motions' poses may be off on the way.
bool is_free_by_speed(const AskedBody& a, const AskedBody& b, double horizon_s, double sweep_s) {
  double speed_mps = 0, error_m = 0;
  for (const AskedBody* body : {&a, &b}) {
    const double reach = reach_m(*body->view.grid, body->view.root().box);
    speed_mps += speed_bound_mps(body->motion, reach);
    error_m += 2 * placing_error_m(body->motion, reach, std::abs(body->age_s) + sweep_s);
  }
  return (horizon_s - sweep_s) * speed_mps > error_m;
}

/// `now`: the answer about the poses as they are.
Result<SweptAnswer> sweep_ahead(const Answer& now, const AskedBody& a, const AskedBody& b,
                                const AnswerOptions& options) {
  const Result<Motion> motion_a = at_frame(a), motion_b = at_frame(b);
  NEARMESH_RETURN_IF_ERROR(motion_a);
  NEARMESH_RETURN_IF_ERROR(motion_b);
  // Of solids an uncertain answer may also lack what tells inside from outside: that is no matter of the surfaces' way.
  const bool is_of_surfaces = now.status != AnswerStatus::kUncertain || !(a.solid || b.solid);
  const bool is_of_now =
      (a.age_s == 0 || is_at_rest(a.motion)) && (b.age_s == 0 || is_at_rest(b.motion));
  return sweep_from(is_of_surfaces && is_of_now ? &now : nullptr, a.view, motion_a.value(), a.name,
                    b.view, motion_b.value(), b.name,
                    {.duration_s = options.sweep_s, .max_tests = options.max_sweep_tests});
}

}  // namespace

bool is_cut(const Answer& answer, const AnswerOptions& options) {
  // Who looks for any pair looks in another order, so where something is missing it may name other nodes.
  return answer.exhausted || answer.truncated ||
         (options.any && (answer.pair_total > 0 || !is_certified(answer.status)));
}

Answer nothing_known() { return {.uncertainty_m = std::numeric_limits<double>::infinity()}; }

Result<Answered> answer(const AskedBody& a, const AskedBody& b, const AnswerOptions& options) {
  for (const AskedBody* body : {&a, &b})
    if (body->solid) NEARMESH_RETURN_IF_ERROR(check_solid(*body->view.surface, body->name));
  const Result<PosedPair> posed =
      pose_pair(*a.view.grid, a.motion.pose, a.name, *b.view.grid, b.motion.pose, b.name);
  NEARMESH_RETURN_IF_ERROR(posed);
  const auto& [frame_a, frame_b] = posed.value();
  Answered all;
  all.answer = query(a.view, frame_a, b.view, frame_b,
                     {.any = options.any,
                      .clearance = options.clearance,
                      .max_pairs = options.max_pairs,
                      .max_tests = options.max_tests,
                      .solid_a = a.solid,
                      .solid_b = b.solid});
  const Answer& now = all.answer;
  if ((options.contacts || options.depth) && !now.pairs.empty())
    all.contacts = find_contacts(a.view, frame_a, b.view, frame_b, now);
  if (options.depth && !now.pairs.empty()) {
    Result<Depth> depth = find_depth(a.view, a.motion.pose, a.name, b.view, b.motion.pose, b.name,
                                     now, *all.contacts, {.solid_a = a.solid, .solid_b = b.solid});
    NEARMESH_RETURN_IF_ERROR(depth);
    all.depth = std::move(depth).value();
  }
  if (is_certified(now.status) && now.pair_total == 0)
    all.safe_horizon_s =
        safe_horizon_s(a.view, a.motion, b.view, b.motion, now.clearance_m, a.age_s, b.age_s);
  if (options.sweep_s <= 0) return all;
  if (is_free_by_speed(a, b, all.safe_horizon_s, options.sweep_s)) {
    all.swept = SweptAnswer{.status = AnswerStatus::kFree, .free_until_s = options.sweep_s};
  } else {
    all.swept = sweep_ahead(now, a, b, options);
  }
  return all;
}

}  // namespace nearmesh
