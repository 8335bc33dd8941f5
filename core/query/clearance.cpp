// SPDX-License-Identifier: Apache-2.0
#include "clearance.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>
#include <vector>

#include "clearance_left.hpp"
#include "core/geometry/motion_bounds.hpp"
#include "core/geometry/nearest_points.hpp"
#include "gaps_below.hpp"

namespace nearmesh {
namespace {

using Kind = TreeEntry::Kind;

/// Of the sizes of two boxes: what the walk's floats may lose of a gap along one axis or slab
/// (box_kernels.hpp: 2^-16 of both), where of a gap along three axes together one has 0.57.
constexpr double kLostOfSize = 0x1p-15;

/// Parts that the search finds so far apart are apart for the walk, too: along three axes together
/// one has 0.57 of it, and no part is larger than the whole.
double surely_clear_m(const Scene& scene) {
  return 4 * kLostOfSize *
         (size_of(scene.a.root().box) * scene.cell_a_m +
          size_of(scene.b.root().box) * scene.cell_b_m);
}

/// One tree's nodes as the other body sees them, the latest few of them: a search comes back to the
/// same ones.
class PlacedNodes {
 public:
  PlacedNodes(const TreeView& tree, const RelativeFrame& tree_in_other)
      : tree_(tree), frame_(tree_in_other) {
    held_.fill(kNone);
  }
  const PlacedLanes& operator[](std::uint32_t node) {
    const std::size_t at = node % kHeld;
    if (held_[at] != node) {
      place_lanes(frame_, tree_.nodes[node].boxes, placed_[at]);
      held_[at] = node;
    }
    return placed_[at];
  }

 private:
  static constexpr std::uint32_t kHeld = 16, kNone = 0xffffffffU;  // each of 1.2 KB
  const TreeView& tree_;
  const RelativeFrame& frame_;
  std::array<std::uint32_t, kHeld> held_;
  std::array<PlacedLanes, kHeld> placed_;
};

constexpr double kFar = std::numeric_limits<double>::infinity();

/// Two parts, and how far they are apart.
struct Gap : PartsGap {
  TreePlace a = 0, b = 0;
};

/// By growing gap, nearly: gaps alike to a sixteenth go in the order of their coming, which follows
/// from the trees' shapes. (Places in the trees' arrays depend on what was refined before, and
/// which of two is looked at first may change the bound.) A heap took a fifth of a search's time.
class GapQueue {
 public:
  GapQueue() { gaps_.reserve(kUsual); }
  /// What is held is no less, but for rounding to a float; infinite where nothing is.
  [[nodiscard]] double floor() const {
    return held_words_ == 0 ? kFar : std::bit_cast<float>(least_step() << kShift);
  }
  void push(const Gap& gap) {
    // A float's exponent and four bits more are as many as there are steps; no gap is negative.
    const std::uint32_t step =
        std::bit_cast<std::uint32_t>(static_cast<float>(gap.gap)) >> kShift & (kSteps - 1);
    const auto place = static_cast<std::uint32_t>(gaps_.size());
    gaps_.push_back({gap, kNone});
    std::uint64_t& word = held_[step / 64];
    const std::uint64_t bit = std::uint64_t{1} << step % 64;
    ((word & bit) == 0 ? first_[step] : gaps_[last_[step]].next) = place;
    last_[step] = place;
    word |= bit;
    held_words_ |= std::uint64_t{1} << step / 64;
  }
  /// Precondition: there is one.
  [[nodiscard]] Gap pop() {
    const std::uint32_t step = least_step(), at = step / 64;
    Held& least = gaps_[first_[step]];
    first_[step] = least.next;
    if (least.next == kNone) held_[at] &= held_[at] - 1;
    if (held_[at] == 0) held_words_ &= held_words_ - 1;
    return std::exchange(least.gap, {{kFar, kFar}});
  }
  /// `use(gap)` of all that are held, in any order, and perhaps of infinite ones.
  template <class Use>
  void for_each(const Use& use) const {
    for (const Held& held : gaps_) use(held.gap);
  }

 private:
  static constexpr std::uint32_t kShift = 19, kSteps = 1U << (31 - kShift), kNone = 0xffffffffU;
  static constexpr std::size_t kUsual = 256;  // most searches hold no more
  [[nodiscard]] std::uint32_t least_step() const {
    const auto at = static_cast<std::uint32_t>(std::countr_zero(held_words_));
    return 64 * at + static_cast<std::uint32_t>(std::countr_zero(held_[at]));
  }
  struct Held {
    Gap gap;
    std::uint32_t next;  // of its step
  };
  std::vector<Held> gaps_;
  std::array<std::uint32_t, kSteps> first_, last_;  // read only where one is held
  std::array<std::uint64_t, kSteps / 64> held_{};
  std::uint64_t held_words_ = 0;
};

/// Pairs of boxes by growing gap. Every pair of faces lies below some pair that was counted, is
/// still queued, or was left out with its gap noted: the least of these three is a bound, whenever
/// the search ends.
///
/// First it dives: from pair to pair below the nearest one, down to two ends. What it finds there
/// says how near is near enough, so that few pairs need be queued. A pair whose gap is more than
/// the share that is sought of the least distance found changes nothing, and is left out.
///
/// Boxes that look past each other hide a part of their gap. So the way between the nearest faces
/// known serves as an axis, too: faces are held along it before they are held against each other.
/// Of parts an exact search asks it as well; a bound does not, since who keeps it relies on gaps
/// that the walk finds again (is_clear, still_free).
///
/// Beside each gap goes what axes and slabs of the larger body alone say of it, less what the
/// walk's floats may lose of that; where no unresolved node is in either part, all of it, for exact
/// faces are held against each other whatever boxes say. Every pair of faces lies below some pair
/// that was counted, queued or left out, so the least that these say is a bound as well.
class NearestSearch {
 public:
  NearestSearch(const Scene& scene, Clearance sought, QueryStats& stats)
      : s_(scene),
        stats_(stats),
        is_exact_(sought == Clearance::kExact),
        clear_m_(surely_clear_m(scene)),
        share_(is_exact_ ? 1 : kClearanceShare),
        max_steps_(is_exact_ ? 65'536 : 256),
        is_a_larger_(is_first_larger(reach_m(*scene.a.grid, scene.a.root().box),
                                     reach_m(*scene.b.grid, scene.b.root().box))),
        placed_a_(scene.a, scene.a_in_b()),
        placed_b_(scene.b, scene.b_in_a) {}

  /// `only_if_clear`: nothing as soon as two ends are found that are not surely clear.
  std::optional<DistanceBounds> run(bool only_if_clear) {
    for (std::optional<Gap> next = Gap(); next;) {
      nearest_below_.reset();
      is_diving_ = true;
      visit(*next);
      next = nearest_below_;
    }
    is_diving_ = false;
    if (only_if_clear && found_ <= clear_m_) return std::nullopt;
    for (int step = 0; step < max_steps_ && is_of_use(queue_.floor());) {
      const Gap top = queue_.pop();
      if (is_of_use(top.gap)) {
        ++step;
        visit(top);
        if (only_if_clear && found_ <= clear_m_) return std::nullopt;
      } else {
        leave_out(top.gap, top.by_larger);
      }
    }
    queue_.for_each([this](const Gap& left) { leave_out(left.gap, left.by_larger); });
    const double bound = std::min(found_, least_left_);
    return with_points({.at_least_m = bound,
                        .share = found_ == bound ? 1 : bound / found_,
                        .by_larger_m = by_larger_,
                        .is_clear = !is_exact_ && bound > clear_m_});
  }

 private:
  [[nodiscard]] bool is_of_use(double gap) const { return gap < share_ * found_; }

  void visit(const Gap& top) {
    if (is_exact_) follow_nearest();
    const Part a(s_.a, top.a), b(s_.b, top.b);
    if (opens_a(s_, a, b)) {
      offer(top, s_.b_in_a, placed_b_[top.b / kLanes], b, s_.a.nodes[a.first()], s_.cell_a_m,
            s_.cell_b_m, is_a_larger_, way_to_b_,
            [&](std::uint32_t lane) { return std::pair(a.first() * kLanes + lane, top.b); });
    } else if (b.kind() == Kind::kInner) {
      offer(top, s_.a_in_b(), placed_a_[top.a / kLanes], a, s_.b.nodes[b.first()], s_.cell_b_m,
            s_.cell_a_m, !is_a_larger_, way_to_a_,
            [&](std::uint32_t lane) { return std::pair(top.a, b.first() * kLanes + lane); });
    } else if (a.kind() == Kind::kFaces && b.kind() == Kind::kFaces) {
      hold_faces(a, b);
    } else {
      // An unresolved node: its box stands for what is in it.
      found_ = std::min(found_, top.gap);
      by_larger_ = std::min(by_larger_, top.by_larger);
      hold_corners(a, b);
    }
  }

  // Queues the lanes of a node, in a dive all but the nearest.
  template <class PairOf>
  void offer(const Gap& top, const RelativeFrame& other_in_own, const PlacedLanes& others,
             const Part& other, const TreeNode& own, double own_cell_m, double other_cell_m,
             bool is_own_larger, const std::optional<ApartWay>& way, const PairOf& pair_of) {
    BoxGaps gaps;
    find_box_gaps(other_in_own, others, other.lane, own.boxes, gaps);
    double along_way_m[kLanes] = {};
    if (is_exact_ && way)
      find_gaps_along(other_in_own, *way, others, other.lane, own.boxes, along_way_m);
    stats_.box_tests += kLanes;
    GapsBelow below;
    const std::uint32_t of_use =
        find_gaps_below(own,
                        {top, kLostOfSize * (other.size() * other_cell_m), kLostOfSize * own_cell_m,
                         other.is_coarse(), is_own_larger},
                        gaps, along_way_m, share_ * found_, below);
    for (std::uint32_t lanes = own.lanes; lanes != 0; lanes &= lanes - 1) {
      const auto lane = static_cast<std::uint32_t>(std::countr_zero(lanes));
      const auto [place_a, place_b] = pair_of(lane);
      Gap offered{{below.gap[lane], below.by_larger[lane]}, place_a, place_b};
      if (is_diving_ && (!nearest_below_ || offered.gap < nearest_below_->gap)) {
        if (!nearest_below_) {
          nearest_below_ = offered;
          continue;
        }
        std::swap(*nearest_below_, offered);
      }
      if ((of_use >> lane & 1U) != 0) {
        queue_.push(offered);
      } else {
        leave_out(offered.gap, offered.by_larger);
      }
    }
  }

  void leave_out(double gap, double by_larger) {
    least_left_ = std::min(least_left_, gap);
    by_larger_ = std::min(by_larger_, by_larger);
  }

  // The least gap of two blocks' faces, where it is of use. Most pairs are settled along the way,
  // or by their extents. Faces are apart whichever axis shows it.
  void hold_faces(const Part& a, const Part& b) {
    follow_nearest();
    const FaceBlock &block_a = s_.a.blocks[a.first()], &block_b = s_.b.blocks[b.first()];
    double along_way_m[kLanes] = {};  // from each of a's faces to all of b's
    if (way_to_b_) find_gaps_along_way(block_a, block_b, b.count(), along_way_m);
    std::optional<PlacedTriangles> placed_b;
    for (std::uint32_t i = 0; i < a.count(); ++i) {
      if (!is_of_use(along_way_m[i])) {
        leave_out(along_way_m[i], along_way_m[i]);
        continue;
      }
      if (!placed_b) place_triangles(s_.b_in_a, block_b.triangles, placed_b.emplace());
      const DoubleTriangle triangle_a = as_doubles(block_a.triangles.corners(i));
      double gaps_m[kLanes];
      extents_gaps_m(s_.b_in_a, triangle_a, *placed_b, gaps_m);
      double least_m = kFar;
      for (std::uint32_t j = 0; j < b.count(); ++j) least_m = std::min(least_m, gaps_m[j]);
      if (!is_of_use(least_m)) {
        leave_out(least_m, least_m);
        continue;
      }
      triangles_gaps_m(s_.b_in_a, triangle_a, *placed_b, gaps_m);
      for (std::uint32_t j = 0; j < b.count(); ++j) {
        found_ = std::min(found_, gaps_m[j]);
        by_larger_ = std::min(by_larger_, gaps_m[j]);
        offer_nearest(gaps_m[j], block_a.triangles.corners(i), block_b.triangles.corners(j));
      }
    }
  }

  void find_gaps_along_way(const FaceBlock& block_a, const FaceBlock& block_b,
                           std::uint32_t count_b, double (&gaps_m)[kLanes]) const {
    double reach_a[kLanes], reach_b[kLanes];
    find_reaches(block_a.triangles, way_to_b_->way, reach_a);
    find_reaches(block_b.triangles, way_to_b_->back, reach_b);
    const double apart =
        way_to_b_->origins - way_to_b_->room - *std::max_element(reach_b, reach_b + count_b);
    for (std::uint32_t i = 0; i < kLanes; ++i) gaps_m[i] = (apart - reach_a[i]) * way_to_b_->metres;
  }

  /// Takes the way between the nearest that are known, if they are new.
  void follow_nearest() {
    if (!is_nearest_new_) return;
    is_nearest_new_ = false;
    const std::array<double, 3> way =
        shortest_way(as_doubles(nearest_a_), to_a_units(s_.b_in_a, nearest_b_));
    if (way == std::array<double, 3>{}) return;
    way_to_b_.emplace(s_.b_in_a, way);
    way_to_a_.emplace(s_.a_in_b(), way_to_b_->back);  // of which length does not count
  }

  using Corners = std::array<GridPoint, 3>;

  /// What two parts have of the full meshes, one of them at least an unresolved node: its vertex;
  /// of faces a corner each.
  void hold_corners(const Part& a, const Part& b) {
    for_each_corner(s_.a, a, [&](const GridPoint& p) {
      for_each_corner(s_.b, b, [&](const GridPoint& q) {
        const std::array<double, 3> at = to_a_units(s_.b_in_a, {q, q, q})[0];
        double square = 0;
        for (std::size_t k = 0; k < 3; ++k) {
          const double way = at[k] - p[static_cast<int>(k)];
          square += way * way;
        }
        offer_nearest(std::sqrt(square) * s_.b_in_a.metres_per_unit, {p, p, p}, {q, q, q});
      });
    });
  }
  template <class Use>
  static void for_each_corner(const TreeView& tree, const Part& part, const Use& use) {
    if (part.kind() == Kind::kUnresolved) return use(tree.store->position({part.first()}));
    for (std::uint32_t i = 0; i < part.count(); ++i)
      use(tree.blocks[part.first()].triangles.corners(i)[0]);
  }

  void offer_nearest(double apart_m, const Corners& a, const Corners& b) {
    if (apart_m < nearest_m_) {
      nearest_m_ = apart_m;
      nearest_a_ = a;
      nearest_b_ = b;
      is_nearest_new_ = true;
    }
  }

  [[nodiscard]] DistanceBounds with_points(DistanceBounds bounds) const {
    if (!(nearest_m_ < kFar)) return bounds;
    const LatticeTriangle a = pose_triangle(s_.frame_a, nearest_a_);
    const NearestPoints nearest = nearest_points(a, pose_triangle(s_.frame_b, nearest_b_));
    const int lattice = s_.frame_a.lattice_exp;
    bounds.at_most_m = std::ldexp(nearest.at_most, lattice);
    for (std::size_t k = 0; k < 3; ++k) {
      const auto origin = static_cast<double>(a[0].v[k]);
      bounds.nearest_a_m[k] = std::ldexp(origin + nearest.on_a[k], lattice);
      bounds.nearest_b_m[k] = std::ldexp(origin + nearest.on_b[k], lattice);
    }
    return bounds;
  }

  const Scene& s_;
  QueryStats& stats_;
  const bool is_exact_;
  const double clear_m_;
  const double share_;  // of the least distance found: a bound of so much is enough
  const int max_steps_;
  const bool is_a_larger_;
  PlacedNodes placed_a_, placed_b_;
  GapQueue queue_;
  bool is_diving_ = false;
  std::optional<Gap> nearest_below_;  // of what the dive has just opened
  double found_ = kFar, least_left_ = kFar, by_larger_ = kFar;
  // The nearest that are known to be there, by what was found of them on the way.
  double nearest_m_ = kFar;
  Corners nearest_a_, nearest_b_;
  bool is_nearest_new_ = false;
  std::optional<ApartWay> way_to_b_, way_to_a_;  // between these, in a's units and in b's
};

constexpr DistanceBounds kNowhere{
    .at_least_m = kFar, .share = 1, .by_larger_m = kFar, .is_clear = true};
[[nodiscard]] bool is_empty(const Scene& scene) {
  return scene.a.nodes[0].lanes == 0 || scene.b.nodes[0].lanes == 0;
}

}  // namespace

DistanceBounds find_distance(const Scene& scene, Clearance sought, QueryStats& stats) {
  if (is_empty(scene)) return kNowhere;
  return *NearestSearch(scene, sought, stats).run(false);
}

std::optional<DistanceBounds> find_bound_if_clear(const Scene& scene, QueryStats& stats) {
  if (is_empty(scene)) return kNowhere;
  return NearestSearch(scene, Clearance::kBound, stats).run(true);
}

}  // namespace nearmesh
