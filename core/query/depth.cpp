// SPDX-License-Identifier: Apache-2.0
// Depth along a direction, in steps of a lattice cell. By k steps B moves by k times the direction,
// rounded to whole cells, so its posed mesh moves as it is, and faces may be tested exactly at any
// step. Far from the origin the doubles of B's translation are farther apart than cells: there a
// step is of as many cells as they are, and B moves by whole steps along each axis, or a query
// would be asked about another place than the step's.
//
// From below. Faces f and g are convex, so {w : f and g + w touch} is convex: touching at steps j
// and k they touch all along the straight way between, which is within a cell of the line. The
// search holds a pair that touches at the step it has reached, goes as far as that one touches,
// asks what touches one step further, and takes of these pairs one that touches at the step before,
// too. Where there is none, or what is there is not exact, it ends.
// From above. Further steps, four times as far each time, until B is certified free; then halves of
// what is between.
#include "nearmesh/core/query/depth.hpp"

#include <algorithm>
#include <cmath>
#include <string>

#include "core/base/float_guard.hpp"
#include "core/geometry/triangle_overlap.hpp"
#include "core/geometry/vec3.hpp"
#include "touching_faces.hpp"

namespace nearmesh {
namespace {

using Step = std::int64_t;

constexpr Step kNoStep = -1;
constexpr std::size_t kMostPatches = 4;
/// Of more pairs that touch at a step so many are looked at.
constexpr std::size_t kMostPairs = 128;
/// What cells_until_apart() counts for, in tests.
constexpr std::uint64_t kTestsAGuess = 32;
/// A query is given at least so many, which is enough where boxes are apart: so some place is found
/// that is free.
constexpr std::uint64_t kLeastTests = 4096;
/// The bracket is narrowed until what is left open is this share of it.
constexpr Step kNarrow = 256;

/// Zero where v has no direction, or is not finite.
Vec3 unit(Vec3 v) {
  const double greatest = std::max({std::abs(v[0]), std::abs(v[1]), std::abs(v[2])});
  if (!(greatest > 0 && std::isfinite(greatest) && std::isfinite(dot(v, v) / greatest))) return {};
  for (double& x : v) x /= greatest;
  const double length = std::sqrt(dot(v, v));
  for (double& x : v) x /= length;
  return v;
}

/// About how many cells b can go along n and still touch a: each axis along which triangles can be
/// apart is tried. A guess, in doubles.
double cells_until_apart(const LatticeTriangle& a, const LatticeTriangle& b, const Vec3& n) {
  std::array<Vec3, 3> x, y;
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t k = 0; k < 3; ++k) {
      x[i][k] = static_cast<double>(a[i].v[k] - a[0].v[k]);
      y[i][k] = static_cast<double>(b[i].v[k] - a[0].v[k]);
    }
  double least = std::numeric_limits<double>::infinity();
  const auto look_along = [&](const Vec3& axis) {
    const double speed = dot(axis, n);
    if (speed == 0) return;
    const double sign = speed > 0 ? 1 : -1;
    double a_end = sign * dot(axis, x[0]), b_start = sign * dot(axis, y[0]);
    for (std::size_t i = 1; i < 3; ++i) {
      a_end = std::max(a_end, sign * dot(axis, x[i]));
      b_start = std::min(b_start, sign * dot(axis, y[i]));
    }
    least = std::min(least, (a_end - b_start) / std::abs(speed));
  };
  std::array<Vec3, 3> edges_a, edges_b;
  for (std::size_t i = 0; i < 3; ++i) {
    edges_a[i] = minus(x[(i + 1) % 3], x[i]);
    edges_b[i] = minus(y[(i + 1) % 3], y[i]);
  }
  look_along(cross(edges_a[0], edges_a[1]));
  look_along(cross(edges_b[0], edges_b[1]));
  for (const Vec3& u : edges_a)
    for (const Vec3& v : edges_b) look_along(cross(u, v));
  return std::max(least, 0.0);
}

/// Two bodies where they touch.
struct Touching {
  const TreeView& a;
  const Pose& pose_a;
  std::string_view name_a;
  const TreeView& b;
  const Pose& pose_b;
  std::string_view name_b;
  PosedPair posed;
  Step cells_a_step;
};

/// As many as a double tells apart at B's translation and wherever a search takes it: bodies that
/// touch are apart after a way of their sizes.
Step cells_a_step(const PosedPair& posed, const GridBox& box_a, const GridBox& box_b,
                  const Pose& pose_b) {
  double farthest = 0, sizes = 0;
  const LatticeBox a = pose_box(posed.a, box_a), b = pose_box(posed.b, box_b);
  for (int k = 0; k < 3; ++k) {
    farthest =
        std::max(farthest, std::abs(std::ldexp(pose_b.translation_m[static_cast<std::size_t>(k)],
                                               -posed.b.lattice_exp)));
    sizes += static_cast<double>((a.hi[k] - a.lo[k]) + (b.hi[k] - b.lo[k]));
  }
  int bits = 0;
  static_cast<void>(std::frexp(farthest + 3 * sizes + 16, &bits));
  return Step{1} << std::max(0, bits - std::numeric_limits<double>::digits);
}

/// One direction.
class WayOut {
 public:
  WayOut(const Touching& bodies, const Vec3& direction, const DepthOptions& options,
         std::uint64_t max_tests)
      : t_(bodies),
        direction_(direction),
        options_(options),
        max_tests_(max_tests),
        farthest_(farthest_step()) {}

  /// In: pairs that touch where B is. Ends early where the depth is at least `of_no_use`.
  void run(const std::vector<FacePair>& pairs, Step of_no_use) {
    climb(pairs, of_no_use);
    if (free_ == kNoStep && reached_ < of_no_use) rise();
    if (free_ != kNoStep) narrow();
  }

  [[nodiscard]] Step reached() const { return reached_; }  ///< touches until here
  [[nodiscard]] Step free() const { return free_; }  ///< is certified free here; kNoStep: not found
  [[nodiscard]] bool has_spent() const { return has_spent_; }
  [[nodiscard]] std::array<Step, 3> cells(Step step) const {
    std::array<Step, 3> out;
    for (std::size_t k = 0; k < 3; ++k)
      out[k] = static_cast<Step>(std::floor(static_cast<double>(step) * direction_[k] + 0.5)) *
               t_.cells_a_step;
    return out;
  }
  [[nodiscard]] double length_m(Step step) const {
    return std::ldexp(static_cast<double>(step * t_.cells_a_step), t_.posed.b.lattice_exp);
  }
  [[nodiscard]] const Answer& undecided() const { return undecided_; }
  [[nodiscard]] const QueryStats& stats() const { return stats_; }
  [[nodiscard]] bool is_over() const { return is_time_over(options_.is_over); }
  [[nodiscard]] std::uint64_t spent() const { return tests_of(stats_) + kTestsAGuess * guesses_; }

 private:
  /// Beyond it the bodies' boxes are apart, along an axis that a query tries: one of them is within
  /// 55 degrees of the direction.
  [[nodiscard]] Step farthest_step() const {
    const LatticeBox box_a = pose_box(t_.posed.a, t_.a.root().box),
                     box_b = pose_box(t_.posed.b, t_.b.root().box);
    double way = 0, sizes = 0;
    for (int k = 0; k < 3; ++k) {
      const double n = direction_[static_cast<std::size_t>(k)];
      way += n * static_cast<double>(n > 0 ? box_a.hi[k] - box_b.lo[k] : box_a.lo[k] - box_b.hi[k]);
      sizes += static_cast<double>((box_a.hi[k] - box_a.lo[k]) + (box_b.hi[k] - box_b.lo[k]));
    }
    const Step cells = static_cast<Step>(std::max(way, 0.0) + 2 * sizes) + 16;
    return (cells + t_.cells_a_step - 1) / t_.cells_a_step;
  }

  /// What touches after so many steps; nothing known where B may not be placed there, or not just
  /// there.
  Answer ask(Step step) {
    Pose moved = t_.pose_b;
    const std::array<Step, 3> way = cells(step);
    for (std::size_t k = 0; k < 3; ++k)
      moved.translation_m[k] += std::ldexp(static_cast<double>(way[k]), t_.posed.b.lattice_exp);
    const Result<PosedPair> posed =
        pose_pair(*t_.a.grid, t_.pose_a, t_.name_a, *t_.b.grid, moved, t_.name_b);
    if (!posed.is_ok()) return {};
    for (std::size_t k = 0; k < 3; ++k)
      if (posed.value().b.translation[k] - t_.posed.b.translation[k] != way[k]) return {};
    Answer answer =
        query(t_.a, posed.value().a, t_.b, posed.value().b,
              {.clearance = Clearance::kNone,
               .max_pairs = kMostPairs,
               .max_tests = std::max(max_tests_ - std::min(max_tests_, spent()), kLeastTests),
               .is_over = options_.is_over,
               .solid_a = options_.solid_a,
               .solid_b = options_.solid_b});
    stats_.box_tests += answer.stats.box_tests;
    stats_.triangle_tests += answer.stats.triangle_tests;
    stats_.exact_tests += answer.stats.exact_tests;
    if (answer.exhausted) has_spent_ = true;
    return answer;
  }

  [[nodiscard]] LatticeTriangle moved(const LatticeTriangle& face, Step step) const {
    const std::array<Step, 3> way = cells(step);
    LatticeTriangle out = face;
    for (LatticePoint& corner : out)
      for (std::size_t k = 0; k < 3; ++k) corner.v[k] += way[k];
    return out;
  }
  bool touch_at(const LatticeTriangle& a, const LatticeTriangle& b, Step step) {
    ++stats_.exact_tests;
    return triangles_overlap(a, moved(b, step));
  }

  /// Where pairs were found to touch.
  struct Found {
    TouchingFaces a, b;
    // Steps from there; place among the pairs.
    std::vector<std::pair<double, std::uint32_t>> farthest_first;
  };
  Found look_at(const std::vector<FacePair>& pairs, Step step) {
    guesses_ += pairs.size();
    Found found{collect_faces(t_.a, t_.posed.a, pairs, &FacePair::a),
                collect_faces(t_.b, t_.posed.b, pairs, &FacePair::b),
                {}};
    for (std::uint32_t i = 0; i < pairs.size(); ++i) {
      const LatticeTriangle& face_b = found.b.posed[found.b.of_pair[i]];
      found.farthest_first.emplace_back(
          -cells_until_apart(found.a.posed[found.a.of_pair[i]], moved(face_b, step), direction_) /
              static_cast<double>(t_.cells_a_step),
          i);
    }
    std::sort(found.farthest_first.begin(), found.farthest_first.end());
    return found;
  }

  /// Goes from the step reached as far as one of the pairs goes that touch there and at `step`,
  /// where they were found. False where none does.
  bool leap(const std::vector<FacePair>& pairs, Step step) {
    const Found found = look_at(pairs, step);
    for (const auto& [steps, i] : found.farthest_first) {
      const LatticeTriangle &a = found.a.posed[found.a.of_pair[i]],
                            &b = found.b.posed[found.b.of_pair[i]];
      if (!touch_at(a, b, reached_) || (step > reached_ && !touch_at(a, b, step))) continue;
      reached_ = step;
      const Step until = std::min(step + static_cast<Step>(std::min(-steps, 0x1p61)), farthest_);
      for (Step end = until; end > step && end > until - 3;
           --end)  // the guess ignores that steps are rounded
        if (touch_at(a, b, end)) {
          reached_ = end;
          break;
        }
      return true;
    }
    return false;
  }

  void climb(std::vector<FacePair> pairs, Step of_no_use) {
    Step step = 0;
    while (leap(pairs, step)) {
      if (reached_ >= of_no_use) return;
      step = reached_ + 1;
      if (spent() >= max_tests_ / 2 || is_over()) {  // the rest is for the other bound
        has_spent_ = true;
        return;
      }
      Answer there = ask(step);
      if (there.status == AnswerStatus::kFree) {
        free_ = step;
        return;
      }
      if (there.pairs.empty()) {
        note(std::move(there));
        return;
      }
      pairs = std::move(there.pairs);
    }
  }

  void note(Answer&& answer) {
    if (undecided_.missing_a.empty() && undecided_.missing_b.empty())
      undecided_ = std::move(answer);
  }

  /// Whether B is certified free after so many steps; else `blocked_` is where it is not, as far as
  /// is easily known.
  bool try_step(Step step) {
    Answer there = ask(step);
    if (there.status == AnswerStatus::kFree) {
      free_ = step;
      return true;
    }
    blocked_ = std::max(blocked_, step);
    if (there.pairs.empty()) {
      note(std::move(there));
    } else {
      const double steps = -look_at(there.pairs, step).farthest_first.front().first;
      blocked_ = std::max(
          blocked_, std::min(step + static_cast<Step>(std::min(steps, 0x1p61)), farthest_ - 1));
    }
    return false;
  }

  void rise() {
    blocked_ = reached_;
    for (Step further = 1; blocked_ < farthest_; further *= 4) {
      if (is_over()) {
        has_spent_ = true;
        return;
      }
      if (try_step(has_run_out() ? farthest_ : std::min(blocked_ + further, farthest_))) return;
    }
  }

  void narrow() {
    blocked_ = std::max(blocked_, reached_);
    while (free_ - blocked_ > 1 && free_ - blocked_ > (free_ - reached_) / kNarrow) {
      if (has_run_out()) return;
      // What touches there may reach beyond the free step, where it would stop the search: it does
      // not count then.
      const Step last = free_;
      (void)try_step(blocked_ + (free_ - blocked_) / 2);
      blocked_ = std::min(blocked_, last - 1);
    }
  }

  bool has_run_out() {
    if (spent() < max_tests_ && !is_over()) return false;
    has_spent_ = true;
    return true;
  }

  const Touching& t_;
  const Vec3 direction_;
  const DepthOptions& options_;
  const std::uint64_t max_tests_;
  const Step farthest_;
  QueryStats stats_;
  std::uint64_t guesses_ = 0;
  Step reached_ = 0, blocked_ = 0, free_ = kNoStep;
  bool has_spent_ = false;
  Answer undecided_;  // the first that was
};

std::vector<Vec3> directions_of(const Contacts& contacts) {
  std::vector<const ContactPatch*> patches;
  Vec3 mean{};
  for (const ContactPatch& patch : contacts.patches) {
    patches.push_back(&patch);
    for (std::size_t k = 0; k < 3; ++k) mean[k] += patch.length_m * patch.normal[k];
  }
  std::stable_sort(
      patches.begin(), patches.end(),
      [](const ContactPatch* x, const ContactPatch* y) { return x->length_m > y->length_m; });
  patches.resize(std::min(patches.size(), kMostPatches));
  std::vector<Vec3> directions;
  if (patches.size() > 1 && unit(mean) != Vec3{}) directions.push_back(unit(mean));
  for (const ContactPatch* patch : patches) directions.push_back(patch->normal);
  return directions;
}

/// Evenly chosen, where there are many: pairs that follow each other are near each other.
std::vector<FacePair> some_of(const std::vector<FacePair>& pairs) {
  std::vector<FacePair> some;
  const std::size_t count = std::min(pairs.size(), kMostPairs);
  for (std::size_t i = 0; i < count; ++i) some.push_back(pairs[i * pairs.size() / count]);
  return some;
}

}  // namespace

Result<Depth> find_depth(const TreeView& a, const Pose& pose_a, std::string_view name_a,
                         const TreeView& b, const Pose& pose_b, std::string_view name_b,
                         const Answer& answer, const Contacts& contacts,
                         const DepthOptions& options) {
  const FloatGuard guard;
  Result<PosedPair> posed = pose_pair(*a.grid, pose_a, name_a, *b.grid, pose_b, name_b);
  NEARMESH_RETURN_IF_ERROR(posed);
  std::vector<Vec3> directions =
      options.directions.empty() ? directions_of(contacts) : options.directions;
  for (std::size_t i = 0; i < directions.size(); ++i) {
    directions[i] = unit(directions[i]);
    if (directions[i] == Vec3{})
      return Status{
          StatusCode::kInvalidArgument,
          "direction " + std::to_string(i) + " of a depth has no length, or an infinite one"};
  }
  Depth best;
  if (answer.pairs.empty() || directions.empty()) return best;
  const Touching bodies{a,
                        pose_a,
                        name_a,
                        b,
                        pose_b,
                        name_b,
                        posed.value(),
                        cells_a_step(posed.value(), a.root().box, b.root().box, pose_b)};
  const std::vector<FacePair> pairs = some_of(answer.pairs);
  Step least_free = std::numeric_limits<Step>::max();
  std::uint64_t left = options.max_tests;
  for (std::size_t i = 0; i < directions.size(); ++i) {
    WayOut search(bodies, directions[i], options, left / (directions.size() - i));
    search.run(pairs, least_free);
    left -= std::min(left, search.spent());
    best.exhausted = best.exhausted || search.has_spent();
    best.stats.box_tests += search.stats().box_tests;
    best.stats.triangle_tests += search.stats().triangle_tests;
    best.stats.exact_tests += search.stats().exact_tests;
    const bool is_better = search.free() != kNoStep && search.free() < least_free;
    if (!is_better && i > 0) continue;
    best.direction = directions[i];
    best.at_least_m = search.length_m(search.reached());
    best.missing_a = search.undecided().missing_a;
    best.missing_b = search.undecided().missing_b;
    if (!is_better) continue;
    least_free = search.free();
    best.at_most_m = search.length_m(least_free);
    const std::array<Step, 3> way = search.cells(least_free);
    for (std::size_t k = 0; k < 3; ++k)
      best.separation_m[k] = std::ldexp(static_cast<double>(way[k]), bodies.posed.b.lattice_exp);
  }
  return best;
}

Result<Depth> certify_depth(LocalModel& a, const Pose& pose_a, const Require& require_a,
                            LocalModel& b, const Pose& pose_b, const Require& require_b,
                            const Answer& answer, const Contacts& contacts,
                            const DepthOptions& options) {
  const FloatGuard guard;
  while (true) {
    Result<Depth> depth =
        find_depth(a.view(), pose_a, "a", b.view(), pose_b, "b", answer, contacts, options);
    if (!depth.is_ok() || depth.value().exhausted ||
        (depth.value().missing_a.empty() && depth.value().missing_b.empty()))
      return depth;
    NEARMESH_RETURN_IF_ERROR(split_missing(a, depth.value().missing_a, require_a));
    NEARMESH_RETURN_IF_ERROR(split_missing(b, depth.value().missing_b, require_b));
  }
}

}  // namespace nearmesh
