// SPDX-License-Identifier: Apache-2.0
// Time by halves, earliest first; in each interval both trees are walked together with boxes grown
// by the motion.
//
// The bound. Let m be the middle of an interval of half-length h, and t in [m - h, m + h].
// 1. The relative frame of the two placements at m (make_relative_frame of poses) is that of
//    pose_at, up to doubles, which are inside its slack; pose_at is within placing_error_m of the
//    true motion.
// 2. From m to t the true motion takes a point of B, as seen from A's place at m, by (v_b - v_a)(t
//    - m), which is what `along` holds for h, and besides turns it by at most |w_b| h |R0 x_b| and
//    a point of A by |w_a| h |R0 x_a|: an arc is longer than its chord. |R0 x| <= 1.0001 reach
//    (check_pose), reach that of the node's own box.
// 3. At t a point of a posed triangle is within posing_error_m of the true motion's.
// 4. Where the motions' poses have themselves been taken to the start (core/query/answer.cpp), each
//    is off by placing_error_m of the way there, and stays so: what moves on rigidly from two such
//    places is no farther apart later. Both are in start_error_m, which goes into `around`.
// So `around` = h (|w_a| reach_a + |w_b| reach_b) 1.0001 + both bodies' placing and posing errors,
// and boxes that stay apart under that drift have no common point at t, whether rigid or posed;
// boxes enclose what is not refined (core/THEOREM.md). Instants k T / 2^n are rounded to doubles: m
// and the ends err by 2^-53 T each, so h is taken larger by 2^-51 T.
#include "nearmesh/core/query/sweep.hpp"

#include <algorithm>
#include <cmath>
#include <optional>

#include "core/base/float_guard.hpp"
#include "core/geometry/motion_bounds.hpp"
#include "lacking_ahead.hpp"
#include "sweep_from.hpp"
#include "swept_frames.hpp"
#include "swept_query.hpp"

namespace nearmesh {
namespace {

/// Bodies at rest, or already in contact, need no time. In: an answer as sweep_from() takes it.
SweptAnswer at_once(const Answer& now, double duration_s) {
  SweptAnswer swept;
  if (now.pair_total > 0) {
    swept.status = AnswerStatus::kContact;
    swept.hit_s = 0;
    return swept;
  }
  swept.missing_a = now.missing_a;
  swept.missing_b = now.missing_b;
  swept.exhausted = now.exhausted;
  if (!is_certified(now.status)) return swept;
  swept.status = AnswerStatus::kFree;  // of the surfaces, also where one body is in the other
  swept.free_until_s = duration_s;
  return swept;
}

}  // namespace

Result<SweptAnswer> sweep(const TreeView& a, const Motion& motion_a, std::string_view name_a,
                          const TreeView& b, const Motion& motion_b, std::string_view name_b,
                          const SweepOptions& options) {
  const FloatGuard guard;
  return sweep_from(nullptr, a, motion_a, name_a, b, motion_b, name_b, options);
}

Result<SweptAnswer> sweep_from(const Answer* now, const TreeView& a, const Motion& motion_a,
                               std::string_view name_a, const TreeView& b, const Motion& motion_b,
                               std::string_view name_b, const SweepOptions& options,
                               double start_error_m) {
  NEARMESH_ASSERT(options.time_levels >= 0 && options.time_levels <= kMaxTimeLevels);
  if (!(options.duration_s >= kMinSweep_s && options.duration_s <= kMaxSweep_s))
    return Status{StatusCode::kInvalidArgument, "duration_s of a sweep is " +
                                                    std::to_string(options.duration_s) +
                                                    ", expected 1e-9 to 1e9"};
  NEARMESH_RETURN_IF_ERROR(check_way(motion_a, name_a, options.duration_s));
  NEARMESH_RETURN_IF_ERROR(check_way(motion_b, name_b, options.duration_s));

  // Contact at the start is the commonest hit, and settles all.
  std::optional<Answer> asked;
  if (now == nullptr) {
    const Result<PosedPair> start =
        pose_pair(*a.grid, motion_a.pose, name_a, *b.grid, motion_b.pose, name_b);
    NEARMESH_RETURN_IF_ERROR(start);
    now = &asked.emplace(query(a, start.value().a, b, start.value().b, first_contact(options)));
  }
  if (now->pair_total > 0 || (is_at_rest(motion_a) && is_at_rest(motion_b))) {
    SweptAnswer swept = at_once(*now, options.duration_s);
    if (asked) swept.stats = asked->stats;
    return swept;
  }
  return SweptQuery({a, motion_a}, name_a, {b, motion_b}, name_b, options, start_error_m).run();
}

Result<Lacking> lacking_ahead(const TreeView& a, const Motion& motion_a, std::string_view name_a,
                              const TreeView& b, const Motion& motion_b, std::string_view name_b,
                              double duration_s, double margin_m, const Require& require_a,
                              const Require& require_b, std::uint64_t max_tests) {
  const FloatGuard guard;
  const AheadOf ahead(motion_a, motion_b, duration_s);
  NEARMESH_RETURN_IF_ERROR(check_way(ahead.motion_a, name_a, ahead.duration_s));
  NEARMESH_RETURN_IF_ERROR(check_way(ahead.motion_b, name_b, ahead.duration_s));
  return SweptQuery({a, ahead.motion_a}, name_a, {b, ahead.motion_b}, name_b,
                    {.duration_s = ahead.duration_s,
                     .time_levels = ahead.time_levels,
                     .max_tests = max_tests},
                    margin_m)
      .lacking(require_a, require_b);
}

double safe_horizon_s(const TreeView& a, const Motion& motion_a, const TreeView& b,
                      const Motion& motion_b, double clearance_m, double age_a_s, double age_b_s) {
  const FloatGuard guard;
  const int lattice = lattice_exponent(*a.grid, *b.grid);
  double speed_mps = 0, rounding_m = 0, gone_m = 0;
  const auto add = [&](const TreeView& tree, const Motion& motion, double age_s) {
    const double reach = reach_m(*tree.grid, tree.root().box);
    const double speed = speed_bound_mps(motion, reach);
    speed_mps += speed;
    if (speed > 0) gone_m += speed * std::abs(age_s) * kRoundUp;
    rounding_m += 2 * posing_error_m(motion, reach, 0, *tree.grid, lattice);  // now and then
  };
  add(a, motion_a, age_a_s);
  add(b, motion_b, age_b_s);
  if (speed_mps == 0) return kNever;
  return guard.keep(std::max(0.0, clearance_m - (rounding_m + gone_m) * kRoundUp) /
                    (speed_mps * kRoundUp));
}

}  // namespace nearmesh
