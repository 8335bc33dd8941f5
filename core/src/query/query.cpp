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
#include "node_size.hpp"

namespace nearmesh {
namespace {

using Kind = TreeNode::Kind;

LatticeTriangle pose_triangle(const PosedFrame& frame, const TreeFace& face) {
  return {pose_point(frame, face.corners[0]), pose_point(frame, face.corners[1]),
          pose_point(frame, face.corners[2])};
}

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
        a_in_b_(make_relative_frame(frame_b, frame_a)) {}

  Answer run() {
    stack_.push_back({a_.root, b_.root});
    while (!stack_.empty() && !(options_.any && !answer_.pairs.empty())) {
      const auto [ia, ib] = stack_.back();
      stack_.pop_back();
      visit(ia, ib);
    }
    finish();
    return std::move(answer_);
  }

 private:
  struct Pair {
    std::uint32_t a, b;
  };

  void visit(std::uint32_t ia, std::uint32_t ib) {
    const TreeNode &na = a_.nodes[ia], &nb = b_.nodes[ib];
    const Kind ka = na.kind(), kb = nb.kind();
    if (ka == Kind::kEmpty || kb == Kind::kEmpty) return;
    // A node already known to be missing will be looked at again once it is split.
    if (ka == Kind::kFrontier && missing_a_.contains(na.first)) return;
    if (kb == Kind::kFrontier && missing_b_.contains(nb.first)) return;
    const CenteredBox box_a = centered(na.box), box_b = centered(nb.box);
    ++answer_.stats.box_tests;
    if (boxes_apart(b_in_a_, box_a, box_b)) return;
    if (opens_a(na, nb)) {
      // Pushed in reverse, so that the first child is taken first.
      stack_.push_back({na.first + 1, ib});
      stack_.push_back({na.first, ib});
    } else if (kb == Kind::kInner) {
      stack_.push_back({ia, nb.first + 1});
      stack_.push_back({ia, nb.first});
    } else if (ka == Kind::kFaces && kb == Kind::kFaces) {
      test_faces(na, nb);
    } else if (ka == Kind::kFrontier && kb == Kind::kFrontier) {
      // The larger of two is the one to split next; ties go to a.
      if (size_m(a_, na) >= size_m(b_, nb)) {
        add_missing(a_, na, missing_a_);
      } else {
        add_missing(b_, nb, missing_b_);
      }
    } else if (ka == Kind::kFrontier) {
      if (meets_face(b_in_a_, box_a, b_, nb)) add_missing(a_, na, missing_a_);
    } else {
      if (meets_face(a_in_b_, box_b, a_, na)) add_missing(b_, nb, missing_b_);
    }
  }

  // Whether the next step goes into a's children: the larger of two inner nodes is opened first.
  [[nodiscard]] bool opens_a(const TreeNode& na, const TreeNode& nb) const {
    return na.kind() == Kind::kInner &&
           (nb.kind() != Kind::kInner || size_m(a_, na) >= size_m(b_, nb));
  }

  void test_faces(const TreeNode& na, const TreeNode& nb) {
    std::array<LatticeTriangle, 16> posed_b;
    for (std::uint32_t j = 0; j < nb.count(); ++j)
      posed_b[j] = pose_triangle(frame_b_, b_.faces[nb.first + j]);
    for (std::uint32_t i = 0; i < na.count(); ++i) {
      const TreeFace& fa = a_.faces[na.first + i];
      const LatticeTriangle posed_a = pose_triangle(frame_a_, fa);
      for (std::uint32_t j = 0; j < nb.count(); ++j) {
        const TreeFace& fb = b_.faces[nb.first + j];
        ++answer_.stats.triangle_tests;
        if (!triangles_overlap(posed_a, posed_b[j])) continue;
        answer_.pairs.push_back({fa.key, fb.key});
        if (options_.any) return;
      }
    }
  }

  // Whether a frontier box (in its own grid) may meet one of the other side's exact faces.
  bool meets_face(const RelativeFrame& other_in_own, const CenteredBox& box, const TreeView& other,
                  const TreeNode& faces) {
    for (std::uint32_t i = 0; i < faces.count(); ++i) {
      const DoubleTriangle triangle =
          to_a_units(other_in_own, other.faces[faces.first + i].corners);
      ++answer_.stats.box_tests;
      if (!box_triangle_apart(other_in_own, box, triangle)) return true;
    }
    return false;
  }

  void add_missing(const TreeView& tree, const TreeNode& node,
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
    const TreeNode &root_a = a_.nodes[a_.root], &root_b = b_.nodes[b_.root];
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
      for (const TreeNode* node : at.missing) {
        if (known.contains(node->first)) continue;
        add_missing(solid, *node, known);
        add_ray_boxes(solid_frame, at.ray, node->box, rays);
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
      std::uint32_t order, a, b;
      bool operator<(const Gap& o) const { return gap != o.gap ? gap > o.gap : order > o.order; }
    };
    std::priority_queue<Gap> queue;
    std::uint32_t order = 0;
    const auto offer = [&](std::uint32_t ia, std::uint32_t ib) {
      const TreeNode &na = a_.nodes[ia], &nb = b_.nodes[ib];
      if (na.kind() == Kind::kEmpty || nb.kind() == Kind::kEmpty) return;
      ++answer_.stats.box_tests;
      queue.push({boxes_gap_m(b_in_a_, centered(na.box), centered(nb.box)), order++, ia, ib});
    };
    offer(a_.root, b_.root);
    double found = std::numeric_limits<double>::infinity();
    for (int step = 0; !queue.empty() && queue.top().gap < found; ++step) {
      const Gap top = queue.top();
      if (step == kMaxSteps) return top.gap;
      queue.pop();
      const TreeNode &na = a_.nodes[top.a], &nb = b_.nodes[top.b];
      if (opens_a(na, nb)) {
        offer(na.first, top.b);
        offer(na.first + 1, top.b);
      } else if (nb.kind() == Kind::kInner) {
        offer(top.a, nb.first);
        offer(top.a, nb.first + 1);
      } else if (na.kind() == Kind::kFaces && nb.kind() == Kind::kFaces) {
        found = faces_gap_m(na, nb, found);
      } else {
        found = std::min(found, top.gap);  // an unresolved node: its box stands for what is in it
      }
    }
    return found;
  }

  // The least gap of two leaves' faces, or `found` when none is below it. Most pairs are settled by their boxes.
  double faces_gap_m(const TreeNode& na, const TreeNode& nb, double found) const {
    for (std::uint32_t j = 0; j < nb.count(); ++j) {
      const DoubleTriangle tb = to_a_units(b_in_a_, b_.faces[nb.first + j].corners);
      for (std::uint32_t i = 0; i < na.count(); ++i) {
        const DoubleTriangle ta = as_doubles(a_.faces[na.first + i].corners);
        if (extents_gap_m(ta, tb) < found)
          found = std::min(found, triangles_gap_m(b_in_a_, ta, tb));
      }
    }
    return found;
  }

  // Lower bound from the triangles' extents along A's axes.
  [[nodiscard]] double extents_gap_m(const DoubleTriangle& ta, const DoubleTriangle& tb) const {
    double square = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      const auto [lo_a, hi_a] = std::minmax({ta[0][k], ta[1][k], ta[2][k]});
      const auto [lo_b, hi_b] = std::minmax({tb[0][k], tb[1][k], tb[2][k]});
      const double gap = std::max({0.0, lo_a - hi_b, lo_b - hi_a});
      square += gap * gap;
    }
    return (std::sqrt(square) - b_in_a_.slack) * b_in_a_.least_metres_per_unit;
  }

  const TreeView &a_, &b_;
  const PosedFrame &frame_a_, &frame_b_;
  const QueryOptions options_;
  const RelativeFrame b_in_a_, a_in_b_;
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
