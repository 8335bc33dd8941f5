// SPDX-License-Identifier: Apache-2.0
#include "polygon.hpp"

#include <cmath>
#include <numeric>
#include <string>

namespace nearmesh::meshio {
namespace {

using Point = std::array<double, 2>;

/// The polygon seen along the axis nearest to its normal, turning left as a whole.
std::vector<Point> flatten(std::span<const std::uint32_t> corners, const IndexedMesh& mesh) {
  const auto& origin = mesh.positions_m[corners[0]];
  const auto offset = [&](std::size_t i, std::size_t axis) {
    return mesh.positions_m[corners[i % corners.size()]][axis] - origin[axis];
  };
  std::array<double, 3> normal{};  // Newell's
  for (std::size_t i = 0; i < corners.size(); ++i)
    for (std::size_t k = 0; k < 3; ++k) {
      const std::size_t u = (k + 1) % 3, v = (k + 2) % 3;
      normal[k] += (offset(i, u) - offset(i + 1, u)) * (offset(i, v) + offset(i + 1, v));
    }
  std::size_t axis = 0;
  for (std::size_t k = 1; k < 3; ++k)
    if (std::fabs(normal[k]) > std::fabs(normal[axis])) axis = k;
  std::size_t u = (axis + 1) % 3, v = (axis + 2) % 3;
  if (normal[axis] < 0) std::swap(u, v);
  std::vector<Point> points(corners.size());
  for (std::size_t i = 0; i < corners.size(); ++i) points[i] = {offset(i, u), offset(i, v)};
  return points;
}

/// Positive where a, b, c turn left.
double turn(const Point& a, const Point& b, const Point& c) {
  return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
}

bool is_convex(const std::vector<Point>& points) {
  const std::size_t n = points.size();
  for (std::size_t i = 0; i < n; ++i)
    if (turn(points[i], points[(i + 1) % n], points[(i + 2) % n]) < 0) return false;
  return true;
}

class EarCutter {
 public:
  EarCutter(std::span<const std::uint32_t> corners, std::vector<Point> points, IndexedMesh& mesh)
      : corners_(corners), points_(std::move(points)), mesh_(mesh), left_(corners.size()) {
    std::iota(left_.begin(), left_.end(), std::size_t{0});
  }

  void cut_all() {
    std::size_t at = 0, failures = 0;
    while (left_.size() > 3 && failures < left_.size()) {
      if (is_ear(at)) {
        emit(around(at, -1), around(at, 0), around(at, 1));
        left_.erase(left_.begin() + static_cast<std::ptrdiff_t>(at));
        failures = 0;
      } else {
        ++at;
        ++failures;
      }
      if (at >= left_.size()) at = 0;
    }
    for (std::size_t i = 2; i < left_.size(); ++i) emit(left_[0], left_[i - 1], left_[i]);
  }

 private:
  [[nodiscard]] std::size_t around(std::size_t at, int step) const {
    return left_[(at + left_.size() + static_cast<std::size_t>(step + 1) - 1) % left_.size()];
  }
  [[nodiscard]] bool is_ear(std::size_t at) const {
    const Point &a = points_[around(at, -1)], &b = points_[around(at, 0)],
                &c = points_[around(at, 1)];
    if (!(turn(a, b, c) > 0)) return false;
    for (const std::size_t i : left_) {
      const Point& p = points_[i];
      if (p == a || p == b || p == c) continue;
      if (turn(a, b, p) >= 0 && turn(b, c, p) >= 0 && turn(c, a, p) >= 0) return false;
    }
    return true;
  }
  void emit(std::size_t a, std::size_t b, std::size_t c) {
    mesh_.faces.push_back({corners_[a], corners_[b], corners_[c]});
  }

  std::span<const std::uint32_t> corners_;
  std::vector<Point> points_;
  IndexedMesh& mesh_;
  std::vector<std::size_t> left_;  // corners not yet cut off
};

}  // namespace

Status append_polygon(std::span<const std::uint32_t> corners, IndexedMesh& mesh) {
  if (corners.size() == 3) mesh.faces.push_back({corners[0], corners[1], corners[2]});
  if (corners.size() <= 3) return Status::ok();
  std::vector<Point> points = flatten(corners, mesh);
  if (is_convex(points)) {
    for (std::size_t i = 2; i < corners.size(); ++i)
      mesh.faces.push_back({corners[0], corners[i - 1], corners[i]});
    return Status::ok();
  }
  if (corners.size() > kMostConcaveCorners)
    return {StatusCode::kUnsupported, "expected concave polygons of at most " +
                                          std::to_string(kMostConcaveCorners) + " corners, found " +
                                          std::to_string(corners.size())};
  EarCutter(corners, std::move(points), mesh).cut_all();
  return Status::ok();
}

}  // namespace nearmesh::meshio
