// SPDX-License-Identifier: Apache-2.0
#pragma once
// Motions that no door may let in: a good one, with every field spoilt in every way.

#include <gtest/gtest.h>

#include <limits>
#include <string>
#include <vector>

#include "nearmesh/core/geometry/motion.hpp"

namespace nearmesh::test {

inline constexpr double kInfinity = std::numeric_limits<double>::infinity();
inline constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
inline constexpr double kDenormal = std::numeric_limits<double>::denorm_min();

struct BadMotion {
  std::string name;
  Motion motion;
};

/// `good` with every field spoilt in every way.
inline std::vector<BadMotion> bad_motions(const Motion& good) {
  std::vector<BadMotion> bad;
  const auto add = [&](const std::string& name, const auto& spoil) {
    bad.push_back({name, good});
    spoil(bad.back().motion);
  };
  for (const double x : {kNan, kInfinity, -kInfinity, 1e308, -1e308}) {
    const std::string to = " = " + std::to_string(x);
    for (std::size_t i = 0; i < 9; ++i)
      add("rotation" + std::to_string(i) + to, [&](Motion& m) { m.pose.rotation[i] = x; });
    for (std::size_t i = 0; i < 3; ++i) {
      const std::string at = std::to_string(i) + to;
      add("translation" + at, [&](Motion& m) { m.pose.translation_m[i] = x; });
      add("linear velocity" + at, [&](Motion& m) { m.linear_velocity_mps[i] = x; });
      add("angular velocity" + at, [&](Motion& m) { m.angular_velocity_radps[i] = x; });
    }
  }
  for (std::size_t i = 0; i < 9; ++i)  // a rotation has no row or column of almost zeros
    add("denormal row " + std::to_string(i / 3), [&](Motion& m) {
      for (std::size_t k = 0; k < 3; ++k) m.pose.rotation[i / 3 * 3 + k] = kDenormal;
    });
  add("reflection", [](Motion& m) {
    for (std::size_t i = 0; i < 3; ++i) m.pose.rotation[i] = -m.pose.rotation[i];
  });
  add("skewed", [](Motion& m) {
    for (std::size_t i = 0; i < 3; ++i) m.pose.rotation[i] += 1e-3 * m.pose.rotation[3 + i];
  });
  for (const double scale : {1.001, 0.999, 1e-200, 1e200})
    add("scaled by " + std::to_string(scale), [&](Motion& m) {
      for (double& x : m.pose.rotation) x *= scale;
    });
  add("all zero", [](Motion& m) { m.pose.rotation = {}; });
  add("far away", [](Motion& m) { m.pose.translation_m = {7e8, 7e8, 7e8}; });
  return bad;
}

inline void expect_names(const std::string& message, const std::string& what,
                         const std::string& name) {
  EXPECT_NE(message.find(what), std::string::npos) << name << " gave: " << message;
}

}  // namespace nearmesh::test
