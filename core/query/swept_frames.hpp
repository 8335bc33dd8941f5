// SPDX-License-Identifier: Apache-2.0
#pragma once
// How two bodies that move stand to one another in parts of a time span: frames at the middle of a
// part, and bounds of how far the rest of it is from there (the proof: sweep.cpp). For all that
// walks two trees over a time.

#include <cstdint>
#include <string_view>

#include "nearmesh/core/abtree/detail/tree.hpp"
#include "nearmesh/core/geometry/detail/box_overlap.hpp"
#include "nearmesh/core/geometry/motion.hpp"

namespace nearmesh {

/// A sweep lasts so long, seconds.
inline constexpr double kMinSweep_s = 1e-9, kMaxSweep_s = 1e9;
/// Takes away the doubt of the last few operations.
inline constexpr double kRoundUp = 1 + 0x1p-40;

/// One of the two, with what does not change on the way. The motion is one that check_way()
/// accepted.
struct Mover {
  const TreeView& tree;
  const Motion& motion;
  double turn_rate;  ///< |w|

  Mover(const TreeView& its_tree, const Motion& its_motion);
};

/// Errors: those of check_motion() and check_pose(), now and at the end; kInvalidArgument, naming
/// the body, where it turns by more than pose_at() follows.
[[nodiscard]] Status check_way(const Motion& motion, std::string_view name, double duration_s);

/// What is looked at ahead: sixty-four steps; of bodies at rest, or for no time, one of hardly any
/// length.
struct AheadOf {
  AheadOf(const Motion& a, const Motion& b, double seconds);

  Motion motion_a, motion_b;
  double duration_s;
  int time_levels;
};

/// A node as an entry, whether or not it is in the tree.
[[nodiscard]] TreeEntry unresolved_entry(const TreeView& tree, NodeSpan node);

/// A part of the time span: the frames at its middle, and the drift about that without the turns.
struct SweptFrame {
  std::uint64_t first = 0, middle = 0;  ///< instants
  double start_s = 0, half_s = 0;
  RelativeFrame b_in_a, a_in_b;
  std::array<double, 3> along_a{},
      along_b{};  ///< the way of half the part, in each one's grid units
  double along_m = 0;

  /// What may be between a place at the middle and one in the part.
  [[nodiscard]] Drift drift_in_a(double around_m) const {
    return {along_a, around_m / b_in_a.least_metres_per_unit * kRoundUp};
  }
  [[nodiscard]] Drift drift_in_b(double around_m) const {
    return {along_b, around_m / a_in_b.least_metres_per_unit * kRoundUp};
  }
};

/// Makes them. Parts are halves of halves, 2^time_levels at most. Movers are kept by reference.
/// Threads: one at a time.
class SweptFrames {
 public:
  /// `margin_m`: what is wanted around, beside what is known.
  SweptFrames(const Mover& a, const Mover& b, double duration_s, int time_levels, double margin_m);

  [[nodiscard]] std::uint64_t last_instant() const { return last_instant_; }
  [[nodiscard]] double seconds(std::uint64_t instant) const {
    return duration_s_ * (static_cast<double>(instant) * instant_share_);
  }
  [[nodiscard]] int lattice() const { return lattice_; }
  /// Placing and posing, of both; and what is wanted around.
  [[nodiscard]] double error_m() const { return error_m_; }

  /// The part that starts at an instant and has so many.
  void set(SweptFrame& frame, std::uint64_t first, std::uint64_t length) const;
  /// How far two parts of bodies, in these boxes, may be off beside the way, metres: `around` of
  /// the bound.
  [[nodiscard]] double around_m(const GridBox& box_a, const GridBox& box_b,
                                const SweptFrame& frame) const;
  /// SweptFrame::drift_in_a() of these, where one body's part is any of a node's.
  [[nodiscard]] DriftLanes drift_in_a(const GridBox& box_a, const TreeNode& node_b,
                                      const SweptFrame& frame) const;
  [[nodiscard]] DriftLanes drift_in_a(const TreeNode& node_a, const GridBox& box_b,
                                      const SweptFrame& frame) const;

 private:
  [[nodiscard]] double error_of(const Mover& x) const;

  const Mover &a_, &b_;
  const double duration_s_;
  const int lattice_;
  const std::uint64_t last_instant_;
  const double instant_share_;  ///< of the duration
  const double error_m_;
  std::array<double, 3> velocity_{};  ///< of b against a
};

}  // namespace nearmesh
