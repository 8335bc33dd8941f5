// SPDX-License-Identifier: Apache-2.0
#pragma once
// The walk of two trees over a time, by halves of it: what sweep() and lacking_ahead() do. Why its
// bounds hold: sweep.cpp.

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "core/geometry/triangle_overlap.hpp"
#include "lacking_ahead.hpp"
#include "met_nodes.hpp"
#include "nearmesh/core/geometry/detail/box_overlap.hpp"
#include "nearmesh/core/query/sweep.hpp"
#include "swept_frames.hpp"
#include "walk.hpp"

namespace nearmesh {

/// So many tests lie between looks at SweepOptions::is_over: they take longer than a query's.
inline constexpr std::uint64_t kSweepTestsALook = 256;
inline constexpr double kNever = std::numeric_limits<double>::infinity();

[[nodiscard]] inline QueryOptions first_contact(const SweepOptions& options) {
  return {.any = true,
          .clearance = Clearance::kNone,
          .max_tests = options.max_tests,
          .is_over = options.is_over};
}

class SweptQuery {
 public:
  /// Errors, too, name the bodies.
  SweptQuery(const Mover& a, std::string_view name_a, const Mover& b, std::string_view name_b,
             const SweepOptions& options, double margin_m = 0)
      : a_(a),
        b_(b),
        name_a_(name_a),
        name_b_(name_b),
        options_(options),
        frames_(a_, b_, options.duration_s, options.time_levels, margin_m),
        cell_a_m_(std::ldexp(1.0, a.tree.grid->exponent)),
        cell_b_m_(std::ldexp(1.0, b.tree.grid->exponent)),
        views_(static_cast<std::size_t>(options.time_levels) + 1),
        mids_(views_.size()) {}

  Result<SweptAnswer> run() {
    advance(level_of_first_contact(), 0, {{a_.tree.root(), b_.tree.root()}});
    NEARMESH_RETURN_IF_ERROR(status_);
    finish();
    return std::move(answer_);
  }

  /// Only what is missing, at any instant: faces may touch meanwhile.
  Result<Lacking> lacking(const Require& require_a, const Require& require_b) {
    seeks_contact_ = false;
    require_a_ = &require_a;
    require_b_ = &require_b;
    advance(0, 0, {{a_.tree.root(), b_.tree.root()}});
    NEARMESH_RETURN_IF_ERROR(status_);
    finish();
    return Lacking{std::move(answer_.missing_a), std::move(answer_.missing_b),
                   answer_.stats.box_tests + answer_.stats.triangle_tests};
  }

 private:
  using Kind = TreeEntry::Kind;
  struct Pair {
    TreeEntry a, b;
    bool is_tested = false;  ///< their boxes meet in this interval
    std::uint32_t met_a = MetNodes::kNone,
                  met_b = MetNodes::kNone;  ///< numbers of unresolved nodes, where known
  };
  /// Both frames at an instant.
  struct Posed {
    std::uint64_t instant = ~std::uint64_t{0};
    PosedFrame a, b;
  };
  /// An interval.
  struct View : SweptFrame {
    int level = 0;
  };

  /// Tests the last instant, and as long as there is contact, the middle of what is before: nothing
  /// later matters then. The level of which the first interval is left to look at.
  int level_of_first_contact() {
    int level = 0;
    const std::uint64_t last = frames_.last_instant();
    for (std::uint64_t instant = last; instant > 1 && touches_at(instant); instant /= 2) {
      answer_.hit_s = seconds(instant);
      if (instant < last) ++level;
    }
    return level;
  }

  bool touches_at(std::uint64_t instant) {
    Posed posed;
    if (!pose_both(instant, posed)) return false;
    const Answer there = query(a_.tree, posed.a, b_.tree, posed.b, first_contact(options_));
    answer_.stats.box_tests += there.stats.box_tests;
    answer_.stats.triangle_tests += there.stats.triangle_tests;
    return there.status == AnswerStatus::kContact;
  }

  [[nodiscard]] double seconds(std::uint64_t instant) const { return frames_.seconds(instant); }

  /// Everything that starts in the interval `index` of 2^level, for the pairs given.
  void advance(int level, std::uint64_t index, const std::vector<Pair>& pairs) {
    const std::uint64_t length = frames_.last_instant() >> level;
    if (is_over(seconds(index * length))) return;
    View& view = views_[static_cast<std::size_t>(level)];
    view.level = level;
    frames_.set(view, index * length, length);
    std::vector<Pair> left;
    for (const Pair& pair : pairs) {
      stack_.push_back(pair);
      while (!stack_.empty()) {
        const Pair at = stack_.back();
        stack_.pop_back();
        if (!is_over(view.start_s)) visit(at, view, left);
      }
    }
    if (left.empty()) return;
    advance(level + 1, 2 * index, left);
    advance(level + 1, 2 * index + 1, left);
  }

  /// Nothing that starts at that time or later can change the answer. Notes an exhausted budget.
  bool is_over(double start_s) {
    if (!status_.is_ok() || answer_.exhausted || start_s >= answer_.hit_s) return true;
    const std::uint64_t spent = answer_.stats.box_tests + answer_.stats.triangle_tests;
    if (spent < options_.max_tests && !has_no_time(spent)) return false;
    answer_.exhausted = true;
    undecided_s_ = std::min(undecided_s_, start_s);
    return true;
  }

  bool has_no_time(std::uint64_t spent) {
    if (options_.is_over == nullptr || spent < next_look_) return false;
    next_look_ = spent + kSweepTestsALook;
    return (*options_.is_over)();
  }

  [[nodiscard]] bool is_finest(const View& view) const {
    return view.level == options_.time_levels;
  }

  void visit(Pair pair, View& view, std::vector<Pair>& left) {
    const TreeEntry &na = pair.a, &nb = pair.b;
    const Kind ka = na.kind(), kb = nb.kind();
    if (ka == Kind::kEmpty || kb == Kind::kEmpty) return;
    if (!seeks_contact_ && !na.is_coarse() && !nb.is_coarse()) return;
    if (ka == Kind::kUnresolved && pair.met_a == MetNodes::kNone)
      pair.met_a = met_a_.number_of(a_.tree, na);
    if (kb == Kind::kUnresolved && pair.met_b == MetNodes::kNone)
      pair.met_b = met_b_.number_of(b_.tree, nb);
    const auto is_settled = [](const MetNodes& met, std::uint32_t number, const TreeEntry& other) {
      return number != MetNodes::kNone && met[number].is_settled && !other.is_coarse();
    };
    if (is_settled(met_a_, pair.met_a, nb) || is_settled(met_b_, pair.met_b, na)) return;
    const double around_m = frames_.around_m(na.box, nb.box, view);
    const CenteredBox box_a = centered(na.box), box_b = centered(nb.box);
    const Drift drift = view.drift_in_a(around_m);
    if (!pair.is_tested) {
      ++answer_.stats.box_tests;
      if (boxes_stay_apart(view.b_in_a, drift, box_a, box_b)) return;
    }
    // Known to be missing since an earlier start, or the same: its parts count, and none of its
    // half-spaces.
    if (ka == Kind::kUnresolved && met_a_[pair.met_a].is_missing) return open_a(pair);
    if (kb == Kind::kUnresolved && met_b_[pair.met_b].is_missing) return open_b(pair);
    if (ka == Kind::kUnresolved && met_a_[pair.met_a].has_half_spaces &&
        stays_behind(view.b_in_a, drift, a_.tree, na, box_b))
      return;
    if (kb == Kind::kUnresolved && met_b_[pair.met_b].has_half_spaces &&
        stays_behind(view.a_in_b, view.drift_in_b(around_m), b_.tree, nb, box_a))
      return;
    // Faces are often much smaller than their boxes.
    if (ka == Kind::kFaces && kb != Kind::kFaces &&
        stays_clear(view.a_in_b, view.drift_in_b(around_m), b_.tree, nb, a_.tree, na))
      return;
    if (kb == Kind::kFaces && ka != Kind::kFaces &&
        stays_clear(view.b_in_a, drift, a_.tree, na, b_.tree, nb))
      return;
    const bool finest = is_finest(view);
    const double size_a = static_cast<double>(size_of(na.box)) * cell_a_m_,
                 size_b = static_cast<double>(size_of(nb.box)) * cell_b_m_;
    const bool inner_a = ka == Kind::kInner, inner_b = kb == Kind::kInner;
    const bool opens_a = inner_a && (!inner_b || size_a >= size_b);
    // The greater cause first: the box to open, or the way.
    const double way_m = view.along_m + around_m;
    // NOLINTNEXTLINE(bugprone-branch-clone): the way may be halved first, or last
    if (!finest && (inner_a || inner_b) && way_m > (opens_a ? size_a : size_b)) {
      leave(pair, left);
    } else if (opens_a) {
      const TreeNode& node = a_.tree.nodes[na.first];
      push_close(
          node,
          boxes_stay_apart(view.b_in_a, frames_.drift_in_a(node, nb.box, view), node.boxes, box_b),
          [&](const TreeEntry& child) {
            stack_.push_back({child, nb, true, MetNodes::kNone, pair.met_b});
          });
    } else if (inner_b) {
      const TreeNode& node = b_.tree.nodes[nb.first];
      push_close(
          node,
          boxes_stay_apart(view.b_in_a, frames_.drift_in_a(na.box, node, view), box_a, node.boxes),
          [&](const TreeEntry& child) {
            stack_.push_back({na, child, true, pair.met_a, MetNodes::kNone});
          });
    } else if (ka == Kind::kFaces && kb == Kind::kFaces) {
      if (seeks_contact_ && !faces_stay_apart(na, nb, view, drift)) {
        if (!finest) {
          leave(pair, left);
        } else {
          undecided_s_ = std::min(undecided_s_, view.start_s);
        }
      }
    } else if (!finest) {
      leave(pair, left);
    } else if (ka == Kind::kUnresolved && (kb != Kind::kUnresolved || size_a >= size_b)) {
      // The larger of two is the one to split next; ties go to a.
      met_a_.add_missing(pair.met_a, view.start_s);
      open_a(pair);
    } else {
      met_b_.add_missing(pair.met_b, view.start_s);
      open_b(pair);
    }
  }

  /// To the halves of the interval.
  static void leave(const Pair& pair, std::vector<Pair>& left) {
    left.push_back(pair);
    left.back().is_tested = false;
  }
  template <class Push>
  void push_close(const TreeNode& node, std::uint32_t apart, const Push& push) {
    answer_.stats.box_tests += static_cast<std::uint64_t>(std::popcount(node.lanes));
    for (std::uint32_t close = node.lanes & ~apart; close != 0; close &= close - 1)
      push(node.entry(static_cast<std::uint32_t>(std::countr_zero(close))));
  }

  /// Goes on with the parts of an unresolved node instead of the node, where they can be known.
  void open_a(const Pair& pair) {
    open(a_.tree, *require_a_, met_a_, pair.met_a, [&](std::uint32_t part) {
      stack_.push_back({met_a_[part].entry, pair.b, false, part, pair.met_b});
    });
  }
  void open_b(const Pair& pair) {
    open(b_.tree, *require_b_, met_b_, pair.met_b, [&](std::uint32_t part) {
      stack_.push_back({pair.a, met_b_[part].entry, false, pair.met_a, part});
    });
  }
  template <class Push>
  void open(const TreeView& tree, const Require& require, MetNodes& met, std::uint32_t number,
            const Push& push) {
    if (!require) return;
    if (!met[number].has_parts) {
      const NodeSpan node = met[number].entry.unresolved_node();
      if (const Status known = require(node); !known.is_ok()) {
        status_ = known;
        return;
      }
      met.add_parts(tree, number, tree.store->split_of(node));
    }
    const std::uint32_t parts[2] = {met[number].parts[0], met[number].parts[1]};
    for (const std::uint32_t part : parts)
      if (part != MetNodes::kNone) push(part);
  }

  /// False when a pair is closer than the drift resolves. Such pairs are tested at the interval's
  /// instants.
  bool faces_stay_apart(const TreeEntry& na, const TreeEntry& nb, const View& view,
                        const Drift& drift) {
    const bool finest = is_finest(view);
    bool apart = true;
    b_.tree.for_each_face(nb, [&](const TreeFace& fb) {
      const DoubleTriangle tb = to_a_units(view.b_in_a, fb.corners);
      a_.tree.for_each_face(na, [&](const TreeFace& fa) {
        ++answer_.stats.triangle_tests;
        if (triangles_stay_apart(view.b_in_a, drift, as_doubles(fa.corners), tb)) return;
        apart = false;
        if (finest) test_at(view.first, start_, fa, fb);
        test_at(view.middle, mids_[static_cast<std::size_t>(view.level)], fa, fb);
      });
    });
    return apart;
  }

  /// The exact test at one instant; `posed` keeps the frames for the next pair.
  void test_at(std::uint64_t instant, Posed& posed, const TreeFace& fa, const TreeFace& fb) {
    if (seconds(instant) >= answer_.hit_s || !pose_both(instant, posed)) return;
    ++answer_.stats.triangle_tests;
    if (triangles_overlap(pose_triangle(posed.a, fa.corners), pose_triangle(posed.b, fb.corners)))
      answer_.hit_s = seconds(instant);
  }

  bool pose_both(std::uint64_t instant, Posed& posed) {
    if (posed.instant == instant) return status_.is_ok();
    const auto pose = [&](const Mover& x, std::string_view name, PosedFrame& frame) {
      const Result<PosedFrame> made =
          make_posed_frame(*x.tree.grid, pose_at(x.motion, seconds(instant)), frames_.lattice());
      if (made.is_ok()) {
        frame = made.value();
      } else {
        status_ = {made.status().code(), std::string(name) + ": " + made.status().message()};
      }
    };
    pose(a_, name_a_, posed.a);
    pose(b_, name_b_, posed.b);
    posed.instant = instant;
    return status_.is_ok();
  }

  /// Whether a half-space of an unresolved node stays clear of the other side's box.
  bool stays_behind(const RelativeFrame& other_in_own, const Drift& drift, const TreeView& own,
                    const TreeEntry& node, const CenteredBox& other) {
    return half_spaces_part(own, node, [&](const BoundedPart& part) {
      ++answer_.stats.box_tests;
      return half_space_box_stay_apart(other_in_own, drift, part, other);
    });
  }

  /// Whether what is below an inner entry or an unresolved node stays clear of the other side's
  /// exact faces.
  bool stays_clear(const RelativeFrame& other_in_own, const Drift& drift, const TreeView& own,
                   const TreeEntry& part, const TreeView& other, const TreeEntry& faces) {
    const std::uint32_t all = (1U << faces.count()) - 1;
    ++answer_.stats.box_tests;
    const FaceBlock& block = other.blocks[faces.first];
    std::uint32_t close =
        all & ~box_triangles_stay_apart(other_in_own, drift, centered(part.box), block.triangles);
    if (close == 0 || part.kind() != Kind::kUnresolved || !has_half_spaces(own, part))
      return close == 0;
    for (; close != 0; close &= close - 1) {
      const DoubleTriangle corners =
          to_a_units(other_in_own,
                     block.triangles.corners(static_cast<std::uint32_t>(std::countr_zero(close))));
      if (!half_spaces_part(own, part, [&](const BoundedPart& bounded) {
            return half_space_triangle_stay_apart(other_in_own, drift, bounded, corners);
          }))
        return false;
    }
    return true;
  }

  void finish() {
    const auto list = [this](const MetNodes& met, std::vector<NodeSpan>& out) {
      for (const MetNodes::Met& node : met.all()) {
        if (!node.is_missing || node.since_s >= answer_.hit_s) continue;
        undecided_s_ = std::min(undecided_s_, node.since_s);
        out.push_back(node.entry.unresolved_node());
      }
      std::sort(out.begin(), out.end());
    };
    list(met_a_, answer_.missing_a);
    list(met_b_, answer_.missing_b);
    const bool complete =
        answer_.missing_a.empty() && answer_.missing_b.empty() && !answer_.exhausted;
    if (answer_.hit_s < kNever) {
      answer_.status = complete ? AnswerStatus::kContact : AnswerStatus::kPartial;
    } else if (undecided_s_ == kNever) {
      answer_.status = AnswerStatus::kFree;
    }
    answer_.free_until_s = std::min({undecided_s_, answer_.hit_s, options_.duration_s});
  }

  const Mover a_, b_;
  const std::string_view name_a_, name_b_;
  const SweepOptions options_;
  const SweptFrames frames_;
  const double cell_a_m_, cell_b_m_;

  std::vector<View> views_;  ///< one a level
  std::vector<Posed> mids_;
  Posed start_;
  std::vector<Pair> stack_;
  MetNodes met_a_, met_b_;
  bool seeks_contact_ = true;
  std::uint64_t next_look_ = kSweepTestsALook;
  const Require nothing_;
  const Require *require_a_ = &nothing_, *require_b_ = &nothing_;
  double undecided_s_ = kNever;  ///< start of the first interval that could not be settled
  Status status_;
  SweptAnswer answer_;
};

}  // namespace nearmesh
