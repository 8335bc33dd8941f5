// SPDX-License-Identifier: Apache-2.0
#pragma once
// All that is said of a pair of bodies at once: the certified answer, where they touch, how long
// that holds, and the time ahead. A peer's session and the proof of its recording both ask here, so
// what is proved is what was answered.

#include <cstdint>
#include <optional>
#include <string_view>

#include "clearance_left.hpp"
#include "nearmesh/core/query/depth.hpp"
#include "nearmesh/core/query/sweep.hpp"

namespace nearmesh {

/// One of the two bodies.
struct AskedBody {
  TreeView view;
  Motion motion;
  std::string_view name;  ///< for errors
  bool solid = false;     ///< it has an inside: is the other one in it?
  double age_s = 0;  ///< so long before the frame's time the motion's pose held; negative: after it
};

struct AnswerOptions {
  Clearance clearance = Clearance::kBound;  ///< changes neither the digest nor what is certified
  bool any = false;                         ///< these three as in QueryOptions
  std::size_t max_pairs = kAllPairs;
  std::uint64_t max_tests = kAllTests;
  bool contacts = false;  ///< also say where they touch
  bool depth = false;     ///< and how deep they are in each other; implies `contacts`
  double sweep_s = 0;     ///< also answer for all of this time ahead; 0: do not
  std::uint64_t max_sweep_tests = SweepOptions{}.max_tests;
  std::uint64_t max_depth_tests = kDepthTests;
  /// Time for all of it. Where it says so before the end, nothing is answered: a part that depends
  /// on when it ended would be none.
  const IsOver* is_over = nullptr;
  bool was_free = false;  ///< as in QueryOptions
};

struct Answered {
  bool is_cut_short = false;  ///< by AnswerOptions::is_over: nothing else in here counts
  Answer answer;
  std::optional<Contacts> contacts;  ///< where asked for and there are pairs
  std::optional<Depth> depth;        ///< likewise
  /// Certified without a pair: safe_horizon_s(), from the frame's time on; else 0.
  double safe_horizon_s = 0;
  /// Where asked for: from the frame's time on, where the motions have taken the bodies by then.
  /// Errors: those of sweep(), which concern the way and not the poses.
  std::optional<Result<SweptAnswer>> swept;
};

/// What is said where nothing is known: uncertain without a bound.
[[nodiscard]] Answer nothing_known();

/// Whether the options may have ended the search before all was listed: the digest depends on them
/// then.
[[nodiscard]] bool is_cut(const Answer& answer, const AnswerOptions& options);

/// Errors: those of pose_pair; kInvalidArgument for a solid body whose surface is open. Both name
/// the body.
/// Deterministic; what is not in the options does not change Answer, nor do ages. Threads: views
/// may be shared.
[[nodiscard]] Result<Answered> answer(const AskedBody& a, const AskedBody& b,
                                      const AnswerOptions& options = {});

/// A certified answer about two bodies that nothing of touched, to be kept for the poses that
/// follow.
struct KeptFree {
  double clearance_m = 0, clearance_share = 0, clearance_by_larger_m = 0;  ///< as in Answer
  double distance_at_most_m = std::numeric_limits<double>::infinity();
  std::array<double, 3> nearest_a_m{}, nearest_b_m{};
  Pose pose_a, pose_b;  ///< that it was about
};

/// Where the bodies have moved so little that the trees need not be asked: what answer() says, but
/// for its bounds, which are worked out from those of then, and so hold as well; none where that is
/// not certain. The digest is the same.
/// In: clearance_left() of what was kept. Both views as they were then, to the last split and
/// half-space, neither body solid.
/// Cost: a hundred operations. Threads: any.
[[nodiscard]] std::optional<Answered> still_free(const AskedBody& a, const AskedBody& b,
                                                 const KeptFree& kept, const ClearanceLeft& left,
                                                 const AnswerOptions& options);

}  // namespace nearmesh
