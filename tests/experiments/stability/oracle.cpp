// SPDX-License-Identifier: Apache-2.0
#include "oracle.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/base/random.hpp"
#include "exact_overlap.hpp"

namespace nearmesh::stability {
namespace {

struct PosedTriangle {
  test::ExactTriangle corners;
  std::array<double, 3> lo, hi;  // encloses the corners
  std::uint32_t number = 0;
};

std::vector<PosedTriangle> pose_all(const Body& body) {
  std::array<mpq_class, 9> rotation;
  std::array<mpq_class, 3> translation;
  for (std::size_t i = 0; i < 9; ++i) rotation[i] = body.pose.rotation[i];
  for (std::size_t i = 0; i < 3; ++i) translation[i] = body.pose.translation_m[i];
  std::vector<std::array<mpq_class, 3>> placed;
  for (const auto& p : body.mesh->positions_m) {
    std::array<mpq_class, 3> at = translation;
    for (std::size_t r = 0; r < 3; ++r)
      for (std::size_t c = 0; c < 3; ++c) at[r] += rotation[3 * r + c] * mpq_class(p[c]);
    placed.push_back(at);
  }
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  std::vector<PosedTriangle> triangles;
  for (std::uint32_t f = 0; f < body.mesh->faces.size(); ++f) {
    PosedTriangle t{.number = f};
    for (std::size_t k = 0; k < 3; ++k) t.corners[k] = placed[body.mesh->faces[f][k]];
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const auto [lo, hi] =
          std::minmax({t.corners[0][axis], t.corners[1][axis], t.corners[2][axis]});
      // get_d cuts towards zero, by less than one step.
      t.lo[axis] = std::nextafter(lo.get_d(), -kInfinity);
      t.hi[axis] = std::nextafter(hi.get_d(), kInfinity);
    }
    triangles.push_back(std::move(t));
  }
  return triangles;
}

PairList find_pairs(const Body& a, const Body& b, bool first_only) {
  const std::vector<PosedTriangle> of_a = pose_all(a);
  std::vector<PosedTriangle> of_b = pose_all(b);
  std::sort(of_b.begin(), of_b.end(),
            [](const PosedTriangle& x, const PosedTriangle& y) { return x.lo[0] < y.lo[0]; });
  PairList pairs;
  for (const PosedTriangle& ta : of_a)
    for (const PosedTriangle& tb : of_b) {
      if (tb.lo[0] > ta.hi[0]) break;
      bool apart = false;
      for (std::size_t k = 0; k < 3; ++k)
        apart = apart || tb.lo[k] > ta.hi[k] || ta.lo[k] > tb.hi[k];
      if (apart || !test::exact_overlap(ta.corners, tb.corners)) continue;
      pairs.emplace_back(ta.number, tb.number);
      if (first_only) return pairs;
    }
  std::sort(pairs.begin(), pairs.end());
  return pairs;
}

using ExactPoint = std::array<mpq_class, 3>;

/// Parity of crossings from p to a far point; another direction is taken while the ray meets an
/// edge.
bool is_inside(const ExactPoint& p, const std::vector<PosedTriangle>& surface) {
  double reach = 1;
  for (const PosedTriangle& t : surface)
    for (std::size_t k = 0; k < 3; ++k)
      reach = std::max({reach, std::abs(t.lo[k] - p[k].get_d()), std::abs(t.hi[k] - p[k].get_d())});
  Random random(1);
  while (true) {
    ExactPoint far = p;
    for (mpq_class& x : far) x += mpq_class(random.between(-1, 1) * 8 * reach);
    far[0] += mpq_class(16 * reach);
    bool meets_edge = false, is_odd = false;
    for (const PosedTriangle& t : surface) {
      if (!test::exact_overlap(test::ExactTriangle{p, far, far}, t.corners)) continue;
      for (std::size_t k = 0; k < 3; ++k)
        meets_edge =
            meets_edge || test::exact_overlap(test::ExactTriangle{p, far, far},
                                              {t.corners[k], t.corners[(k + 1) % 3], t.corners[k]});
      is_odd = !is_odd;
    }
    if (!meets_edge) return is_odd;
  }
}

}  // namespace

PairList touching_pairs(const Body& a, const Body& b) { return find_pairs(a, b, false); }

bool touches(const Body& a, const Body& b) { return !find_pairs(a, b, true).empty(); }

bool solids_meet(const Body& a, bool solid_a, const Body& b, bool solid_b) {
  if (touches(a, b)) return true;
  const std::vector<PosedTriangle> of_a = pose_all(a), of_b = pose_all(b);
  return (solid_a && is_inside(of_b.front().corners[0], of_a)) ||
         (solid_b && is_inside(of_a.front().corners[0], of_b));
}

}  // namespace nearmesh::stability
