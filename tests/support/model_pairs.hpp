// SPDX-License-Identifier: Apache-2.0
#pragma once
// Tests that run over pairs of the models of test_models.hpp.

#include <string>
#include <utility>

#include "half_spaces.hpp"
#include "nearmesh/core/geometry/motion.hpp"
#include "rounds.hpp"
#include "test_models.hpp"

namespace nearmesh::test {

using ModelNames = std::pair<const char*, const char*>;
inline std::string name_of_pair(const ::testing::TestParamInfo<ModelNames>& names) {
  return std::string(names.param.first) + "_" + names.param.second;
}
/// Every model of mesh_names(), in pairs that differ in kind.
inline auto model_pairs() {
  return ::testing::Values(ModelNames{"terrain", "aircraft"}, ModelNames{"sphere", "sphere"},
                           ModelNames{"soup", "degenerate"}, ModelNames{"book", "components"},
                           ModelNames{"one_face", "sphere"});
}

class ModelPair : public ::testing::TestWithParam<ModelNames> {
 protected:
  /// What touches grows with the square of the faces, and sanitizers take ten times as long.
  static constexpr std::uint32_t kPart = kSanitized ? 3 : 1;
  BakedModel a_ = bake_named(GetParam().first, kPart), b_ = bake_named(GetParam().second, kPart);

  test::TrueHalfSpaces half_spaces_a_{a_.store}, half_spaces_b_{b_.store};

  /// At poses near each other, on their way.
  [[nodiscard]] std::pair<Motion, Motion> near_motions(Random& random) const {
    const PairOfPoses poses = near_poses(random, a_, radius_m(a_), b_, radius_m(b_));
    std::pair<Motion, Motion> motions{{.pose = poses.a}, {.pose = poses.b}};
    for (Motion* motion : {&motions.first, &motions.second}) {
      for (double& x : motion->linear_velocity_mps) x = random.between(-1, 1);
      for (double& x : motion->angular_velocity_radps) x = random.between(-0.2, 0.2);
    }
    return motions;
  }

  /// Both models, each refined at random, every other pair with half-spaces, and what is left of
  /// the random numbers.
  struct State {
    State(const ModelPair& pair, std::uint64_t seed)
        : random(seed),
          a(pair.a_.store, pair.a_.header.grid),
          b(pair.b_.store, pair.b_.header.grid) {
      refine_at_random(a, random);
      refine_at_random(b, random);
      if (seed % 2 == 0) return;
      Random directions(seed);
      tell_half_spaces(a, pair.half_spaces_a_, directions);
      tell_half_spaces(b, pair.half_spaces_b_, directions);
    }
    Random random;
    LocalModel a, b;
  };
};

}  // namespace nearmesh::test
