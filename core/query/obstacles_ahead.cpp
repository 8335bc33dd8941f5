// SPDX-License-Identifier: Apache-2.0
#include "obstacles_ahead.hpp"

#include <algorithm>
#include <bit>
#include <cmath>

#include "core/base/float_guard.hpp"
#include "walk.hpp"

namespace nearmesh {
namespace {

using Kind = TreeEntry::Kind;

/// An obstacle may move by so much of the node that it is near to: more instants would be more
/// obstacles.
constexpr double kSmallWay = 1.0 / 8;

}  // namespace

Result<std::unique_ptr<ObstaclesAhead>> ObstaclesAhead::make(
    const TreeView& a, const Motion& motion_a, std::string_view name_a, const TreeView& b,
    const Motion& motion_b, std::string_view name_b, double duration_s, double margin_m) {
  const FloatGuard guard;
  const AheadOf ahead(motion_a, motion_b, duration_s);
  NEARMESH_RETURN_IF_ERROR(check_way(ahead.motion_a, name_a, ahead.duration_s));
  NEARMESH_RETURN_IF_ERROR(check_way(ahead.motion_b, name_b, ahead.duration_s));
  return std::unique_ptr<ObstaclesAhead>(new ObstaclesAhead(a, b, ahead, margin_m));
}

ObstaclesAhead::ObstaclesAhead(const TreeView& a, const TreeView& b, const AheadOf& ahead,
                               double margin_m)
    : a_(a),
      b_(b),
      ahead_(ahead),
      mover_a_(a_, ahead_.motion_a),
      mover_b_(b_, ahead_.motion_b),
      frames_(mover_a_, mover_b_, ahead_.duration_s, ahead_.time_levels, margin_m),
      cell_a_m_(std::ldexp(1.0, a.grid->exponent)),
      cell_b_m_(std::ldexp(1.0, b.grid->exponent)),
      parts_(std::size_t{2} << ahead_.time_levels) {}

const SweptFrame& ObstaclesAhead::frame(std::uint32_t part) {
  if (parts_[part] == nullptr) {
    parts_[part] = std::make_unique<SweptFrame>();
    const std::uint32_t parts = std::bit_floor(part);
    const std::uint64_t length = frames_.last_instant() / parts;
    frames_.set(*parts_[part], (part - parts) * length, length);
  }
  return *parts_[part];
}

std::uint64_t ObstaclesAhead::find(NodeSpan node, std::span<const HalfSpace> told, std::size_t most,
                                   std::uint64_t max_tests, std::vector<Obstacle>& to) {
  const FloatGuard guard;
  const TreeEntry own = unresolved_entry(a_, node);
  const CenteredBox own_box = centered(own.box);
  const double own_size_m = static_cast<double>(size_of(own.box)) * cell_a_m_;
  told_.clear();
  for (const HalfSpace& half_space : told)
    told_.push_back(bounded_part(half_space, a_.store->position(node.first)));
  const auto finest = static_cast<std::uint32_t>(parts_.size() / 2);
  std::uint64_t tests = 0;
  stack_.assign(1, {1, 0, false});
  while (!stack_.empty() && to.size() < most && tests <= max_tests) {
    const Pending at = stack_.back();
    stack_.pop_back();
    const TreeEntry other = b_.nodes[at.place / kLanes].entry(at.place % kLanes);
    const Kind kind = other.kind();
    if (kind == Kind::kEmpty) continue;
    const SweptFrame& frame = this->frame(at.part);
    const double around_m = frames_.around_m(own.box, other.box, frame);
    const Drift drift = frame.drift_in_a(around_m);
    const CenteredBox box = centered(other.box);
    if (!at.is_tested) {
      ++tests;
      if (boxes_stay_apart(frame.b_in_a, drift, own_box, box)) continue;
    }
    const auto is_parted = [&](const auto& stay_apart) {
      return std::any_of(told_.begin(), told_.end(), [&](const BoundedPart& part) {
        ++tests;
        return stay_apart(part);
      });
    };
    if (is_parted([&](const BoundedPart& part) {
          return half_space_box_stay_apart(frame.b_in_a, drift, part, box);
        }))
      continue;
    if (kind == Kind::kUnresolved && half_spaces_part(b_, other, [&](const BoundedPart& part) {
          ++tests;
          return half_space_box_stay_apart(frame.a_in_b, frame.drift_in_b(around_m), part, own_box);
        }))
      continue;
    const double way_m = frame.along_m + around_m;
    const auto halve = [&] {
      stack_.push_back({2 * at.part + 1, at.place, false});
      stack_.push_back({2 * at.part, at.place, false});
    };
    if (kind == Kind::kInner) {
      // The greater cause first: the box to open, or the way.
      if (at.part < finest && way_m > static_cast<double>(size_of(other.box)) * cell_b_m_) {
        halve();
        continue;
      }
      const TreeNode& below = b_.nodes[other.first];
      tests += static_cast<std::uint64_t>(std::popcount(below.lanes));
      for (std::uint32_t close =
               below.lanes & ~boxes_stay_apart(frame.b_in_a,
                                               frames_.drift_in_a(own.box, below, frame), own_box,
                                               below.boxes);
           close != 0; close &= close - 1)
        stack_.push_back(
            {at.part, other.first * kLanes + static_cast<std::uint32_t>(std::countr_zero(close)),
             true});
      continue;
    }
    const bool is_near_enough =
        at.part >= finest || way_m - frames_.error_m() <= kSmallWay * own_size_m;
    const std::size_t before = to.size();
    if (kind == Kind::kUnresolved) {
      to.push_back({&frame.b_in_a, std::nullopt, box, drift});
    } else {
      const FaceBlock& block = b_.blocks[other.first];
      ++tests;
      for (std::uint32_t close =
               ((1U << other.count()) - 1) &
               ~box_triangles_stay_apart(frame.b_in_a, drift, own_box, block.triangles);
           close != 0 && (is_near_enough || to.size() == before); close &= close - 1) {
        const DoubleTriangle corners = to_a_units(
            frame.b_in_a,
            block.triangles.corners(static_cast<std::uint32_t>(std::countr_zero(close))));
        if (!is_parted([&](const BoundedPart& part) {
              return half_space_triangle_stay_apart(frame.b_in_a, drift, part, corners);
            }))
          to.push_back({&frame.b_in_a, corners, {}, drift});
      }
    }
    if (is_near_enough || to.size() == before) continue;
    to.resize(before);
    halve();
  }
  return to.size() >= most || stack_.empty() ? tests : std::max(tests, max_tests + 1);
}

}  // namespace nearmesh
