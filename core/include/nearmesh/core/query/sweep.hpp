// SPDX-License-Identifier: Apache-2.0
#pragma once
// API (docs/api.md).
// The certified collision query over a time interval: two trees, two motions, and a proof of when
// the bodies are free of each other, or an instant at which they touch, or what is missing. Source:
// conservative advancement over boxes (Zhang, Lee, Kim 2006, "Interactive continuous collision
// detection for non-convex polyhedra"); ours walks time by halves, earliest first, grows boxes
// along the motion instead of dividing gaps by speeds, and extends the certificate of query.hpp:
// the theorem (core/THEOREM.md) holds at each instant.

#include <cstdint>
#include <limits>
#include <string_view>
#include <vector>

#include "nearmesh/core/geometry/motion.hpp"
#include "nearmesh/core/query/query.hpp"

namespace nearmesh {

inline constexpr int kMaxTimeLevels = 24;

struct SweepOptions {
  double duration_s = 0;  ///< in [1e-9, 1e9]
  int time_levels = 12;   ///< the finest step is duration_s / 2^time_levels; in [0, kMaxTimeLevels]
  /// Bodies that slide along each other closer than the finest step resolves would cost steps x
  /// faces; after so many box and triangle tests the answer is what is known by then.
  std::uint64_t max_tests = 1'000'000;
  const IsOver* is_over = nullptr;  ///< as in QueryOptions; asked each some 25 us
};

/// All instants are seconds from the pose of the motions, which follow pose_at and keep their
/// velocities.
struct SweptAnswer {
  /// kFree: certified free at every instant of [0, duration]. kContact: free on [0, free_until_s),
  /// in contact at hit_s; nothing missing could touch earlier than hit_s. kPartial: the same
  /// bracket, but what is missing, or was not looked at (`exhausted`), might touch earlier than
  /// hit_s. kUncertain: no contact was found, but what is missing might touch, or something that is
  /// here comes closer than the finest step (or max_tests) resolves.
  AnswerStatus status = AnswerStatus::kUncertain;
  /// Certified free on [0, free_until_s), also when uncertain; duration when free.
  double free_until_s = 0;
  /// An instant at which exact faces touch; infinite unless one was found. Of the instants k
  /// duration / 2^(time_levels + 1) it is the first (where max_tests was not spent), so it depends
  /// on the exact faces alone, not on the trees' shapes.
  double hit_s = std::numeric_limits<double>::infinity();
  std::vector<NodeSpan> missing_a, missing_b;  ///< ascending; what would narrow the answer
  bool exhausted = false;                      ///< max_tests was spent, or is_over said so
  QueryStats stats;
};

/// Answers for two trees that move. What is certified holds for the fixed-point posed geometry
/// (query() at pose_at of any double in [0, duration]) and for the true rigid motion of the models
/// on their grids. A translation that both share costs nothing. Swapped bodies: the same hit_s;
/// free_until_s may differ by what the finest step leaves open. Bodies of which neither moves:
/// query()'s answer.
/// Errors: kInvalidArgument or kUnsupported, naming the body, as check_motion and make_posed_frame
/// say for any instant on the way, or for a turn beyond kMaxTurnRad; kInvalidArgument for a
/// duration out of range.
/// Deterministic. Threads: views may be shared.
[[nodiscard]] Result<SweptAnswer> sweep(const TreeView& a, const Motion& motion_a,
                                        std::string_view name_a, const TreeView& b,
                                        const Motion& motion_b, std::string_view name_b,
                                        const SweepOptions& options);

/// For so long nothing can touch while neither body moves or turns faster than its motion states,
/// whichever way: clearance (of a free answer at the motions' poses) over the bodies' greatest
/// speeds, less what posing rounds. Each pose may be of another instant: so long before now, or,
/// negative, after it. Infinite when neither moves. Seconds from now.
[[nodiscard]] double safe_horizon_s(const TreeView& a, const Motion& motion_a, const TreeView& b,
                                    const Motion& motion_b, double clearance_m, double age_a_s = 0,
                                    double age_b_s = 0);

}  // namespace nearmesh
