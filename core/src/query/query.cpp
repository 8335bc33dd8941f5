// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/core/query/query.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <queue>
#include <unordered_set>

#include "containment.hpp"
#include "nearmesh/core/base/hash.hpp"
#include "nearmesh/core/geometry/box_overlap.hpp"
#include "nearmesh/core/geometry/triangle_overlap.hpp"

namespace nearmesh {
namespace {

using Kind = TreeEntry::Kind;

/// One tree's nodes as the other body sees them, the latest few of them: a walk comes back to the same ones.
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

class Walk {
 public:
  Walk(const TreeView& a, const PosedFrame& frame_a, const TreeView& b, const PosedFrame& frame_b,
       const QueryOptions& options)
      : a_(a),
        b_(b),
        frame_a_(frame_a),
        frame_b_(frame_b),
        options_(options),
        b_in_a_(make_relative_frame(frame_a, frame_b)),
        a_in_b_(make_relative_frame(frame_b, frame_a)),
        cell_a_m_(std::ldexp(1.0, a.grid->exponent)),
        cell_b_m_(std::ldexp(1.0, b.grid->exponent)),
        placed_a_(a, a_in_b_),
        placed_b_(b, b_in_a_) {}

  Answer run() {
    if (!roots_apart()) stack_.push_back({.a = 0, .b = 0});
    while (!stack_.empty() && !(options_.any && !answer_.pairs.empty())) {
      const Pair pair = stack_.back();
      stack_.pop_back();
      visit(pair);
    }
    finish();
    return std::move(answer_);
  }

 private:
  struct Pair {
    TreePlace a, b;
    /// Of an entry of kind kFaces: the faces that may meet the other entry, as far as is known.
    std::uint32_t faces_a = kAllLanes, faces_b = kAllLanes;
  };
  /// An entry in its place.
  struct Part {
    Part(const TreeView& tree, TreePlace at)
        : place(at), node(tree.nodes[at / kLanes]), lane(at % kLanes) {}
    [[nodiscard]] Kind kind() const { return node.kind(lane); }
    [[nodiscard]] std::uint32_t first() const { return node.first[lane]; }
    [[nodiscard]] std::uint32_t count() const { return node.kind_and_count[lane] >> 2; }
    [[nodiscard]] float size() const { return node.size[lane]; }
    [[nodiscard]] TreeEntry entry() const { return node.entry(lane); }
    /// The lanes of a block that hold faces.
    [[nodiscard]] std::uint32_t faces() const { return (1U << count()) - 1; }

    TreePlace place;
    const TreeNode& node;
    std::uint32_t lane;
  };

  bool roots_apart() {
    const TreeNode &a = a_.nodes[0], &b = b_.nodes[0];
    if (a.lanes == 0 || b.lanes == 0) return true;
    ++answer_.stats.box_tests;
    return (boxes_apart(b_in_a_, placed_b_[0], 0, a.boxes) & 1U) != 0;
  }

  // A pair whose boxes may meet.
  void visit(const Pair& pair) {
    const Part a(a_, pair.a), b(b_, pair.b);
    const Kind ka = a.kind(), kb = b.kind();
    if (ka == Kind::kInner || kb == Kind::kInner) {
      if (opens_a(ka, a.size(), kb, b.size())) {
        open(b_in_a_, placed_b_[pair.b / kLanes], b.lane, a_.nodes[a.first()],
             [&](std::uint32_t lane) { push_a(pair, a.first(), lane, b); });
      } else {
        open(a_in_b_, placed_a_[pair.a / kLanes], a.lane, b_.nodes[b.first()],
             [&](std::uint32_t lane) { push_b(pair, b.first(), lane, a); });
      }
    } else if (ka == Kind::kFaces && kb == Kind::kFaces) {
      test_faces(a, pair.faces_a, b, pair.faces_b);
    } else if (is_missing(a, b)) {
      return;  // will be looked at again once it is split
    } else if (ka == Kind::kFrontier && kb == Kind::kFrontier) {
      // The larger of two is the one to split next; ties go to a.
      if (is_larger(a.size(), b.size())) {
        add_missing(a_, a.entry(), missing_a_);
      } else {
        add_missing(b_, b.entry(), missing_b_);
      }
    } else if (ka == Kind::kFrontier) {
      if (meets_face(b_in_a_, a_in_b_, a, placed_a_, b_.blocks[b.first()],
                     pair.faces_b & b.faces()))
        add_missing(a_, a.entry(), missing_a_);
    } else {
      if (meets_face(a_in_b_, b_in_a_, b, placed_b_, a_.blocks[a.first()],
                     pair.faces_a & a.faces()))
        add_missing(b_, b.entry(), missing_b_);
    }
  }

  // Single faces are much thinner than their block. Where the block is much larger than the lane, a look at each of them
  // saves most of what is below the lane; else it costs as much as it saves.
  static bool is_worth_it(double block_m, double lane_m) { return block_m > 2 * lane_m; }
  void push_a(Pair pair, std::uint32_t node, std::uint32_t lane, const Part& b) {
    pair.a = node * kLanes + lane;
    if (b.kind() == Kind::kFaces &&
        is_worth_it(b.size() * cell_b_m_, a_.nodes[node].size[lane] * cell_a_m_))
      pair.faces_b &= b.faces() & ~triangles_apart(a_in_b_, placed_a_[node], lane,
                                                   b_.blocks[b.first()].triangles);
    if (pair.faces_b != 0) stack_.push_back(pair);
  }
  void push_b(Pair pair, std::uint32_t node, std::uint32_t lane, const Part& a) {
    pair.b = node * kLanes + lane;
    if (a.kind() == Kind::kFaces &&
        is_worth_it(a.size() * cell_a_m_, b_.nodes[node].size[lane] * cell_b_m_))
      pair.faces_a &= a.faces() & ~triangles_apart(b_in_a_, placed_b_[node], lane,
                                                   a_.blocks[a.first()].triangles);
    if (pair.faces_a != 0) stack_.push_back(pair);
  }

  // Hands on those of a node's lanes that may meet the other side's part.
  template <class Push>
  void open(const RelativeFrame& other_in_own, const PlacedLanes& other, std::uint32_t other_lane,
            const TreeNode& own, const Push& push) {
    std::uint32_t close = own.lanes & ~boxes_apart(other_in_own, other, other_lane, own.boxes);
    answer_.stats.box_tests += kLanes;
    if (options_.any) {
      push_deepest_last(other, other_lane, own, close, push);
      return;
    }
    // In reverse, so that the first is on top of the stack.
    while (close != 0) {
      const auto lane = static_cast<std::uint32_t>(std::bit_width(close) - 1);
      close ^= 1U << lane;
      push(lane);
    }
  }

  // Where one contact suffices, the parts that reach deepest into each other are the likeliest to have it.
  template <class Push>
  static void push_deepest_last(const PlacedLanes& other, std::uint32_t other_lane,
                                const TreeNode& own, std::uint32_t close, const Push& push) {
    if ((close & (close - 1)) == 0) {
      if (close != 0) push(static_cast<std::uint32_t>(std::countr_zero(close)));
      return;
    }
    double distances[kLanes];
    centers_apart(other, other_lane, own.boxes, distances);
    std::array<std::uint32_t, kLanes> lanes;
    std::size_t count = 0;
    for (; close != 0; close &= close - 1) {
      const auto lane = static_cast<std::uint32_t>(std::countr_zero(close));
      std::size_t at = count++;  // insertion, farthest first
      for (; at > 0 && distances[lanes[at - 1]] < distances[lane]; --at) lanes[at] = lanes[at - 1];
      lanes[at] = lane;
    }
    for (std::size_t i = 0; i < count; ++i) push(lanes[i]);
  }

  [[nodiscard]] bool is_missing(const Part& a, const Part& b) const {
    return (a.kind() == Kind::kFrontier && missing_a_.contains(a.first())) ||
           (b.kind() == Kind::kFrontier && missing_b_.contains(b.first()));
  }

  [[nodiscard]] bool is_larger(float size_a, float size_b) const {
    return static_cast<double>(size_a) * cell_a_m_ >= static_cast<double>(size_b) * cell_b_m_;
  }

  // Whether the next step goes into a's children: the larger of two inner parts is opened first.
  [[nodiscard]] bool opens_a(Kind ka, float size_a, Kind kb, float size_b) const {
    return ka == Kind::kInner && (kb != Kind::kInner || is_larger(size_a, size_b));
  }

  // The leaf that was opened last has not been held against the other yet.
  void test_faces(const Part& a, std::uint32_t close_a, const Part& b, std::uint32_t close_b) {
    const FaceBlock &block_a = a_.blocks[a.first()], &block_b = b_.blocks[b.first()];
    answer_.stats.triangle_tests += std::uint64_t{a.count()} * b.count();
    if (close_a == kAllLanes)
      close_a = a.faces() &
                ~triangles_apart(b_in_a_, placed_b_[b.place / kLanes], b.lane, block_a.triangles);
    if (close_a == 0) return;
    if (close_b == kAllLanes)
      close_b = b.faces() &
                ~triangles_apart(a_in_b_, placed_a_[a.place / kLanes], a.lane, block_b.triangles);
    if (close_b == 0) return;
    PlacedTriangles placed_b;
    place_triangles(b_in_a_, block_b.triangles, placed_b);
    for (; close_a != 0; close_a &= close_a - 1) {
      const auto i = static_cast<std::uint32_t>(std::countr_zero(close_a));
      const std::array<GridPoint, 3> corners_a = block_a.triangles.corners(i);
      const PairVerdicts verdicts = test_triangles(b_in_a_, as_doubles(corners_a), placed_b);
      for (std::uint32_t close = close_b & ~verdicts.apart; close != 0; close &= close - 1) {
        const auto j = static_cast<std::uint32_t>(std::countr_zero(close));
        if ((verdicts.touching >> j & 1U) == 0 &&
            !triangles_overlap(pose_triangle(frame_a_, corners_a),
                               pose_triangle(frame_b_, block_b.triangles.corners(j))))
          continue;
        answer_.pairs.push_back({block_a.keys[i], block_b.keys[j]});
        if (options_.any) return;
      }
    }
  }

  // Whether a frontier box (in its own grid) may meet one of the other side's exact faces.
  bool meets_face(const RelativeFrame& other_in_own, const RelativeFrame& own_in_other,
                  const Part& own, PlacedNodes& placed, const FaceBlock& block,
                  std::uint32_t faces) {
    std::uint32_t close = faces & ~triangles_apart(own_in_other, placed[own.place / kLanes],
                                                   own.lane, block.triangles);
    const CenteredBox box = centered(own.node.boxes.box(own.lane));
    for (; close != 0; close &= close - 1) {
      const auto i = static_cast<std::uint32_t>(std::countr_zero(close));
      ++answer_.stats.box_tests;
      if (!box_triangle_apart(other_in_own, box,
                              to_a_units(other_in_own, block.triangles.corners(i))))
        return true;
    }
    return false;
  }

  void add_missing(const TreeView& tree, const TreeEntry& node,
                   std::unordered_set<std::uint32_t>& set) {
    set.insert(node.first);
    // By the set: both bodies may have the same tree.
    (&set == &missing_a_ ? answer_.missing_a : answer_.missing_b).push_back(node.frontier_node());
    const double bound = node_bound(*tree.store, node.frontier_node());
    answer_.uncertainty_m = std::max(answer_.uncertainty_m, std::ldexp(bound, tree.grid->exponent));
  }

  void finish() {
    const bool touches = !answer_.pairs.empty();
    const bool complete = missing_a_.empty() && missing_b_.empty();
    if (complete && !touches) {
      answer_.status = AnswerStatus::kFree;
      if (options_.solid_a || options_.solid_b) settle_containment();
    } else if (complete || (options_.any && touches)) {
      answer_.status = AnswerStatus::kContact;
      answer_.missing_a.clear();
      answer_.missing_b.clear();
      answer_.uncertainty_m = 0;
    } else {
      answer_.status = touches ? AnswerStatus::kPartial : AnswerStatus::kUncertain;
    }
    if (is_certified(answer_.status) && !touches && options_.clearance)
      answer_.clearance_m = clearance();
    std::sort(answer_.pairs.begin(), answer_.pairs.end());
    answer_.pair_total = answer_.pairs.size();
    answer_.truncated = answer_.pair_total > options_.max_pairs;
    if (answer_.truncated) answer_.pairs.resize(options_.max_pairs);
    std::sort(answer_.missing_a.begin(), answer_.missing_a.end());
    std::sort(answer_.missing_b.begin(), answer_.missing_b.end());
  }

  // The surfaces are apart. Each question is answered to the end, so that a certified answer is the same on every peer.
  void settle_containment() {
    const TreeEntry root_a = a_.root(), root_b = b_.root();
    if (root_a.kind() == Kind::kEmpty || root_b.kind() == Kind::kEmpty ||
        boxes_apart(b_in_a_, centered(root_a.box), centered(root_b.box)))
      return;
    const Side a_in_b =
        options_.solid_b ? side_of(a_, frame_a_, b_, frame_b_, missing_b_) : Side::kOutside;
    const Side b_in_a =
        options_.solid_a ? side_of(b_, frame_b_, a_, frame_a_, missing_a_) : Side::kOutside;
    const bool inside = a_in_b == Side::kInside || b_in_a == Side::kInside;
    const bool open = a_in_b == Side::kOpen || b_in_a == Side::kOpen;
    if (!missing_a_.empty() || !missing_b_.empty() || (open && !inside)) {
      answer_.status = AnswerStatus::kUncertain;
      if (missing_a_.empty() && missing_b_.empty())
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
    if (!inner.surface->has_seeds()) return Side::kOpen;
    std::vector<Location> open;
    for (const GridPoint& seed : inner.surface->component_seeds) {
      Location at = locate(solid, solid_frame, pose_point(inner_frame, seed), answer_.stats);
      if (at.side == Side::kInside) return Side::kInside;
      if (at.side == Side::kOpen) open.push_back(std::move(at));
    }
    std::vector<GridBox>& rays = &known == &missing_a_ ? answer_.rays_a : answer_.rays_b;
    for (const Location& at : open)
      for (const TreeEntry& node : at.missing) {
        if (known.contains(node.first)) continue;
        add_missing(solid, node, known);
        add_ray_boxes(solid_frame, at.ray, node.box, rays);
      }
    return open.empty() ? Side::kOutside : Side::kOpen;
  }

  // A lower bound of the distance of two bodies that do not touch: pairs of boxes by growing gap, until the least gap
  // left is no smaller than the least distance found. Every pair of faces lies below some pair that was counted or is
  // still queued, so stopping early only makes the bound smaller.
  double clearance() {
    constexpr int kMaxSteps = 4096;
    // Equal gaps are taken in the order of their finding, which follows from the trees' shapes. Places in the trees'
    // arrays would not do: they depend on what was refined before, and which of two equals is looked at may change the
    // bound.
    struct Gap {
      double gap;
      std::uint32_t order;
      TreePlace a, b;
      bool operator<(const Gap& o) const { return gap != o.gap ? gap > o.gap : order > o.order; }
    };
    if (a_.nodes[0].lanes == 0 || b_.nodes[0].lanes == 0)
      return std::numeric_limits<double>::infinity();
    std::priority_queue<Gap> queue;
    std::uint32_t order = 0;
    queue.push({0, order++, 0, 0});
    double found = std::numeric_limits<double>::infinity();
    for (int step = 0; !queue.empty() && queue.top().gap < found; ++step) {
      const Gap top = queue.top();
      if (step == kMaxSteps) return top.gap;
      queue.pop();
      const Part a(a_, top.a), b(b_, top.b);
      const auto offer = [&](const RelativeFrame& other_in_own, const PlacedLanes& other,
                             std::uint32_t other_lane, const TreeNode& own, const auto& pair_of) {
        double gaps_m[kLanes];
        boxes_gaps_m(other_in_own, other, other_lane, own.boxes, gaps_m);
        answer_.stats.box_tests += kLanes;
        for (std::uint32_t lane = 0; lane < kLanes; ++lane) {
          if ((own.lanes >> lane & 1U) == 0) continue;
          const auto [place_a, place_b] = pair_of(lane);
          const double gap = std::max(gaps_m[lane], top.gap);  // what holds above holds below
          if (gap < found) queue.push({gap, order++, place_a, place_b});
        }
      };
      if (opens_a(a.kind(), a.size(), b.kind(), b.size())) {
        offer(b_in_a_, placed_b_[top.b / kLanes], b.lane, a_.nodes[a.first()],
              [&](std::uint32_t lane) { return std::pair(a.first() * kLanes + lane, top.b); });
      } else if (b.kind() == Kind::kInner) {
        offer(a_in_b_, placed_a_[top.a / kLanes], a.lane, b_.nodes[b.first()],
              [&](std::uint32_t lane) { return std::pair(top.a, b.first() * kLanes + lane); });
      } else if (a.kind() == Kind::kFaces && b.kind() == Kind::kFaces) {
        found = faces_gap_m(a, b, found);
      } else {
        found = std::min(found, top.gap);  // an unresolved node: its box stands for what is in it
      }
    }
    return found;
  }

  // The least gap of two leaves' faces, or `found` when none is below it. Most pairs are settled by their extents.
  double faces_gap_m(const Part& a, const Part& b, double found) const {
    const FaceBlock &block_a = a_.blocks[a.first()], &block_b = b_.blocks[b.first()];
    PlacedTriangles placed_b;
    place_triangles(b_in_a_, block_b.triangles, placed_b);
    for (std::uint32_t i = 0; i < a.count(); ++i) {
      const DoubleTriangle triangle_a = as_doubles(block_a.triangles.corners(i));
      double gaps_m[kLanes];
      extents_gaps_m(b_in_a_, triangle_a, placed_b, gaps_m);
      for (std::uint32_t j = 0; j < b.count(); ++j) {
        if (!(gaps_m[j] < found)) continue;
        DoubleTriangle triangle_b;
        for (std::size_t c = 0; c < 3; ++c)
          for (std::size_t k = 0; k < 3; ++k) triangle_b[c][k] = placed_b.corner[c][k][j];
        found = std::min(found, triangles_gap_m(b_in_a_, triangle_a, triangle_b));
      }
    }
    return found;
  }

  const TreeView &a_, &b_;
  const PosedFrame &frame_a_, &frame_b_;
  const QueryOptions options_;
  const RelativeFrame b_in_a_, a_in_b_;
  const double cell_a_m_, cell_b_m_;
  PlacedNodes placed_a_, placed_b_;
  std::vector<Pair> stack_;
  std::unordered_set<std::uint32_t> missing_a_, missing_b_;  // by first vertex; membership only
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
  add(std::bit_cast<std::uint64_t>(answer.clearance_m));
  add(std::bit_cast<std::uint64_t>(answer.uncertainty_m));
  return h;
}

double node_bound(const SplitStore& store, NodeSpan node) {
  const GridBox box = store.box(node);
  const GridPoint& stand_in = store.position(node.first);
  double square = 0;
  for (int k = 0; k < 3; ++k) {
    const auto farther = static_cast<double>(
        std::max(std::int64_t{stand_in[k]} - box.lo[k], std::int64_t{box.hi[k]} - stand_in[k]));
    square += farther * farther;
  }
  // Rounded up: the sum and the root err by less than 2^-50 of the result.
  return std::sqrt(square) * (1 + 0x1p-48);
}

Answer query(const TreeView& a, const PosedFrame& frame_a, const TreeView& b,
             const PosedFrame& frame_b, const QueryOptions& options) {
  NEARMESH_ASSERT(frame_a.lattice_exp == frame_b.lattice_exp);
  NEARMESH_ASSERT(!(options.solid_a || options.solid_b) ||
                  (a.surface != nullptr && b.surface != nullptr));
  NEARMESH_ASSERT(!options.solid_a || a.surface->is_closed());
  NEARMESH_ASSERT(!options.solid_b || b.surface->is_closed());
  return Walk(a, frame_a, b, frame_b, options).run();
}

Result<PosedPair> pose_pair(const Grid& grid_a, const Pose& pose_a, std::string_view name_a,
                            const Grid& grid_b, const Pose& pose_b, std::string_view name_b) {
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
