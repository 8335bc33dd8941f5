// SPDX-License-Identifier: Apache-2.0
#include "answer.hpp"

#include "sweep_from.hpp"

namespace nearmesh {
Result<Answered> answer(const AskedBody& a, const AskedBody& b, const AnswerOptions& options) {
  for (const AskedBody* body : {&a, &b})
    if (body->solid) NEARMESH_RETURN_IF_ERROR(check_solid(*body->view.surface, body->name));
  const Result<PosedPair> posed =
      pose_pair(*a.view.grid, a.motion.pose, a.name, *b.view.grid, b.motion.pose, b.name);
  NEARMESH_RETURN_IF_ERROR(posed);
  const auto& [frame_a, frame_b] = posed.value();
  Answered all;
  all.answer = query(a.view, frame_a, b.view, frame_b, {.solid_a = a.solid, .solid_b = b.solid});
  const Answer& now = all.answer;
  if (options.contacts && !now.pairs.empty())
    all.contacts = find_contacts(a.view, frame_a, b.view, frame_b, now);
  if (is_certified(now.status) && now.pair_total == 0)
    all.safe_horizon_s = safe_horizon_s(a.view, a.motion, b.view, b.motion, now.clearance_m);
  if (options.sweep_s > 0) {
    // Of solids an uncertain answer may also lack what tells inside from outside: that is no matter of the surfaces' way.
    const bool is_of_surfaces = now.status != AnswerStatus::kUncertain || !(a.solid || b.solid);
    all.swept =
        sweep_from(is_of_surfaces ? &now : nullptr, a.view, a.motion, a.name, b.view, b.motion,
                   b.name, {.duration_s = options.sweep_s, .max_tests = options.max_sweep_tests});
  }
  return all;
}

}  // namespace nearmesh
