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
// So `around` = h (|w_a| reach_a + |w_b| reach_b) 1.0001 + both bodies' placing and posing errors, and boxes that stay apart
// under that drift have no common point at t, whether rigid or posed; boxes enclose what is not refined (core/THEOREM.md).
// Instants k T / 2^n are rounded to doubles: m and the ends err by 2^-53 T each, so h is taken larger by 2^-51 T.
#include "nearmesh/core/query/sweep.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <string>
#include <unordered_set>

#include "core/base/float_guard.hpp"
#include "core/geometry/motion_bounds.hpp"
#include "core/geometry/triangle_overlap.hpp"
#include "lacking_ahead.hpp"
#include "nearmesh/core/geometry/detail/box_overlap.hpp"
#include "sweep_from.hpp"
#include "walk.hpp"

namespace nearmesh {
namespace {

using Kind = TreeEntry::Kind;
using Vec3 = std::array<double, 3>;

constexpr double kNever = std::numeric_limits<double>::infinity();
constexpr double kMinDuration_s = 1e-9;
constexpr double kMaxDuration_s = 1e9;
constexpr double kRoundUp = 1 + 0x1p-40;
constexpr double kStretch = 1.0001;
/// Of what is looked for ahead: sixty-four steps.
constexpr int kAheadLevels = 6;
/// An obstacle may move by so much of the node that it is near to: more instants would be more obstacles.
constexpr double kSmallWay = 1.0 / 8;

/// One of the two, with what does not change on the way.
struct Mover {
  const TreeView& tree;
  const Motion& motion;
  std::string_view name;
  double turn_rate;  ///< |w|
};

[[nodiscard]] QueryOptions first_contact(const SweepOptions& options) {
  return {.any = true, .clearance = Clearance::kNone, .max_tests = options.max_tests};
}

/// An unresolved node, and the start of the first interval in which it might touch.
struct Missing {
  NodeSpan node;
  double since_s;
};

[[nodiscard]] std::uint64_t key_of(const TreeEntry& unresolved) {
  const NodeSpan node = unresolved.unresolved_node();
  return std::uint64_t{node.begin()} << 32 | node.size;
}

/// A node as an entry, whether or not it is in the tree.
[[nodiscard]] TreeEntry unresolved_entry(const TreeView& tree, NodeSpan node) {
  TreeEntry entry;
  entry.box = tree.store->box(node);
  entry.set(Kind::kUnresolved, node.begin(), node.size);
  return entry;
}

class SweptQuery {
 public:
  SweptQuery(const Mover& a, const Mover& b, const SweepOptions& options, double margin_m = 0)
      : a_(a),
        b_(b),
        options_(options),
        lattice_(lattice_exponent(*a.tree.grid, *b.tree.grid)),
        last_instant_(std::uint64_t{1} << (options.time_levels + 1)),
        instant_share_(1.0 / static_cast<double>(last_instant_)),
        error_m_(error_of(a) + error_of(b) + margin_m),
        cell_a_m_(std::ldexp(1.0, a.tree.grid->exponent)),
        cell_b_m_(std::ldexp(1.0, b.tree.grid->exponent)),
        views_(static_cast<std::size_t>(options.time_levels) + 1),
        mids_(views_.size()) {
    for (std::size_t k = 0; k < 3; ++k)
      velocity_[k] = b.motion.linear_velocity_mps[k] - a.motion.linear_velocity_mps[k];
  }

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

  /// What of b's a part of a's may meet, at any instant.
  Obstacles obstacles(const TreeEntry& part, std::size_t most) {
    Obstacles found;
    most_obstacles_ = most;
    obstacles_ = &found;
    seeks_contact_ = false;
    advance(0, 0, {{part, b_.tree.root()}});
    found.is_all = !answer_.exhausted;
    found.tests = answer_.stats.box_tests + answer_.stats.triangle_tests;
    return found;
  }

 private:
  struct Pair {
    TreeEntry a, b;
  };
  /// Both frames at an instant.
  struct Posed {
    std::uint64_t instant = ~std::uint64_t{0};
    PosedFrame a, b;
  };
  /// An interval, and the drift about its middle without the turns.
  struct View {
    int level;
    std::uint64_t first, middle;  ///< instants
    double start_s, half_s;
    RelativeFrame b_in_a, a_in_b;
    Vec3 along_a, along_b;  ///< the way of half the interval, in each one's grid units
    double along_m;
    const RelativeFrame* kept;  ///< b_in_a, where an obstacle refers to it
  };

  [[nodiscard]] double error_of(const Mover& x) const {
    const double reach = reach_m(*x.tree.grid, x.tree.root().box);
    return placing_error_m(x.motion, reach, options_.duration_s) +
           posing_error_m(x.motion, reach, options_.duration_s, *x.tree.grid, lattice_);
  }

  /// Tests the last instant, and as long as there is contact, the middle of what is before: nothing later matters then.
  /// The level of which the first interval is left to look at.
  int level_of_first_contact() {
    int level = 0;
    for (std::uint64_t instant = last_instant_; instant > 1 && touches_at(instant); instant /= 2) {
      answer_.hit_s = seconds(instant);
      if (instant < last_instant_) ++level;
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

  [[nodiscard]] double seconds(std::uint64_t instant) const {
    return options_.duration_s * (static_cast<double>(instant) * instant_share_);
  }

  /// Everything that starts in the interval `index` of 2^level, for the pairs given.
  void advance(int level, std::uint64_t index, const std::vector<Pair>& pairs) {
    const std::uint64_t length = last_instant_ >> level;
    if (is_over(seconds(index * length))) return;
    View& view = views_[static_cast<std::size_t>(level)];
    set_view(view, level, index * length, length);
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
    if (answer_.stats.box_tests + answer_.stats.triangle_tests < options_.max_tests) return false;
    answer_.exhausted = true;
    undecided_s_ = std::min(undecided_s_, start_s);
    return true;
  }

  void set_view(View& view, int level, std::uint64_t first, std::uint64_t length) const {
    view.level = level;
    view.kept = nullptr;
    view.first = first;
    view.middle = first + length / 2;
    view.start_s = seconds(first);
    view.half_s = seconds(length / 2) + 0x1p-51 * options_.duration_s;
    const Pose pose_a = pose_at(a_.motion, seconds(view.middle));
    const Pose pose_b = pose_at(b_.motion, seconds(view.middle));
    const Grid &grid_a = *a_.tree.grid, &grid_b = *b_.tree.grid;
    view.b_in_a = make_relative_frame(grid_a, pose_a, grid_b, pose_b);
    Vec3 along;
    for (std::size_t k = 0; k < 3; ++k) along[k] = velocity_[k] * view.half_s;
    view.along_a = to_grid_units(grid_a, pose_a, along);
    view.along_m = length_bound(along);
    view.a_in_b = make_relative_frame(grid_b, pose_b, grid_a, pose_a);
    view.along_b = to_grid_units(grid_b, pose_b, along);
  }

  [[nodiscard]] bool is_finest(const View& view) const {
    return view.level == options_.time_levels;
  }

  void visit(const Pair& pair, View& view, std::vector<Pair>& left) {
    const TreeEntry &na = pair.a, &nb = pair.b;
    const Kind ka = na.kind(), kb = nb.kind();
    if (ka == Kind::kEmpty || kb == Kind::kEmpty) return;
    if (!seeks_contact_ && !na.is_coarse() && !nb.is_coarse()) return;
    // Known to be missing since an earlier start, or the same.
    if (ka == Kind::kUnresolved && known_a_.contains(key_of(na))) return open_a(pair);
    if (kb == Kind::kUnresolved && known_b_.contains(key_of(nb))) return open_b(pair);
    const double around_m = around(na, nb, view);
    const CenteredBox box_a = centered(na.box), box_b = centered(nb.box);
    ++answer_.stats.box_tests;
    const Drift drift = in_units(view.b_in_a, view.along_a, around_m);
    if (boxes_stay_apart(view.b_in_a, drift, box_a, box_b)) return;
    if (ka == Kind::kUnresolved && has_half_spaces(a_.tree, na) &&
        stays_behind(view.b_in_a, drift, a_.tree, na, box_b))
      return;
    if (kb == Kind::kUnresolved && has_half_spaces(b_.tree, nb) &&
        stays_behind(view.a_in_b, in_units(view.a_in_b, view.along_b, around_m), b_.tree, nb,
                     box_a))
      return;
    // Faces are often much smaller than their boxes.
    if (ka == Kind::kFaces && kb != Kind::kFaces &&
        stays_clear(view.a_in_b, in_units(view.a_in_b, view.along_b, around_m), b_.tree, nb,
                    a_.tree, na))
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
      left.push_back(pair);
    } else if (opens_a) {
      a_.tree.for_each_child(na, [&](const TreeEntry& child) { stack_.push_back({child, nb}); });
    } else if (inner_b) {
      b_.tree.for_each_child(nb, [&](const TreeEntry& child) { stack_.push_back({na, child}); });
    } else if (ka == Kind::kFaces && kb == Kind::kFaces) {
      if (seeks_contact_ && !faces_stay_apart(na, nb, view, drift)) {
        if (!finest) {
          left.push_back(pair);
        } else {
          undecided_s_ = std::min(undecided_s_, view.start_s);
        }
      }
    } else if (obstacles_ != nullptr && (finest || way_m - error_m_ <= kSmallWay * size_a)) {
      add_obstacles(na, nb, view, drift);
    } else if (!finest) {
      left.push_back(pair);
    } else if (ka == Kind::kUnresolved && (kb != Kind::kUnresolved || size_a >= size_b)) {
      // The larger of two is the one to split next; ties go to a.
      add_missing(na, view, known_a_, missing_a_);
      open_a(pair);
    } else {
      add_missing(nb, view, known_b_, missing_b_);
      open_b(pair);
    }
  }

  /// Goes on with the parts of an unresolved node instead of the node, where they can be known.
  void open_a(const Pair& pair) {
    open(a_.tree, *require_a_, pair.a, [&](const TreeEntry& part) {
      stack_.push_back({part, pair.b});
    });
  }
  void open_b(const Pair& pair) {
    open(b_.tree, *require_b_, pair.b, [&](const TreeEntry& part) {
      stack_.push_back({pair.a, part});
    });
  }
  template <class Push>
  void open(const TreeView& tree, const Require& require, const TreeEntry& entry,
            const Push& push) {
    if (!require) return;
    const NodeSpan node = entry.unresolved_node();
    if (const Status known = require(node); !known.is_ok()) {
      status_ = known;
      return;
    }
    const VertexId split = tree.store->split_of(node);
    for (const NodeSpan part : {node.right_of(split), node.left_of(split)})
      if (part.size > 1) push(unresolved_entry(tree, part));
  }

  /// `around` of the bound, metres.
  [[nodiscard]] double around(const TreeEntry& na, const TreeEntry& nb, const View& view) const {
    double turned = 0;
    if (a_.turn_rate > 0) turned += a_.turn_rate * reach_m(*a_.tree.grid, na.box);
    if (b_.turn_rate > 0) turned += b_.turn_rate * reach_m(*b_.tree.grid, nb.box);
    // Last: the velocities' difference and its way were rounded.
    return (view.half_s * turned * kStretch + error_m_ + 0x1p-40 * view.along_m) * kRoundUp;
  }

  static Drift in_units(const RelativeFrame& f, const Vec3& along, double around_m) {
    return {along, around_m / f.least_metres_per_unit * kRoundUp};
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
    const auto pose = [&](const Mover& x, PosedFrame& frame) {
      const Result<PosedFrame> made =
          make_posed_frame(*x.tree.grid, pose_at(x.motion, seconds(instant)), lattice_);
      if (made.is_ok()) {
        frame = made.value();
      } else {
        status_ = {made.status().code(), std::string(x.name) + ": " + made.status().message()};
      }
    };
    pose(a_, posed.a);
    pose(b_, posed.b);
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
    const CenteredBox box = centered(part.box);
    const bool has_planes = part.kind() == Kind::kUnresolved && has_half_spaces(own, part);
    bool clear = true;
    other.for_each_face(faces, [&](const TreeFace& face) {
      if (!clear) return;
      ++answer_.stats.box_tests;
      const DoubleTriangle corners = to_a_units(other_in_own, face.corners);
      clear = box_triangle_stay_apart(other_in_own, drift, box, corners) ||
              (has_planes && half_spaces_part(own, part, [&](const BoundedPart& bounded) {
                 return half_space_triangle_stay_apart(other_in_own, drift, bounded, corners);
               }));
    });
    return clear;
  }

  void add_obstacles(const TreeEntry& part, const TreeEntry& other, View& view,
                     const Drift& drift) {
    if (view.kept == nullptr) view.kept = &obstacles_->frames.emplace_back(view.b_in_a);
    if (other.kind() == Kind::kUnresolved) {
      obstacles_->obstacles.push_back({view.kept, std::nullopt, centered(other.box), drift});
    } else {
      const CenteredBox box = centered(part.box);
      b_.tree.for_each_face(other, [&](const TreeFace& face) {
        ++answer_.stats.box_tests;
        const DoubleTriangle corners = to_a_units(view.b_in_a, face.corners);
        if (!box_triangle_stay_apart(view.b_in_a, drift, box, corners))
          obstacles_->obstacles.push_back({view.kept, corners, {}, drift});
      });
    }
    if (obstacles_->obstacles.size() > most_obstacles_) answer_.exhausted = true;
  }

  static void add_missing(const TreeEntry& node, const View& view,
                          std::unordered_set<std::uint64_t>& known, std::vector<Missing>& missing) {
    known.insert(key_of(node));
    missing.push_back({node.unresolved_node(), view.start_s});
  }

  void finish() {
    const auto list = [this](const std::vector<Missing>& missing, std::vector<NodeSpan>& out) {
      for (const Missing& m : missing) {
        if (m.since_s >= answer_.hit_s) continue;
        undecided_s_ = std::min(undecided_s_, m.since_s);
        out.push_back(m.node);
      }
      std::sort(out.begin(), out.end());
    };
    list(missing_a_, answer_.missing_a);
    list(missing_b_, answer_.missing_b);
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
  const SweepOptions options_;
  const int lattice_;
  const std::uint64_t last_instant_;
  const double instant_share_;  ///< of the duration
  const double error_m_;        ///< placing and posing, of both; and what is wanted around
  const double cell_a_m_, cell_b_m_;
  Vec3 velocity_{};  ///< of b against a

  std::vector<View> views_;  ///< one a level
  std::vector<Posed> mids_;
  Posed start_;
  std::vector<Pair> stack_;
  std::unordered_set<std::uint64_t> known_a_, known_b_;  // missing nodes; membership only
  std::vector<Missing> missing_a_, missing_b_;
  bool seeks_contact_ = true;
  const Require nothing_;
  const Require *require_a_ = &nothing_, *require_b_ = &nothing_;
  Obstacles* obstacles_ = nullptr;  ///< what is looked for, if not null
  std::size_t most_obstacles_ = 0;
  double undecided_s_ = kNever;  ///< start of the first interval that could not be settled
  Status status_;
  SweptAnswer answer_;
};

Status check_way(const Mover& x, double duration_s) {
  NEARMESH_RETURN_IF_ERROR(check_motion(x.motion, x.name));
  if (!(x.turn_rate * duration_s <= kMaxTurnRad))
    return {StatusCode::kInvalidArgument,
            "motion of " + std::string(x.name) + ": turns by more than 2^20 radians on the way"};
  Pose end = x.motion.pose;
  end.translation_m = pose_at(x.motion, duration_s).translation_m;
  return check_pose(end, x.name);
}

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
                               std::string_view name_b, const SweepOptions& options) {
  NEARMESH_ASSERT(options.time_levels >= 0 && options.time_levels <= kMaxTimeLevels);
  if (!(options.duration_s >= kMinDuration_s && options.duration_s <= kMaxDuration_s))
    return Status{StatusCode::kInvalidArgument,
                  "a sweep's duration must lie between 1e-9 and 1e9 seconds"};
  const Mover mover_a{a, motion_a, name_a, length_bound(motion_a.angular_velocity_radps)};
  const Mover mover_b{b, motion_b, name_b, length_bound(motion_b.angular_velocity_radps)};
  NEARMESH_RETURN_IF_ERROR(check_way(mover_a, options.duration_s));
  NEARMESH_RETURN_IF_ERROR(check_way(mover_b, options.duration_s));

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
  return SweptQuery(mover_a, mover_b, options).run();
}

namespace {

/// What looks ahead along two motions: `look`, given a SweptQuery. Errors: those of the motions.
template <class Found, class Look>
Result<Found> look_ahead(const TreeView& a, const Motion& motion_a, std::string_view name_a,
                         const TreeView& b, const Motion& motion_b, std::string_view name_b,
                         double duration_s, double margin_m, std::uint64_t max_tests,
                         const Look& look) {
  const FloatGuard guard;
  const bool is_still =
      duration_s < kMinDuration_s || (is_at_rest(motion_a) && is_at_rest(motion_b));
  const SweepOptions options{.duration_s = is_still ? kMinDuration_s : duration_s,
                             .time_levels = is_still ? 0 : kAheadLevels,
                             .max_tests = max_tests};
  Motion now_a = motion_a, now_b = motion_b;
  if (is_still)
    for (Motion* motion : {&now_a, &now_b}) *motion = {.pose = motion->pose};
  const Mover mover_a{a, now_a, name_a, length_bound(now_a.angular_velocity_radps)};
  const Mover mover_b{b, now_b, name_b, length_bound(now_b.angular_velocity_radps)};
  NEARMESH_RETURN_IF_ERROR(check_way(mover_a, options.duration_s));
  NEARMESH_RETURN_IF_ERROR(check_way(mover_b, options.duration_s));
  SweptQuery query(mover_a, mover_b, options, margin_m);
  return look(query);
}

}  // namespace

Result<Lacking> lacking_ahead(const TreeView& a, const Motion& motion_a, std::string_view name_a,
                              const TreeView& b, const Motion& motion_b, std::string_view name_b,
                              double duration_s, double margin_m, const Require& require_a,
                              const Require& require_b, std::uint64_t max_tests) {
  return look_ahead<Lacking>(
      a, motion_a, name_a, b, motion_b, name_b, duration_s, margin_m, max_tests,
      [&](SweptQuery& query) { return query.lacking(require_a, require_b); });
}

Result<Obstacles> obstacles_ahead(const TreeView& a, const Motion& motion_a,
                                  std::string_view name_a, NodeSpan node, const TreeView& b,
                                  const Motion& motion_b, std::string_view name_b,
                                  double duration_s, double margin_m, std::size_t most) {
  const TreeEntry part = unresolved_entry(a, node);
  TreeView bare = a;
  bare.half_spaces = nullptr;  // of a smaller node that has the same first vertex, perhaps
  return look_ahead<Obstacles>(bare, motion_a, name_a, b, motion_b, name_b, duration_s, margin_m,
                               kLookTests,
                               [&](SweptQuery& query) { return query.obstacles(part, most); });
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
