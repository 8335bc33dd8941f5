// SPDX-License-Identifier: Apache-2.0
#pragma once
// Whether contact points lie where they should: distance of each from both posed meshes, angle of
// each normal to the truth.

#include <algorithm>
#include <cmath>
#include <vector>

#include "case.hpp"
#include "distance.hpp"
#include "tests/peers/peers.hpp"

namespace nearmesh::stability {

using Point = std::array<double, 3>;
using peers::ContactPoint;
using test::operator-;

/// In long doubles, of the mesh as doubles place it.
inline double distance_m(const Point& x, const Body& body) {
  std::vector<test::Vec> placed;
  const auto& m = body.pose.rotation;
  const auto& t = body.pose.translation_m;
  for (const Point& p : body.mesh->positions_m)
    placed.push_back({m[0] * p[0] + m[1] * p[1] + m[2] * p[2] + t[0],
                      m[3] * p[0] + m[4] * p[1] + m[5] * p[2] + t[1],
                      m[6] * p[0] + m[7] * p[1] + m[8] * p[2] + t[2]});
  long double least = 1e300L;
  for (const auto& f : body.mesh->faces)
    least = std::min(least, test::point_triangle({x[0], x[1], x[2]},
                                                 {placed[f[0]], placed[f[1]], placed[f[2]]}));
  return static_cast<double>(least);
}

/// The verdict of a system that found these. Points beyond the first 400 are skipped evenly.
inline Verdict judge_contacts(const Case& asked, const std::vector<ContactPoint>& contacts) {
  Verdict verdict{.kind = contacts.empty() ? Verdict::Kind::kFree : Verdict::Kind::kTouches};
  const std::size_t stride = contacts.size() / 400 + 1;
  for (std::size_t i = 0; i < contacts.size(); i += stride) {
    const ContactPoint& c = contacts[i];
    verdict.position_error_m = std::max(
        {verdict.position_error_m, distance_m(c.at_m, asked.a), distance_m(c.at_m, asked.b)});
    const test::Vec truth{asked.normal[0], asked.normal[1], asked.normal[2]};
    const test::Vec given{c.normal[0], c.normal[1], c.normal[2]};
    const long double size = test::length(given);
    // atan2 is good at small angles, where acos is not. No normal at all counts as the opposite
    // one.
    const test::Vec n = size > 0 ? test::along({}, given, 1 / size) : test::along({}, truth, -1);
    verdict.normal_error_rad =
        std::max(verdict.normal_error_rad,
                 static_cast<double>(2 * std::atan2(test::length(n - truth),
                                                    test::length(test::along(n, truth, 1)))));
  }
  return verdict;
}

}  // namespace nearmesh::stability
