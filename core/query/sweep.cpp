// SPDX-License-Identifier: Apache-2.0
// Time by halves, earliest first; in each interval both trees are walked together with boxes grown by the motion.
//
// The bound. Let m be the middle of an interval of half-length h, and t in [m - h, m + h].
// 1. The relative frame of the two placements at m (make_relative_frame of poses) is that of pose_at, up to doubles,
//    which are inside its slack; pose_at is within placing_error_m of the true motion.
// 2. From m to t the true motion takes a point of B, as seen from A's place at m, by (v_b - v_a)(t - m), which is what
//    `along` holds for h, and besides turns it by at most |w_b| h |R0 x_b| and a point of A by |w_a| h |R0 x_a|: an arc is
//    longer than its chord. |R0 x| <= 1.0001 reach (check_pose), reach that of the node's own box.
// 3. At t a point of a posed triangle is within posing_error_m of the true motion's.
// 4. Where the motions' poses have themselves been taken to the start (core/query/answer.cpp), each is off by placing_error_m of the way there,
//    and stays so: what moves on rigidly from two such places is no farther apart later. Both are in start_error_m, which goes into `around`.
// So `around` = h (|w_a| reach_a + |w_b| reach_b) 1.0001 + both bodies' placing and posing errors, and boxes that stay apart
// under that drift have no common point at t, whether rigid or posed; boxes enclose what is not refined (core/THEOREM.md).
// Instants k T / 2^n are rounded to doubles: m and the ends err by 2^-53 T each, so h is taken larger by 2^-51 T.
#include "nearmesh/core/query/sweep.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <optional>
#include <string>
#include <unordered_map>

#include "core/base/float_guard.hpp"
#include "core/geometry/motion_bounds.hpp"
#include "core/geometry/triangle_overlap.hpp"
#include "core/geometry/vec3.hpp"
#include "lacking_ahead.hpp"
#include "nearmesh/core/geometry/detail/box_overlap.hpp"
#include "sweep_from.hpp"
#include "swept_frames.hpp"
#include "walk.hpp"

namespace nearmesh {
namespace {

using Kind = TreeEntry::Kind;

/// So many tests lie between looks at SweepOptions::is_over: they take longer than a query's.
constexpr std::uint64_t kSweepTestsALook = 256;
constexpr double kNever = std::numeric_limits<double>::infinity();

[[nodiscard]] QueryOptions first_contact(const SweepOptions& options) {
  return {.any = true,
          .clearance = Clearance::kNone,
          .max_tests = options.max_tests,
          .is_over = options.is_over};
}

/// Unresolved nodes that a sweep met, those of the tree and parts of missing ones: by number, since it comes back to the same ones in
/// each interval.
class MetNodes {
 public:
  static constexpr std::uint32_t kNone = 0xffffffffU;
  struct Met {
    TreeEntry entry;
    std::uint32_t whole = kNone;              ///< what it is a part of
    std::uint32_t parts[2] = {kNone, kNone};  ///< of more than one vertex, where they are known
    std::uint32_t open_parts = 0;             ///< of which something may be found yet
    double since_s =
        0;  ///< of a missing one: the start of the first interval in which it might touch
    bool has_half_spaces = false, is_missing = false, has_parts = false;
    bool is_settled =
        false;  ///< it is missing, and so is all below it: nothing more is to be found
  };
  /// Of an entry of the tree.
  std::uint32_t number_of(const TreeView& tree, const TreeEntry& entry) {
    const auto [at, is_new] =
        by_first_.try_emplace(entry.first, static_cast<std::uint32_t>(met_.size()));
    if (is_new) met_.push_back({.entry = entry, .has_half_spaces = has_half_spaces(tree, entry)});
    return at->second;
  }
  /// The split of a missing node is known.
  void add_parts(const TreeView& tree, std::uint32_t number, VertexId split) {
    const NodeSpan node = met_[number].entry.unresolved_node();
    const NodeSpan parts[2] = {node.right_of(split), node.left_of(split)};
    for (const std::size_t side : {0U, 1U}) {
      if (parts[side].size < 2) continue;
      met_[number].parts[side] = static_cast<std::uint32_t>(met_.size());
      ++met_[number].open_parts;
      met_.push_back({.entry = unresolved_entry(tree, parts[side]), .whole = number});
    }
    met_[number].has_parts = true;
    settle(number);
  }
  void add_missing(std::uint32_t number, double since_s) {
    met_[number].is_missing = true;
    met_[number].since_s = since_s;
  }
  [[nodiscard]] const Met& operator[](std::uint32_t number) const { return met_[number]; }
  [[nodiscard]] const std::vector<Met>& all() const { return met_; }

 private:
  void settle(std::uint32_t number) {
    while (number != kNone && met_[number].open_parts == 0) {
      met_[number].is_settled = true;
      number = met_[number].whole;
      if (number != kNone) --met_[number].open_parts;
    }
  }

  std::vector<Met> met_;
  std::unordered_map<std::uint32_t, std::uint32_t> by_first_;  // by the first vertex; look-ups only
};

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

  /// Tests the last instant, and as long as there is contact, the middle of what is before: nothing later matters then.
  /// The level of which the first interval is left to look at.
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
    // Known to be missing since an earlier start, or the same: its parts count, and none of its half-spaces.
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

  /// False when a pair is closer than the drift resolves. Such pairs are tested at the interval's instants.
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

  /// Whether what is below an inner entry or an unresolved node stays clear of the other side's exact faces.
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

/// Bodies at rest, or already in contact, need no time. In: an answer as sweep_from() takes it.
SweptAnswer at_once(const Answer& now, double duration_s) {
  SweptAnswer swept;
  if (now.pair_total > 0) {
    swept.status = AnswerStatus::kContact;
    swept.hit_s = 0;
    return swept;
  }
  swept.missing_a = now.missing_a;
  swept.missing_b = now.missing_b;
  swept.exhausted = now.exhausted;
  if (!is_certified(now.status)) return swept;
  swept.status = AnswerStatus::kFree;  // of the surfaces, also where one body is in the other
  swept.free_until_s = duration_s;
  return swept;
}

}  // namespace

Result<SweptAnswer> sweep(const TreeView& a, const Motion& motion_a, std::string_view name_a,
                          const TreeView& b, const Motion& motion_b, std::string_view name_b,
                          const SweepOptions& options) {
  const FloatGuard guard;
  return sweep_from(nullptr, a, motion_a, name_a, b, motion_b, name_b, options);
}

Result<SweptAnswer> sweep_from(const Answer* now, const TreeView& a, const Motion& motion_a,
                               std::string_view name_a, const TreeView& b, const Motion& motion_b,
                               std::string_view name_b, const SweepOptions& options,
                               double start_error_m) {
  NEARMESH_ASSERT(options.time_levels >= 0 && options.time_levels <= kMaxTimeLevels);
  if (!(options.duration_s >= kMinSweep_s && options.duration_s <= kMaxSweep_s))
    return Status{StatusCode::kInvalidArgument, "duration_s of a sweep is " +
                                                    std::to_string(options.duration_s) +
                                                    ", expected 1e-9 to 1e9"};
  NEARMESH_RETURN_IF_ERROR(check_way(motion_a, name_a, options.duration_s));
  NEARMESH_RETURN_IF_ERROR(check_way(motion_b, name_b, options.duration_s));

  // Contact at the start is the commonest hit, and settles all.
  std::optional<Answer> asked;
  if (now == nullptr) {
    const Result<PosedPair> start =
        pose_pair(*a.grid, motion_a.pose, name_a, *b.grid, motion_b.pose, name_b);
    NEARMESH_RETURN_IF_ERROR(start);
    now = &asked.emplace(query(a, start.value().a, b, start.value().b, first_contact(options)));
  }
  if (now->pair_total > 0 || (is_at_rest(motion_a) && is_at_rest(motion_b))) {
    SweptAnswer swept = at_once(*now, options.duration_s);
    if (asked) swept.stats = asked->stats;
    return swept;
  }
  return SweptQuery({a, motion_a}, name_a, {b, motion_b}, name_b, options, start_error_m).run();
}

Result<Lacking> lacking_ahead(const TreeView& a, const Motion& motion_a, std::string_view name_a,
                              const TreeView& b, const Motion& motion_b, std::string_view name_b,
                              double duration_s, double margin_m, const Require& require_a,
                              const Require& require_b, std::uint64_t max_tests) {
  const FloatGuard guard;
  const AheadOf ahead(motion_a, motion_b, duration_s);
  NEARMESH_RETURN_IF_ERROR(check_way(ahead.motion_a, name_a, ahead.duration_s));
  NEARMESH_RETURN_IF_ERROR(check_way(ahead.motion_b, name_b, ahead.duration_s));
  return SweptQuery({a, ahead.motion_a}, name_a, {b, ahead.motion_b}, name_b,
                    {.duration_s = ahead.duration_s,
                     .time_levels = ahead.time_levels,
                     .max_tests = max_tests},
                    margin_m)
      .lacking(require_a, require_b);
}

double safe_horizon_s(const TreeView& a, const Motion& motion_a, const TreeView& b,
                      const Motion& motion_b, double clearance_m, double age_a_s, double age_b_s) {
  const FloatGuard guard;
  const int lattice = lattice_exponent(*a.grid, *b.grid);
  double speed_mps = 0, rounding_m = 0, gone_m = 0;
  const auto add = [&](const TreeView& tree, const Motion& motion, double age_s) {
    const double reach = reach_m(*tree.grid, tree.root().box);
    const double speed = speed_bound_mps(motion, reach);
    speed_mps += speed;
    if (speed > 0) gone_m += speed * std::abs(age_s) * kRoundUp;
    rounding_m += 2 * posing_error_m(motion, reach, 0, *tree.grid, lattice);  // now and then
  };
  add(a, motion_a, age_a_s);
  add(b, motion_b, age_b_s);
  if (speed_mps == 0) return kNever;
  return guard.keep(std::max(0.0, clearance_m - (rounding_m + gone_m) * kRoundUp) /
                    (speed_mps * kRoundUp));
}

}  // namespace nearmesh
