// SPDX-License-Identifier: Apache-2.0
#include "choose_half_spaces.hpp"

#include <algorithm>
#include <cmath>

#include "core/base/float_guard.hpp"
#include "core/geometry/vec3.hpp"
#include "walk.hpp"

namespace nearmesh {
namespace {

/// The corners of an obstacle, in own units. The drift is left out: what is chosen is tested with
/// it.
void add_corners(const Obstacle& obstacle, std::vector<Vec3>& to) {
  if (obstacle.face) {
    to.insert(to.end(), obstacle.face->begin(), obstacle.face->end());
    return;
  }
  const RelativeFrame& f = *obstacle.other_in_own;
  for (unsigned corner = 0; corner < 8; ++corner) {
    Vec3 p = obstacle.box.center, at = f.translation;
    for (std::size_t j = 0; j < 3; ++j)
      p[j] += (corner >> j & 1U) != 0 ? obstacle.box.half[j] : -obstacle.box.half[j];
    for (std::size_t k = 0; k < 3; ++k)
      at[k] +=
          f.rotation[3 * k] * p[0] + f.rotation[3 * k + 1] * p[1] + f.rotation[3 * k + 2] * p[2];
    to.push_back(at);
  }
}

/// The first of those that are farthest along d. Precondition: there is one.
const Vec3& farthest(const std::vector<Vec3>& points, const Vec3& d) {
  std::size_t found = 0;
  double most = dot(d, points[0]);
  for (std::size_t i = 1; i < points.size(); ++i) {
    const double along = dot(d, points[i]);
    if (along <= most) continue;
    most = along;
    found = i;
  }
  return points[found];
}

class Chooser {
 public:
  Chooser(std::span<const GridPoint> points, const GridPoint& from,
          std::optional<std::uint16_t> hint)
      : points_(points), from_(from) {
    if (hint) {
      const std::array<std::int8_t, 3>& normal = half_space_normal(*hint);
      for (std::size_t k = 0; k < 3; ++k) first_way_[k] = normal[k];
    }
    corners_.reserve(points.size());
    for (const GridPoint& p : points)
      corners_.push_back(
          {static_cast<double>(p[0]), static_cast<double>(p[1]), static_cast<double>(p[2])});
  }

  /// The half-space that parts most of these obstacles from the points, among those that look about
  /// from the points to their hull; nothing where none parts any.
  std::optional<HalfSpace> choose(std::span<const Obstacle* const> obstacles) const {
    const std::optional<Vec3> direction = direction_to(obstacles);
    if (!direction) return std::nullopt;
    std::optional<HalfSpace> best;
    std::size_t most = 0;
    const int code = nearest_direction(*direction);
    // Rounded to a code the direction may just miss: the codes around it are tried as well.
    for (const int column : {0, -64, 64})
      for (const int row : {0, -1, 1}) {
        const int next = code + column + row;
        if (next < 0 || next >= 1 << kDirectionBits) continue;
        const std::optional<HalfSpace> found = tightest(static_cast<std::uint16_t>(next));
        if (!found) continue;
        const auto parted = static_cast<std::size_t>(std::count_if(
            obstacles.begin(), obstacles.end(),
            [&](const Obstacle* obstacle) { return keeps_clear(*found, from_, *obstacle); }));
        if (parted <= most) continue;
        most = parted;
        best = found;
        if (most == obstacles.size()) return best;
      }
    return best;
  }

  /// The obstacle nearest to the points' middle, about.
  const Obstacle* nearest(std::span<const Obstacle* const> obstacles) const {
    Vec3 middle{};
    for (const Vec3& p : corners_)
      for (std::size_t k = 0; k < 3; ++k) middle[k] += p[k] / static_cast<double>(corners_.size());
    std::vector<Vec3> corners;
    const auto square_to = [&](const Obstacle* obstacle) {
      corners.clear();
      add_corners(*obstacle, corners);
      double square = 0;
      for (std::size_t k = 0; k < 3; ++k) {
        const auto [lo, hi] =
            std::minmax_element(corners.begin(), corners.end(),
                                [k](const Vec3& x, const Vec3& y) { return x[k] < y[k]; });
        const double way = 0.5 * ((*lo)[k] + (*hi)[k]) - middle[k];
        square += way * way;
      }
      return square;
    };
    const Obstacle* found = nullptr;
    double least = 0;
    for (const Obstacle* obstacle : obstacles) {
      const double square = square_to(obstacle);
      if (found != nullptr && square >= least) continue;
      found = obstacle;
      least = square;
    }
    return found;
  }

 private:
  std::optional<HalfSpace> tightest(std::uint16_t direction) const {
    return tightest_half_space(points_, from_, direction);
  }

  // w is a point of the difference {points} - {obstacles}, ever nearer to the origin. Where all of
  // it lies beyond a plane across w, this plane's normal parts the two. Some more steps turn the
  // plane towards the widest gap.
  std::optional<Vec3> direction_to(std::span<const Obstacle* const> obstacles) const {
    constexpr int kSteps = 32, kMore = 6;
    std::vector<Vec3> there;
    double least_around = obstacles.front()->drift.around;
    for (const Obstacle* obstacle : obstacles) {
      add_corners(*obstacle, there);
      least_around = std::min(least_around, obstacle->drift.around);
    }
    const auto corner = [&](const Vec3& d) {
      const Vec3 &p = farthest(corners_, d), &q = farthest(there, {-d[0], -d[1], -d[2]});
      return Vec3{p[0] - q[0], p[1] - q[1], p[2] - q[2]};
    };
    Vec3 w = corner(first_way_);
    std::optional<Vec3> found;
    double widest = 0;
    for (int step = 0, more = 0; step < kSteps && more < kMore; ++step) {
      const double square = dot(w, w);
      // The hulls share a point, or are nearer than the obstacles may move.
      if (!(square > least_around * least_around)) return std::nullopt;
      const double length = std::sqrt(square);
      const Vec3 d{-w[0] / length, -w[1] / length, -w[2] / length};
      const Vec3 s = corner(d);
      const double gap = -dot(d, s);
      if (gap > widest) {
        widest = gap;
        found = d;
      }
      more += found ? 1 : 0;
      const Vec3 e{s[0] - w[0], s[1] - w[1], s[2] - w[2]};
      const double along = dot(e, e);
      if (!(along > 0)) break;
      const double t = std::clamp(-dot(w, e) / along, 0.0, 1.0);
      if (t == 0) break;
      for (std::size_t k = 0; k < 3; ++k) w[k] += t * e[k];
    }
    return found;
  }

  std::span<const GridPoint> points_;
  const GridPoint from_;
  Vec3 first_way_{1, 0, 0};
  std::vector<Vec3> corners_;  // the points
};

}  // namespace

bool keeps_clear(const HalfSpace& half_space, const GridPoint& from, const Obstacle& obstacle) {
  const BoundedPart part = bounded_part(half_space, from);
  const RelativeFrame& f = *obstacle.other_in_own;
  return obstacle.face ? half_space_triangle_stay_apart(f, obstacle.drift, part, *obstacle.face)
                       : half_space_box_stay_apart(f, obstacle.drift, part, obstacle.box);
}

std::optional<HalfSpace> tightest_half_space(std::span<const GridPoint> points,
                                             const GridPoint& from, std::uint16_t direction) {
  std::int64_t reach = 0;
  for (const GridPoint& p : points)
    reach = std::max(reach, way_along(half_space_normal(direction), from, p));
  const std::optional<std::uint8_t> code = half_space_reach_code(reach);
  return code ? std::optional(HalfSpace{direction, *code}) : std::nullopt;
}

ChosenHalfSpaces choose_half_spaces(std::span<const GridPoint> points, const GridPoint& from,
                                    std::span<const Obstacle> obstacles, std::size_t most,
                                    std::optional<std::uint16_t> hint) {
  const FloatGuard guard;
  ChosenHalfSpaces chosen;
  std::vector<const Obstacle*> left;
  for (const Obstacle& obstacle : obstacles) left.push_back(&obstacle);
  if (points.empty()) return {{}, left.size()};
  const Chooser chooser(points, from, hint);
  while (!left.empty() && chosen.half_spaces.size() < most) {
    std::optional<HalfSpace> next = chooser.choose(left);
    // No plane for all of them: one for the nearest, which may part others.
    if (!next) {
      const Obstacle* const nearest = chooser.nearest(left);
      next = chooser.choose({&nearest, 1});
    }
    if (!next) break;
    chosen.half_spaces.push_back(*next);
    std::erase_if(left,
                  [&](const Obstacle* obstacle) { return keeps_clear(*next, from, *obstacle); });
  }
  chosen.left = left.size();
  std::sort(chosen.half_spaces.begin(), chosen.half_spaces.end());
  return chosen;
}

}  // namespace nearmesh
