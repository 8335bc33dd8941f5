// SPDX-License-Identifier: Apache-2.0
#include "swept_frames.hpp"

#include <algorithm>
#include <cmath>
#include <string>

#include "core/geometry/motion_bounds.hpp"

namespace nearmesh {
namespace {

/// Of a rotation that check_pose() accepts.
constexpr double kStretch = 1.0001;
constexpr int kAheadLevels = 6;

}  // namespace

Mover::Mover(const TreeView& its_tree, const Motion& its_motion)
    : tree(its_tree),
      motion(its_motion),
      turn_rate(length_bound(its_motion.angular_velocity_radps)) {}

Status check_way(const Motion& motion, std::string_view name, double duration_s) {
  NEARMESH_RETURN_IF_ERROR(check_motion(motion, name));
  if (!(length_bound(motion.angular_velocity_radps) * duration_s <= kMaxTurnRad))
    return {StatusCode::kInvalidArgument,
            "motion of " + std::string(name) + ": turns by more than 2^20 radians on the way"};
  Pose end = motion.pose;
  end.translation_m = pose_at(motion, duration_s).translation_m;
  return check_pose(end, name);
}

AheadOf::AheadOf(const Motion& a, const Motion& b, double seconds)
    : motion_a(a), motion_b(b), duration_s(seconds), time_levels(kAheadLevels) {
  if (seconds >= kMinSweep_s && !(is_at_rest(a) && is_at_rest(b))) return;
  motion_a = {.pose = a.pose};
  motion_b = {.pose = b.pose};
  duration_s = kMinSweep_s;
  time_levels = 0;
}

TreeEntry unresolved_entry(const TreeView& tree, NodeSpan node) {
  TreeEntry entry;
  entry.box = tree.store->box(node);
  entry.set(TreeEntry::Kind::kUnresolved, node.begin(), node.size);
  return entry;
}

SweptFrames::SweptFrames(const Mover& a, const Mover& b, double duration_s, int time_levels,
                         double margin_m)
    : a_(a),
      b_(b),
      duration_s_(duration_s),
      lattice_(lattice_exponent(*a.tree.grid, *b.tree.grid)),
      last_instant_(std::uint64_t{1} << (time_levels + 1)),
      instant_share_(1.0 / static_cast<double>(last_instant_)),
      error_m_(error_of(a) + error_of(b) + margin_m) {
  for (std::size_t k = 0; k < 3; ++k)
    velocity_[k] = b.motion.linear_velocity_mps[k] - a.motion.linear_velocity_mps[k];
}

double SweptFrames::error_of(const Mover& x) const {
  const double reach = reach_m(*x.tree.grid, x.tree.root().box);
  return placing_error_m(x.motion, reach, duration_s_) +
         posing_error_m(x.motion, reach, duration_s_, *x.tree.grid, lattice_);
}

void SweptFrames::set(SweptFrame& frame, std::uint64_t first, std::uint64_t length) const {
  frame.first = first;
  frame.middle = first + length / 2;
  frame.start_s = seconds(first);
  frame.half_s = seconds(length / 2) + 0x1p-51 * duration_s_;
  const Pose pose_a = pose_at(a_.motion, seconds(frame.middle));
  const Pose pose_b = pose_at(b_.motion, seconds(frame.middle));
  const Grid &grid_a = *a_.tree.grid, &grid_b = *b_.tree.grid;
  std::array<double, 3> along;
  for (std::size_t k = 0; k < 3; ++k) along[k] = velocity_[k] * frame.half_s;
  frame.b_in_a = make_relative_frame(grid_a, pose_a, grid_b, pose_b);
  frame.a_in_b = make_relative_frame(grid_b, pose_b, grid_a, pose_a);
  frame.along_a = to_grid_units(grid_a, pose_a, along);
  frame.along_b = to_grid_units(grid_b, pose_b, along);
  frame.along_m = length_bound(along);
}

double SweptFrames::around_m(const GridBox& box_a, const GridBox& box_b,
                             const SweptFrame& frame) const {
  double turned = 0;
  if (a_.turn_rate > 0) turned += a_.turn_rate * reach_m(*a_.tree.grid, box_a);
  if (b_.turn_rate > 0) turned += b_.turn_rate * reach_m(*b_.tree.grid, box_b);
  // Last: the velocities' difference and its way were rounded.
  return (frame.half_s * turned * kStretch + error_m_ + 0x1p-40 * frame.along_m) * kRoundUp;
}

DriftLanes SweptFrames::drift_in_a(const GridBox& box_a, const TreeNode& node_b,
                                   const SweptFrame& frame) const {
  DriftLanes drift{.along = frame.along_a};
  // What does not turn is all alike.
  const std::uint32_t alike = b_.turn_rate > 0 ? 1 : kLanes;
  for (std::uint32_t lane = 0; lane < kLanes; lane += alike) {
    const double around = frame.drift_in_a(around_m(box_a, node_b.boxes.box(lane), frame)).around;
    std::fill_n(drift.around.begin() + lane, alike, around);
  }
  return drift;
}

DriftLanes SweptFrames::drift_in_a(const TreeNode& node_a, const GridBox& box_b,
                                   const SweptFrame& frame) const {
  DriftLanes drift{.along = frame.along_a};
  const std::uint32_t alike = a_.turn_rate > 0 ? 1 : kLanes;
  for (std::uint32_t lane = 0; lane < kLanes; lane += alike) {
    const double around = frame.drift_in_a(around_m(node_a.boxes.box(lane), box_b, frame)).around;
    std::fill_n(drift.around.begin() + lane, alike, around);
  }
  return drift;
}

}  // namespace nearmesh
