// SPDX-License-Identifier: Apache-2.0
#include "answer.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include "clearance.hpp"
#include "contacts_in_time.hpp"
#include "core/geometry/motion_bounds.hpp"
#include "core/geometry/vec3.hpp"
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

/// How far from there its point may truly be: what pose_at() rounds on the way, which grows with
/// the turn.
double error_at_frame_m(const AskedBody& body) {
  if (body.age_s == 0 || is_at_rest(body.motion)) return 0;
  return placing_error_m(body.motion, reach_m(*body.view.grid, body.view.root().box),
                         std::abs(body.age_s));
}

/// Whether the bodies cannot meet in all of the time ahead, whichever way they go at their speeds:
/// the horizon is longer by more than what their motions' poses may be off on the way.
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
  // Of solids an uncertain answer may also lack what tells inside from outside: that is no matter
  // of the surfaces' way.
  const bool is_of_surfaces = now.status != AnswerStatus::kUncertain || !(a.solid || b.solid);
  const bool is_of_now =
      (a.age_s == 0 || is_at_rest(a.motion)) && (b.age_s == 0 || is_at_rest(b.motion));
  return sweep_from(is_of_surfaces && is_of_now ? &now : nullptr, a.view, motion_a.value(), a.name,
                    b.view, motion_b.value(), b.name,
                    {.duration_s = options.sweep_s,
                     .max_tests = options.max_sweep_tests,
                     .is_over = options.is_over},
                    error_at_frame_m(a) + error_at_frame_m(b));
}

/// Where a point that went with the body is now. What came from another mover is a rotation but for
/// 1e-5, so it is undone by its inverse: the transposed matrix would leave the point off by as much
/// of its distance from the origin.
Vec3 carried(const Pose& then, const Pose& now, const Vec3& p) {
  const std::array<double, 9>& r = then.rotation;
  const std::array<Vec3, 3> columns{{{r[0], r[3], r[6]}, {r[1], r[4], r[7]}, {r[2], r[5], r[8]}}};
  const Vec3 way = minus(p, then.translation_m);
  Vec3 own, out = now.translation_m;
  for (std::size_t i = 0; i < 3; ++i) {
    const Vec3 across = cross(columns[(i + 1) % 3], columns[(i + 2) % 3]);
    own[i] = dot(across, way) / dot(across, columns[i]);
  }
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t k = 0; k < 3; ++k) out[i] += now.rotation[3 * i + k] * own[k];
  return out;
}

}  // namespace

bool is_cut(const Answer& answer, const AnswerOptions& options) {
  // Who looks for any pair looks in another order, so where something is missing it may name other
  // nodes.
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
  const auto is_over = [&options] { return is_time_over(options.is_over); };
  Answered all;
  all.answer = query(a.view, frame_a, b.view, frame_b,
                     {.any = options.any,
                      .clearance = options.clearance,
                      .max_pairs = options.max_pairs,
                      .max_tests = options.max_tests,
                      .is_over = options.is_over,
                      .solid_a = a.solid,
                      .solid_b = b.solid,
                      .was_free = options.was_free});
  const Answer& now = all.answer;
  const bool wants_contacts = (options.contacts || options.depth) && !now.pairs.empty();
  all.is_cut_short = (now.exhausted && tests_of(now.stats) < options.max_tests) ||
                     ((wants_contacts || options.sweep_s > 0) && is_over());
  if (all.is_cut_short) return all;
  if (wants_contacts) {
    all.contacts = find_contacts(a.view, frame_a, b.view, frame_b, now, options.is_over);
    all.is_cut_short = !all.contacts;
    if (all.is_cut_short) return all;
  }
  if (options.depth && wants_contacts) {
    Result<Depth> depth =
        find_depth(a.view, a.motion.pose, a.name, b.view, b.motion.pose, b.name, now, *all.contacts,
                   {.solid_a = a.solid,
                    .solid_b = b.solid,
                    .max_tests = options.max_depth_tests,
                    .is_over = options.is_over});
    NEARMESH_RETURN_IF_ERROR(depth);
    all.depth = std::move(depth).value();
    all.is_cut_short = all.depth->exhausted && is_over();
    if (all.is_cut_short) return all;
  }
  if (is_certified(now.status) && now.pair_total == 0)
    all.safe_horizon_s =
        safe_horizon_s(a.view, a.motion, b.view, b.motion, now.clearance_m, a.age_s, b.age_s);
  if (options.sweep_s <= 0) return all;
  if (is_free_by_speed(a, b, all.safe_horizon_s, options.sweep_s)) {
    all.swept = SweptAnswer{.status = AnswerStatus::kFree, .free_until_s = options.sweep_s};
    return all;
  }
  all.swept = sweep_ahead(now, a, b, options);
  all.is_cut_short = all.swept->is_ok() && all.swept->value().exhausted && is_over();
  return all;
}

// Why the walk would find nothing. The search for the bound goes down from pair to pair of parts as
// the walk does, and each pair of ends lies below a pair whose gap it found to be `clearance_m` at
// least: along three axes of one body together, so that one of them has 0.57 of it, or along a
// slab's normal. A motion changes that by less than boxes_moved_m, of which four are not more: the
// walk, which tries the same axes and normals, parts that pair. The same goes for what axes and
// normals of the larger body alone show, from which what floats lose is off already, so that two
// are enough. Exact faces are as far apart as clearance_left() says.
std::optional<Answered> still_free(const AskedBody& a, const AskedBody& b, const KeptFree& kept,
                                   const ClearanceLeft& left, const AnswerOptions& options) {
  if (options.clearance != Clearance::kBound || options.max_tests < kFreeTests ||
      !std::isfinite(kept.distance_at_most_m))
    return std::nullopt;
  double clearance_m = 0;
  if (4 * left.boxes_moved_m <= kept.clearance_m)
    clearance_m = kept.clearance_m - left.boxes_moved_m;
  if (2 * left.moved_by_larger_m <= kept.clearance_by_larger_m)
    clearance_m = std::max(clearance_m, kept.clearance_by_larger_m - left.moved_by_larger_m);
  if (!(clearance_m > 0)) return std::nullopt;
  Answered all;
  Answer& now = all.answer;
  now.status = AnswerStatus::kFree;
  now.clearance_m = clearance_m;
  now.nearest_a_m = carried(kept.pose_a, a.motion.pose, kept.nearest_a_m);
  now.nearest_b_m = carried(kept.pose_b, b.motion.pose, kept.nearest_b_m);
  std::array<double, 3> way;
  for (std::size_t k = 0; k < 3; ++k) way[k] = now.nearest_b_m[k] - now.nearest_a_m[k];
  now.distance_at_most_m = length_bound(way) + left.error_m;
  if (left.boxes_moved_m == 0) {  // nor have they moved at all
    now.nearest_a_m = kept.nearest_a_m;
    now.nearest_b_m = kept.nearest_b_m;
    now.distance_at_most_m = kept.distance_at_most_m;
  }
  // The greatest that what is held allows has grown by no more, and is no more than the distance.
  now.clearance_share =
      now.clearance_m / std::min(kept.clearance_m / kept.clearance_share + left.boxes_moved_m,
                                 std::max(now.distance_at_most_m, now.clearance_m));
  all.safe_horizon_s =
      safe_horizon_s(a.view, a.motion, b.view, b.motion, now.clearance_m, a.age_s, b.age_s);
  if (options.sweep_s <= 0) return all;
  if (!is_free_by_speed(a, b, all.safe_horizon_s, options.sweep_s)) return std::nullopt;
  all.swept = SweptAnswer{.status = AnswerStatus::kFree, .free_until_s = options.sweep_s};
  return all;
}

}  // namespace nearmesh
