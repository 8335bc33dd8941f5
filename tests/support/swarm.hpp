// SPDX-License-Identifier: Apache-2.0
#pragma once
// Many bodies in motion.

#include <vector>

#include "nearmesh/core/geometry/motion.hpp"
#include "test_models.hpp"

namespace nearmesh::test {

/// Aircraft that fly, turn and now and then jump, over a ground and near each other.
class Swarm {
 public:
  Swarm(const BakedModel& ground, std::uint64_t seed, std::size_t count)
      : ground_(ground), random_(seed) {
    for (std::size_t i = 0; i < count; ++i) motions.push_back(anywhere());
  }
  void step(double step_s) {
    for (Motion& motion : motions) {
      motion.pose = pose_at(motion, step_s);
      if (random_.unit() < 0.05) motion.angular_velocity_radps = spin();
      if (random_.unit() < 0.02) motion = anywhere();
    }
  }

  std::vector<Motion> motions;

 private:
  std::array<double, 3> spin() {
    return {random_.between(-2, 2), random_.between(-2, 2), random_.between(-2, 2)};
  }
  Motion anywhere() {
    Motion motion;
    motion.pose.translation_m =
        position_m(ground_.header, ground_.store, {random_.below(ground_.header.vertex_count)});
    motion.pose.translation_m[2] += random_.between(0, 400);
    motion.pose.rotation = random_rotation(random_);
    for (double& v : motion.linear_velocity_mps) v = random_.between(-60, 60);
    motion.angular_velocity_radps = spin();
    return motion;
  }

  const BakedModel& ground_;
  Random random_;
};

}  // namespace nearmesh::test
