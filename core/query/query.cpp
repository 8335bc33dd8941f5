// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/core/query/query.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <optional>
#include <unordered_set>

#include "clearance.hpp"
#include "containment.hpp"
#include "core/base/float_guard.hpp"
#include "core/base/hash.hpp"
#include "find_missing.hpp"
#include "nearmesh/core/geometry/detail/box_overlap.hpp"
#include "sort_pairs.hpp"
#include "walk.hpp"

namespace nearmesh {
namespace {

using Kind = TreeEntry::Kind;

class Query {
 public:
  Query(const Scene& scene, const QueryOptions& options) : s_(scene), options_(options) {}

  Answer run() {
    if (options_.was_free && options_.clearance == Clearance::kBound &&
        options_.max_tests >= kFreeTests)
      distance_ = find_bound_if_clear(s_, answer_.stats);
    if (!distance_ || !distance_->is_clear) look(options_.any ? Seeks::kAnyPair : Seeks::kPairs);
    finish();
    return std::move(answer_);
  }

  /// Of an answer only what it misses.
  Answer missing() {
    look(Seeks::kUnresolved);
    if (answer_.exhausted) answer_.uncertainty_m = std::numeric_limits<double>::infinity();
    sort_missing();
    return std::move(answer_);
  }

 private:
  /// Held back for sorting: the least are looked for when there are twice as many.
  static constexpr std::size_t kFewPairs = 4096;

  void look(Seeks seeks) {
    WalkFinds finds;
    if (options_.max_pairs < kAllPairs - kFewPairs)
      finds.most_pairs = 2 * std::max(options_.max_pairs, kFewPairs);
    finds.hand_on = [&] { take(finds); };
    answer_.exhausted =
        !walk_trees(s_, seeks, {options_.max_tests, options_.is_over}, finds, answer_.stats);
    if (seeks == Seeks::kAnyPair && !finds.pairs.empty()) {
      answer_.exhausted = false;
      finds.unresolved.clear();
    }
    take(finds);
    answer_.pairs = std::move(finds.pairs);
  }

  /// Settles what is unresolved; counts the pairs, and keeps those that may be listed.
  void take(WalkFinds& finds) {
    for (const UnresolvedPair& pair : finds.unresolved) settle(pair);
    finds.unresolved.clear();
    if (finds.pairs.size() <= options_.max_pairs) return;
    const auto kept = finds.pairs.begin() + static_cast<std::ptrdiff_t>(options_.max_pairs);
    std::nth_element(finds.pairs.begin(), kept, finds.pairs.end());
    dropped_pairs_ += static_cast<std::uint64_t>(finds.pairs.end() - kept);
    finds.pairs.erase(kept, finds.pairs.end());
  }

  [[nodiscard]] bool touches() const { return dropped_pairs_ != 0 || !answer_.pairs.empty(); }
  [[nodiscard]] bool has_spent() const {
    return tests_of(answer_.stats) >= options_.max_tests || is_time_over(options_.is_over);
  }

  // Names what to split next, unless the pair is proved apart, or has a part that is named already:
  // it will be looked at again once that is split.
  void settle(const UnresolvedPair& pair) {
    const TreeEntry a = s_.a.nodes[pair.a / kLanes].entry(pair.a % kLanes),
                    b = s_.b.nodes[pair.b / kLanes].entry(pair.b % kLanes);
    const bool unresolved_a = a.kind() == Kind::kUnresolved,
               unresolved_b = b.kind() == Kind::kUnresolved;
    if ((unresolved_a && missing_a_.contains(a.first)) ||
        (unresolved_b && missing_b_.contains(b.first)))
      return;
    if (unresolved_a && unresolved_b) {
      // The walk tried six axes; nine more settle one pair in twelve.
      ++answer_.stats.box_tests;
      if (boxes_apart(s_.b_in_a, centered(a.box), centered(b.box))) return;
      if (parted(s_.a, a, s_.b_in_a, b.box)) return;
      if (has_half_spaces(s_.b, b) && parted(s_.b, b, s_.a_in_b(), a.box)) return;
      // The larger of two is the one to split next; ties go to a.
      if (size_of(a.box) * s_.cell_a_m >= size_of(b.box) * s_.cell_b_m) {
        add_missing(s_.a, a, missing_a_);
      } else {
        add_missing(s_.b, b, missing_b_);
      }
    } else if (unresolved_a) {
      if (meets_face(s_.a, a, s_.b_in_a, s_.b.blocks[b.first], pair.faces))
        add_missing(s_.a, a, missing_a_);
    } else {
      if (meets_face(s_.b, b, s_.a_in_b(), s_.a.blocks[a.first], pair.faces))
        add_missing(s_.b, b, missing_b_);
    }
  }

  // Whether a half-space of an unresolved node keeps it clear of the other side's box. (One of them
  // is in its lane's slab, but the walk tests that in floats.)
  bool parted(const TreeView& own, const TreeEntry& node, const RelativeFrame& other_in_own,
              const GridBox& other) {
    return half_spaces_part(own, node, [&](const BoundedPart& part) {
      ++answer_.stats.box_tests;
      return half_space_box_stay_apart(other_in_own, {}, part, centered(other));
    });
  }

  // Whether what is below an unresolved node may meet one of the other side's faces.
  bool meets_face(const TreeView& own, const TreeEntry& node, const RelativeFrame& other_in_own,
                  const FaceBlock& block, std::uint32_t faces) {
    const CenteredBox box = centered(node.box);
    for (; faces != 0; faces &= faces - 1) {
      const auto i = static_cast<std::uint32_t>(std::countr_zero(faces));
      ++answer_.stats.box_tests;
      const DoubleTriangle face = to_a_units(other_in_own, block.triangles.corners(i));
      if (!box_triangle_apart(other_in_own, box, face) &&
          !half_spaces_part(own, node, [&](const BoundedPart& part) {
            return half_space_triangle_stay_apart(other_in_own, {}, part, face);
          }))
        return true;
    }
    return false;
  }

  void add_missing(const TreeView& tree, const TreeEntry& node,
                   std::unordered_set<std::uint32_t>& set) {
    set.insert(node.first);
    // By the set: both bodies may have the same tree.
    (&set == &missing_a_ ? answer_.missing_a : answer_.missing_b).push_back(node.unresolved_node());
    const double bound = node_bound(*tree.store, node.unresolved_node());
    answer_.uncertainty_m = std::max(answer_.uncertainty_m, std::ldexp(bound, tree.grid->exponent));
  }

  void finish() {
    const bool complete = missing_a_.empty() && missing_b_.empty() && !answer_.exhausted;
    if (complete && !touches()) {
      answer_.status = AnswerStatus::kFree;
      if (options_.solid_a || options_.solid_b) settle_containment();
    } else if (complete || (options_.any && touches())) {
      answer_.status = AnswerStatus::kContact;
      answer_.missing_a.clear();
      answer_.missing_b.clear();
      answer_.uncertainty_m = 0;
    } else {
      answer_.status = touches() ? AnswerStatus::kPartial : AnswerStatus::kUncertain;
    }
    if (answer_.exhausted) answer_.uncertainty_m = std::numeric_limits<double>::infinity();
    bound_distance();
    sort_pairs(answer_.pairs);
    answer_.pair_total = dropped_pairs_ + answer_.pairs.size();
    answer_.truncated = dropped_pairs_ != 0;
    sort_missing();
  }

  void bound_distance() {
    if (touches()) answer_.distance_at_most_m = 0;
    if (touches() || answer_.exhausted || options_.clearance == Clearance::kNone) return;
    const DistanceBounds bounds =
        distance_ ? *distance_ : find_distance(s_, options_.clearance, answer_.stats);
    answer_.distance_at_most_m = bounds.at_most_m;
    answer_.nearest_a_m = bounds.nearest_a_m;
    answer_.nearest_b_m = bounds.nearest_b_m;
    if (!is_certified(answer_.status)) return;  // what is missing may be nearer
    answer_.clearance_m = bounds.at_least_m;
    answer_.clearance_share = bounds.share;
    answer_.clearance_by_larger_m = bounds.by_larger_m;
  }

  void sort_missing() {
    std::sort(answer_.missing_a.begin(), answer_.missing_a.end());
    std::sort(answer_.missing_b.begin(), answer_.missing_b.end());
  }

  // The surfaces are apart. Each question is answered to the end, so that a certified answer is the
  // same on every peer.
  void settle_containment() {
    const TreeEntry root_a = s_.a.root(), root_b = s_.b.root();
    if (root_a.kind() == Kind::kEmpty || root_b.kind() == Kind::kEmpty ||
        boxes_apart(s_.b_in_a, centered(root_a.box), centered(root_b.box)))
      return;
    const Side a_in_b =
        options_.solid_b ? side_of(s_.a, s_.frame_a, s_.b, s_.frame_b, missing_b_) : Side::kOutside;
    const Side b_in_a =
        options_.solid_a ? side_of(s_.b, s_.frame_b, s_.a, s_.frame_a, missing_a_) : Side::kOutside;
    const bool inside = a_in_b == Side::kInside || b_in_a == Side::kInside;
    const bool undecided = a_in_b == Side::kUndecided || b_in_a == Side::kUndecided;
    if (!missing_a_.empty() || !missing_b_.empty() || answer_.exhausted || (undecided && !inside)) {
      answer_.status = AnswerStatus::kUncertain;
      if (is_beyond_detail(answer_))
        answer_.uncertainty_m = std::numeric_limits<double>::infinity();
    } else if (inside) {
      answer_.status = AnswerStatus::kContained;
      answer_.contained = static_cast<Containment>((a_in_b == Side::kInside ? 1 : 0) +
                                                   (b_in_a == Side::kInside ? 2 : 0));
    }
  }

  // Inside when one part of the inner body is; outside when all parts are.
  Side side_of(const TreeView& inner, const PosedFrame& inner_frame, const TreeView& solid,
               const PosedFrame& solid_frame, std::unordered_set<std::uint32_t>& known) {
    if (!inner.surface->has_seeds()) return Side::kUndecided;
    std::vector<Location> undecided;
    for (const GridPoint& seed : inner.surface->component_seeds) {
      if (has_spent()) {
        answer_.exhausted = true;
        return Side::kUndecided;
      }
      Location at = locate(solid, solid_frame, pose_point(inner_frame, seed), answer_.stats);
      if (at.side == Side::kInside) return Side::kInside;
      if (at.side == Side::kUndecided) undecided.push_back(std::move(at));
    }
    std::vector<GridBox>& rays = &known == &missing_a_ ? answer_.rays_a : answer_.rays_b;
    for (const Location& at : undecided)
      for (const TreeEntry& node : at.missing) {
        if (known.contains(node.first)) continue;
        add_missing(solid, node, known);
        add_ray_boxes(solid_frame, at.ray, node.box, rays);
      }
    return undecided.empty() ? Side::kOutside : Side::kUndecided;
  }

  const Scene& s_;
  const QueryOptions options_;
  std::unordered_set<std::uint32_t> missing_a_, missing_b_;  // by first vertex; membership only
  std::optional<DistanceBounds> distance_;                   // where it was sought first
  std::uint64_t dropped_pairs_ = 0;                          // that max_pairs leaves out
  Answer answer_;
};

}  // namespace

const char* to_string(AnswerStatus status) {
  switch (status) {
    case AnswerStatus::kFree:
      return "free";
    case AnswerStatus::kContact:
      return "contact";
    case AnswerStatus::kPartial:
      return "partial";
    case AnswerStatus::kUncertain:
      return "uncertain";
    case AnswerStatus::kContained:
      return "contained";
  }
  return "unknown";
}

const char* to_string(Containment contained) {
  switch (contained) {
    case Containment::kNone:
      return "none";
    case Containment::kAInB:
      return "a_in_b";
    case Containment::kBInA:
      return "b_in_a";
    case Containment::kBoth:
      return "both";
  }
  return "unknown";
}

std::uint64_t digest(const std::vector<FacePair>& pairs) {
  std::uint64_t h = pairs.size();
  for (const FacePair& pair : pairs)
    for (const FaceKey& key : {pair.a, pair.b})
      h = mix(h ^ (std::uint64_t{key.split.value} << 32 | key.index));
  return h;
}

std::uint64_t digest(const Answer& answer) {
  std::uint64_t h = digest(answer.pairs);
  const auto add = [&h](std::uint64_t x) { h = mix(h ^ x); };
  add(static_cast<std::uint64_t>(answer.status));
  add(static_cast<std::uint64_t>(answer.contained));
  add(answer.pair_total);
  for (const std::vector<NodeSpan>* missing : {&answer.missing_a, &answer.missing_b}) {
    add(missing->size());
    for (const NodeSpan& node : *missing) add(std::uint64_t{node.begin()} << 32 | node.size);
  }
  add(std::bit_cast<std::uint64_t>(answer.uncertainty_m));
  if (answer.exhausted) add(1);
  return h;
}

double node_bound(const SplitStore& store, NodeSpan node) {
  const FloatGuard guard;
  const GridBox box = store.box(node);
  const GridPoint& stand_in = store.position(node.first);
  double square = 0;
  for (int k = 0; k < 3; ++k) {
    const auto farther = static_cast<double>(
        std::max(std::int64_t{stand_in[k]} - box.lo[k], std::int64_t{box.hi[k]} - stand_in[k]));
    square += farther * farther;
  }
  // Rounded up: the sum and the root err by less than 2^-50 of the result.
  return guard.keep(std::sqrt(square) * (1 + 0x1p-48));
}

namespace {

/// What the walk finds of roots far apart, before anything is made for it.
bool are_far_apart(const TreeView& a, const PosedFrame& frame_a, const TreeView& b,
                   const PosedFrame& frame_b) {
  return a.nodes[0].lanes != 0 && b.nodes[0].lanes != 0 &&
         balls_apart(frame_a, a.nodes[0].boxes.box(0), frame_b, b.nodes[0].boxes.box(0));
}

}  // namespace

Answer query(const TreeView& a, const PosedFrame& frame_a, const TreeView& b,
             const PosedFrame& frame_b, const QueryOptions& options) {
  const FloatGuard guard;
  NEARMESH_ASSERT(frame_a.lattice_exp == frame_b.lattice_exp);
  NEARMESH_ASSERT(!(options.solid_a || options.solid_b) ||
                  (a.surface != nullptr && b.surface != nullptr));
  NEARMESH_ASSERT(!options.solid_a || a.surface->is_closed());
  NEARMESH_ASSERT(!options.solid_b || b.surface->is_closed());
  if (options.clearance == Clearance::kNone && are_far_apart(a, frame_a, b, frame_b))
    return {.status = AnswerStatus::kFree, .stats = {.box_tests = 1}};
  return Query(Scene(a, frame_a, b, frame_b), options).run();
}

Answer find_missing(const TreeView& a, const PosedFrame& frame_a, const TreeView& b,
                    const PosedFrame& frame_b, std::uint64_t max_tests) {
  const FloatGuard guard;
  NEARMESH_ASSERT(frame_a.lattice_exp == frame_b.lattice_exp);
  return Query(Scene(a, frame_a, b, frame_b), {.max_tests = max_tests}).missing();
}

Result<PosedPair> pose_pair(const Grid& grid_a, const Pose& pose_a, std::string_view name_a,
                            const Grid& grid_b, const Pose& pose_b, std::string_view name_b) {
  const FloatGuard guard;
  NEARMESH_RETURN_IF_ERROR(check_pose(pose_a, name_a));
  NEARMESH_RETURN_IF_ERROR(check_pose(pose_b, name_b));
  const int lattice = lattice_exponent(grid_a, grid_b);
  Result<PosedFrame> a = make_posed_frame(grid_a, pose_a, lattice);
  if (!a.is_ok())
    return Status{a.status().code(), std::string(name_a) + ": " + a.status().message()};
  Result<PosedFrame> b = make_posed_frame(grid_b, pose_b, lattice);
  if (!b.is_ok())
    return Status{b.status().code(), std::string(name_b) + ": " + b.status().message()};
  return PosedPair{a.value(), b.value()};
}

}  // namespace nearmesh
